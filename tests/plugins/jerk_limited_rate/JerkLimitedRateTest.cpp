#include "JerkLimitedRate.h"

#include "LawBench.h"

namespace viable {
namespace {

constexpr double dt = 1e-3;

using Bench = LawBench<JerkLimitedRate>;

double clip(double x, double low, double high) {
    return std::max(low, std::min(x, high));
}

/** The published rule, as it is printed: the next velocity. */
double limitVelocity(double command, double v, double a, double V, double A, double J) {
    const double jerk = clip(((command - v) / dt - a) / dt, -J, J);
    const double most = std::min(J / A * (V - v), A), least = std::max(J / A * (-V - v), -A);
    return v + clip(a + jerk * dt, least, most) * dt;
}

TEST(JerkLimitedRate, IsThePublishedRule) {
    Bench bench("single_joint", "jerk_limited_rate");
    const double V = 2 * kPi, A = 3 * kPi, J = 4 * kPi;
    std::mt19937 random(71);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    int limits[5] = {};
    for (int k = 0; k < 20000; ++k) {
        const double a = A * unit(random);
        const AxisState s{unit(random), V * unit(random), k % 4 < 2 ? a : std::copysign(A, a)};
        const double desired = s.a + (k % 2 ? 1e-2 : 10.0) * unit(random);
        FilterDecision d;
        const FilterStatus status = bench.decide("", s, desired, d);
        ASSERT_EQ(d.held, HeldQuantity::Acceleration);
        ASSERT_NEAR(s.v + d.value[0] * dt, limitVelocity(s.v + desired * dt, s.v, s.a, V, A, J), 1e-13);
        EXPECT_EQ(status == FilterStatus::Passed, d.value[0] == desired);
        EXPECT_EQ(status == FilterStatus::Passed, d.joints[0].limit == LimitKind::None);
        if (std::abs(s.a) <= J / A * (V - std::abs(s.v))) {  // where the rule itself leads
            EXPECT_EQ(d.joints[0].side == LimitSide::Upper, d.value[0] < desired);
        }
        ++limits[static_cast<int>(d.joints[0].limit)];
    }
    for (const LimitKind kind : {LimitKind::None, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
        EXPECT_GT(limits[static_cast<int>(kind)], 10) << getName(kind, LimitSide::Upper);
    EXPECT_EQ(limits[static_cast<int>(LimitKind::Position)], 0);
}

TEST(JerkLimitedRate, VelocityAccelerationAndJerkHoldUnderRandomLimitsOfEitherSide) {
    Bench bench("single_joint", "jerk_limited_rate");
    std::mt19937 random(25);
    for (unsigned k = 0; k < 200; ++k) {
        bench.drawLimits(random);
        const LawOutcome outcome = bench.push("", 20.0, 3.0 * bench.arm.limits.acceleration.upper[0], k % 2 == 0, k);
        SCOPED_TRACE("limits " + std::to_string(k));
        EXPECT_LE(outcome.excess.velocity, 1e-9);
        EXPECT_LE(outcome.excess.acceleration, 1e-9);
        EXPECT_LE(outcome.excess.jerk, 1e-9);
        EXPECT_EQ(outcome.infeasible, 0);
        EXPECT_EQ(outcome.allocations, 0);
        EXPECT_GT(outcome.modified, 100);
        ASSERT_FALSE(HasFailure());
    }
}

TEST(JerkLimitedRate, TheSameOnTheArmAndThePositionIsNotItsBusiness) {
    Bench bench("indy7", "jerk_limited_rate");
    setPaperLimits(bench.arm);
    const LawOutcome outcome = bench.push("", 10.0, 40.0, true, 8);
    EXPECT_LE(outcome.excess.velocity, 1e-9);
    EXPECT_LE(outcome.excess.acceleration, 1e-9);
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_EQ(outcome.allocations, 0);
    EXPECT_GT(outcome.excess.position, 0.5);
}

TEST(JerkLimitedRate, ApproachesAVelocityLimitWithoutPassingIt) {
    Bench bench("single_joint", "jerk_limited_rate");
    bench.arm.limits.position = {JointVector::Constant(1, -kInfinity), JointVector::Constant(1, kInfinity)};
    const LawOutcome outcome = bench.run("", 10.0, [](const MotionState&) { return JointVector::Constant(1, 100.0); });
    EXPECT_EQ(outcome.excess.velocity, 0.0);
    EXPECT_NEAR(outcome.end.qd[0], 2 * kPi, 1e-4);
}

TEST(JerkLimitedRate, AdmissibleTorquePassesBitForBit) {
    Bench bench("indy7", "jerk_limited_rate");
    const auto filter = bench.make();
    std::mt19937 random(5);
    for (int k = 0; k < 200; ++k) {
        const MotionState state = makeRandomState(bench.arm, 0.2, 0.2, 1.0, random);
        const Dynamics dynamics = bench.arm.calcDynamics(state);
        JointVector torque;
        calcInverseDynamics(dynamics, state.qdd + makeRandomVector(6, 0.01, random), torque);
        FilterDecision decision;
        ASSERT_EQ(filter->filter({state, torque, dynamics}, decision), FilterStatus::Passed);
        ASSERT_EQ(calcTorque({state, torque, dynamics}, FilterStatus::Passed, decision), torque);
    }
}

TEST(JerkLimitedRate, UnlimitedAccelerationOrJerkIsRefused) {
    Bench bench("single_joint", "jerk_limited_rate");
    bench.arm.limits.acceleration.upper[0] = kInfinity;
    EXPECT_CONTAINS(bench.findConfigureComplaint(""), "needs finite acceleration and jerk limits");
    bench.arm.limits.acceleration.upper[0] = 1.0;
    bench.arm.limits.jerk.lower[0] = -kInfinity;
    EXPECT_CONTAINS(bench.findConfigureComplaint(""), "experiment.yaml:1:");
}

TEST(JerkLimitedRate, LoadsAsALibrary) {
    expectSameAsLibrary<JerkLimitedRate>("jerk_limited_rate");
}

}  // namespace
}  // namespace viable
