// `viable sweep` from outside: the same table however it is run, and nothing lost whatever dies (faults 76 and 77).
#include <signal.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "Program.h"
#include "sweep/SweepStore.h"

namespace viable::test {
namespace {

namespace fs = std::filesystem;
using Folder = TemporaryFolder;

const char* const kSweptExperiment = R"(schema: 1
title: a sweep
robot: single_joint
duration_s: 0.1
command: {plugin: random_steps, seed: '~integer(0, 1000000)', shortest_s: 0.02, longest_s: 0.05}
controller: {plugin: joint_pd, stiffness: '~uniform(2, 8)'}
robust_loop: {plugin: none}
real_plant: {plugin: simbody, friction: none, payload_kg: '~uniform(0, 2)', mass_factor: ['~normal(1, 0.1, 0.7, 1.3)']}
cases:
  A: {filter: {plugin: tosbp, k_alpha: '~log_uniform(1, 10)'}}
  B: {filter: {plugin: certified_braking}}
)";

/** One of its cases fails in every way that there is. */
const char* const kMisbehaving = R"(schema: 1
title: some misbehave
robot: single_joint
duration_s: 0.1
command: {plugin: random_steps, seed: '~integer(0, 1000000)'}
controller: {plugin: joint_pd}
cases:
  good: {filter: {plugin: tosbp, k_alpha: 5}}
  bad:
    filter:
      plugin: misbehaves
      after_ticks: 10
      how: ~choice(not, not, not, segfaults, exits, is_killed, hangs, refuses)
)";

struct Sweep : ::testing::Test {
    void SetUp() override {
#ifdef __SANITIZE_THREAD__
        GTEST_SKIP() << "oneTBB is not built with the sanitizer: it would be blamed";
#endif
    }

    std::vector<std::string> arguments(const fs::path& out, std::vector<std::string> more = {}) {
        std::vector<std::string> all{"sweep", file_, "--out", out};
        all.insert(all.end(), more.begin(), more.end());
        return all;
    }
    /** A sweep that must go well; returns its table. */
    std::string sweep(const std::string& out, std::vector<std::string> more) {
        expectOutcome(run(arguments(folder_ / out, std::move(more))), 0);
        return readFile(folder_ / (out + "/sweep.csv"));
    }
    SweepStore open(const std::string& out) const {
        return SweepStore(folder_ / out);
    }
    std::int64_t countRuns(const std::string& out) const {
        if (!fs::exists(folder_ / (out + "/sweep.sqlite"))) return 0;
        try {
            return static_cast<std::int64_t>(open(out).findRuns().size());
        } catch (const std::exception&) {
            return 0;  // just being made
        }
    }
    /** False: it did not come to that. */
    bool waitFor(const std::function<bool()>& condition) const {
        for (int i = 0; i < 6000; ++i) {
            if (condition()) return true;
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        }
        return false;
    }

    Folder folder_;
    std::string file_ = folder_.write("e.yaml", kSweptExperiment);
};

std::vector<pid_t> findChildren(pid_t pid) {
    std::ifstream stream("/proc/" + std::to_string(pid) + "/task/" + std::to_string(pid) + "/children");
    std::vector<pid_t> children;
    for (pid_t child; stream >> child;) children.push_back(child);
    return children;
}

std::string get(const SweepStore& store, const SweepRow& row, const std::string& column) {
    const std::vector<SweepColumn>& columns = store.plan().columns;
    for (std::size_t i = 0; i < columns.size(); ++i) {
        if (columns[i].name != column) continue;
        if (const auto* text = std::get_if<std::string>(&row.values[i])) return *text;
        if (const auto* whole = std::get_if<std::int64_t>(&row.values[i])) return std::to_string(*whole);
        return "";
    }
    ADD_FAILURE() << "no column " << column;
    return {};
}

double getNumber(const SweepStore& store, const SweepRow& row, const std::string& column) {
    for (std::size_t i = 0; i < row.values.size(); ++i)
        if (store.plan().columns[i].name == column)
            if (const auto* number = std::get_if<double>(&row.values[i])) return *number;
    ADD_FAILURE() << "no number in " << column;
    return 0.0;
}

using Fault77_Sweep = Sweep;

TEST_F(Fault77_Sweep, IsTheSameToTheLastBitHoweverItIsRun) {
    const std::string one = sweep("one", {"--runs", "24", "--jobs", "1"});
    EXPECT_EQ(std::count(one.begin(), one.end(), '\n'), 1 + 24 * 2);
    EXPECT_EQ(sweep("two", {"--runs", "24", "--jobs", "2"}), one);
    EXPECT_EQ(sweep("eight", {"--runs", "24", "--jobs", "8"}), one);
    EXPECT_NE(sweep("other", {"--runs", "24", "--seed", "2"}), one);

    // In shards, and the first half before the whole.
    std::vector<std::string> merge{"sweep", "--out", folder_ / "whole", "--merge"};
    for (const char* i : {"0", "1", "2"}) {
        const std::string out = std::string("shard") + i;
        sweep(out, {"--runs", "24", "--shard", std::string(i) + "/3"});
        merge.push_back(folder_ / out);
    }
    expectOutcome(run(merge), 0);
    EXPECT_EQ(readFile(folder_ / "whole/sweep.csv"), one);
    sweep("more", {"--runs", "12"});
    EXPECT_EQ(sweep("more", {"--runs", "24"}), one);
}

TEST_F(Fault77_Sweep, IsTheSameInRanksOfMpi) {
    if (!fs::exists(fs::path(VIABLE_PROGRAM).parent_path() / "viable_mpi.so") ||
        std::system("command -v mpirun >/dev/null") != 0)
        GTEST_SKIP() << "built without Open MPI";
    const std::string one = sweep("one", {"--runs", "24", "--jobs", "1"});
    const std::string command = "cd '" VIABLE_SOURCE_DIR
                                "' && timeout 60 mpirun --allow-run-as-root --oversubscribe "
                                "--mca btl self,vader -n 3 '" VIABLE_PROGRAM "' sweep '" +
                                file_ + "' --runs 24 --out '" + (folder_ / "mpi").string() + "' >'" +
                                (folder_ / "mpi.out").string() + "' 2>&1";
    EXPECT_EQ(std::system(command.c_str()), 0) << readFile(folder_ / "mpi.out");
    EXPECT_EQ(readFile(folder_ / "mpi/sweep.csv"), one);
}

TEST_F(Fault77_Sweep, ARunAloneIsTheRunOfTheSweep) {
    sweep("s", {"--runs", "5", "--set", "controller.damping=4"});
    const SweepStore store = open("s");
    store.forEach([&](const SweepRow& row) {
        if (row.run != 4) return;
        EXPECT_EQ(get(store, row, "replay"),
                  "viable run " + file_ + " --draw 1:4 --case " + row.caseName + " --set controller.damping=4");
        const std::string out = folder_ / ("r" + row.caseName);
        std::string command = get(store, row, "replay");
        command.replace(0, 6, VIABLE_PROGRAM);
        ASSERT_EQ(
            std::system(
                ("cd " VIABLE_SOURCE_DIR " && " + command + " --no-report --out " + out + " >/dev/null 2>&1").c_str()),
            0)
            << command;
        const auto summary = nlohmann::json::parse(readFile(out + "/summary.json"));
        const auto& own = summary["cases"][0];
        EXPECT_EQ(getNumber(store, row, "tracking.max_rad"), own.at("tracking").at("max_rad")) << own.dump(1);
    });
}

using Fault76_Sweep = Sweep;

// Whoever is killed: the process of the runs, again and again; the one that watches; and the user has had enough.
TEST_F(Fault76_Sweep, KilledInTheMiddleLosesNoRun) {
    const std::vector<std::string> more{"--runs", "60", "--jobs", "2"};
    const std::string whole = sweep("whole", more);

    Program program(arguments(folder_ / "child", more));
    std::int64_t seen = 0;
    for (int kill = 0; kill < 3; ++kill) {
        ASSERT_TRUE(waitFor([&] { return countRuns("child") > seen; }));
        seen = countRuns("child") + 10;
        for (const pid_t child : findChildren(program.pid())) ::kill(child, SIGKILL);
    }
    expectOutcome(program.wait(), 0);
    EXPECT_EQ(readFile(folder_ / "child/sweep.csv"), whole);

    for (const int signal : {SIGKILL, SIGINT}) {
        const std::string out = "signal" + std::to_string(signal);
        Program first(arguments(folder_ / out, more));
        ASSERT_TRUE(waitFor([&] { return countRuns(out) >= 5; }));
        const std::vector<pid_t> children = findChildren(first.pid());
        EXPECT_EQ(children.size(), 1u);
        ::kill(first.pid(), signal);
        const Outcome ended = first.wait();
        EXPECT_EQ(ended.code, signal == SIGKILL ? -SIGKILL : 128 + SIGINT) << ended.err;
        for (const pid_t child : children)
            EXPECT_TRUE(waitFor([&] { return ::kill(child, 0) != 0; })) << "the child lives on";
        if (signal == SIGINT)
            EXPECT_NE(ended.err.find("The same command continues from there"), std::string::npos) << ended.err;
        std::map<std::string, double> walls_s;
        const auto name = [](const SweepRow& row) { return std::to_string(row.run) + row.caseName; };
        {
            const SweepStore store = open(out);
            store.forEach([&](const SweepRow& row) { walls_s[name(row)] = getNumber(store, row, "wall_s"); });
        }
        EXPECT_GE(walls_s.size(), 10u);
        EXPECT_LT(walls_s.size(), 120u) << "killed too late to show anything";
        EXPECT_EQ(sweep(out, more), whole);
        const SweepStore store = open(out);
        store.forEach([&](const SweepRow& row) {
            const auto before = walls_s.find(name(row));
            if (before != walls_s.end()) EXPECT_EQ(getNumber(store, row, "wall_s"), before->second) << "done again";
        });
    }
}

TEST_F(Fault76_Sweep, APluginThatFailsCostsItsOwnRunOnlyAndIsReplayed) {
    if (kSanitized) GTEST_SKIP() << "sanitizers answer crashes themselves";
    file_ = folder_.write("bad.yaml", kMisbehaving);
    const std::vector<std::string> more{"--runs", "24", "--timeout", "0.5", "--jobs"};
    std::vector<std::string> tables;
    Outcome o;
    for (const char* jobs : {"1", "4"}) {
        std::vector<std::string> all = more;
        all.push_back(jobs);
        o = run(arguments(folder_ / jobs, all));
        EXPECT_EQ(o.code, 4) << o.out << o.err;
        tables.push_back(readFile(folder_ / (std::string(jobs) + "/sweep.csv")));
    }
    EXPECT_EQ(tables[0], tables[1]);
    EXPECT_EQ(tables[0].find(VIABLE_BINARY_DIR), std::string::npos) << tables[0];
    EXPECT_NE(o.out.find("good: 24 ok"), std::string::npos) << o.out;

    const std::map<std::string, std::pair<std::string, std::string>> expected = {
        {"not", {"ok", ""}},
        {"segfaults", {"crashed", "crashed in tick 10: signal 11 (Segmentation fault)"}},
        {"exits", {"crashed", "called exit() in tick 10"}},
        {"is_killed", {"crashed", "was killed (signal 9)"}},
        {"hangs", {"timed_out", "--timeout"}},
        {"refuses", {"failed", "it does not want to"}},
    };
    std::set<std::string> seen;
    std::string replay;
    const SweepStore store = open("4");
    store.forEach([&](const SweepRow& row) {
        if (row.caseName != "bad") return;
        const std::string how = get(store, row, "draw.cases.bad.filter.how");
        seen.insert(how);
        const auto& [status, message] = expected.at(how);
        EXPECT_EQ(get(store, row, "status"), status) << how << ", run " << row.run;
        EXPECT_NE(get(store, row, "message").find(message), std::string::npos) << get(store, row, "message");
        if (how == "segfaults" && replay.empty()) replay = get(store, row, "replay");
    });
    EXPECT_EQ(seen.size(), expected.size()) << "the seed draws not every way to fail";
    EXPECT_NE(o.out.find(replay), std::string::npos) << o.out;
    replay.replace(0, 6, "VIABLE_PLUGIN_PATH=" VIABLE_BINARY_DIR "/tests/broken_plugins " VIABLE_PROGRAM);
    const int code = std::system(("cd " VIABLE_SOURCE_DIR " && " + replay + " --no-report --out " +
                                  (folder_ / "again").string() + " >/dev/null 2>" + (folder_ / "again.err").string())
                                     .c_str());
    EXPECT_EQ(WEXITSTATUS(code), 4);
    EXPECT_NE(readFile(folder_ / "again.err").find("crashed in tick 10: signal 11"), std::string::npos)
        << readFile(folder_ / "again.err");
}

// Runs beside it in the same process get none either: they are no less good for it.
TEST_F(Fault76_Sweep, ARunThatTakesAllMemoryCostsNoOther) {
    if (kSanitized) GTEST_SKIP() << "sanitizers take memory of their own";
    file_ = folder_.write("bad.yaml", kMisbehaving);
    const Outcome o = run(arguments(folder_ / "s", {"--runs", "8", "--jobs", "4", "--set",
                                                    "cases.bad.filter.how=~choice(not, not, eats_memory)"}),
                          [] {
                              const rlimit limit{rlim_t(4) << 30, RLIM_INFINITY};
                              setrlimit(RLIMIT_AS, &limit);
                          });
    EXPECT_EQ(o.code, 4) << o.out << o.err;
    EXPECT_NE(o.out.find("good: 8 ok"), std::string::npos) << o.out;
    int eaten = 0, rows = 0;
    const SweepStore store = open("s");
    store.forEach([&](const SweepRow& row) {
        ++rows;
        if (row.caseName != "bad" || get(store, row, "draw.cases.bad.filter.how") == "not") {
            EXPECT_EQ(get(store, row, "status"), "ok") << get(store, row, "message");
            return;
        }
        ++eaten;
        EXPECT_EQ(get(store, row, "status"), "crashed");
        EXPECT_EQ(get(store, row, "message"),
                  "the filter plugin 'misbehaves' asked for memory and there was none left, in tick 10");
        EXPECT_NE(get(store, row, "replay").find(" --draw 1:" + std::to_string(row.run) + " --case bad"),
                  std::string::npos)
            << get(store, row, "replay");
    });
    EXPECT_EQ(rows, 16);
    EXPECT_GE(eaten, 1);
    EXPECT_LE(eaten, 7);
}

// A push beyond the stated set, too short for a trip: one of the two runs bears it.
TEST_F(Sweep, ABrokenGuaranteeOnTheRealArmIsNotOk) {
    const Outcome o = run({"sweep", "experiments/indy7_sweep.yaml", "--runs", "4", "--shard", "1/2", "--out",
                           folder_ / "s", "--set", "duration_s=3", "--set", "real_plant.push_Nm=[900,900,0,0,0,0]",
                           "--set", "real_plant.push_from_s=2", "--set", "real_plant.push_until_s=2.001"});
    EXPECT_EQ(o.code, 3) << o.err;
    std::map<std::string, int> ends;
    const SweepStore store = open("s");
    store.forEach([&](const SweepRow& row) {
        const std::string status = get(store, row, "status"), code = get(store, row, "exit_code");
        ++ends[status];
        EXPECT_EQ(status == "ok", code == "0") << status << " with " << code;
        if (status != "guarantee_broken") return;
        EXPECT_EQ(code, "3");
        EXPECT_EQ(get(store, row, "message").find("the real arm exceeded its limits: velocity by "), 0u);
        EXPECT_NE(get(store, row, "message").find(" rad/s (joint"), std::string::npos);
        EXPECT_NE(o.out.find(get(store, row, "replay")), std::string::npos) << o.out;
    });
    EXPECT_EQ(ends, (std::map<std::string, int>{{"ok", 1}, {"guarantee_broken", 1}})) << o.out;
}

TEST_F(Sweep, ChecksWhatItIsGiven) {
    expectRun({"run", file_}, 2, {"`--draw SEED:INDEX` takes the values of one of its runs"});
    expectRun({"run", file_, "--draw", "1"}, 2, {"Write SEED:INDEX"});
    expectRun({"sweep", file_}, 2, {"--runs N"});
    expectRun({"sweep", file_, "--runs", "2", "--shard", "2/2"}, 2, {"i from 0 to N-1"});
    expectRun({"sweep", "experiments/arena.yaml", "--runs", "2", "--out", folder_ / "x"}, 2,
              {"nothing in this file is drawn"});
    expectRun(arguments(folder_ / "x", {"--runs", "2", "--case", "C"}), 2, {"Its cases: A, B"});
    sweep("s", {"--runs", "2"});
    expectRun(arguments(folder_ / "s", {"--runs", "2", "--seed", "3"}), 2, {"its seed is 1, not 3"});
    expectRun(arguments(folder_ / "s", {"--runs", "2", "--set", "duration_s=0.2"}), 2,
              {"the experiment file, its overrides"});
    expectRun(arguments(folder_ / "s", {"--runs", "1"}), 2, {"--runs 2 continues it"});
    sweep("t", {"--runs", "2", "--seed", "3"});
    expectRun({"sweep", "--merge", folder_ / "s", folder_ / "t", "--out", folder_ / "m"}, 2, {"its seed is 1, not 3"});
}

// Even one that no run has drawn yet.
TEST_F(Sweep, APluginBuiltAnewBeginsAnotherSweep) {
    const fs::path built = fs::path(VIABLE_PROGRAM).parent_path() / "plugins/viable_filter_tosbp.so";
    const fs::path own = folder_ / built.filename();
    fs::copy_file(built, own);
    std::string choice = "--set=cases.A.filter.plugin=~choice(";
    for (int i = 0; i < 20; ++i) choice += "tosbp, ";
    choice += own.string() + ")";
    sweep("s", {"--runs", "1", choice});
    sweep("s", {"--runs", "1", choice});
    std::ofstream(own, std::ios::app) << "x";
    expectRun(arguments(folder_ / "s", {"--runs", "1", choice}), 2, {"a plugin or the program is another"});
}

TEST_F(Sweep, AgainDoesLostRunsOnceMore) {
    if (kSanitized) GTEST_SKIP() << "sanitizers answer crashes themselves";
    file_ = folder_.write("bad.yaml", kMisbehaving);
    const std::vector<std::string> first =
        arguments(folder_ / "s", {"--runs", "4", "--set", "cases.bad.filter.how=~choice(exits, exits)"});
    EXPECT_EQ(run(first).code, 4);
    Outcome o = run(first);
    EXPECT_NE(o.out.find("4 runs are there already, 0 to do"), std::string::npos) << o.out;
    std::vector<std::string> again = first;
    again.push_back("--again");
    o = run(again);
    EXPECT_EQ(o.code, 4) << o.err;
    EXPECT_NE(o.out.find("4 runs that crashed or took too long are done again"), std::string::npos) << o.out;
    EXPECT_EQ(open("s").findRuns().size(), 4u);
}

TEST_F(Sweep, AFileSizeLimitIsToldAndTheSweepGoesOnFromThere) {
    const Outcome o = run(arguments(folder_ / "s", {"--runs", "8"}), [] {
        const rlimit limit{40000, RLIM_INFINITY};
        setrlimit(RLIMIT_FSIZE, &limit);
    });
    EXPECT_EQ(o.code, 5) << o.out << o.err;
    sweep("s", {"--runs", "8"});
}

TEST_F(Sweep, CheckTriesRunsAndTheEndsOfTheirRanges) {
    expectRun({"check", file_}, 0, {"5 values drawn; 10 runs and 10 ends of their ranges tried"});
    // None of the ten runs has drawn it.
    expectRun({"check", file_, "--set", "tick_s=~choice(0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 7)"}, 2,
              {"tick_s"});
    EXPECT_EQ(run({"check", file_, "--draw", "9:4"}).code, 0);
}

}  // namespace
}  // namespace viable::test
