#include "summary/SpeedCounter.h"

#include <gtest/gtest.h>

#include "viable/testing/TwoLinkArm.h"

namespace viable {
namespace {

/** Rows of an arm whose first joint turns at 1 rad/s; in a row that is missed the reading is the one before. */
Speeds judge(const std::vector<bool>& missed) {
    RobotDescription robot = testing::makeTwoLinkArm();
    robot.speedLimits.tool = 10.0;
    detail::SpeedCounter counter(robot, nullptr, true);
    TickRecord row;
    for (std::size_t k = 0; k < missed.size(); ++k) {
        row.time_s = 1e-3 * static_cast<double>(k);
        row.missed = missed[k];
        row.nominal.q = row.nominal.qd = JointVector::Zero(2);
        row.nominal.q[0] = row.time_s;
        row.nominal.qd[0] = 1.0;
        if (!row.missed) row.actual = {row.nominal.q, row.nominal.qd};
        counter.add(row);
    }
    return counter.speeds();
}

TEST(SpeedCounter, AReadingThatStandsThereAgainIsNoJump) {
    const Speeds all = judge({false, false, false, false, false, false, false});
    const Speeds late = judge({false, false, true, true, true, false, false});
    ASSERT_TRUE(all.real && late.real);
    EXPECT_GT(all.real->largest, 0.1);
    EXPECT_NEAR(all.real->largest, all.nominal.largest, 1e-12);
    EXPECT_NEAR(late.real->largest, all.real->largest, 1e-9);
    EXPECT_EQ(all.real->ticks, 6);
    EXPECT_EQ(late.real->ticks, 3);
    EXPECT_EQ(late.nominal.ticks, 6);
}

}  // namespace
}  // namespace viable
