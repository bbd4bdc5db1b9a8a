
#include "CaseSupport.h"
#include "viable/testing/AllocationCounter.h"

// The loop with its monitor: filters that break their word, ticks that are missed, limits that change.

namespace viable::test {
namespace {

const char* const kGuaranteeing = "filter={plugin: guaranteeing}";

/** The nominal arm stayed within every limit of the case in every record and at the end. */
class LimitKeeper {
public:
    explicit LimitKeeper(const CasePlan& plan)
        : summary_(plan.robot.jointNames(), plan.limits, plan.realPlant.has_value()) {}
    void add(const TickRecord& record) { summary_.add(record); }
    void finish(const ControlLoop& loop) {
        summary_.addEnd(loop.nominal(), loop.time());
        EXPECT_FALSE(summary_.anyLimitBroken());
        for (LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
            EXPECT_EQ(summary_.ticksOutside(kind), 0) << getName(kind, LimitSide::Neither);
    }
    const Summary& summary() const { return summary_; }

private:
    Summary summary_;
};

/** It stops for this reason, in at most `most` ticks and within every limit. */
void expectKeptStop(TestLoop& t, int most, StopReason reason) {
    LimitKeeper keeper(t.experiment.cases[0]);
    TickRecord record;
    ASSERT_NO_FATAL_FAILURE(runUntilStopped(t.loop, record, most, [&](const TickRecord& r) { keeper.add(r); }));
    keeper.finish(t.loop);
    EXPECT_EQ(t.loop.stopReason(), reason);
}

struct Lie {
    const char* name;
    const char* message;
};
const Lie kLies[] = {
    {"jerk", "jerk limit by"},        {"moving", "would not be at rest at the end of its stop"},
    {"outside", "position limit by"}, {"stop_jerk", "jerk limit by"},
    {"nan", "the stop of"},           {"negative", "would not be at rest at the end of its stop"},
    {"endless", "the stop of"},
};

TEST(Fault37, EveryLieIsCaughtInItsFirstTickAndTheArmKeepsItsLimits) {
    for (const char* arm : {kOneJoint, kTeleoperation})
        for (const Lie& lie : kLies) {
            SCOPED_TRACE(std::string(lie.name) + (arm == kOneJoint ? ", one joint" : ", arm"));
            TestLoop t(arm, {kGuaranteeing, std::string("filter.lie=") + lie.name, "filter.after_ticks=300"});
            LimitKeeper keeper(t.experiment.cases[0]);
            ASSERT_NO_FATAL_FAILURE(runUntilStopped(t.loop, t.record, 3000, [&](const TickRecord& r) {
                keeper.add(r);
                ASSERT_EQ(r.braking, r.time_s > 0.2995) << r.time_s;
                ASSERT_EQ(r.verdict, StopVerdict::Safe) << r.time_s;
                ASSERT_EQ(r.status, r.braking ? FilterStatus::StoppedByPlan : FilterStatus::Modified);
            }));
            keeper.finish(t.loop);
            EXPECT_EQ(t.loop.stopReason(), StopReason::GuaranteeBroken);
            EXPECT_NEAR(t.loop.stopTime(), 0.3, 1e-9);
            const std::string message = t.loop.stopMessage();
            EXPECT_EQ(message.rfind("it guarantees all limits, but ", 0), 0u) << message;
            EXPECT_CONTAINS(message, lie.message);
            const std::vector<std::string> names = t.experiment.cases[0].robot.jointNames();
            const std::string culprit = std::string(lie.name) == "jerk" ? names.front() : names.back();
            EXPECT_CONTAINS(message, culprit);
            EXPECT_LT(t.loop.nominal().qd.cwiseAbs().maxCoeff(), 1e-9);
            EXPECT_LT(t.loop.nominal().qdd.cwiseAbs().maxCoeff(), 1e-9);
        }
}

TEST(Fault37, ACreepOverALimitIsStoppedAtTheLimit) {
    for (const char* witness : {"true", "false"}) {
        TestLoop t(kOneJoint,
                   {kGuaranteeing, "filter.lie=creep", std::string("filter.witness=") + witness, "duration_s=20"});
        expectKeptStop(t, 20000, StopReason::GuaranteeBroken);
        EXPECT_CONTAINS(t.loop.stopMessage(), "joint0 would pass its upper position limit by");
        EXPECT_LE(t.loop.nominal().q[0], EIGEN_PI + 1e-9);
        EXPECT_GT(t.loop.nominal().q[0], EIGEN_PI - 2e-3);  // not before it had to be
    }
}

TEST(Fault37, AFilterThatHoldsAccelerationsIsHeldToItsWordOnJerk) {
    TestLoop t(kOneJoint, {"filter={plugin: liar}"});
    expectKeptStop(t, 3000, StopReason::GuaranteeBroken);
    EXPECT_CONTAINS(t.loop.stopMessage(), "jerk limit");
}

TEST(Fault37, DecisionsInUnknownWordsAreNotApplied) {
    for (const char* arm : {kOneJoint, kTeleoperation})
        for (const char* lie : {"limit", "side", "status"}) {
            SCOPED_TRACE(std::string(lie) + " on " + arm);
            TestLoop t(arm, {kGuaranteeing, std::string("filter.lie=") + lie, "filter.after_ticks=300"});
            expectKeptStop(t, 3000, StopReason::FilterFailed);
            EXPECT_NEAR(t.loop.stopTime(), 0.3, 1e-9);
            EXPECT_STREQ(t.loop.stopMessage(), "its status or an acting limit is not a known value");
        }
}

TEST(Fault37, ABrokenGuaranteeEndsTheRunWith3) {
    const CaseResult result = runFirstCase(kOneJoint, {kGuaranteeing, "filter.lie=jerk", "filter.after_ticks=100"});
    EXPECT_EQ(result.exitCode(), 3);
    EXPECT_FALSE(result.summary.anyLimitBroken());
    for (const char* part : {"stopped at 0.1000 s (tick 100): the filter plugin 'guaranteeing' (",
                             "failed: it guarantees all limits, but joint0 would pass its"})
        EXPECT_CONTAINS(result.stopMessage, part);
}

TEST(Monitor, AnHonestGuaranteeIsKeptToTheEndOfTheRun) {
    for (const char* witness : {"true", "false"}) {
        const CaseResult result =
            runFirstCase(kTeleoperation, {kGuaranteeing, std::string("filter.witness=") + witness});
        EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
        EXPECT_EQ(result.summary.unviableTicks(), 0);
        EXPECT_EQ(result.summary.ticks(), 2000);
        EXPECT_GT(result.summary.worstMargin().value, 0.0);
        EXPECT_GT(result.summary.longestStop().value, 0.01);
    }
}

TEST(Monitor, AFilterWithoutGuaranteeIsOnlyReported) {
    const CaseResult result =
        runFirstCase(kOneJoint, {"filter={plugin: pass_through}", "command.points=[[0, 4], [1, -4]]"});
    EXPECT_EQ(result.exitCode(), 0);
    EXPECT_GT(result.summary.unviableTicks(), 10);
    EXPECT_TRUE(result.summary.anyLimitBroken());
    expectContains(formatDetails(result),
                   {"unviable ticks " + std::to_string(result.summary.unviableTicks()) + " (first at "});
}

TEST(Monitor, StopsOnRequestKeepPositionLimitsWhereTheMonitorFoundTheStopSafe) {
    TestLoop t(kOneJoint, {"duration_s=10", "command.points=[[0, pi], [1, -pi]]"});
    const AxisLimits axis = t.experiment.cases[0].limits.axis(0);
    int safe = 0;
    for (int begin = 50; begin < 2500; begin += 31) {
        t.loop.reset();
        t.tick(begin);
        if (t.record.verdict != StopVerdict::Safe) continue;
        ++safe;
        t.loop.requestStop(StopReason::Requested, "test");
        ASSERT_NO_FATAL_FAILURE(runUntilStopped(t.loop, t.record, 5000, [&](const TickRecord& r) {
            ASSERT_LE(r.nominal.q[0], axis.positionUpper + 1e-9) << "begun in tick " << begin;
            ASSERT_GE(r.nominal.q[0], axis.positionLower - 1e-9) << "begun in tick " << begin;
        }));
    }
    EXPECT_GT(safe, 50);
}

TEST(Monitor, ATickWithAWitnessAllocatesNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    for (const char* witness : {"true", "false"}) {
        TestLoop t(kTeleoperation, {kGuaranteeing, std::string("filter.witness=") + witness, "duration_s=12"});
        t.tick(100);
        const testing::AllocationCounter counter;
        t.tick(5000);
        for (int k = 0; k < 100; ++k) t.loop.missTick(t.record);
        t.tick();
        t.loop.requestStop(StopReason::Requested, "test");
        t.tick(100);
        EXPECT_EQ(counter.count(), 0);
    }
}

TEST(Fault24, TicksThatTakeTheirTimeGiveTheSameBits) {
    const char* const command = "command={plugin: changing_limits, size_rad: 0.2}";
    for (const char* filter : {"filter={plugin: tosbp}", kGuaranteeing}) {
        TestLoop quick(kOneJoint, {command, filter});
        TestLoop slow(kOneJoint, {command, filter, "command.sleep_us=3000"});
        TickRecord a, b;
        for (int k = 0; k < 600; ++k) {
            quick.loop.tick(a);
            slow.loop.tick(b);
            ASSERT_EQ(a.time_s, b.time_s);
            ASSERT_EQ(a.nominal.q, b.nominal.q) << k;
            ASSERT_EQ(a.nominal.qd, b.nominal.qd) << k;
            ASSERT_EQ(a.nominal.qdd, b.nominal.qdd) << k;
            ASSERT_EQ(a.filterTorque, b.filterTorque) << k;
        }
        EXPECT_GT(a.nominal.q.norm(), 1e-3);
    }
}

TEST(Fault25, MissedTicksFollowTheStopHeldReadyAndTheRunGoesOn) {
    for (const int count : {1, 5, 20, 1000})
        for (const char* filter : {kGuaranteeing, "filter={plugin: tosbp}"}) {
            SCOPED_TRACE(std::string(filter) + ", " + std::to_string(count));
            TestLoop t(kTeleoperation, {filter, "duration_s=10"});
            LimitKeeper keeper(t.experiment.cases[0]);
            double moved = 0.0;
            for (int round = 0; round < 3; ++round) {
                for (int k = 0; k < 400; ++k) {
                    t.tick();
                    keeper.add(t.record);
                    ASSERT_FALSE(t.record.missed);
                    ASSERT_NE(t.record.status, FilterStatus::StoppedByPlan);
                }
                for (int k = 0; k < count; ++k) {
                    t.loop.missTick(t.record);
                    keeper.add(t.record);
                    ASSERT_TRUE(t.record.missed);
                    ASSERT_FALSE(t.record.braking);
                    ASSERT_EQ(t.record.status, FilterStatus::StoppedByPlan);
                    ASSERT_TRUE(allFinite(t.record));
                    moved += t.record.nominal.qd.norm();
                }
            }
            if (count == 1000) EXPECT_LT(t.record.nominal.qd.cwiseAbs().maxCoeff(), 1e-9);
            EXPECT_GT(moved, 0.0);
            t.tick();
            EXPECT_EQ(t.loop.stopReason(), StopReason::None) << t.loop.stopMessage();
            keeper.finish(t.loop);
            EXPECT_EQ(keeper.summary().missedTicks(), 3 * count);
        }
}

TEST(Fault25, TooManyInARowBrakeTheArmForGood) {
    TestLoop t(kOneJoint, {kGuaranteeing});
    t.tick(300);
    for (int k = 0; k < kMaxMissedTicks; ++k) t.loop.missTick(t.record);
    EXPECT_EQ(t.loop.stopReason(), StopReason::None);
    EXPECT_FALSE(t.loop.hasStopped());
    t.loop.missTick(t.record);
    EXPECT_EQ(t.loop.stopReason(), StopReason::TicksMissed);
    EXPECT_STREQ(t.loop.stopMessage(), "more than 1000 ticks in a row were missed");
    EXPECT_TRUE(t.loop.hasStopped());

    const CaseResult result = runFirstCase(kOneJoint, {kGuaranteeing, "missed_ticks=[{at_s: 0.3, count: 1200}]"});
    EXPECT_EQ(result.exitCode(), 4);
    EXPECT_EQ(result.stopMessage, "stopped at 1.3000 s (tick 1300) because more than 1000 ticks in a row were missed");
}

TEST(Fault25, TheFileMissesTicksInTheRunAndTheSummaryCountsThem) {
    const CaseResult result =
        runFirstCase(kOneJoint, {kGuaranteeing, "missed_ticks=[{at_s: 0.3, count: 20}, {at_s: 0.5, count: 1}]"});
    EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
    EXPECT_EQ(result.summary.missedTicks(), 21);
    EXPECT_EQ(result.summary.ticksWith(FilterStatus::StoppedByPlan), 21);
    EXPECT_EQ(result.summary.ticks(), 2000);
    EXPECT_CONTAINS(formatDetails(result), "missed ticks 21");
}

const char* const kShrink = "command={plugin: changing_limits, at_s: 0.7, position_share: 0.001, rate_share: 0.8}";

TEST(ChangingLimits, ShrunkBelowTheArmTheyAreReturnedToAndNoGuaranteeIsBroken) {
    const CaseResult result = runFirstCase(kOneJoint, {kShrink, "filter={plugin: certified_braking}"});
    EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
    const Summary& s = result.summary;
    EXPECT_FALSE(s.anyLimitBroken());
    EXPECT_GT(s.recoveringTicks(), 100);
    EXPECT_LT(s.recoveringTicks(), 1300);  // it has come back
    EXPECT_EQ(s.ticksOutside(LimitKind::Position), 0);
    EXPECT_GT(s.limit(LimitKind::Position)[0].ticksRecovering, 50);
    EXPECT_GT(s.limit(LimitKind::Position)[0].worstRecovering, 1e-3);
    EXPECT_LT(s.worstMargin().value, -1e-3);
    EXPECT_EQ(s.unviableTicks(), 0);
}

TEST(ChangingLimits, AFilterThatGuaranteesMustComeBackToThem) {
    TestLoop t(kOneJoint, {kShrink, kGuaranteeing, "duration_s=10"});  // it brakes and stays
    expectStop(t.loop, StopReason::GuaranteeBroken);
    expectContains(t.loop.stopMessage(), {"rad beyond its", "position limit and comes no nearer"});
    EXPECT_GT(t.loop.stopTime(), 1.7);  // braking counts as coming back, then a second of patience
    EXPECT_LT(t.loop.stopTime(), 2.5);
}

TEST(ChangingLimits, AreInForceFromTheirTickOnAndInTheRecord) {
    TestLoop t(kOneJoint, {"command={plugin: changing_limits, at_s: 0.7, rate_share: 2}", kGuaranteeing});
    for (int k = 0; k < 1000; ++k) {
        t.tick();
        ASSERT_NEAR(t.record.limits.jerk.upper[0], (k < 700 ? 4.0 : 8.0) * EIGEN_PI, 1e-12) << k;
        ASSERT_EQ(t.record.verdict, StopVerdict::Safe);
    }
    EXPECT_EQ(t.loop.stopReason(), StopReason::None);
}

TEST(ChangingLimits, ThatAreOfNoUseOrTooMuchForTheFilterStopTheArm) {
    const auto stop = [](const std::vector<std::string>& overrides, StopReason reason, const char* message) {
        TestLoop t(kOneJoint, overrides);
        expectStop(t.loop, reason);
        EXPECT_NEAR(t.loop.stopTime(), 0.7, 1e-9);
        EXPECT_CONTAINS(t.loop.stopMessage(), message);
    };
    for (const char* fault : {"nan", "size"})
        stop({kShrink, kGuaranteeing, std::string("command.fault=") + fault}, StopReason::CommandFailed,
             "the limits that it gave are not usable");
    stop({kShrink, kGuaranteeing, "command.fault=throw"}, StopReason::CommandFailed, "it threw: no limits today");
    stop({kShrink, "filter={plugin: guaranteeing, changes: false}"}, StopReason::FilterFailed,
         "it cannot change its own during a run");
    stop({kShrink, "filter={plugin: tosbp}"}, StopReason::FilterFailed, "cannot change");
}

TEST(Fault28, NoNumberOfOneJointOrAllForOneTickIsReplacedByTheLastGoodTorque) {
    for (const char* joint : {"-1", "0", "3"})
        for (const char* value : {"nan", "inf"}) {
            TestLoop t(kTeleoperation, {std::string("controller={plugin: nan_torque, after_ticks: 100, joint: ") +
                                        joint + ", value: " + value + "}"});
            JointVector before;
            for (int k = 0; k < 300; ++k) {
                t.tick();
                ASSERT_TRUE(allFinite(t.record)) << k;
                if (k == 99) before = t.record.desiredTorque;
                if (k == 100) ASSERT_EQ(t.record.desiredTorque, before);
            }
            EXPECT_EQ(t.record.substituted, 1);
            EXPECT_EQ(t.loop.stopReason(), StopReason::None);
        }
}

TEST(Fault28, NoNumberForGoodBrakesTheArmInsideItsLimits) {
    for (const char* joint : {"-1", "5"})
        for (const char* filter : {kGuaranteeing, "filter={plugin: tosbp}"}) {
            TestLoop t(kTeleoperation, {std::string("controller={plugin: nan_torque, after_ticks: 400, ticks: "
                                                    "100000, joint: ") +
                                            joint + "}",
                                        filter});
            expectKeptStop(t, 5000, StopReason::ControllerFailed);
            EXPECT_NEAR(t.loop.stopTime(), 0.410, 1e-9);
        }
}

TEST(Summary, TellsHowOftenHowLongAndHowMuchALimitActed) {
    JointLimits limits = JointLimits::unlimited(2);
    Summary summary({"a", "b"}, limits, false);
    for (int k = 0; k < 10; ++k) {
        TickRecord r;
        r.time_s = 0.01 * k;
        r.limits = limits;
        for (JointVector* v : {&r.nominal.q, &r.nominal.qd, &r.nominal.qdd, &r.nominal.jerk, &r.removedTorque})
            v->setZero(2);
        r.stops[0] = {k == 4 ? -0.5 : 1.0, 0.1 * k};
        r.stops[1] = {2.0, 0.0};
        r.verdict = k == 4 ? StopVerdict::NoStop : StopVerdict::Safe;
        if (k == 2 || k == 3 || k == 7) {  // two episodes, the longer one of two ticks
            r.joints[1] = {LimitKind::Jerk, LimitSide::Upper};
            r.removedTorque[1] = k == 7 ? -6.0 : 3.0;
        }
        if (k == 8) r.joints[1] = {LimitKind::Jerk, LimitSide::Lower};
        summary.add(r);
    }
    const auto all = summary.interventions();
    ASSERT_EQ(all.size(), 2u);
    const InterventionRecord& upper = all.at({"b", "jerk_upper"});
    EXPECT_EQ(upper.ticks, 3);
    EXPECT_EQ(upper.episodes, 2);
    EXPECT_EQ(upper.longestTicks, 2);
    EXPECT_EQ(upper.largestTorque, 6.0);
    EXPECT_NEAR(upper.torqueRms(), std::sqrt((9.0 + 9.0 + 36.0) / 3.0), 1e-12);
    EXPECT_EQ(all.at({"b", "jerk_lower"}).episodes, 1);
    EXPECT_NEAR(summary.tick_s(), 0.01, 1e-12);
    EXPECT_EQ(summary.worstMargin().value, -0.5);
    EXPECT_EQ(summary.worstMargin().joint, 0);
    EXPECT_NEAR(summary.worstMargin().time_s, 0.04, 1e-12);
    EXPECT_NEAR(summary.longestStop().value, 0.9, 1e-12);
    EXPECT_EQ(summary.unviableTicks(), 1);
    EXPECT_NEAR(summary.firstUnviable_s(), 0.04, 1e-12);
}

}  // namespace
}  // namespace viable::test
