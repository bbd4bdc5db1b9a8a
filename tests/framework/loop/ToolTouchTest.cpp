#include "loop/ToolTouch.h"

#include <gtest/gtest.h>

#include "TestArm.h"

namespace viable {
namespace {

/** An arm at rest that is to press with 20 N, and whose sensors feel a force from below. */
class ToolTouchTest : public testing::Test {
protected:
    /** @param gives  so much more can the second motor press with [N]; beyond half of what it can at all, pressing relieves it */
    void feel(double force, double gives, int ticks = 1) {
        const JointVector pull = arm_.calcDynamics(arm_.start).J.row(2).transpose();
        JointVector driving = JointVector::Zero(arm_.size());
        driving[1] = gives * pull[1] - std::copysign(motor_, pull[1]);
        most_ = 2.0 * motor_ / std::abs(pull[1]);
        for (int k = 0; k < ticks; ++k)
            touch_.update({arm_.start.q, arm_.start.qd}, force * pull, JointVector::Constant(arm_.size(), kInfinity),
                          driving);
        touch_.fill(record_);
    }

    TestArm arm_{"indy7"};
    const double motor_ = arm_.robot.actuation.torqueLimit[1];
    double most_ = 0.0;
    TickRecord::Touch record_;
    detail::ToolTouch touch_{arm_.setup(), 20.0, nullptr};
};

TEST_F(ToolTouchTest, AMotorThatPressingRelievesGivesAll) {
    feel(30.0, 10.0);
    EXPECT_NEAR(record_.asked, 6.0, 1e-4);
    feel(30.0, most_ - 10.0);
    EXPECT_EQ(record_.asked, 20.0);
}

TEST_F(ToolTouchTest, WhatTheJointsMayHardlyPressWithIsNoContact) {
    feel(10.0, 0.5);
    EXPECT_FALSE(touch_.isOn()) << "asked for 0.3 N";
    feel(10.0, 5.0, 2);
    EXPECT_TRUE(touch_.isOn() && !touch_.hasLost());
    feel(0.3, 0.5, 102);
    EXPECT_TRUE(touch_.hasLost());
}

}  // namespace
}  // namespace viable
