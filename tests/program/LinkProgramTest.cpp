// `viable robot` and `viable run` with the plant `link`, each in a process of its own; faults 83, 84 and 86.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "ExpectContains.h"
#include "Program.h"
#include "TemporaryFolder.h"

namespace viable {
namespace {

using test::expectContains;
using test::Outcome;
using test::Program;
using test::readFile;

const char* const kExperiment = "experiments/planar_two_link_linked.yaml";

void sleepFor(double seconds) {
    const timespec pause{static_cast<time_t>(seconds),
                         static_cast<long>(1e9 * (seconds - static_cast<time_t>(seconds)))};
    nanosleep(&pause, nullptr);
}

/** A second process, and where it listens. Its clock runs slowly where the machine is busy with other tests. */
class Robot {
public:
    explicit Robot(bool usesUdp, std::vector<std::string> more = {"--clock", "0.5"}) {
        static std::atomic<int> count{0};
        std::vector<std::string> arguments{"robot", kExperiment, "--case", "simulated"};
        if (usesUdp) {
            arguments.insert(arguments.end(), {"--listen", "127.0.0.1:0"});
        } else {
            name_ = "viable-program-" + std::to_string(getpid()) + "-" + std::to_string(++count);
            arguments.insert(arguments.end(), {"--shm", name_});
        }
        arguments.insert(arguments.end(), more.begin(), more.end());
        program_ = std::make_unique<Program>(arguments);
        const std::string line = await(" at ");
        const std::size_t at = line.rfind(" at ");
        address_ = line.substr(at + 4, line.find('\n', at) - at - 4);
    }
    ~Robot() {
        if (!hasEnded_) {
            kill(program_->pid(), SIGKILL);
            program_->wait();
        }
        if (!name_.empty()) shm_unlink(("/" + name_).c_str());  // a killed one leaves it
    }
    Robot(const Robot&) = delete;
    Robot& operator=(const Robot&) = delete;

    const std::string& address() const { return address_; }
    /** Waits until it has said so; what it has said then. */
    std::string await(const std::string& words) const {
        for (int k = 0; k < 2000; ++k) {
            std::string text = program_->output();
            const std::size_t at = text.find(words);
            if (at != std::string::npos && text.find('\n', at) != std::string::npos) return text;
            sleepFor(0.01);
        }
        ADD_FAILURE() << "'" << words << "' was not said in 20 s:\n" << program_->output();
        return {};
    }
    Outcome end(int signal) {
        kill(program_->pid(), signal);
        hasEnded_ = true;
        return program_->wait();
    }

private:
    std::unique_ptr<Program> program_;
    std::string name_, address_;  // name_: of shared memory
    bool hasEnded_ = false;
};

std::vector<std::string> makeRun(const Robot& robot, const std::string& out, const std::string& duration_s,
                                 const std::vector<std::string>& more = {"--case", "linked"}) {
    std::vector<std::string> arguments{"run",        kExperiment,
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
    const test::TemporaryFolder folder;
    Robot robot(true);
    const Outcome o = test::run(makeRun(robot, folder / "run", "0.9", {"--jobs", "1"}));
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    const nlohmann::json plain = readCase(folder / "run", "simulated"), linked = readCase(folder / "run", "linked");
    expectLimitsKept(plain);
    expectLimitsKept(linked);
    const double expected = plain["tracking"]["rms_rad"], measured = linked["tracking"]["rms_rad"];
    EXPECT_GT(measured, expected / 5.0);
    EXPECT_LT(measured, expected * 5.0);
    std::printf("  real - nominal: %.3f mrad RMS over the link, %.3f mrad in one process\n", 1e3 * measured,
                1e3 * expected);
    const Outcome ended = robot.end(SIGINT);
    EXPECT_EQ(ended.code, 0) << ended.err;
    expectContains(ended.out,
                   {"2 joints, tick 0.001 s", "a host has come\n", "the host has gone\n", "hosts     1\n", " good"});
}

TEST(Fault83, OnALineThatLosesDelaysDoublesAndCorruptsTheNominalLimitsHold) {
    const test::TemporaryFolder folder;
    Robot robot(true, {"--clock", "0.5", "--lose", "0.02", "--duplicate", "0.05", "--reorder", "0.05", "--corrupt",
                       "0.02", "--delay", "1", "--seed", "7"});
    const Outcome o = test::run(makeRun(robot, folder / "run", "0.6"));
    ASSERT_EQ(o.code, 0) << o.out << o.err;
    const nlohmann::json linked = readCase(folder / "run", "linked");
    expectLimitsKept(linked);
    expectContains(linked["account"].get<std::string>(), {"missed ticks"});
    const Outcome ended = robot.end(SIGTERM);
    EXPECT_EQ(ended.code, 0) << ended.err;
    expectContains(ended.out, {" corrupt", " duplicate", " old"});
}

TEST(Fault84, AKilledRobotEndsTheRunWithASentence) {
    for (const bool isIsolated : {false, true}) {
        const test::TemporaryFolder folder;
        Robot robot(!isIsolated);
        std::vector<std::string> more{"--case", "linked"};
        if (isIsolated) more.push_back("--isolate");
        Program program(makeRun(robot, folder / "run", "100", more));
        robot.await("a host has come");
        sleepFor(0.3);
        robot.end(SIGKILL);
        const Outcome o = program.wait();
        EXPECT_EQ(o.code, 4) << o.out << o.err;
        expectContains(o.err, {"the plant plugin 'link'", "it cannot drive the robot at " + robot.address() +
                                                              " any more: no state has come for 0.3 s (packets: "});
        expectLimitsKept(readCase(folder / "run", "linked"));
    }
}

TEST(Fault86, AStoppedHostLeavesTheRobotToItsOwnHoldAndBrakes) {
    const test::TemporaryFolder folder;
    Robot robot(false, {"--clock", "0.5", "--repeat", "100", "--brake-after", "10"});
    Program program(makeRun(robot, folder / "run", "100"));
    robot.await("a host has come");
    sleepFor(0.3);
    kill(program.pid(), SIGSTOP);
    robot.await("commands are missing: it holds itself");
    robot.await("its brakes are closed");
    kill(program.pid(), SIGCONT);
    const Outcome o = program.wait();
    EXPECT_EQ(o.code, 4) << o.out << o.err;
    expectContains(o.err, {"any more: its brakes are closed (packets: "});
    expectLimitsKept(readCase(folder / "run", "linked"));
}

TEST(LinkProgram, WhatCannotBeServedOrCalledIsRefused) {
    const auto expectRefused = [](const std::vector<std::string>& arguments, const std::vector<std::string>& words) {
        const Outcome o = test::run(arguments);
        EXPECT_EQ(o.code, 2) << o.out << o.err;
        expectContains(o.err, words);
    };
    expectRefused({"robot", kExperiment},
                  {"it has 2 cases, and one arm is served. Name it with --case: simulated, linked"});
    expectRefused({"robot", kExperiment, "--case", "linked"},
                  {"its real arm, 'link', is itself a robot elsewhere. Name a case with a simulated one"});
    expectRefused({"robot", kExperiment, "--case", "simulated", "--listen", "nowhere"},
                  {"nowhere: an address is numeric", "--listen ADDRESS:PORT"});
    expectRefused({"robot", kExperiment, "--case", "simulated", "--key-file", "README.md"},
                  {"--key-file README.md: other users can read it (chmod 600). Make one: "});
    const test::TemporaryFolder folder;
    expectRefused(
        {"run", kExperiment, "--case", "linked", "--out", folder / "run", "--set",
         "cases.linked.real_plant.address=shm:viable-nobody", "--set", "cases.linked.real_plant.connect_timeout_s=0.1"},
        {"the plant plugin 'link'", "the robot at shm:viable-nobody cannot be called: there is no robot",
         "See that `viable robot` or the robot's driver runs there"});
}

}  // namespace
}  // namespace viable
