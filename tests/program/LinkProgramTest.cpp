// `viable robot` and `viable run` with the plant `link`, each in a process of its own; faults 83, 84 and 86.

#include <nlohmann/json.hpp>

#include "RobotProcess.h"
#include "viable/link/viable_link_linux.h"

namespace viable::test {
namespace {

std::vector<std::string> makeRun(const Robot& robot, const std::string& out, const std::string& duration_s,
                                 const std::vector<std::string>& more = {"--case", "linked"}) {
    std::vector<std::string> arguments{"run",        kLinkedExperiment,
                                       "--set",      "cases.linked.real_plant.address=\"" + robot.address() + "\"",
                                       "--set",      "cases.linked.real_plant.repeat_ticks=100",
                                       "--set",      "cases.linked.real_plant.silence_timeout_s=0.3",
                                       "--set",      "duration_s=" + duration_s,
                                       "--out",      out,
                                       "--no-report"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
}

nlohmann::json readCase(const std::string& folder, const std::string& name) {
    const auto summary = nlohmann::json::parse(readFile(folder + "/summary.json"));
    for (const auto& one : summary["cases"])
        if (one["name"] == name) return one;
    ADD_FAILURE() << name << " is missing in " << folder;
    return {};
}

void expectLimitsKept(const nlohmann::json& one) {
    expectContains(one["account"].get<std::string>(), {"all limits kept (nominal arm"});
}

TEST(LinkProgram, ARobotInAnotherProcessIsDrivenAsThePlainOne) {
    const TemporaryFolder folder;
    Robot robot(true);
    double expected = 0.0, measured = 0.0;
    int runs = 0;
    for (bool isWhole = false; !isWhole;) {  // a machine that is busy makes ticks be missed: then it is another run
        ASSERT_LE(++runs, 10) << "each run missed ticks";
        const std::string out = folder / ("run" + std::to_string(runs));
        // Without a blend: the plain arm begins with the model's torque.
        const Outcome o =
            run(makeRun(robot, out, "0.9", {"--jobs", "1", "--set", "cases.linked.real_plant.rest_torque_share=.inf"}));
        ASSERT_EQ(o.code, 0) << o.out << o.err;
        const nlohmann::json plain = readCase(out, "simulated"), linked = readCase(out, "linked");
        expectLimitsKept(plain);
        expectLimitsKept(linked);
        expected = plain["tracking"]["rms_rad"];
        measured = linked["tracking"]["rms_rad"];
        isWhole = linked["missed_ticks"] == 0;
    }
    EXPECT_NEAR(measured, expected, 0.01 * expected);  // the same arm, torques, delay and readings
    std::printf("  real - nominal: %.3f mrad RMS over the link, %.3f mrad in one process\n", 1e3 * measured,
                1e3 * expected);
    robot.await("the host has gone");
    expectOutcome(robot.end(SIGINT), 0,
                  {"2 joints, tick 0.001 s", "a host has come\n", "the host has gone\n",
                   "hosts     " + std::to_string(runs) + "\n", " good", "held itself for want of commands 0 times"});
}

TEST(Fault83, OnALineThatLosesDelaysDoublesAndCorruptsTheNominalLimitsHold) {
    const TemporaryFolder folder;
    Robot robot(true, {"--clock", "0.5", "--lose", "0.02", "--duplicate", "0.05", "--reorder", "0.05", "--corrupt",
                       "0.02", "--delay", "1", "--seed", "7"});
    const Outcome o = run(makeRun(robot, folder / "run", "0.6"));
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    const nlohmann::json linked = readCase(folder / "run", "linked");
    expectLimitsKept(linked);
    expectContains(linked["account"].get<std::string>(), {"missed ticks"});
    expectOutcome(robot.end(SIGTERM), 0, {" corrupt", " duplicate", " old"});
}

TEST(Fault84, AKilledRobotEndsTheRunWithASentence) {
    for (const bool isIsolated : {false, true}) {
        const TemporaryFolder folder;
        Robot robot(!isIsolated);
        std::vector<std::string> more{"--case", "linked"};
        if (isIsolated) more.push_back("--isolate");
        Program program(makeRun(robot, folder / "run", "100", more));
        robot.await("a host has come");
        sleepFor(0.3);
        robot.end(SIGKILL);
        expectOutcome(
            program.wait(), 4,
            {"the plant plugin 'link'", "it cannot drive the robot at " + robot.address() +
                                            " any more: no state has come for 0.3 s; see that it and the line are up "
                                            "(packets: "});
        expectLimitsKept(readCase(folder / "run", "linked"));
    }
}

TEST(Fault86, AStoppedHostLeavesTheRobotToItsOwnHoldAndBrakes) {
    const TemporaryFolder folder;
    Robot robot(false, {"--clock", "0.5", "--repeat", "100", "--brake-after", "10"});
    Program program(makeRun(robot, folder / "run", "100"));
    robot.await("a host has come");
    sleepFor(0.3);
    kill(program.pid(), SIGSTOP);
    robot.await("commands are missing: it holds itself");
    robot.await("its brakes are closed");
    kill(program.pid(), SIGCONT);
    expectOutcome(program.wait(), 4, {"any more: its brakes are closed; see at the robot what closed them (packets: "});
    expectLimitsKept(readCase(folder / "run", "linked"));
}

/** What stands behind `word` on the robot's output, as a number. */
double readFigure(const std::string& text, const std::string& word) {
    const std::size_t at = text.find(word);
    EXPECT_NE(at, std::string::npos) << word << " is missing in:\n" << text;
    return at == std::string::npos ? -1.0 : std::stod(text.substr(at + word.size()));
}

/** The robot's state, as whoever calls it is told who takes nothing. */
vl_state see(const std::string& address) {
    vl_line line;
    char error[256];
    vl_state state{};
    EXPECT_EQ(vl_line_open(&line, address.c_str(), 0, error, sizeof error), 0) << error;
    for (int k = 0; k < 500 && state.sequence == 0; ++k) {
        vl_host host;
        std::uint8_t bytes[VL_MAX_PACKET + 1];
        std::uint64_t peer = 0;
        vl_host_init(&host, 2, 0.001, vl_random(), vl_line_peer(&line));
        vl_line_send(&line, bytes, vl_host_command(&host, VL_HOLD, nullptr, 0, bytes));  // hello
        if (const std::size_t size = vl_line_receive(&line, bytes, 20'000'000, &peer))
            vl_host_receive(&host, bytes, size, peer, &state);
    }
    vl_line_close(&line);
    EXPECT_GT(state.sequence, 0u) << "it tells no state";
    return state;
}

/** In full motion; no torque of the robot steps farther than it allows, whether that is asked for or not. As seen from outside it
comes to rest by itself and stays there, and it serves the next host. */
TEST(Fault86, AKilledHostLeavesTheRobotToItsOwnStopAndTheNextHostIsServed) {
    for (const bool usesUdp : {true, false}) {
        const TemporaryFolder folder;
        std::vector<std::string> options{"--clock", "0.5", "--repeat", "20"};
        if (usesUdp) options.insert(options.end(), {"--torque-rate", "800"});
        Robot robot(usesUdp, options);
        Program program(makeRun(robot, folder / "run", "100"));
        robot.await("a host has come");
        sleepFor(3.0);  // 1.5 s of its time: the motion begins at 1 s
        kill(program.pid(), SIGKILL);
        program.wait();
        robot.await("commands are missing: it holds itself");
        std::string text = robot.await("it has come to rest in ");
        text = text.substr(text.find("it has come to rest"));
        const double stop_s = readFigure(text, "rest in "), way = readFigure(text, " s, ");
        EXPECT_GT(stop_s, 0.02) << text;
        robot.await("the host has gone");
        const vl_state first = see(robot.address());
        sleepFor(0.2);
        const vl_state then = see(robot.address());
        EXPECT_GT(then.sequence, first.sequence);
        for (int i = 0; i < 2; ++i) {
            EXPECT_LT(std::abs(first.qd[i]) + std::abs(then.qd[i]), 1e-3);
            EXPECT_LT(std::abs(then.q[i] - first.q[i]), 1e-4);
        }
        std::printf("  killed at %.2f rad/s or more; rests after %.3f s\n", way / stop_s, stop_s);
        std::fflush(stdout);  // the next process would say it, too
        EXPECT_GT(way / stop_s, 0.3);
        expectOutcome(run(makeRun(robot, folder / "next", "0.2")), 0);
        const Outcome ended = robot.end(SIGINT);
        expectContains(ended.out, {"hosts     2\n", "held itself for want of commands 1 times"});
        const double step = readFigure(ended.out, "largest step ");
        EXPECT_LE(step, (usesUdp ? 0.8 : 60.0 * 0.001 / 0.025) * (1.0 + 1e-9));
        EXPECT_GT(step, 0.1);
    }
}

/** Torques go missing in motion, and the host goes on with its own. */
TEST(Fault83, LostTorquesDoNotStepFartherThanTheRobotAllows) {
    const TemporaryFolder folder;
    Robot robot(true, {"--clock", "0.5", "--torque-rate", "800", "--lose", "0.25", "--from", "1.0", "--seed", "5"});
    const Outcome o = run(makeRun(robot, folder / "run", "1.4"));
    EXPECT_TRUE(o.code == 0 || o.code == 4) << o.code << o.out << o.err;  // 4: too late in the mean, on a busy machine
    expectLimitsKept(readCase(folder / "run", "linked"));
    const Outcome ended = robot.end(SIGINT);
    EXPECT_GT(readFigure(ended.out, "repeated  "), 20.0);
    const double step = readFigure(ended.out, "largest step ");
    EXPECT_LE(step, 0.8 * (1.0 + 1e-9));
    EXPECT_GT(step, 0.7);
}

TEST(Fault84, ARobotThatReportsAFaultInMotionEndsTheRunAndComesToRest) {
    const TemporaryFolder folder;
    Robot robot(true, {"--clock", "0.5", "--fault-at", "1.3"});
    expectOutcome(run(makeRun(robot, folder / "run", "100")), 4,
                  {"any more: it reports a fault of its own; find and clear it at the robot"});
    expectLimitsKept(readCase(folder / "run", "linked"));
    robot.await("it has come to rest in ");
}

/** Ctrl-C while the robot is called, which would go on for 20 s. */
TEST(LinkProgram, TheCallOfARobotEndsAtOnceWhenTheUserAsksForIt) {
    const TemporaryFolder folder;
    Program program({"run", kLinkedExperiment, "--case", "linked", "--out", folder / "run", "--set",
                     "cases.linked.real_plant.address=127.0.0.1:9", "--set",
                     "cases.linked.real_plant.connect_timeout_s=20"});
    for (int k = 0; k < 1000 && program.output().find("output in") == std::string::npos; ++k) sleepFor(0.01);
    sleepFor(0.3);
    const std::int64_t begin = vl_now_ns();
    kill(program.pid(), SIGINT);
    const Outcome o = program.wait();
    const std::int64_t took_ns = vl_now_ns() - begin;
    EXPECT_EQ(o.code, 128 + SIGINT) << o.out << o.err;
    expectContains(o.err, {"the robot at 127.0.0.1:9 was still being called when the user asked for the end"});
    EXPECT_LT(took_ns, 500'000'000);  // 0.2 s, and the program's own end
}

/** One that ends leaves no shared memory; what a killed one leaves is no robot, and told so. */
TEST(LinkProgram, SharedMemoryOfARobotThatHasEndedIsNoRobot) {
    const TemporaryFolder folder;
    for (const int signal : {SIGTERM, SIGKILL}) {
        Robot robot(false);
        const std::string file = "/" + robot.address().substr(4);
        robot.end(signal);
        const int fd = shm_open(file.c_str(), O_RDWR, 0600);
        EXPECT_EQ(fd >= 0, signal == SIGKILL);
        if (fd >= 0) close(fd);
        expectOutcome(
            run({"run", kLinkedExperiment, "--case", "linked", "--out", folder / ("run" + std::to_string(signal)),
                 "--set", "cases.linked.real_plant.address=" + robot.address(), "--set",
                 "cases.linked.real_plant.connect_timeout_s=0.1"}),
            2,
            {signal == SIGKILL ? "there is no robot: the one that had this shared memory is gone"
                               : "cannot be called: there is no robot: No such file",
             "See that `viable robot` or the robot's driver runs there"});
    }
}

TEST(LinkProgram, WhatCannotBeServedOrCalledIsRefused) {
    expectRun({"robot", kLinkedExperiment}, 2,
              {"it has 2 cases, and one arm is served. Name it with --case: simulated, linked"});
    expectRun({"robot", kLinkedExperiment, "--case", "linked"}, 2,
              {"its real arm, 'link', is itself a robot elsewhere. Name a case with a simulated one"});
    expectRun({"robot", kLinkedExperiment, "--case", "simulated", "--listen", "nowhere"}, 2,
              {"nowhere: an address is numeric", "--listen ADDRESS:PORT"});
    expectRun(
        {"robot", kLinkedExperiment, "--case", "simulated", "--key-file", "README.md"}, 2,
        {"--key-file README.md: other users can read or write it (mode 644); if nobody did: chmod 600 README.md"});
    expectRun({"robot", kLinkedExperiment, "--case", "simulated", "--key-file", "", "--duration", "0.1"}, 2,
              {"--key-file ", "it cannot be read: No such file"});
    const TemporaryFolder folder;
    expectRun(
        {"run", kLinkedExperiment, "--case", "linked", "--out", folder / "run", "--set",
         "cases.linked.real_plant.address=shm:viable-nobody", "--set", "cases.linked.real_plant.connect_timeout_s=0.1"},
        2,
        {"the plant plugin 'link'", "the robot at shm:viable-nobody cannot be called: there is no robot",
         "See that `viable robot` or the robot's driver runs there"});
}

}  // namespace
}  // namespace viable::test
