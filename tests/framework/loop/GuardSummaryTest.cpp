#include "viable/loop/GuardSummary.h"

#include <gtest/gtest.h>

#include "Joints.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

/** Two joints at rest in the middle of limits of 1, 2, 3 and 4. */
TickRecord makeRecord(double time_s) {
    TickRecord record;
    record.time_s = time_s;
    record.nominal = {joints(0, 0), joints(0, 0), joints(0, 0), joints(0, 0)};
    record.limits.position = {joints(-1, -1), joints(1, 1)};
    record.limits.velocity = {joints(-2, -2), joints(2, 2)};
    record.limits.acceleration = {joints(-3, -3), joints(3, 3)};
    record.limits.jerk = {joints(-4, -4), joints(4, 4)};
    record.verdict = StopVerdict::Safe;
    return record;
}

TEST(GuardSummary, TellsTheWorstUseOfEachLimitAndItsJoint) {
    GuardSummary summary(2);
    TickRecord record = makeRecord(0.0);
    record.nominal = {joints(0.5, -0.25), joints(-1, 1.5), joints(0, 3), joints(-1, 2)};
    summary.add(record);
    summary.add(makeRecord(0.001));
    EXPECT_EQ(summary.ticks(), 2);
    EXPECT_FALSE(summary.anyLimitBroken());
    EXPECT_DOUBLE_EQ(summary.limit(LimitKind::Position)[0].worstUse, 0.5);
    EXPECT_DOUBLE_EQ(summary.limit(LimitKind::Velocity)[1].worstUse, 0.75);
    EXPECT_EQ(summary.limit(LimitKind::Velocity)[1].worstTime_s, 0.0);
    EXPECT_DOUBLE_EQ(summary.limit(LimitKind::Acceleration)[1].worstUse, 1.0);
    EXPECT_EQ(summary.worstJoint(LimitKind::Position), 0);
    EXPECT_EQ(summary.worstJoint(LimitKind::Jerk), 1);
    EXPECT_EQ(summary.ticksOutside(LimitKind::Acceleration), 0);
}

TEST(GuardSummary, CountsTicksOutsideAndTheEnd) {
    GuardSummary summary(2);
    TickRecord record = makeRecord(0.0);
    record.nominal.jerk = joints(4.1, 5.0);
    summary.add(record);
    EXPECT_TRUE(summary.anyLimitBroken());
    EXPECT_EQ(summary.ticksOutside(LimitKind::Jerk), 2);
    EXPECT_EQ(summary.ticksOutside(LimitKind::Position), 0);
    summary.addEnd({joints(1.1, 0), joints(0, 0), joints(0, 0)}, 0.001);
    EXPECT_EQ(summary.ticksOutside(LimitKind::Position), 1);
    EXPECT_EQ(summary.ticks(), 1);
}

TEST(GuardSummary, AnArmThatRecoversBreaksNothing) {
    GuardSummary summary(2);
    TickRecord record = makeRecord(0.0);
    record.nominal.q = joints(1.5, 0);
    record.verdict = StopVerdict::Recovering;
    summary.add(record);
    EXPECT_FALSE(summary.anyLimitBroken());
    EXPECT_EQ(summary.ticksOutside(LimitKind::Position), 0);
    EXPECT_EQ(summary.limit(LimitKind::Position)[0].ticksRecovering, 1);
    record.verdict = StopVerdict::Safe;
    summary.add(record);
    EXPECT_TRUE(summary.anyLimitBroken());
}

TEST(GuardSummary, TellsHowFarTheRealArmWasAndTakesNoMemory) {
    GuardSummary summary(2);
    TickRecord record = makeRecord(0.0);
    summary.add(record);
    EXPECT_EQ(summary.trackingMax(), 0.0);  // no real arm
    record.actual.q = joints(9, 9);
    record.hasReading = false;
    summary.add(record);
    EXPECT_EQ(summary.trackingMax(), 0.0);
    record.hasReading = true;
    record.actual.q = joints(0.01, -0.02);
    const testing::AllocationCounter counter;
    summary.add(record);
    if (testing::AllocationCounter::isAvailable()) EXPECT_EQ(counter.count(), 0);
    EXPECT_DOUBLE_EQ(summary.trackingMax(), 0.02);
}

}  // namespace
}  // namespace viable::test
