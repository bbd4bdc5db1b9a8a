#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>

#include <chrono>
#include <cmath>
#include <ctime>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "Program.h"
#include "RobotFolder.h"

namespace viable::test {
namespace {

using Folder = TemporaryFolder;

const char* const kExperiment = R"(schema: 1
title: one joint
robot: single_joint
duration_s: 2
command: {plugin: waypoints, points: [[0, 1], [1, -1]], repeat_s: 2}
controller: {plugin: joint_pd}
filter: {plugin: tosbp, gamma: 100}
cases:
  A: {}
  B: {filter: {plugin: acceleration_viability}}
)";

TEST(Program, RunWritesLogsAndSummaryAndPrintsATable) {
    Folder folder;
    const std::string out = folder / "run";
    const Outcome o = run({"run", folder.write("e.yaml", kExperiment), "--out", out});
    ASSERT_EQ(o.code, 0) << o.err;
    expectContains(o.out, {"one joint", "from command", "\nA controller joint_pd, filter tosbp: the arm was ",
                           "\nB controller joint_pd, filter acceleration_viability: nominal arm: limits broken",
                           "best first", out});
    std::istringstream lines(o.out);
    for (std::string line; std::getline(lines, line);)
        EXPECT_LE(line.size(), 100 + (line.find(out) == std::string::npos ? 0 : out.size())) << line;
    EXPECT_EQ(o.out.find("\033["), std::string::npos) << "colour is for terminals";
    const Outcome full =
        run({"run", folder.write("e.yaml", kExperiment), "--no-report", "--details", "--out", folder / "b"});
    expectContains(full.out, {"ranking: joint-ticks", "A: filter tosbp", "  jerk          worst use", "acted N times"});
    EXPECT_EQ(countRows(out + "/A.mcap"), 2000);
    const auto summary = nlohmann::json::parse(readFile(out + "/summary.json"));
    EXPECT_EQ(summary["cases"].size(), 2u);
    EXPECT_EQ(summary["cases"][0]["ticks"], 2000);
    EXPECT_LE(summary["cases"][0]["limits"]["jerk"]["joint0"]["worst_use"].get<double>(), 1.0 + 1e-9);
}

TEST(Program, TheLogCarriesTheResolvedExperimentAndRunsAgainFromIt) {
    Folder folder;
    ASSERT_EQ(run({"run", folder.write("e.yaml", kExperiment), "--out", folder / "one", "--case", "A"}).code, 0);
    LogReader first(folder / "one/A.mcap");
    std::string resolved;
    for (const LogAttachment& attachment : first.attachments())
        if (attachment.name == "experiment.yaml") resolved = attachment.data;
    ASSERT_FALSE(resolved.empty());
    ASSERT_EQ(run({"run", folder.write("again.yaml", resolved), "--out", folder / "two"}).code, 0);
    LogReader second(folder / "two/A.mcap");
    TickRecord a, b;
    while (first.read(a)) {
        ASSERT_TRUE(second.read(b));
        ASSERT_EQ(a.nominal.q, b.nominal.q);
        ASSERT_EQ(a.nominal.jerk, b.nominal.jerk);
    }
    ASSERT_FALSE(second.read(b));
}

TEST(Program, CheckReportsEveryCaseWithoutARun) {
    Folder folder;
    expectRun({"check", folder.write("e.yaml", kExperiment)}, 0, {"A: robot single_joint", "B: robot", "ok"});
}

TEST(Program, CheckTellsOfPeopleOnceAndOfEachFilterThatDoesNotKnowThem) {
    const auto check = [](const std::string& cases) {
        const Outcome o = run({"check", "experiments/indy7_people.yaml", "--set", "cases=" + cases});
        EXPECT_EQ(o.code, 0) << o.err;
        return o.out;
    };
    const std::string blind =
        check("{one: {filter: {plugin: certified_braking}}, two: {filter: {plugin: certified_braking}}}");
    expectContains(blind, {"\n  people   ann: at most 1.6 m/s, seen at most 0.05 s late and 0.02 m off",
                           "\n           carl: at most 3 m/s",
                           "\n           are not known to the filter certified_braking\ntwo: robot",
                           "\n  people   are not known to the filter certified_braking\n"});
    EXPECT_EQ(blind.find("ann: "), blind.rfind("ann: ")) << blind;
    const std::string seeing = check("{one: {filter: {plugin: whole_arm_braking}}}");
    expectContains(seeing, {"\n  people   ann: "});
    EXPECT_EQ(seeing.find("not known"), std::string::npos) << seeing;
}

TEST(Program, TheExperimentFileOfItsReadmeRunsAsPrinted) {
    const std::string readme = readFile(VIABLE_SOURCE_DIR "/experiments/README.md");
    const std::size_t section = readme.find("## An experiment file");
    ASSERT_NE(section, std::string::npos);
    const std::size_t begin = readme.find("```yaml\n", section) + 8;
    const std::string yaml = readme.substr(begin, readme.find("```", begin) - begin);
    Folder folder;
    expectRun({"run", folder.write("e.yaml", yaml), "--out", folder / "run", "--set", "duration_s=2"}, 0,
              {"My question", "\ncertified ", "\npaper "});
}

TEST(Program, EveryKeyOfAnExperimentFileStandsInTheReadme) {
    const std::string readme = readFile(VIABLE_SOURCE_DIR "/experiments/README.md");
    const std::string section = readme.substr(readme.find("## An experiment file"));
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment);
    int keys = 0;
    for (const char* wrong : {"zzzzzzzz=1", "start.zzzzzzzz=1", "limits.zzzzzzzz=1"}) {
        const Outcome o = run({"check", file, "--set", wrong});
        ASSERT_EQ(o.code, 2);
        std::size_t at = o.err.find("Known keys: ");
        ASSERT_NE(at, std::string::npos) << o.err;
        while ((at = o.err.find('`', at)) != std::string::npos) {
            const std::size_t end = o.err.find('`', at + 1);
            const std::string key = o.err.substr(at + 1, end - at - 1);
            EXPECT_TRUE(section.find("`" + key + "`") != std::string::npos ||
                        section.find("." + key + "`") != std::string::npos ||
                        section.find("`" + key + ".") != std::string::npos)
                << "experiments/README.md lacks " << key;
            at = end + 1;
            ++keys;
        }
    }
    EXPECT_GT(keys, 20);
}

TEST(Program, BadInputExitsWith2AndOneParagraph) {
    Folder folder;
    const std::string file = folder.write("e.yaml", std::string(kExperiment) + "duraton_s: 3\n");
    expectRun({"run", file, "--out", folder / "run"}, 2, {"viable: ", file + ":11:", "duraton_s", "duration_s"});
    EXPECT_FALSE(std::filesystem::exists(folder / "run"));  // nothing half-made
    EXPECT_EQ(run({"run"}).code, 2);
    EXPECT_EQ(run({"rum"}).code, 2);
    EXPECT_EQ(run({"run", "nowhere.yaml"}).code, 2);
    expectContains(run({"run"}).err, {"run: FILE is required", "`viable run --help`"});
    expectContains(run({"run", file, "--cse", "A", "--jbos=2"}).err,
                   {"no option `--cse`, did you mean `--case`?", "no option `--jbos`, did you mean `--jobs`?"});
    expectContains(run({"run", file, "A"}).err, {"run: `A` is more than it takes"});
    expectRun({"check", folder.write("g.yaml", kExperiment), "--set", "cases.A.start={position_rad: 9}", "--set",
               "cases.B.start={position_rad: -9}"},
              2, {"2 things are wrong", "1. ", "2. "});
    expectRun({"run", folder.write("f.yaml", kExperiment), "--case", "a"}, 2, {"no case", "A, B"});
}

TEST(Program, ADeletedCurrentFolderIsToldWithTheRemedy) {
    Folder folder;
    const std::string gone = folder / "gone";
    for (const std::vector<std::string>& arguments :
         {std::vector<std::string>{"new", "filter", "mine"}, {"run", "e.yaml"}, {"check", "e.yaml"}}) {
        const Outcome o = run(arguments, [gone] {
            std::filesystem::create_directory(gone);
            if (chdir(gone.c_str()) != 0 || rmdir(gone.c_str()) != 0) _exit(98);
        });
        EXPECT_EQ(o.code, 2) << o.err;
        EXPECT_EQ(o.out, "");
        expectContains(o.err, {"current folder"});
        EXPECT_EQ(o.err.find("filesystem error"), std::string::npos) << o.err;
    }
}

TEST(Program, TooLittleMemoryIsToldWithTheRemedy) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "a sanitizer takes terabytes of addresses";
#endif
    Folder folder;
    std::string text = "time_s,a_rad\n";
    for (int i = 0; i < 400000; ++i) text += std::to_string(1e-3 * i) + "," + std::to_string(std::sin(5e-3 * i)) + "\n";
    const Outcome o = run({"verify", folder.write("large.csv", text)}, [] {
        constexpr rlim_t kMost_B = 192 << 20;
        const rlimit limit{kMost_B, kMost_B};
        setrlimit(RLIMIT_AS, &limit);
    });
    EXPECT_EQ(o.code, 71);
    EXPECT_EQ(o.out, "");
    EXPECT_EQ(o.err,
              "viable: out of memory. Close other programs, raise the limit (`ulimit -v`), or give it less at a time: "
              "fewer --jobs, a shorter run, a part of the record.\n");
}

TEST(Program, APayloadBeyondAllArmsIsBadInputWithItsPlace) {
    Folder folder;
    for (const char* key : {"real_plant.payload_kg", "disturbance_set.payload_kg"})
        for (const char* mass : {"1e16", "1001"}) {
            const Outcome o =
                expectRun({"check", "experiments/indy7_real_limits.yaml", "--set", std::string(key) + "=" + mass}, 2,
                          {key, "1000"});
            EXPECT_EQ(o.err.find("SimTK"), std::string::npos) << o.err;
        }
    expectRun({"check", "experiments/indy7_teleoperation.yaml", "--set", "real_plant.payload_kg=1000"}, 0);
}

TEST(Program, HelpAndVersionExitWith0) {
    EXPECT_EQ(run({"--help"}).code, 0);
    EXPECT_EQ(run({"run", "--help"}).code, 0);
    expectRun({"--version"}, 0, {"viable "});
}

TEST(Program, PluginsAndRobotsAreListedAndDescribed) {
    const Outcome list = run({"plugins"}, [] { unsetenv("VIABLE_PLUGIN_PATH"); });
    EXPECT_EQ(list.code, 0);
    expectContains(list.out, {"tosbp", "nric", "simbody", "generated_hand_motion", "joint_pd"});
    EXPECT_EQ(list.err, "");
    const Outcome one = run({"plugins", "--describe", "tosbp"}, [] { unsetenv("VIABLE_PLUGIN_PATH"); });
    EXPECT_EQ(one.code, 0);
    expectContains(one.out, {"k_alpha", "gamma", "1/s"});
    const Outcome miss = run({"plugins", "--describe", "tosbq"}, [] { unsetenv("VIABLE_PLUGIN_PATH"); });
    EXPECT_EQ(miss.code, 2);
    expectContains(miss.err, {"tosbq", "Did you mean 'tosbp'"});
    const Outcome json = run({"plugins", "--json"});  // with the broken ones in the path
    EXPECT_EQ(json.code, 0);
    const auto root = nlohmann::json::parse(json.out);
    EXPECT_GT(root["plugins"].size(), 18u);
    EXPECT_GT(root["refused"].size(), 10u);
    const auto described = nlohmann::json::parse(run({"plugins", "--describe", "certified_braking", "--json"}).out);
    ASSERT_EQ(described["plugins"].size(), 1u);
    EXPECT_EQ(described["plugins"][0]["guarantees_limits"], true);
    EXPECT_EQ(run({"plugins", "--markdown"}).code, 2);  // of one plugin only
    EXPECT_EQ(run({"plugins", "--describe", "tosbp", "--markdown", "--json"}).code, 2);
    expectRun({"robots"}, 0, {"indy7", "single_joint"});
    expectContains(run({"robots", "--describe", "indy7"}).out, {"joint5", "79.79"});
    expectRun(
        {"gains", "panda", "--tick", "0.002", "--delay", "1"}, 0,
        {"panda at a tick of 0.002 s and a delay of 1 ticks", "joint7", "Margins: ", "No rotor inertias are given"});
    RobotFolder mixed, lift;
    makeSlantedArm(mixed);
    mixed.write();
    const std::string units = run({"robots", "--describe", mixed.path()}).out;
    expectContains(units, {"position               velocity ", " in\n", " rad, s, Nm\n", " m, s, N\n"});
    EXPECT_EQ(units.find("[rad"), std::string::npos) << units;
    expectContains(run({"gains", mixed.path()}).out, {"  in\n", "  Ns/m, kg\n", "  Nms/rad, kg m^2\n"});
    lift.urdf = "<robot name='arm'><link name='base'/>" +
                makeJoint("lift", "prismatic", "base", "fork", "xyz='0 0 0.1' rpy='0 0 0'", "0 0 1") +
                makeLink("fork", 2.0, "0 0 0", "0 0 0", kSomeInertia) + "</robot>";
    lift.limits = kSomeLimits;
    lift.write();
    expectContains(run({"robots", "--describe", lift.path()}).out,
                   {"position [m]", "velocity [m/s]", "accel. [m/s^2]", "jerk [m/s^3]", "motor [N]"});
    expectContains(run({"gains", lift.path()}).out, {"K_r [Ns/m]", "mass [kg]"});
    expectRun({"gains", "panda", "--tick", "1"}, 2, {"--tick: 1 s is outside [1e-05, 0.1]"});
}

TEST(Program, ExportWritesCsvAndRefusesToOverwrite) {
    Folder folder;
    ASSERT_EQ(run({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A"}).code, 0);
    const std::string csv = folder / "a.csv";
    ASSERT_EQ(run({"export", folder / "run/A.mcap", "--to", "csv", csv}).code, 0);
    const std::string text = readFile(csv);
    EXPECT_EQ(text.rfind("time_s,", 0), 0u);
    expectContains(text.substr(0, text.find('\n')),
                   {"nominal.joint0.q_rad", "nominal.joint0.jerk_radps3", "filter.joint0.active", "tick.status"});
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 2001);
    EXPECT_EQ(run({"export", folder / "run/A.mcap", "--to", "csv", csv}).code, 2);
    EXPECT_EQ(run({"export", folder / "run/A.mcap", "--to", "xls", folder / "b"}).code, 2);
    EXPECT_EQ(run({"export", folder / "run/summary.json", "--to", "csv", folder / "b"}).code, 2);
}

TEST(Program, ABrokenGuaranteeExitsWith3AndSaysWhatBroke) {
    Folder folder;
    expectRun({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A", "--set",
               "filter.plugin=liar"},
              3, {"case A", "'liar'", "guarantees all limits", "jerk"});
    expectContains(readFile(folder / "run/summary.json"), {"\"exit_code\": 3"});
}

TEST(Fault13, CheckRefusesAStartWithoutAStopInsideTheLimits) {
    Folder folder;
    expectRun({"check", folder.write("e.yaml", kExperiment), "--set", "start={position_rad: [3], velocity_radps: [2]}"},
              2, {"--set start", "joint0 is not viable", "upper position limit by"});
}

TEST(Fault25, MissedTicksAreRunAndCountedInTheSummary) {
    Folder folder;
    expectRun({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A", "--details", "--set",
               "missed_ticks=[{at_s: 0.5, count: 20}]"},
              0, {"missed ticks 20", "least margin"});
    expectContains(readFile(folder / "run/summary.json"),
                   {"\"missed_ticks\": 20", "\"unviable_ticks\": ", "\"recovering_ticks\": 0",
                    "\"least_margin\": ", "\"tau_removed_max_Nm\": ", "\"episodes\": "});
}

TEST(Fault44, APluginThatThrowsInTheRunExitsWith4AndKeepsTheLog) {
    Folder folder;
    expectRun({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A", "--set",
               "filter.plugin=throwing_tick", "--set", "filter.after_ticks=500"},
              4, {"case A", "stopped at 0.5000 s (tick 500)", "'throwing_tick'", "it threw"});
    EXPECT_GT(countRows(folder / "run/A.mcap"), 500);
}

TEST(Fault72, AFullDiskEndsTheLogNotTheRun) {
    Folder folder;
    const auto limitFiles = [] {
        signal(SIGXFSZ, SIG_IGN);
        const rlimit limit{60000, 60000};
        setrlimit(RLIMIT_FSIZE, &limit);
    };
    const Outcome o = expectOutcome(
        run({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A", "--details"},
            limitFiles),
        5, {"case A", "log could not be written"});
    expectContains(o.out, {"LOG LOST", "2.000 s simulated"});
    EXPECT_GT(countRows(folder / "run/A.mcap"), 0);  // what was written is readable
}

TEST(Fault72, AnUnwritableFolderIsRefusedBeforeTheRun) {
    Folder folder;
    folder.write("file", "");
    expectRun({"run", folder.write("e.yaml", kExperiment), "--out", folder / "file/run"}, 5,
              {"cannot create the folder"});
}

TEST(Fault74, ASecondRunIntoTheSameFolderIsRefused) {
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment);
    ASSERT_EQ(run({"run", file, "--out", folder / "run"}).code, 0);
    const std::string before = readFile(folder / "run/A.mcap");
    expectRun({"run", file, "--out", folder / "run"}, 2, {"already holds something", "never overwrites"});
    EXPECT_EQ(readFile(folder / "run/A.mcap"), before);
}

// Of different cases, so that no log's name tells the runs apart: only the folder does.
TEST(Fault74, OfTwoRunsAtOnceIntoOneFolderOneGetsIt) {
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment);
    constexpr int kTries = 20;
    for (int i = 0; i < kTries; ++i) {
        const std::string out = folder / ("run" + std::to_string(i));
        const auto start = [&](const std::string& name) {
            return Program({"run", file, "--out", out, "--no-report", "--case", name, "--set", "duration_s=0.05"});
        };
        Program a = start("A"), b = start("B");
        const Outcome ofA = a.wait(), ofB = b.wait();
        ASSERT_EQ(ofA.code + ofB.code, 2) << ofA.err << ofB.err;
        const std::string winner = ofA.code == 0 ? "A" : "B";
        expectContains(ofA.code == 0 ? ofB.err : ofA.err, {"--out " + out, "Name a"});
        const auto summary = nlohmann::json::parse(readFile(out + "/summary.json"));
        ASSERT_EQ(summary["cases"].size(), 1u);
        EXPECT_EQ(summary["cases"][0]["name"], winner);
        EXPECT_EQ(countRows(out + "/" + winner + ".mcap"), 50);
        EXPECT_EQ(std::distance(std::filesystem::directory_iterator(out), {}), 2);  // log and summary, no more
    }
}

TEST(Fault74, OfTwoWritersIntoOneFolderOrFileOneIsRefused) {
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment), sweep = folder / "sweep", log = folder / "run/A.mcap";
    std::filesystem::create_directory(sweep);
    const int held = ::open(sweep.c_str(), O_RDONLY | O_DIRECTORY);  // as a sweep that has just begun holds it
    ASSERT_EQ(::flock(held, LOCK_EX), 0);
    expectRun({"run", file, "--out", sweep, "--no-report", "--case", "A"}, 2,
              {"another run or sweep writes into this folder"});
    EXPECT_TRUE(std::filesystem::is_empty(sweep));
    ::close(held);
    ASSERT_EQ(run({"run", file, "--out", folder / "run", "--no-report", "--case", "A"}).code, 0);
    for (int i = 0; i < 5; ++i) {
        const std::string out = folder / ("verdict" + std::to_string(i)), csv = folder / ("c" + std::to_string(i));
        Program a({"verify", log, "--signal", "nominal", "--json", out}),
            b({"verify", log, "--signal", "nominal", "--json", out});
        Program c({"export", log, "--to", "csv", csv}), d({"export", log, "--to", "csv", csv});
        Program e({"report", folder / "run"}), f({"report", folder / "run"});
        EXPECT_EQ((a.wait().code == 2) + (b.wait().code == 2), 1);
        EXPECT_EQ(c.wait().code + d.wait().code, 2);
        EXPECT_EQ(e.wait().code + f.wait().code, 0);
        EXPECT_TRUE(nlohmann::json::accept(readFile(out)));
        EXPECT_CONTAINS(readFile(folder / "run/report.html"), "</html>");
    }
}

TEST(Program, LongWorkTellsHowFarItIs) {
    const Outcome o = run({"check", "experiments/indy7_real_limits.yaml", "--set", "command.seed=~choice(1, 2)"},
                          [] { setenv("VIABLE_MESSAGES", "json", 1); });
    EXPECT_EQ(o.code, 0) << o.err;
    expectContains(o.err, {"{\"progress\":{\"trying draws\":0."});
    const Outcome doctor = run({"doctor", "--measure", "2"}, [] { setenv("VIABLE_MESSAGES", "json", 1); });
    expectContains(doctor.err, {"{\"progress\":{\"measuring\":0.5}}", "{\"progress\":{\"measuring\":1.0}}"});
}

TEST(Program, AllComplaintsComeAtOnceAndTheirRemediesFit) {
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment);
    expectContains(run({"run", file, "--case", "x", "--case", "y"}).err, {"--case x", "--case y"});
    expectContains(run({"check", file, "--set", "tick_s=-1", "--set", "limits.jerk_radps3=-4"}).err,
                   {"tick_s", "jerk"});
    expectContains(run({"check", file, "--set", "robot=./nowhere"}).err, {"`./nowhere` in " VIABLE_SOURCE_DIR ","});
    expectContains(run({"check", file, "--set", "filter.plugin=/usr/lib/none.so"}).err, {"Check the path"});
    expectContains(run({"check", file, "--set", "command={plugin: waypoints, points: [1, 2]}"}).err,
                   {"such as `[1, 2"});
    const Outcome none =
        run({"check", file, "--set", "robust_loop={plugin: none}", "--set", "real_plant={plugin: simbody}"});
    EXPECT_EQ(none.code, 0) << none.err;
    EXPECT_EQ(none.out.find("the robust loop adds"), std::string::npos) << none.out;
}

TEST(Fault74, AFolderThatAKilledRunHasClaimedIsRefusedWithTheRemedy) {
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment);
    std::filesystem::create_directory(folder / "run");
    const std::string claim = folder.write("run/run.claim", "");
    const std::vector<std::string> arguments{"run", file, "--out", folder / "run", "--no-report", "--case", "A"};
    expectRun(arguments, 2, {"another run has this folder", "if that run was killed, delete " + claim});
    std::filesystem::remove(claim);
    EXPECT_EQ(run(arguments).code, 0);
}

// The names that the clock gives in the next half minute are taken before.
TEST(Fault74, RunsOfOneSecondGetFoldersOfTheirOwn) {
    Folder folder;
    const std::string file = folder.write("e.yaml", kExperiment);
    std::filesystem::create_directory(folder / "runs");
    const std::time_t now = std::time(nullptr);
    std::set<std::string> taken;
    for (int s = 0; s < 30; ++s) {
        char name[32];
        const std::time_t then = now + s;
        std::strftime(name, sizeof name, "e-%Y%m%d-%H%M%S", std::localtime(&then));
        taken.insert(name);
        std::filesystem::create_directory(folder / "runs" / name);
    }
    const auto start = [&] {
        return Program({"run", file, "--no-report", "--set", "duration_s=0.05"}, [&] {
            if (chdir(folder.path().c_str()) != 0) _exit(98);
            setenv("VIABLE_ROBOT_PATH", VIABLE_SOURCE_DIR "/robots", 1);
        });
    };
    Program a = start(), b = start(), c = start();
    for (Program* program : {&a, &b, &c}) EXPECT_EQ(program->wait().code, 0);
    int runs = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder / "runs")) {
        const std::string name = entry.path().filename();
        if (taken.count(name) > 0) {
            EXPECT_TRUE(std::filesystem::is_empty(entry.path())) << "not its own: " << name;
            continue;
        }
        ++runs;
        EXPECT_EQ(taken.count(name.substr(0, name.size() - 2)), 1u) << name;  // "-2", "-3" or "-4" is added
        EXPECT_TRUE(std::filesystem::exists(entry.path() / "summary.json"));
    }
    EXPECT_EQ(runs, 3);
}

/** Starts a long run, waits for its log to grow, and sends `signals` in turn. */
Outcome runAndSignal(const Folder& folder, const std::vector<int>& signals, double& seconds) {
    Program program({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A", "--set",
                     "duration_s=80000"});
    while (!std::filesystem::exists(folder / "run/A.mcap") || std::filesystem::file_size(folder / "run/A.mcap") < 50000)
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    const auto begin = std::chrono::steady_clock::now();
    for (int s : signals) kill(program.pid(), s);
    const Outcome o = program.wait();
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return o;
}

TEST(Fault75, ASignalBrakesTheArmAndFinishesTheLog) {
    for (int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) {
        Folder folder;
        double seconds = 0.0;
        const Outcome o = runAndSignal(folder, {signal}, seconds);
        EXPECT_EQ(o.code, 128 + signal);
        EXPECT_LT(seconds, kSanitized ? 20.0 : 2.0);  // the run itself takes hours
        expectContains(o.err, {"ended early by signal", "braked"});
        LogReader reader(folder / "run/A.mcap");
        EXPECT_TRUE(reader.isComplete());
        TickRecord record, last;
        while (reader.read(record)) last = record;
        EXPECT_TRUE(last.braking);
        EXPECT_NEAR(last.nominal.qd[0], 0.0, 0.01);  // the last row is one tick before rest
        EXPECT_TRUE(std::filesystem::exists(folder / "run/summary.json"));
    }
}

// nohup starts a program so that it ignores SIGHUP; the terminal then sends one when it is closed.
TEST(Fault75, ARunUnderNohupOutlivesItsTerminal) {
    Folder folder;
    Program program({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A", "--set",
                     "duration_s=80000"},
                    [] { signal(SIGHUP, SIG_IGN); });
    const auto awaitLog = [&](std::uintmax_t size) {
        std::error_code absent;
        for (std::uintmax_t is = 0; is < size || is == static_cast<std::uintmax_t>(-1);
             is = std::filesystem::file_size(folder / "run/A.mcap", absent))
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        return std::filesystem::file_size(folder / "run/A.mcap");
    };
    const std::uintmax_t size = awaitLog(50000);
    for (int i = 0; i < 3; ++i) kill(program.pid(), SIGHUP);
    awaitLog(2 * size);
    kill(program.pid(), SIGTERM);
    expectOutcome(program.wait(), 128 + SIGTERM, {"ended early by signal 15"});
}

// A plugin that never returns keeps the arm from braking: only the second signal ends such a run.
TEST(Fault75, ASecondSignalForcesTheEnd) {
    for (const int second : {SIGINT, SIGTERM, SIGPIPE}) {
        Folder folder;
        Program program({"run", folder.write("e.yaml", kExperiment), "--out", folder / "run", "--case", "A",
                         "--no-report", "--set", "duration_s=80000", "--set",
                         "filter={plugin: hangs, after_ticks: 5000}"});
        std::uintmax_t size = 0;
        for (std::uintmax_t seen = 1; size == 0 || size != seen;) {  // it hangs when its log stands still
            seen = size;
            std::this_thread::sleep_for(std::chrono::milliseconds(300));
            std::error_code absent;
            size = std::filesystem::file_size(folder / "run/A.mcap", absent);
            if (absent) size = 0;
            ASSERT_EQ(waitpid(program.pid(), nullptr, WNOHANG), 0);
        }
        kill(program.pid(), SIGINT);
        std::this_thread::sleep_for(std::chrono::milliseconds(100));  // of two at once the system may deliver one
        EXPECT_EQ(waitpid(program.pid(), nullptr, WNOHANG), 0) << "the first one is to be waited out";
        const auto begin = std::chrono::steady_clock::now();
        kill(program.pid(), second);
        const Outcome o = program.wait();
        EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
        EXPECT_EQ(o.code, 128 + second);
    }
}

TEST(Fault75, AClosedPipeDoesNotKillTheRun) {
    Folder folder;
    const std::string command = std::string(VIABLE_PROGRAM) + " run " + folder.write("e.yaml", kExperiment) +
                                " --out " + (folder / "run").string() + " | true";
    setenv("VIABLE_ROBOT_PATH", VIABLE_SOURCE_DIR "/robots", 1);
    ASSERT_EQ(std::system(command.c_str()), 0);
    EXPECT_EQ(countRows(folder / "run/A.mcap"), 2000);
    EXPECT_TRUE(std::filesystem::exists(folder / "run/summary.json"));
}

}  // namespace
}  // namespace viable::test
