#include "TestArm.h"

namespace viable {
namespace {

struct Arm {
    MotionState nominal;
    Dynamics dynamics;
};

Arm makeRandomArm(int n, std::mt19937& random) {
    Arm arm;
    arm.nominal = {makeRandomVector(n, 3, random), makeRandomVector(n, 2, random), makeRandomVector(n, 12, random)};
    JointMatrix root(n, n);
    for (int i = 0; i < n; ++i) root.col(i) = makeRandomVector(n, 1, random);
    arm.dynamics.M = root * root.transpose() + JointMatrix::Identity(n, n);
    arm.dynamics.b = makeRandomVector(n, 50, random);
    arm.dynamics.gravity.setZero(n);
    arm.dynamics.J.setZero(6, n);
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

/** What the host makes of a decision about that arm. */
HeldMotion calcMotion(const Arm& arm, const FilterDecision& decision, FilterStatus status = FilterStatus::Modified,
                      const JointVector& torque = {}) {
    HeldMotion motion;
    calcHeldMotion({arm.nominal, torque, arm.dynamics}, status, decision, kTick_s, motion);
    return motion;
}

TEST(SafetyFilter, AHeldJerkOrAccelerationGivesTheOtherAndItsTorque) {
    std::mt19937 random(1);
    for (int n = 1; n <= kMaxJoints; ++n) {
        const Arm arm = makeRandomArm(n, random);
        const JointVector jerk = makeRandomVector(n, 40, random), acceleration = makeRandomVector(n, 12, random);
        FilterDecision first, second;
        first.holdJerk(jerk);
        second.holdAcceleration(acceleration);
        EXPECT_EQ(first.held, HeldQuantity::Jerk);
        EXPECT_EQ(second.held, HeldQuantity::Acceleration);
        const HeldMotion mean = calcMotion(arm, first), led = calcMotion(arm, second);
        EXPECT_EQ(mean.jerk, jerk);
        EXPECT_EQ(led.acceleration, acceleration);
        for (int i = 0; i < n; ++i) {
            // The mean over the tick of qdd + jerk t, as the mean of its two ends.
            const double end = arm.nominal.qdd[i] + jerk[i] * kTick_s;
            EXPECT_NEAR(mean.acceleration[i], (arm.nominal.qdd[i] + end) / 2, 1e-13);
            EXPECT_NEAR(mean.torque[i], calcTorque(arm.dynamics, mean.acceleration, i), 1e-11);
            EXPECT_NEAR(arm.nominal.qdd[i] + led.jerk[i] * kTick_s, acceleration[i], 1e-12);
            EXPECT_NEAR(led.torque[i], calcTorque(arm.dynamics, acceleration, i), 1e-11);
        }
    }
}

TEST(SafetyFilter, ThePassedTorqueIsTheDesiredOneToTheLastBit) {
    std::mt19937 random(3);
    int differs = 0;
    for (int trial = 0; trial < 100; ++trial) {
        const Arm arm = makeRandomArm(6, random);
        const JointVector torque = makeRandomVector(6, 100, random);
        FilterDecision decision;
        decision.holdAcceleration(arm.dynamics.M.llt().solve(torque - arm.dynamics.b));
        EXPECT_EQ(calcMotion(arm, decision, FilterStatus::Passed, torque).torque, torque);
        const JointVector computed = calcMotion(arm, decision, FilterStatus::Modified, torque).torque;
        EXPECT_LT((computed - torque).cwiseAbs().maxCoeff(), 1e-10);
        differs += computed != torque;
    }
    EXPECT_GT(differs, 0);  // else this says nothing
}

TEST(SafetyFilter, AWrongPassedDoesNotPartTheTorqueFromTheMotion) {
    std::mt19937 random(4);
    const Arm arm = makeRandomArm(6, random);
    const JointVector torque = makeRandomVector(6, 100, random);
    FilterDecision decision;
    decision.holdAcceleration(makeRandomVector(6, 12, random));
    EXPECT_EQ(calcMotion(arm, decision, FilterStatus::Passed, torque).torque, calcMotion(arm, decision).torque);
    decision.holdJerk(makeRandomVector(6, 40, random));
    EXPECT_EQ(calcMotion(arm, decision, FilterStatus::Passed, torque).torque, calcMotion(arm, decision).torque);
}

TEST(SafetyFilter, HoldingLeavesInterventionsAsTheyAre) {
    std::mt19937 random(5);
    FilterDecision decision;
    decision.joints[1] = {LimitKind::Velocity, LimitSide::Upper};
    decision.holdJerk(makeRandomVector(2, 1, random));
    EXPECT_EQ(decision.joints[0].limit, LimitKind::None);
    EXPECT_EQ(decision.joints[1].limit, LimitKind::Velocity);
    EXPECT_EQ(decision.joints[1].side, LimitSide::Upper);
}

TEST(SafetyFilter, InputsAreCheckedInEveryPart) {
    std::mt19937 random(6);
    const Arm arm = makeRandomArm(3, random);
    const JointVector good = makeRandomVector(3, 1, random), wrongSize = makeRandomVector(2, 1, random);
    EXPECT_TRUE(isFinite(FilterInput{arm.nominal, good, arm.dynamics, nullptr}, 3));
    EXPECT_TRUE(isFinite(FilterInput{arm.nominal, good, arm.dynamics, &good}, 3));
    EXPECT_FALSE(isFinite(FilterInput{arm.nominal, wrongSize, arm.dynamics, &good}, 3));
    EXPECT_FALSE(isFinite(FilterInput{arm.nominal, good, arm.dynamics, &wrongSize}, 3));
    EXPECT_FALSE(isFinite(FilterInput{arm.nominal, good, arm.dynamics, &good}, 2));
}

}  // namespace
}  // namespace viable
