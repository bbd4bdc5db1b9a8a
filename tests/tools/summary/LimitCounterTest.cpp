#include "summary/LimitCounter.h"

#include <gtest/gtest.h>

#include "limits/PointSpeedLimit.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable {
namespace {

/** Rows of an arm whose first joint has so many rad/s in each of them; in those of `late` the reading is the one before. */
LimitAccount countLimit(const std::vector<double>& velocity, const std::vector<bool>& late) {
    RobotDescription robot = testing::makeTwoLinkArm();
    robot.speedLimits.tool = 10.0;
    detail::LimitCounter counter(LimitKind::Speed, std::make_unique<detail::PointSpeedLimit>(robot, nullptr), true);
    TickRecord row;
    row.nominal.q = row.nominal.qd = JointVector::Zero(2);
    for (std::size_t k = 0; k < velocity.size(); ++k) {
        row.time_s = 1e-3 * static_cast<double>(k);
        if (k > 0) row.nominal.q[0] += 0.5e-3 * (velocity[k - 1] + velocity[k]);
        row.nominal.qd[0] = velocity[k];
        row.missed = late[k];
        row.hasReading = !late[k];
        if (row.hasReading) row.actual = {row.nominal.q, row.nominal.qd};
        counter.add(row);
    }
    return counter.account();
}

TEST(LimitCounter, AReadingThatStandsThereAgainIsNoJump) {
    const std::vector<double> velocity(7, 1.0);
    const LimitAccount all = countLimit(velocity, std::vector<bool>(7, false));
    const LimitAccount late = countLimit(velocity, {false, false, true, true, true, false, false});
    ASSERT_TRUE(all.real && late.real);
    EXPECT_GT(all.real->largest, 0.1);
    EXPECT_NEAR(all.real->largest, all.nominal.largest, 1e-12);
    EXPECT_NEAR(late.real->largest, all.real->largest, 1e-9);
    EXPECT_EQ(all.real->ticks, 6);
    EXPECT_EQ(late.real->ticks, 3);
    EXPECT_EQ(late.nominal.ticks, 6);
}

TEST(LimitCounter, NothingIsMadeUpForAGap) {
    std::vector<double> velocity(120, 1.0);  // it coasts, and brakes in the last part of the gap
    for (std::size_t k = 100; k < velocity.size(); ++k) velocity[k] = 1.0 - 0.05 * static_cast<double>(k - 99);
    std::vector<bool> late(velocity.size(), true);
    late.front() = late.back() = false;
    late[1] = false;
    const LimitAccount found = countLimit(velocity, late);
    EXPECT_NEAR(found.real->largest, found.nominal.largest, 1e-9);
    EXPECT_LE(found.real->worst, found.nominal.worst + 1e-12);
}

}  // namespace
}  // namespace viable
