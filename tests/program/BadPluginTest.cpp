// What a user reads when a plugin misbehaves in the run, with and without --isolate.

#include <chrono>
#include <csignal>

#include "Program.h"

namespace viable::test {
namespace {

using Folder = TemporaryFolder;

const char* const kFaultyExperiment = R"(schema: 1
title: bad plugins
robot: single_joint
duration_s: 0.5
command: {plugin: waypoints, points: [[0, 1], [1, -1]], repeat_s: 2}
controller: {plugin: joint_pd}
cases: {A: {filter: {plugin: pass_through}}}
)";

/** A run of the experiment with that filter. */
Outcome runWith(const Folder& folder, const std::string& filter, std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"run", folder.write("e.yaml", kFaultyExperiment), "--out", folder / "run", "--no-report",
                               "--set", "cases.A.filter=" + filter});
    return test::run(std::move(more));
}

int countRowsOfWholeLog(const std::filesystem::path& log) {
    EXPECT_TRUE(LogReader(log).isComplete());
    return countRows(log);
}

struct Fixture {
    const char* plugin;
    const char* inProcess;  ///< what is said without --isolate
    const char* isolated;
};

struct BadPlugin : ::testing::TestWithParam<Fixture> {
    Outcome run(std::vector<std::string> more) {
        return runWith(folder_, std::string("{plugin: ") + GetParam().plugin + ", after_ticks: 100}", std::move(more));
    }
    std::string who() const {
        return std::string("the filter plugin '") + GetParam().plugin +
               "' (" VIABLE_BINARY_DIR "/tests/broken_plugins/viable_filter_" + GetParam().plugin + ".so)";
    }
    Folder folder_;
};

TEST_P(BadPlugin, IsolatedItIsNamedAndTheArmIsBraked) {
    expectOutcome(run({"--isolate", "--watchdog", "1"}), 4,
                  {"stopped at 0.1000 s (tick 100): " + who() + " failed: ", GetParam().isolated, "\n"});
    const std::filesystem::path log = folder_ / "run/A.mcap";
    EXPECT_GT(countRowsOfWholeLog(log), 101);  // and its stop
    LogReader reader(log);
    TickRecord record;
    int braking = 0;
    while (reader.read(record)) braking += record.braking;
    EXPECT_GT(braking, 1);
    // These filters hold accelerations, and so does their stop: its last tick leads to rest.
    const double dt = 1e-3, held = record.nominal.qdd[0] + record.nominal.jerk[0] * dt;
    EXPECT_LT(std::abs(record.nominal.qd[0] + held * dt), 1e-12);
}

TEST_P(BadPlugin, WithoutIsolationItIsNamedAndTheLogIsWhole) {
    const bool hangs = GetParam().plugin == std::string("hangs");
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    expectOutcome(run(hangs ? std::vector<std::string>{"--watchdog", "1"} : std::vector<std::string>{}), 4,
                  {who(), GetParam().inProcess, "tick 100"});
    EXPECT_GE(countRowsOfWholeLog(folder_ / "run/A.mcap"), 100);
}

INSTANTIATE_TEST_SUITE_P(
    Fault44And47To50, BadPlugin,
    ::testing::Values(
        Fixture{"segfaults", "crashed in tick 100: signal 11 (Segmentation fault). The logs in ",
                "its process died: signal 11 (Segmentation fault)\nFix the plugin"},
        Fixture{"overflows_stack", "crashed in tick 100: signal 11 (Segmentation fault). The logs",
                "its process died: signal 11 (Segmentation fault)\nFix the plugin"},
        Fixture{"aborts", "crashed in tick 100: signal 6 (Aborted). The logs in ",
                "its process died: signal 6 (Aborted)\nFix the plugin"},
        Fixture{"calls_exit", "called exit() in tick 100. The logs in ",
                "its process ended: it called exit(0)\nFix the plugin"},
        Fixture{"hangs", " has not come back in tick 100. The logs in ",
                "it did not return for 1 s; its process was ended\nFix the plugin"},
        Fixture{"rounds_in_tick",
                "failed: it changed the floating point arithmetic of the whole thread (the "
                "rounding mode; set back)\nSet the modes back",
                "it changed the floating point arithmetic of the whole thread (the rounding mode; "
                "set back)\nSet the modes back"},
        Fixture{"throwing_tick",
                "failed: it threw: the filter lost its temper\nreset() and the tick functions must not throw",
                "it threw: the filter lost its temper\nreset() and the tick functions must not throw"},
        Fixture{"nan_output",
                "failed: its decision has the wrong size or is not finite\nReturn one finite "
                "number per joint",
                "its decision has the wrong size or is not finite\nReturn one finite number per joint"},
        Fixture{"wrong_size",
                "failed: its decision has the wrong size or is not finite\nReturn one finite number per joint",
                "its decision has the wrong size or is not finite\nReturn one finite number per joint"}),
    [](const auto& fixture) { return std::string(fixture.param.plugin); });

TEST(Fault49, APluginThatTakesMemoryInItsTickIsToldOf) {
    if (kSanitized) GTEST_SKIP() << "allocations are not counted in sanitizer builds";
    Folder folder;
    expectOutcome(runWith(folder, "{plugin: allocates, after_ticks: 100}", {"--details"}), 0,
                  {"WARNING       the filter plugin 'allocates' (", "viable_filter_allocates.so",
                   "(in 400 ticks, first in tick 100)", "Take the memory in configure()"});
    expectContains(readFile(folder / "run/summary.json"), {"\"warnings\": [\n", "allocates"});
}

TEST(Fault49, NoPluginOfTheMainExperimentTakesMemoryInItsTick) {
    if (kSanitized) GTEST_SKIP() << "allocations are not counted in sanitizer builds";
    Folder folder;
    const Outcome o = test::run({"run", "experiments/indy7_teleoperation.yaml", "--out", folder / "run", "--no-report",
                                 "--set", "duration_s=2"});
    EXPECT_EQ(o.code, 0) << o.err;
    EXPECT_EQ(o.out.find("WARNING"), std::string::npos) << o.out;
}

TEST(Fault49, ALeakIsToldOfWithWhatItHasTaken) {
    if (kSanitized) GTEST_SKIP() << "allocations are not counted in sanitizer builds";
    Folder folder;
    expectOutcome(runWith(folder, "{plugin: leaks, after_ticks: 100}", {"--details", "--set", "duration_s=0.2"}), 0,
                  {"WARNING       the filter plugin 'leaks' (", "(in 100 ticks, first in tick 100)",
                   "The program grew by 1", " MB in this case's ticks"});
}

/** Which of them has taken it is not known. */
TEST(Fault49, OfCasesThatRunAtOnceNoneIsToldOfWhatTheProgramHasTaken) {
    if (kSanitized) GTEST_SKIP() << "allocations are not counted in sanitizer builds";
    Folder folder;
    const std::string file =
        folder.write("e.yaml", std::string(kFaultyExperiment).substr(0, std::string(kFaultyExperiment).find("cases:")) +
                                   "cases:\n  A: {filter: {plugin: leaks, after_ticks: 100}}\n"
                                   "  B: {filter: {plugin: leaks, after_ticks: 100}}\n");
    for (const char* jobs : {"1", "2"}) {
        const Outcome o =
            expectRun({"run", file, "--out", folder / jobs, "--no-report", "--details", "--jobs", jobs, "--set",
                       "duration_s=0.2"},
                      0, {"WARNING       the filter plugin 'leaks' (", "(in 100 ticks, first in tick 100)"});
        EXPECT_EQ(o.out.find("The program grew by") != std::string::npos, jobs == std::string("1")) << o.out;
    }
}

TEST(Fault49, APluginThatTakesAllMemoryIsNamedAndTheArmBraked) {
    if (kSanitized) GTEST_SKIP() << "sanitizers take memory of their own";
    Folder folder;
    const Outcome o =
        test::run({"run", folder.write("e.yaml", kFaultyExperiment), "--out", folder / "run", "--no-report", "--set",
                   "cases.A.filter={plugin: misbehaves, how: eats_memory, after_ticks: 100}"},
                  [] {
                      const rlimit limit{rlim_t(4) << 30, RLIM_INFINITY};
                      setrlimit(RLIMIT_AS, &limit);
                  });
    EXPECT_EQ(o.code, 4);
    expectContains(o.err, {"the filter plugin 'misbehaves' (", "failed: it threw: std::bad_alloc"});
    EXPECT_GT(countRowsOfWholeLog(folder / "run/A.mcap"), 101);  // and its stop
}

TEST(Fault49, AnIsolatedOneIsToldOfToo) {
    if (kSanitized) GTEST_SKIP() << "allocations are not counted in sanitizer builds";
    Folder folder;
    expectOutcome(runWith(folder, "{plugin: allocates, after_ticks: 100}", {"--isolate", "--details"}), 0,
                  {"WARNING       the filter plugin 'allocates' (", "(in 400 ticks, first in tick 100)"});
}

TEST(Fault50, AChangeOfArithmeticBeforeTheFirstTickIsRefused) {
    for (const char* how : {"--jobs=1", "--isolate"}) {
        Folder folder;
        const Outcome o = runWith(folder, "{plugin: rounds_in_configure}", {how});
        EXPECT_EQ(o.code, 4) << how;
        expectContains(o.err, {"the filter plugin 'rounds_in_configure' (",
                               "it changed the floating point arithmetic of the whole thread (the "
                               "rounding mode; set back). Set the modes back"});
        EXPECT_FALSE(std::filesystem::exists(folder / "run"));
    }
}

TEST(Fault50, AChangeOfWhatTheProgramSharesIsUndoneAndTold) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    for (const char* when : {"loaded", "made", "configured"})
        for (const char* how : {"--jobs=1", "--isolate"}) {
            SCOPED_TRACE(std::string(when) + " " + how);
            Folder folder;
            const std::string name = std::string("changes_process_when_") + when;
            const std::string path = folder.path();
            const std::string file = folder.write("e.yaml", kFaultyExperiment);
            // What is relative is relative to where the user stands.
            const Outcome o = test::run({"run", "e.yaml", "--out", "run", "--set", "cases.A.filter.plugin=" + name,
                                         "--no-report", "--details", how},
                                        [path] {
                                            setenv("VIABLE_ROBOT_PATH", VIABLE_SOURCE_DIR "/robots", 1);
                                            if (chdir(path.c_str()) != 0) _exit(98);
                                        });
            EXPECT_EQ(o.code, 0) << o.err;
            EXPECT_EQ(countRowsOfWholeLog(folder / "run/A.mcap"), 500);
            expectContains(o.out, {"WARNING       the filter plugin '" + name + "' (",
                                   std::string("(when it was ") + (when == std::string("loaded") ? "loaded" : "made") +
                                       ": the global locale of C++, the locale (C.UTF-8 instead of C), the working "
                                       "folder (to /), what is done at signal 2 (Interrupt), what is done at signal 11 "
                                       "(Segmentation fault)",
                                   "It was set back"});
            const Outcome check = test::run({"check", file, "--set", "cases.A.filter.plugin=" + name});
            EXPECT_EQ(check.code, 0) << check.err;
            expectContains(check.err, {"viable: warning: case A: the filter plugin '" + name + "' ("});
        }
}

TEST(Fault44, AThrowOutsideOfTicksNamesThePlugin) {
    for (const char* how : {"--jobs=1", "--isolate"}) {
        SCOPED_TRACE(how);
        Folder folder;
        expectOutcome(runWith(folder, "{plugin: throws_when_asked}", {how}), 4,
                      {"the filter plugin 'throws_when_asked' (", "threw while it was configured: who knows"});
        for (const char* filter : {"{plugin: throws_in_reset}", "[certified_braking, throws_in_reset]"}) {
            SCOPED_TRACE(filter);
            Folder other;
            expectOutcome(runWith(other, filter, {how}), 4,
                          {"the filter plugin 'throws_in_reset' (", "threw in reset(): no way back"});
        }
    }
}

TEST(Fault48, ACrashInADestructorNamesThePlugin) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    Folder folder;
    expectOutcome(
        runWith(folder, "{plugin: crashes_when_destroyed}"), 4,
        {"the filter plugin 'crashes_when_destroyed' (", " crashed while it was destroyed: signal 6 (Aborted)"});
    EXPECT_EQ(countRowsOfWholeLog(folder / "run/A.mcap"), 500);
    Folder other;
    expectOutcome(runWith(other, "{plugin: crashes_when_destroyed}", {"--isolate", "--details"}), 0,
                  {"WARNING       the filter plugin 'crashes_when_destroyed' (",
                   "failed while it was destroyed: its process died: signal 6 (Aborted)"});
}

std::string nameDeadly(const std::string& plugin) {
    return VIABLE_BINARY_DIR "/tests/broken_plugins/deadly/viable_filter_" + plugin + ".so";
}

TEST(Fault48, AFailureWhileALibraryIsLoadedNamesIt) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    struct Failure {
        const char *plugin, *inProcess, *isolated;
    };
    for (const Failure& fixture :
         {Failure{"crashes_on_load", " crashed while it was loaded: signal 6 (Aborted)",
                  "failed while it was loaded: its process died: signal 6 (Aborted). Fix its static objects"},
          Failure{"exits_on_load", " called exit() while it was loaded",
                  "failed while it was loaded: its process ended: it called exit(0). Fix its static objects"},
          Failure{"hangs_on_load", " has not come back while it was loaded",
                  "failed while it was loaded: it did not return for 0.3 s; its process was ended. Fix"}})
        for (const bool isIsolated : {false, true}) {
            SCOPED_TRACE(testing::Message() << fixture.plugin << isIsolated);
            Folder folder;
            std::vector<std::string> more{"--watchdog", "0.3"};
            if (isIsolated) more.push_back("--isolate");
            const std::string library = nameDeadly(fixture.plugin);
            expectOutcome(runWith(folder, "{plugin: \"" + library + "\"}", more), 4,
                          {"the plugin library '" + library + "'", isIsolated ? fixture.isolated : fixture.inProcess});
            EXPECT_FALSE(std::filesystem::exists(folder / "run"));
        }
}

TEST(Fault47, AHangBeforeTheFirstTickIsNamedWithItsCall) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    const std::map<std::string, std::string> calls = {{"made", "while it was made"},
                                                      {"configured", "in configure()"},
                                                      {"asked", "while it was asked what it is"},
                                                      {"reset", "in reset()"}};
    for (const auto& [when, call] : calls)
        for (const bool isIsolated : {false, true}) {
            SCOPED_TRACE(when + (isIsolated ? " --isolate" : ""));
            Folder folder;
            std::vector<std::string> arguments{
                "run",   folder.write("e.yaml", kFaultyExperiment),     "--out",      folder / "run", "--no-report",
                "--set", "cases.A.filter={plugin: hangs_before_ticks}", "--watchdog", "0.3"};
            if (isIsolated) arguments.push_back("--isolate");
            const std::string wanted = when;
            const auto begin = std::chrono::steady_clock::now();
            const Outcome o = test::run(arguments, [wanted] { setenv("VIABLE_HANGS_WHEN", wanted.c_str(), 1); });
            EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(8));  // not after 10 or 60
            EXPECT_EQ(o.code, 4);
            expectContains(o.err, {"the filter plugin 'hangs_before_ticks' (",
                                   isIsolated ? "it did not return " + call + " for 0.3 s; its process was ended"
                                              : "has not come back " + call});
            if (when != "reset" || !isIsolated) {  // isolated, the summary says that the case was not run
                EXPECT_FALSE(std::filesystem::exists(folder / "run"));
            }
        }
}

TEST(Fault48, AnExceptionThatLeavesAPluginsOwnThreadIsToldWithItsLibrary) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    Folder folder;
    expectOutcome(runWith(folder, "{plugin: throws_in_thread, after_ticks: 100}"), 4,
                  {"viable: std::terminate() was called: an exception that nobody catches: the thread lost its temper "
                   "while the cases ran, outside of the calls of plugins, in a thread that runs code of ",
                   "tests/broken_plugins/viable_filter_throws_in_thread.so. The logs in ", "are complete"});
    EXPECT_GE(countRowsOfWholeLog(folder / "run/A.mcap"), 100);
    Folder other;
    expectOutcome(runWith(other, "{plugin: throws_in_thread, after_ticks: 100}", {"--isolate"}), 4,
                  {"the filter plugin 'throws_in_thread' (", "failed: its process died: signal 6 (Aborted)"});
}

TEST(Fault48, ACrashOutsideOfPluginsNamesTheSuspects) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    Folder folder;
    expectOutcome(runWith(folder, "{plugin: damages_heap, after_ticks: 100}"), 4,
                  {"viable: crashed: signal 6 (Aborted) while the cases ran, outside of the calls of plugins. A "
                   "plugin may have damaged memory before, or a thread of its own has failed. Suspects are all "
                   "that are loaded: ",
                   "viable_command_waypoints.so, ", "viable_filter_damages_heap.so"});
    EXPECT_GE(countRowsOfWholeLog(folder / "run/A.mcap"), 100);
}

/** In the process that becomes the program: one beside it makes it crash once `file` is there, and so much later. */
void crashOnceThereIs(const std::string& file, useconds_t later_us) {
    const pid_t program = getpid();
    if (fork() != 0) return;
    while (getppid() == program && access(file.c_str(), F_OK) != 0) usleep(100);
    usleep(later_us);
    if (getppid() == program) kill(program, SIGSEGV);
    _exit(0);
}

TEST(Fault48, ACrashOfViableWhilePluginsAreIsolatedIsItsOwn) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    Folder folder;
    const std::string log = folder / "run/A.mcap";
    const Outcome o = test::run({"run", folder.write("e.yaml", kFaultyExperiment), "--out", folder / "run",
                                 "--no-report", "--isolate", "--set", "duration_s=60"},
                                [log] { crashOnceThereIs(log, 100000); });
    EXPECT_EQ(o.code, 70) << o.err;
    expectContains(o.err, {"viable: crashed: signal 11 (Segmentation fault) while the cases ran. Each plugin runs in a "
                           "process of its own: this is a fault of viable. Please report it. The logs in "});
    EXPECT_EQ(o.err.find("Suspects"), std::string::npos) << o.err;
    EXPECT_EQ(o.err.find("With `viable run --isolate`"), std::string::npos) << o.err;
    countRowsOfWholeLog(log);
    EXPECT_FALSE(std::filesystem::exists(folder / "run/run.claim"));
}

TEST(Fault48, ACrashAfterTheCasesIsViablesAndLeavesNoClaim) {
    if (kSanitized) GTEST_SKIP() << "sanitizers have crash handlers of their own";
    Folder folder;
    const std::string summary = folder / "run/summary.json";
    // The report of many rows takes a while.
    const Outcome o =
        test::run({"run", folder.write("e.yaml", kFaultyExperiment), "--out", folder / "run", "--set", "duration_s=60"},
                  [summary] { crashOnceThereIs(summary, 0); });
    EXPECT_EQ(o.code, 70) << o.err;
    expectContains(o.err, {"viable: crashed: signal 11 (Segmentation fault) while summary and report were written. All "
                           "cases have ended, and no plugin is called any more: this is a fault of viable, unless a "
                           "plugin damaged memory before. Please report it. The logs in ",
                           "are complete. `viable report "});
    EXPECT_FALSE(std::filesystem::exists(folder / "run/run.claim"));
    EXPECT_EQ(countRowsOfWholeLog(folder / "run/A.mcap"), 60000);
}

TEST(FilterChain, WhatAFilterOfAChainDoesWrongIsToldAsItsOwn) {
    Folder folder;
    expectOutcome(runWith(folder, "[{plugin: rounds_in_tick, after_ticks: 100}, certified_braking]"), 4,
                  {"the filter plugin 'rounds_in_tick' (", "failed: it changed the floating"});
    Folder other;
    expectOutcome(runWith(other, "[{plugin: nan_output, after_ticks: 100}, certified_braking]"), 4,
                  {"the filter plugin 'nan_output' (", "failed: its decision has the wrong size or is not finite"});
}

TEST(Isolate, ARunIsTheSameToTheLastBit) {
    Folder folder;
    for (const char* how : {"--no-report", "--isolate"}) {
        const Outcome o =
            test::run({"run", "experiments/indy7_teleoperation.yaml", "--out", folder / how, "--case", "C3", "--set",
                       "duration_s=2", "--no-report", "--set", "missed_ticks=[{at_s: 1, count: 5}]", how});
        ASSERT_EQ(o.code, 0) << o.err;
    }
    LogReader here(folder / "--no-report/C3.mcap"), there(folder / "--isolate/C3.mcap");
    TickRecord a, b;
    int rows = 0;
    while (here.read(a)) {
        ASSERT_TRUE(there.read(b));
        ++rows;
        ASSERT_EQ(a.nominal.q, b.nominal.q);
        ASSERT_EQ(a.nominal.jerk, b.nominal.jerk);
        ASSERT_EQ(a.motorTorque, b.motorTorque);
        ASSERT_EQ(a.real.q, b.real.q);
        ASSERT_EQ(a.status, b.status);
        ASSERT_EQ(a.stops[0].duration_s, b.stops[0].duration_s);
    }
    EXPECT_EQ(rows, 2000);
    EXPECT_FALSE(there.read(b));
}

TEST(Isolate, APluginThatDiesWhileItIsMadeIsBadNewsBeforeTheRun) {
    Folder folder;
    expectRun({"run", folder.write("e.yaml", kFaultyExperiment), "--out", folder / "run", "--isolate", "--set",
               "cases.A.filter.plugin=create_throws"},
              4, {"viable_filter_create_throws.so", "could not be made"});
    EXPECT_FALSE(std::filesystem::exists(folder / "run"));
}

TEST(FilterChain, ALawWithoutAGuaranteeBeforeOneThatGuaranteesKeepsAllLimits) {
    Folder folder;
    expectRun({"run", "experiments/indy7_teleoperation.yaml", "--out", folder / "run", "--case", "C1", "--set",
               "duration_s=5", "--no-report", "--details", "--set",
               "cases.C1.filter=[acceleration_viability, certified_braking]"},
              0,
              {"C1: filter acceleration_viability + certified_braking",
               "all limits kept (nominal arm; the filter guarantees all)"});
}

TEST(FilterChain, WhoBreaksAnEarlierGuaranteeIsNamedWithIt) {
    Folder folder;
    expectRun({"run", folder.write("e.yaml", kFaultyExperiment), "--out", folder / "run", "--no-report", "--set",
               "duration_s=5", "--set", "limits={position_rad: 0.5}", "--set",
               "cases.A.filter=[certified_braking, {plugin: rewrites}]"},
              3,
              {"the filter plugin 'rewrites' (",
               "failed: it changed what 'certified_braking' before it had decided, which "
               "guarantees all limits, but joint0",
               "Put the filter before the one"});
}

}  // namespace
}  // namespace viable::test
