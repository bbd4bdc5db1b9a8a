#include "live/LiveSession.h"

#include "CaseSupport.h"
#include "live/Replay.h"
#include "records/LogReader.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

constexpr char kCertified[] = "filter={plugin: certified_braking}";
constexpr double kSimulatedHold_s = RunningCase::kSettling_s;

/** No machine of a test is asked for more than it is. */
LiveOptions makeOptions(double duration_s) {
    LiveOptions options;
    options.realTime = {-1, 0, false};
    options.duration_s = duration_s;
    return options;
}

template <class Condition>
void await(const Condition& condition) {
    for (int k = 0; k < 20000; ++k) {
        if (condition()) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    FAIL() << "not within 20 s";
}

std::vector<std::string> listChanges(const CaseResult& result) {
    std::vector<std::string> all;
    for (const LiveTiming::Change& change : result.live->changes)
        all.push_back(change.state + " (" + change.asker + ")");
    return all;
}

TEST(LiveSession, TakesAsLongAsTheClockSaysAndEndsAtRest) {
    const Experiment e = readTestExperiment(kTeleoperation, {kCertified});
    LiveSession session(configureCase(e.cases[0]), makeOptions(0.8));
    const auto before = std::chrono::steady_clock::now();
    session.begin();
    await([&] { return session.hasEnded(); });
    const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
    const LiveStatus last = session.status();
    const CaseResult result = session.finish();
    EXPECT_EQ(last.state, LiveState::Stopped);
    EXPECT_EQ(last.record.nominal.qd.cwiseAbs().maxCoeff(), 0.0);
    EXPECT_GT(result.simulated_s, 0.8 + kSimulatedHold_s);
    EXPECT_LT(result.simulated_s, 0.8 + kSimulatedHold_s + 1.5);
    EXPECT_GE(wall_s, result.simulated_s - 0.002);  // the first tick begins a tick after the start
    EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
    ASSERT_TRUE(result.live);
    EXPECT_FALSE(result.live->isRealTime);
    EXPECT_FALSE(result.live->hasClock);
    EXPECT_EQ(result.live->ticks, std::llround(result.simulated_s / 0.001));
    EXPECT_EQ(result.live->compute.count(), result.live->ticks);
    EXPECT_GT(result.live->wakeUp.count(), 0);
    EXPECT_EQ(result.summary.missedTicks(), result.live->missed);
    EXPECT_EQ(result.summary.ticksOutside(LimitKind::Position) + result.summary.ticksOutside(LimitKind::Velocity) +
                  result.summary.ticksOutside(LimitKind::Acceleration) + result.summary.ticksOutside(LimitKind::Jerk),
              0);
    EXPECT_EQ(listChanges(result),
              (std::vector<std::string>{"running (program)", "stopping (duration)", "stopped (program)"}));
}

TEST(LiveSession, WaitsArmedAndDoesWhatItIsTold) {
    const TemporaryFolder folder;
    const Experiment e = readTestExperiment(kOneJoint, {kCertified, "duration_s=100"});
    LiveOptions options = makeOptions(INFINITY);
    options.waitsArmed = true;
    options.log.file = folder / "A.mcap";
    LiveSession session(configureCase(e.cases[0]), options);
    session.begin();
    await([&] { return session.status().time_s > 0.1; });
    EXPECT_EQ(session.status().state, LiveState::Armed);
    EXPECT_EQ(session.status().commandTime_s, 0.0);
    EXPECT_EQ(session.status().record.nominal.q, e.cases[0].start.q);
    session.resume(LiveAsker::Key);
    await([&] { return session.status().commandTime_s > 0.5; });
    session.pause(LiveAsker::Key);
    await([&] { return session.status().state == LiveState::Armed; });
    const double held_s = session.status().commandTime_s;
    await([&] { return session.status().record.paused && session.status().record.nominal.qd.isZero(0.0); });
    EXPECT_EQ(session.status().commandTime_s, held_s);
    session.resume(LiveAsker::Key);
    await([&] { return session.status().commandTime_s > held_s + 0.2; });
    session.stop(LiveAsker::Signal);
    session.resume(LiveAsker::Key);  // a stop is final
    await([&] { return session.hasEnded(); });
    const CaseResult result = session.finish();
    EXPECT_EQ(listChanges(result),
              (std::vector<std::string>{"armed (program)", "running (key)", "armed (key)", "running (key)",
                                        "stopping (signal)", "stopped (program)"}));
    EXPECT_EQ(result.exitCode(), 0);
    EXPECT_EQ(result.live->lostRows, 0);
    EXPECT_EQ(result.logRows, result.live->ticks);
    LatencyHistogram logged;  // the histogram can be had from the log alone
    LogReader reader(folder / "A.mcap");
    for (TickRecord row; reader.read(row);)
        if (row.interval_us > 0.0) logged.add(std::llround(1e3 * row.interval_us));
    EXPECT_GT(logged.count(), 100);
    EXPECT_EQ(logged.count(), result.live->interval.count());
    EXPECT_EQ(logged.worst_ns(), result.live->interval.worst_ns());
    EXPECT_EQ(logged.calcQuantile_ns(0.99), result.live->interval.calcQuantile_ns(0.99));
    const ReplayResult again = replayLog(folder / "A.mcap", makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
    EXPECT_EQ(again.difference, "");
    EXPECT_EQ(again.ticks, result.live->ticks);
}

TEST(LiveSession, MarksWhatTheOperatorRecords) {
    const TemporaryFolder folder;
    const Experiment e = readTestExperiment(kOneJoint, {kCertified, "duration_s=100"});
    LiveOptions options = makeOptions(INFINITY);
    options.log.file = folder / "A.mcap";
    LiveSession session(configureCase(e.cases[0]), options);
    session.begin();
    for (const std::int64_t take : {1, 2}) {
        await([&] { return session.status().record.take == 0 && session.status().time_s > 0.1; });
        session.record(true);
        await([&] { return session.status().record.take == take; });
        session.record(true);  // it does already
        const double begin_s = session.status().time_s;
        await([&] { return session.status().time_s > begin_s + 0.1; });
        EXPECT_EQ(session.status().record.take, take);
        if (take == 1) session.record(false);
    }
    session.stop(LiveAsker::Page);  // ends the second
    const CaseResult result = session.finish();
    ASSERT_EQ(result.live->takes.size(), 2u);
    expectContains(formatDetails(result), {"takes         1 from ", " s, 2 from "});
    std::array<std::vector<double>, 3> times;
    LogReader reader(folder / "A.mcap");
    for (TickRecord row; reader.read(row);) times.at(static_cast<std::size_t>(row.take)).push_back(row.time_s);
    EXPECT_FALSE(times[0].empty());
    for (std::size_t k = 0; k < 2; ++k) {
        const LiveTiming::Take& take = result.live->takes[k];
        ASSERT_GT(times[k + 1].size(), 50u);
        EXPECT_EQ(take.begin_s, times[k + 1].front());
        EXPECT_EQ(take.end_s, times[k + 1].back());
        EXPECT_EQ(std::llround((take.end_s - take.begin_s) / 0.001) + 1,
                  static_cast<std::int64_t>(times[k + 1].size()));  // without a hole
    }
    const ReplayResult again = replayLog(folder / "A.mcap", makeTestLoader(), {VIABLE_SOURCE_DIR "/robots"});
    EXPECT_EQ(again.difference, "");
    EXPECT_EQ(again.ticks, result.live->ticks);
}

TEST(LiveSession, ResumeDoesNotReplaceAPauseThatWasNotTakenYet) {
    const Experiment e = readTestExperiment(kOneJoint, {kCertified, "duration_s=100"});
    LiveSession session(configureCase(e.cases[0]), makeOptions(INFINITY));
    session.resume(LiveAsker::Page);  // before any tick: all three are there at the first one
    session.pause(LiveAsker::Key);
    session.resume(LiveAsker::Page);
    session.begin();
    await([&] { return session.status().time_s > 0.1; });
    EXPECT_EQ(session.status().state, LiveState::Armed);
    EXPECT_LT(session.status().commandTime_s, 0.1);
    session.resume(LiveAsker::Page);  // now it has been
    await([&] { return session.status().state == LiveState::Running; });
    session.stop(LiveAsker::Signal);
    EXPECT_EQ(listChanges(session.finish()),
              (std::vector<std::string>{"running (program)", "armed (key)", "running (page)", "stopping (signal)",
                                        "stopped (program)"}));
}

/** A command that sleeps now and then, and counts what the loop's thread takes from the heap. */
class SleepyCommand : public CommandSource {
public:
    void configure(const RunSetup& setup, const Parameters&) override { start_ = setup.start.q; }
    void reset(const MotionState& start) override { start_ = start.q; }
    CommandTraits traits() const override { return {MotionCommand::Space::Joint}; }
    TickStatus sample(double t, MotionCommand& out) override {
        out.q = start_;
        out.q[0] += 0.3 * std::sin(3.0 * t);
        out.qd.setZero(start_.size());
        const int tick = ++asked;
        if (tick == 20) before_ = testing::AllocationCounter::total();
        if (tick == 500) allocations = testing::AllocationCounter::total() - before_;
        if (sleep_s > 0.0 && tick % 100 == 0) std::this_thread::sleep_for(std::chrono::duration<double>(sleep_s));
        return TickStatus::Ok;
    }

    double sleep_s = 0.0;
    std::atomic<int> asked{0};
    std::atomic<std::int64_t> allocations{-1};

private:
    JointVector start_;
    std::int64_t before_ = 0;
};

std::unique_ptr<ConfiguredCase> configureWith(const Experiment& e, SleepyCommand& command) {
    auto configured = configureCase(e.cases[0]);
    command.configure(configured->setup, e.cases[0].command.parameters);
    configured->plugins.command = PluginPtr<CommandSource>(&command, [](void*) {});
    return configured;
}

TEST(LiveSession, TicksThatTookTooLongAreMissedOnesAndTheArmKeepsItsLimits) {
    const TemporaryFolder folder;
    const Experiment e = readTestExperiment(kOneJoint, {kCertified, "duration_s=100"});
    SleepyCommand command;
    command.sleep_s = 0.0105;
    LiveOptions options = makeOptions(0.6);
    options.log.file = folder / "A.mcap";
    LiveSession session(configureWith(e, command), options);
    session.begin();
    const CaseResult result = session.finish();
    EXPECT_GE(result.live->missed, 10);
    EXPECT_GE(result.live->longestGap, 9);
    EXPECT_GE(result.live->compute.worst_ns(), 10'000'000);
    EXPECT_EQ(result.summary.missedTicks(), result.live->missed);
    EXPECT_FALSE(result.summary.anyLimitBroken());
    EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
    LogReader reader(folder / "A.mcap");
    TickRecord row;
    std::int64_t missed = 0, rows = 0;
    for (; reader.read(row); ++rows) {
        ASSERT_NEAR(row.time_s, 0.001 * static_cast<double>(rows), 1e-9);
        missed += row.missed;
    }
    EXPECT_EQ(missed, result.live->missed);
    EXPECT_EQ(rows, result.live->ticks);
}

TEST(LiveSession, TakesNothingFromTheHeapInItsTicks) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const TemporaryFolder folder;
    const Experiment e = readTestExperiment(
        kOneJoint, {kCertified, "duration_s=100", "robust_loop={plugin: nric}", "real_plant={plugin: simbody}"});
    SleepyCommand command;
    LiveOptions options = makeOptions(0.7);
    options.log.file = folder / "A.mcap";
    LiveSession session(configureWith(e, command), options);
    session.begin();
    await([&] { return session.status().time_s > 0.2; });
    session.record(true);
    EXPECT_EQ(session.finish().live->takes.size(), 1u);
    EXPECT_GT(command.asked, 500);
    EXPECT_EQ(command.allocations, 0);
}

TEST(LiveSession, AFailureStopsTheArmAndIsTold) {
    const Experiment e =
        readTestExperiment(kTeleoperation, {kCertified, "robust_loop={plugin: throwing_robust, after_ticks: 200}"});
    LiveSession session(configureCase(e.cases[0]), makeOptions(INFINITY));
    session.begin();
    const CaseResult result = session.finish();
    EXPECT_EQ(result.stopReason, StopReason::RobustLoopFailed);
    EXPECT_NE(result.exitCode(), 0);
    const std::vector<std::string> changes = listChanges(result);
    ASSERT_EQ(changes.size(), 3u);
    EXPECT_EQ(changes[1], "stopping (fault)");
}

TEST(LiveSession, ARehearsalNeedsNoRealArm) {
    const Experiment e =
        readTestExperiment(kTeleoperation, {kCertified, "real_plant={plugin: link, address: \"127.0.0.1:9\"}"});
    EXPECT_NO_THROW(LiveSession::rehearse(e.cases[0]));
    LiveOptions options = makeOptions(1.0);
    EXPECT_THROW(LiveSession(configureCase(e.cases[0]), options), Error);
}

TEST(LiveSession, WhatFailsInTheRehearsalIsRefused) {
    const Experiment e = readTestExperiment(kTeleoperation, {"filter={plugin: throwing_tick, after_ticks: 50}"});
    expectError({"case A", "rehearsal", "stopped at 0.0500 s", "'throwing_tick'", "it threw"}, ErrorKind::PluginFailed,
                [&] { LiveSession::rehearse(e.cases[0]); });
}

TEST(LatestValue, TheReaderGetsTheNewestAndAlwaysAWholeOne) {
    struct Pair {
        std::int64_t a = 0, b = 0;
    };
    LatestValue<Pair> latest;
    EXPECT_EQ(latest.read().a, 0);
    std::thread writer([&] {
        for (std::int64_t k = 1; k <= 200000; ++k) latest.write({k, -k});
    });
    std::int64_t last = 0;
    while (last < 200000) {
        const Pair now = latest.read();
        ASSERT_EQ(now.a, -now.b);
        ASSERT_GE(now.a, last);
        last = now.a;
    }
    writer.join();
    EXPECT_EQ(latest.read().a, 200000);
}

}  // namespace
}  // namespace viable::test
