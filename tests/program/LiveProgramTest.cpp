// `viable live` and `viable run LOG --again`.
#include <fcntl.h>
#include <sys/ioctl.h>

#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "../tools/page/TlsClient.h"
#include "RobotProcess.h"

namespace viable::test {
namespace {

using nlohmann::json;

const char* const kExperiment = kLinkedExperiment;

std::vector<std::string> makeLive(const std::filesystem::path& folder, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"live",  kExperiment,     "--case",        "simulated",
                                       "--out", folder.string(), "--no-priority", "--no-report"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

json readLive(const std::filesystem::path& folder) {
    return json::parse(readFile(folder / "summary.json"))["cases"][0]["live"];
}

std::vector<std::string> listChanges(const json& live) {
    std::vector<std::string> all;
    for (const json& change : live["changes"])
        all.push_back(change["state"].get<std::string>() + " (" + change["asked_by"].get<std::string>() + ")");
    return all;
}

void await(const Program& program, const std::string& words, const std::string& after = "") {
    for (int k = 0; k < 3000; ++k) {
        if (const std::string text = program.output(); text.find(words, text.find(after)) != text.npos) return;
        sleepFor(0.01);
    }
    FAIL() << "'" << words << "' was not said in 30 s:\n" << program.output();
}

TEST(Live, DrivesACaseInRealTimeAndItsLogReplaysToTheBit) {
    const TemporaryFolder folder;
    const Outcome o = run(makeLive(folder / "run", {"--duration", "1.7", "--details"}));
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    expectContains(o.out, {"running (program)", "stopping (duration)", "stopped (program)", "all limits kept",
                           "NOT real time, by the clock of the computer"});
    const json live = readLive(folder / "run");
    EXPECT_EQ(live["real_time"], false);
    EXPECT_EQ(live["rows_lost"], 0);
    EXPECT_GE(live["ticks"], 1700);
    EXPECT_EQ(live["compute"]["count"], live["ticks"]);
    EXPECT_FALSE(live["wake_up"]["buckets_us"].empty());
    expectRun({"run", (folder / "run" / "simulated.mcap").string(), "--again"}, 0,
              {"simulated: replayed " + std::to_string(live["ticks"].get<int>()) + " ticks",
               "all equal to the log, to the bit"});
}

TEST(Live, ASignalBrakesTheArm) {
    const TemporaryFolder folder;
    for (const int signal : {SIGINT, SIGTERM}) {
        const std::string name = "run" + std::to_string(signal);
        Program program(makeLive(folder / name, {"--duration", "inf"}));
        await(program, "running (program)");
        sleepFor(0.8);
        kill(program.pid(), signal);
        expectOutcome(program.wait(), 128 + signal);
        EXPECT_EQ(listChanges(readLive(folder / name)),
                  (std::vector<std::string>{"running (program)", "stopping (signal)", "stopped (program)"}));
    }
}

TEST(Fault25, AStoppedProgramHasMissedTicksAndGoesOnUnlessThereWereTooMany) {
    const TemporaryFolder folder;
    for (const double pause_s : {0.3, 1.6}) {
        const bool isLong = pause_s > 1.0;
        const std::string name = isLong ? "long" : "short";
        Program program(makeLive(folder / name, {"--duration", "2.5"}));
        await(program, "running (program)");
        sleepFor(0.7);
        kill(program.pid(), SIGSTOP);
        sleepFor(pause_s);
        kill(program.pid(), SIGCONT);
        const Outcome o = program.wait();
        EXPECT_EQ(o.code, isLong ? 4 : 0) << o.out << o.err;
        const json one = json::parse(readFile(folder / name / "summary.json"))["cases"][0];
        expectContains(one["account"].get<std::string>(), {"all limits kept (nominal arm"});
        EXPECT_GE(one["live"]["longest_gap"], isLong ? 1000 : 250);
        if (isLong) expectContains(o.err, {"more than 1000 ticks in a row were missed"});
        EXPECT_EQ(run({"run", (folder / name / "simulated.mcap").string(), "--again"}).code, 0);
    }
}

TEST(Fault26, ALoadedMachineMissesTicksAndDecidesTheSame) {
    const TemporaryFolder folder;
    std::atomic<bool> isDone{false};
    std::vector<std::thread> load;
    for (unsigned k = 0; k < 3 * std::thread::hardware_concurrency(); ++k)
        load.emplace_back([&] {
            std::vector<char> memory(1 << 24);
            for (unsigned i = 0; !isDone; ++i) memory[i * 4097u % memory.size()] = static_cast<char>(i);
        });
    const Outcome o = run(makeLive(folder / "run", {"--duration", "1.5"}));
    isDone = true;
    for (std::thread& thread : load) thread.join();
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    const std::string said = std::regex_replace(o.out, std::regex("\\s+"), " ");  // its lines may end anywhere
    expectContains(said, {"largest use", "the nominal arm kept its joints' limits", " ticks missed", "--details"});
    EXPECT_EQ(o.out.find("  verdict "), std::string::npos) << o.out;
    std::printf("  missed ticks: %s\n", readLive(folder / "run")["missed"].dump().c_str());
    EXPECT_EQ(run({"run", (folder / "run" / "simulated.mcap").string(), "--again"}).code, 0);
}

TEST(Live, KeysStartHoldGoOnAndEnd) {
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY);
    ASSERT_GE(terminal, 0);
    ASSERT_EQ(grantpt(terminal), 0);
    ASSERT_EQ(unlockpt(terminal), 0);
    const std::string slave = ptsname(terminal);
    const TemporaryFolder folder;
    Program program(makeLive(folder / "run", {"--wait", "--duration", "inf"}), [&] {
        setsid();
        const int input = open(slave.c_str(), O_RDWR);
        ioctl(input, TIOCSCTTY, 0);
        dup2(input, STDIN_FILENO);
    });
    const auto press = [&](char key) { ASSERT_EQ(write(terminal, &key, 1), 1); };
    press('\n');  // too early: it is forgotten
    await(program, "armed (program)");
    await(program, "keys: space");
    sleepFor(0.3);
    press('\n');
    await(program, "running (key)");
    sleepFor(0.5);
    press(' ');
    await(program, "armed (key)");
    sleepFor(0.3);
    press('\n');
    await(program, "running (key)", "armed (key)");
    press('q');
    const Outcome o = program.wait();
    close(terminal);
    EXPECT_EQ(o.code, 0) << o.out << o.err;
    const json live = readLive(folder / "run");
    EXPECT_EQ(listChanges(live), (std::vector<std::string>{"armed (program)", "running (key)", "armed (key)",
                                                           "running (key)", "stopping (key)", "stopped (program)"}));
    EXPECT_GT(live["changes"][1]["time_s"], 0.25);
    EXPECT_EQ(run({"run", (folder / "run" / "simulated.mcap").string(), "--again"}).code, 0);
}

TEST(Live, WhatCannotBeDrivenIsRefusedBeforeAFileIsMade) {
    const TemporaryFolder folder;
    const std::string out = (folder / "run").string();
    const auto expectRefused = [&](std::vector<std::string> arguments, const std::vector<std::string>& words) {
        arguments.insert(arguments.end(), {"--out", out});
        const Outcome o = run(arguments);
        EXPECT_EQ(o.code, 2) << o.out << o.err;
        expectContains(o.err, words);
        EXPECT_FALSE(std::filesystem::exists(out));
    };
    expectRefused({"live", kExperiment}, {"2 cases, and one arm is driven", "--case: simulated, linked"});
    expectRefused({"live", kExperiment, "--case", "simulatd"}, {"Did you mean 'simulated'?"});
    expectRefused({"live", kExperiment, "--case", "simulated", "--from-here"}, {"--from-here", "plant link"});
    expectRefused({"live", kExperiment, "--case", "simulated", "--duration", "-1"}, {"--duration"});
    expectRefused({"live", kExperiment, "--case", "simulated", "--wait"}, {"--wait", "no terminal"});
    expectRefused({"live", kExperiment, "--case", "simulated", "--set", "missed_ticks=[{at_s: 1, count: 2}]"},
                  {"missed_ticks are for simulated time"});
    expectRefused({"live", kExperiment, "--case", "simulated", "--page", "127.0.0.1:80x"}, {"127.0.0.1:80x"});
    expectRefused({"live", kExperiment, "--case", "simulated", "--page", "192.0.2.1:0"},  // of nobody, RFC 5737
                  {"--page 192.0.2.1:0", "Name an address of this computer"});
    const int taken = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ASSERT_EQ(bind(taken, reinterpret_cast<sockaddr*>(&address), size), 0);
    ASSERT_EQ(listen(taken, 1), 0);
    ASSERT_EQ(getsockname(taken, reinterpret_cast<sockaddr*>(&address), &size), 0);
    const std::string there = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    expectRefused({"live", kExperiment, "--case", "simulated", "--page", there}, {there, "Name another port"});
    close(taken);
    expectRefused({"live", kExperiment, "--case", "linked", "--set",
                   "cases.linked.real_plant={plugin: link, address: \"127.0.0.1:9\", connect_timeout_s: 0.3}"},
                  {"127.0.0.1:9", "does not answer", "See that `viable robot`"});
}

/** The robot's clock runs at half speed, so that a busy machine keeps up with it. */
std::vector<std::string> makeLinked(const Robot& robot, const std::filesystem::path& folder,
                                    const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"live",          kExperiment,
                                       "--case",        "linked",
                                       "--out",         folder.string(),
                                       "--no-priority", "--no-report",
                                       "--set",         "cases.linked.real_plant.address=\"" + robot.address() + "\"",
                                       "--set",         "cases.linked.real_plant.repeat_ticks=100"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

/** The robot's words of its end: no lapse, whatever ended the run. */
void expectNoLapse(const Outcome& robot) {
    EXPECT_EQ(robot.code, 0) << robot.err;
    expectContains(robot.out, {"held itself for want of commands 0 times"});
}

TEST(LiveLink, BeyondTheFilesDurationUntilASignalTheRobotMissesNothing) {
    const TemporaryFolder folder;
    for (const bool usesUdp : {true, false}) {
        const std::string name = usesUdp ? "udp" : "shm";
        Robot robot(usesUdp);
        Program program(makeLinked(robot, folder / name, {"--set", "duration_s=0.4", "--duration", "inf"}));
        await(program, "running (program)");
        sleepFor(2.0);  // more than the file's duration, in the robot's time
        kill(program.pid(), SIGTERM);
        expectOutcome(program.wait(), 128 + SIGTERM);
        const json one = json::parse(readFile(folder / name / "summary.json"))["cases"][0];
        EXPECT_EQ(one["live"]["clock"], "plant");
        EXPECT_GT(one["live"]["changes"][1]["time_s"], 0.6);
        expectContains(one["account"].get<std::string>(), {"all limits kept (nominal arm"});
        expectNoLapse(robot.end(SIGINT));
        expectRun({"run", (folder / name / "linked.mcap").string(), "--again"}, 0);
    }
}

TEST(LiveLink, ASecondRunStartsWhereTheFirstOneEndedWithoutAStep) {
    const TemporaryFolder folder;
    Robot robot(true, {"--clock", "0.5", "--stay"});
    ASSERT_EQ(run(makeLinked(robot, folder / "first", {"--duration", "1.7"})).code, 0);
    expectOutcome(run(makeLinked(robot, folder / "second", {"--duration", "0.5"})), 2,
                  {"does not stand where the file starts", "viable live --from-here"});
    sleepFor(10.0);  // the robot's own hold comes to rest: the robust loop answers what is left of a motion
    const Outcome o = run(makeLinked(robot, folder / "third", {"--duration", "0.5", "--from-here"}));
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    expectNoLapse(robot.end(SIGINT));
    const std::filesystem::path log = folder / "third" / "linked.mcap", csv = folder / "third.csv";
    ASSERT_EQ(run({"export", log.string(), "--to", "csv", csv.string()}).code, 0);
    std::ifstream stream(csv);
    std::string names, row;
    std::getline(stream, names);
    std::getline(stream, row);
    const auto get = [&](const std::string& column) {
        std::istringstream name(names), value(row);
        std::string one, text;
        while (std::getline(name, one, ',') && std::getline(value, text, ','))
            if (one == column) return std::stod(text);
        ADD_FAILURE() << column << " is missing";
        return 0.0;
    };
    for (const std::string joint : {"shoulder", "elbow"}) {
        EXPECT_NEAR(get("nominal." + joint + ".q_rad"), get("real." + joint + ".q_rad"), 5e-4);
        EXPECT_LT(std::abs(get("robust." + joint + ".tau_Nm")), 0.5);
    }
    expectRun({"run", log.string(), "--again"}, 0);
}

TEST(LiveLink, ARobotThatIsKilledEndsTheRunAndItsLogReplays) {
    const TemporaryFolder folder;
    Robot robot(true);
    Program program(makeLinked(robot, folder / "run", {"--duration", "inf"}));
    await(program, "running (program)");
    sleepFor(0.6);
    robot.end(SIGKILL);
    expectOutcome(program.wait(), 4, {"no state has come for"});
    const json one = json::parse(readFile(folder / "run" / "summary.json"))["cases"][0];
    EXPECT_EQ(listChanges(one["live"]), (std::vector<std::string>{"running (program)", "stopping (fault)",
                                                                  "stopped (fault)"}));  // it did not stop
    expectContains(one["account"].get<std::string>(), {"all limits kept (nominal arm"});
    expectRun({"run", (folder / "run" / "linked.mcap").string(), "--again"}, 0);
}

/** A page without a browser. @param address  of the program, with a token or a session behind '#' */
std::unique_ptr<TlsClient> openPage(const std::string& address) {
    const std::string origin = address.substr(0, address.find("/#")), host = origin.substr(origin.find("//") + 2);
    auto page = std::make_unique<TlsClient>(static_cast<unsigned short>(std::stoi(host.substr(host.find(':') + 1))));
    page->send("GET /live HTTP/1.1\r\nHost: " + host + "\r\nOrigin: " + origin +
               "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
               "dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: viable.1, " +
               address.substr(address.find('#') + 1) + "\r\n\r\n");
    EXPECT_EQ(page->readHead().rfind("HTTP/1.1 101", 0), 0u);
    return page;
}

/** The next message with this key; null: none comes. */
json readMessage(TlsClient& page, const char* key) {
    for (ServerFrame frame; (frame = readFrame(page)).opcode >= 0;)
        if (json message = json::parse(frame.payload, nullptr, false); message.is_object() && message.contains(key))
            return message[key];
    return nullptr;
}

/** A page that returns is told first what is there, and where nothing was put, that. The age of all that is around runs against
max_age_s: the arm stands from there on until something is put again. */
TEST(LivePage, ReturnsToWhatIsPlacedWhoseAgeIsInTheLog) {
    const TemporaryFolder folder;
    Program program({"live", "experiments/indy7_live.yaml", "--case", "tool", "--page", "127.0.0.1:0", "--out",
                     folder / "run", "--no-priority", "--no-report", "--set", "cases.tool.filter.max_age_s=0.5"},
                    [&] { setenv("XDG_STATE_HOME", folder.path().c_str(), 1); });
    await(program, "page: ");
    std::string address = program.output();
    address = address.substr(address.find("page: ") + 6);
    address.erase(address.find('\n'));
    std::string session;
    {
        const auto page = openPage(address);
        session = readMessage(*page, "session");
        EXPECT_EQ(readMessage(*page, "placed"), json::array());
        page->send(makeFrame(0x81, "take") + makeFrame(0x81, "start"));
        sleepFor(1.0);
        page->send(makeFrame(0x81, R"({"place": 2, "ball": 0.05, "at": [0.1, -0.6, 0.3]})"));
        EXPECT_EQ(readMessage(*page, "placed")[0]["place"], 2);
    }
    sleepFor(0.1);
    const auto again = openPage(address.substr(0, address.find('#') + 1) + session);
    EXPECT_EQ(readMessage(*again, "placed")[0]["ball"], 0.05);
    sleepFor(0.8);
    again->send(makeFrame(0x81, "stop"));
    EXPECT_EQ(program.wait().code, 0);
    LogReader log(folder / "run" / "tool.mcap");
    double before_s = 0.0, oldest_s = 0.0;
    int renewed = 0;
    for (TickRecord row; log.read(row);) {
        const LimitReport& told = row.reports[LimitKind::Clearance];
        if (!told.isKnown) continue;  // nobody was asked
        renewed += told.age_s < before_s;
        before_s = told.age_s;
        oldest_s = std::max(oldest_s, told.age_s);
        ASSERT_TRUE(told.age_s <= 0.5 || row.status == FilterStatus::StoppedByPlan) << row.time_s;
    }
    EXPECT_EQ(renewed, 1);
    EXPECT_GT(oldest_s, 0.6);
}

TEST(RunAgain, IsForLogsOfAnyRun) {
    const TemporaryFolder folder;
    const Outcome o = run({"run", kExperiment, "--case", "simulated", "--set", "duration_s=0.5", "--no-report", "--out",
                           (folder / "run").string()});
    ASSERT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(run({"run", (folder / "run" / "simulated.mcap").string(), "--again"}).code, 0);
    expectRun({"run", kExperiment, "--again"}, 2, {"planar_two_link_linked.yaml"});
}

}  // namespace
}  // namespace viable::test
