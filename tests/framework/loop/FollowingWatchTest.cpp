#include "loop/FollowingWatch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "TestArm.h"
#include "viable/core/Numbers.h"

namespace viable {
namespace {

using detail::FollowingWatch;
using Cause = FollowingWatch::Cause;

class FollowingWatchTest : public ::testing::Test {
protected:
    FollowingWatchTest() {
        arm_.limits.velocity = {JointVector::Constant(6, -2.0), JointVector::Constant(6, 1.0)};
        begin();
    }
    void begin() {
        setup_.emplace(arm_.setup());
        watch_.begin(*setup_);
        nominal_ = arm_.start;
        real_ = {nominal_.q, nominal_.qd};
        asked_ = given_ = JointVector::Zero(6);
    }
    Cause look() {
        finding_ = watch_.look(real_, nominal_, asked_, given_);
        return finding_.cause;
    }
    /** Time until something is found, at most a second; joint 2 swings about its nominal velocity. */
    double swing(double frequency_hz, double amplitude) {
        for (int tick = 0; tick < 1000; ++tick) {
            real_.qd[2] = nominal_.qd[2] + amplitude * std::sin(2.0 * kPi * frequency_hz * tick * 1e-3 + 0.1);
            if (look() != Cause::None) return tick * 1e-3;
        }
        return kInfinity;
    }

    TestArm arm_{"indy7"};
    std::optional<RunSetup> setup_;
    FollowingWatch watch_;
    MotionState nominal_;
    JointState real_;
    JointVector asked_, given_;
    FollowingWatch::Finding finding_;
};

TEST_F(FollowingWatchTest, AJointThatRunsAwayIsSeenAtItsDistance) {
    const double allowed = FollowingWatch::kLag_s * 2.0;
    real_.q[3] += 0.999 * allowed;
    EXPECT_EQ(look(), Cause::None);
    real_.q[3] = nominal_.q[3] - 1.001 * allowed;
    EXPECT_EQ(look(), Cause::Drift);
    EXPECT_EQ(finding_.joint, 3);
    EXPECT_NEAR(finding_.error, 1.001 * allowed, 1e-12);
    EXPECT_EQ(finding_.allowed, allowed);
}

TEST_F(FollowingWatchTest, AMotorAtItsLimitIsTheCause) {
    asked_[1] = -arm_.robot.actuation.torqueLimit[1];
    given_ = asked_;
    for (int tick = 0; tick < 150; ++tick) EXPECT_EQ(look(), Cause::None);
    real_.q[4] += 1.0;
    EXPECT_EQ(look(), Cause::Saturation);
    EXPECT_EQ(finding_.joint, 4);
    EXPECT_EQ(finding_.motor, 1);
    // A weaker motor than is stated gives less than is asked for.
    begin();
    asked_[5] = 10.0;
    given_[5] = 5.0;
    for (int tick = 0; tick < 150; ++tick) look();
    real_.q[4] += 1.0;
    EXPECT_EQ(look(), Cause::Weakness);
    EXPECT_EQ(finding_.motor, 5);
}

TEST_F(FollowingWatchTest, OscillationIsSeenWithin50Milliseconds) {
    for (const double frequency : {60.0, 120.0, 250.0, 400.0})
        for (const bool isAtLimit : {false, true}) {
            begin();
            if (isAtLimit) asked_[2] = given_[2] = arm_.robot.actuation.torqueLimit[2];
            EXPECT_LE(swing(frequency, isAtLimit ? 3.0 : 12.0), 0.05) << frequency;
            EXPECT_EQ(finding_.cause, Cause::Oscillation);
            EXPECT_EQ(finding_.joint, 2);
        }
}

TEST_F(FollowingWatchTest, WhatIsSlowOrSmallOrACountIsNoOscillation) {
    for (const auto& [frequency, amplitude] : {std::pair(5.0, 6.0), std::pair(15.0, 6.0), std::pair(200.0, 3.5)}) {
        begin();
        EXPECT_EQ(swing(frequency, amplitude), kInfinity) << frequency << " " << amplitude;
    }
    // A slow joint.
    arm_.limits.velocity = {JointVector::Constant(6, -0.01), JointVector::Constant(6, 0.01)};
    begin();
    EXPECT_EQ(swing(250.0, 0.4), kInfinity);
    // Coarse encoders: their counts in a tick are larger than twice the velocity limit.
    arm_.robot.actuation.encoderCounts.setConstant(6, 4096.0);
    arm_.limits.velocity = {JointVector::Constant(6, -0.1), JointVector::Constant(6, 0.1)};
    begin();
    EXPECT_EQ(swing(250.0, 3.9 * arm_.robot.encoderStep(2) / 1e-3), kInfinity);
}

// White noise of the reading changes the sign of the velocity nearly every tick.
TEST_F(FollowingWatchTest, NoiseOfTheEncoderIsNoOscillation) {
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0.0, 1e-4);
    double last = 0.0;
    for (int tick = 0; tick < 20000; ++tick) {
        const double reading = noise(random);
        real_.qd[1] = (reading - last) / 1e-3;
        last = reading;
        ASSERT_EQ(look(), Cause::None) << tick;
    }
}

TEST_F(FollowingWatchTest, ASlowJointMayBeAwayByWhatFrictionMakes) {
    arm_.limits.velocity = {JointVector::Constant(6, -0.01), JointVector::Constant(6, 0.01)};
    begin();
    real_.q[0] += 0.049;
    EXPECT_EQ(look(), Cause::None);
    EXPECT_FALSE(watch_.runsAway(real_, nominal_));
    real_.q[0] += 0.052;
    EXPECT_EQ(look(), Cause::Drift);
    EXPECT_TRUE(watch_.runsAway(real_, nominal_));
}

TEST_F(FollowingWatchTest, LimitsThatBecomeWiderCountFromThenOn) {
    JointLimits wide = arm_.limits;
    wide.velocity.upper.setConstant(6, 10.0);
    watch_.widen(wide);
    real_.q[0] += 1.4;
    EXPECT_EQ(look(), Cause::None);
    watch_.widen(arm_.limits);  // tighter ones do not
    EXPECT_EQ(look(), Cause::None);
}

TEST_F(FollowingWatchTest, WithoutVelocityLimitsTheRangeCounts) {
    arm_.limits.velocity = JointLimits::unlimited(6).velocity;
    arm_.limits.position = {JointVector::Constant(6, -1.0), JointVector::Constant(6, 1.0)};
    arm_.limits.position.upper[5] = kInfinity;
    begin();
    real_.q[0] += 0.19;
    real_.q[5] += 0.9;
    EXPECT_EQ(look(), Cause::None);
    real_.q[0] += 0.02;
    EXPECT_EQ(look(), Cause::Drift);
    EXPECT_EQ(finding_.joint, 0);
}

}  // namespace
}  // namespace viable
