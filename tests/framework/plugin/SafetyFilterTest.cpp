#include "viable/plugin/SafetyFilter.h"

#include <gtest/gtest.h>

#include <random>

namespace viable {
namespace {

JointVector makeRandom(int n, double size, std::mt19937& random) {
    std::uniform_real_distribution<double> number(-size, size);
    JointVector v(n);
    for (int i = 0; i < n; ++i) v[i] = number(random);
    return v;
}

struct Arm {
    MotionState nominal;
    Dynamics dynamics;
};

Arm makeRandomArm(int n, std::mt19937& random) {
    Arm arm;
    arm.nominal = {makeRandom(n, 3, random), makeRandom(n, 2, random), makeRandom(n, 12, random)};
    JointMatrix root(n, n);
    for (int i = 0; i < n; ++i) root.col(i) = makeRandom(n, 1, random);
    arm.dynamics.M = root * root.transpose() + JointMatrix::Identity(n, n);
    arm.dynamics.b = makeRandom(n, 50, random);
    return arm;
}

// M x + b, joint by joint.
double calcTorque(const Dynamics& dynamics, const JointVector& acceleration, int joint) {
    double torque = dynamics.b[joint];
    for (int k = 0; k < acceleration.size(); ++k) torque += dynamics.M(joint, k) * acceleration[k];
    return torque;
}

constexpr double kTick_s = 0.001;

TEST(SafetyFilter, NamesOfStatusesAreThoseOfTheLogs) {
    EXPECT_STREQ(getName(FilterStatus::Passed), "passed");
    EXPECT_STREQ(getName(FilterStatus::Modified), "modified");
    EXPECT_STREQ(getName(FilterStatus::StoppedByPlan), "stopped_by_plan");
    EXPECT_STREQ(getName(FilterStatus::Infeasible), "infeasible");
    EXPECT_STREQ(getName(FilterStatus::InvalidInput), "invalid_input");
    EXPECT_STREQ(getName(FilterStatus::Faulted), "faulted");
    EXPECT_STREQ(getName(FilterStatus::Ended), "ended");
}

TEST(SafetyFilter, HoldJerkGivesTheMeanAccelerationAndItsTorque) {
    std::mt19937 random(1);
    for (int n = 1; n <= kMaxJoints; ++n) {
        const Arm arm = makeRandomArm(n, random);
        const JointVector jerk = makeRandom(n, 40, random);
        FilterDecision decision;
        holdJerk(arm.nominal, arm.dynamics, jerk, kTick_s, decision);
        EXPECT_EQ(decision.held, HeldQuantity::Jerk);
        EXPECT_EQ(decision.jerk, jerk);
        for (int i = 0; i < n; ++i) {
            // The mean over the tick of qdd + jerk t, as the mean of its two ends.
            const double end = arm.nominal.qdd[i] + jerk[i] * kTick_s;
            EXPECT_NEAR(decision.acceleration[i], (arm.nominal.qdd[i] + end) / 2, 1e-13);
            EXPECT_NEAR(decision.torque[i], calcTorque(arm.dynamics, decision.acceleration, i), 1e-11);
        }
    }
}

TEST(SafetyFilter, HoldAccelerationGivesTheJerkThatLeadsThereInOneTick) {
    std::mt19937 random(2);
    for (int n = 1; n <= kMaxJoints; ++n) {
        const Arm arm = makeRandomArm(n, random);
        const JointVector acceleration = makeRandom(n, 12, random);
        FilterDecision decision;
        holdAcceleration(arm.nominal, arm.dynamics, acceleration, kTick_s, decision);
        EXPECT_EQ(decision.held, HeldQuantity::Acceleration);
        EXPECT_EQ(decision.acceleration, acceleration);
        for (int i = 0; i < n; ++i) {
            EXPECT_NEAR(arm.nominal.qdd[i] + decision.jerk[i] * kTick_s, acceleration[i], 1e-12);
            EXPECT_NEAR(decision.torque[i], calcTorque(arm.dynamics, acceleration, i), 1e-11);
        }
    }
}

TEST(SafetyFilter, HoldingTheDesiredAccelerationGivesTheDesiredTorqueBack) {
    std::mt19937 random(3);
    const Arm arm = makeRandomArm(6, random);
    const JointVector torque = makeRandom(6, 100, random);
    const JointVector desired = arm.dynamics.M.llt().solve(torque - arm.dynamics.b);
    FilterDecision decision;
    holdAcceleration(arm.nominal, arm.dynamics, desired, kTick_s, decision);
    EXPECT_LT((decision.torque - torque).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(SafetyFilter, ArgumentsMayBePartsOfTheDecision) {
    std::mt19937 random(4);
    const Arm arm = makeRandomArm(4, random);
    const JointVector input = makeRandom(4, 5, random);
    FilterDecision expected, decision;

    holdJerk(arm.nominal, arm.dynamics, input, kTick_s, expected);
    for (JointVector FilterDecision::*part :
         {&FilterDecision::torque, &FilterDecision::acceleration, &FilterDecision::jerk}) {
        decision.*part = input;
        holdJerk(arm.nominal, arm.dynamics, decision.*part, kTick_s, decision);
        EXPECT_EQ(decision.torque, expected.torque);
        EXPECT_EQ(decision.jerk, expected.jerk);
    }
    holdAcceleration(arm.nominal, arm.dynamics, input, kTick_s, expected);
    for (JointVector FilterDecision::*part :
         {&FilterDecision::torque, &FilterDecision::acceleration, &FilterDecision::jerk}) {
        decision.*part = input;
        holdAcceleration(arm.nominal, arm.dynamics, decision.*part, kTick_s, decision);
        EXPECT_EQ(decision.torque, expected.torque);
        EXPECT_EQ(decision.jerk, expected.jerk);
    }
}

TEST(SafetyFilter, InterventionsAreLeftAsTheyAre) {
    std::mt19937 random(5);
    const Arm arm = makeRandomArm(2, random);
    FilterDecision decision;
    decision.joints[1] = {LimitKind::Velocity, LimitSide::Upper};
    holdJerk(arm.nominal, arm.dynamics, makeRandom(2, 1, random), kTick_s, decision);
    EXPECT_EQ(decision.joints[0].limit, LimitKind::None);
    EXPECT_EQ(decision.joints[1].limit, LimitKind::Velocity);
    EXPECT_EQ(decision.joints[1].side, LimitSide::Upper);
}

}  // namespace
}  // namespace viable
