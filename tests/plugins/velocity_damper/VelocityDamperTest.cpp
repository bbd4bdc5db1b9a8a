#include "VelocityDamper.h"

#include "LawBench.h"

namespace viable {
namespace {

constexpr double dt = 1e-3;

using Bench = LawBench<VelocityDamper>;

const char* const kZone = "xi: 0.8, influence_rad: 0.3, safety_rad: 0.05, gamma: 100";

/** v+ of a decision. */
double calcNext(const AxisState& s, const FilterDecision& d) {
    return s.v + s.a * dt + d.value[0] * dt * dt / 2;
}

TEST(VelocityDamper, VelocityAfterTheTickIsThatOfTheDamper) {
    Bench bench("single_joint", "velocity_damper");
    std::mt19937 random(61);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    for (int k = 0; k < 2000; ++k) {
        const double d = 0.3 * unit(random), a = 6.0 * (unit(random) - 0.5);
        const double allowed = 0.8 * (d - 0.05) / (0.3 - 0.05);
        // A velocity that some jerk within the limits brings to the allowed one.
        const double jerk = 12.0 * (2 * unit(random) - 1);
        const AxisState s{kPi - d, allowed - a * dt - jerk * dt * dt / 2, a};
        FilterDecision decision;
        ASSERT_EQ(bench.decide(kZone, s, 1e3, decision), FilterStatus::Modified);
        EXPECT_NEAR(decision.value[0], jerk, 1e-6);
        EXPECT_NEAR(calcNext(s, decision), allowed, 1e-12);
        EXPECT_EQ(decision.joints[0].limit, LimitKind::Position);
        EXPECT_EQ(decision.joints[0].side, LimitSide::Upper);
        const AxisState mirror{-s.p, -s.v, -s.a};
        ASSERT_EQ(bench.decide(kZone, mirror, -1e3, decision), FilterStatus::Modified);
        EXPECT_NEAR(calcNext(mirror, decision), -allowed, 1e-12);
        EXPECT_EQ(decision.joints[0].side, LimitSide::Lower);
    }
}

TEST(VelocityDamper, OutsideTheZoneOnlyTheOtherLimitsAct) {
    Bench bench("single_joint", "velocity_damper");
    FilterDecision d;
    // Nearer than the influence distance the same velocity is too much.
    EXPECT_EQ(bench.decide(kZone, {kPi - 0.301, 2.0, 0.0}, 0.0, d), FilterStatus::Passed);
    EXPECT_EQ(bench.decide(kZone, {kPi - 0.299, 2.0, 0.0}, 0.0, d), FilterStatus::Infeasible);
    bench.decide(kZone, {0, 0, 0}, 1e3, d);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Jerk);
    EXPECT_EQ(d.value[0], 4 * kPi);
    bench.decide(kZone, {0, 0, 3 * kPi - 0.002}, 1e3, d);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Acceleration);
    EXPECT_NEAR(d.value[0], 2.0, 1e-9);
    const AxisState fast{0, 2 * kPi - 0.001 - 1e-6, 1.0};
    bench.decide(kZone, fast, 1e3, d);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Velocity);
    EXPECT_NEAR(calcNext(fast, d), 2 * kPi, 1e-12);
}

TEST(VelocityDamper, WhereTheVelocityCannotBeHadItBrakesAndSaysSo) {
    Bench bench("single_joint", "velocity_damper");
    FilterDecision d;
    EXPECT_EQ(bench.decide(kZone, {kPi - 0.1, 3.0, 0.0}, 0.0, d), FilterStatus::Infeasible);
    EXPECT_EQ(d.value[0], -4 * kPi);
    EXPECT_EQ(bench.decide(kZone, {-kPi + 0.1, -3.0, 0.0}, 0.0, d), FilterStatus::Infeasible);
    EXPECT_EQ(d.value[0], 4 * kPi);
    // As far as the acceleration limit lets it.
    EXPECT_EQ(bench.decide(kZone, {kPi - 0.1, 5.0, -3 * kPi + 0.001}, 0.0, d), FilterStatus::Infeasible);
    EXPECT_NEAR(d.value[0], -1.0, 1e-9);
    // Braking so hard that the velocity would fall below the allowed one before a = 0: it lets go in time.
    EXPECT_EQ(bench.decide(kZone, {kPi - 0.1, 2.0, -3 * kPi}, 0.0, d), FilterStatus::Infeasible);
    EXPECT_EQ(d.value[0], 4 * kPi);
    // At rest inside the safety distance: led away, at either limit.
    EXPECT_EQ(bench.decide(kZone, {kPi - 0.01, 0.0, 0.0}, 0.0, d), FilterStatus::Infeasible);
    EXPECT_EQ(d.value[0], -4 * kPi);
    EXPECT_EQ(bench.decide(kZone, {-kPi + 0.01, 0.0, 0.0}, 0.0, d), FilterStatus::Infeasible);
    EXPECT_EQ(d.value[0], 4 * kPi);
    // Too fast away from a limit that has been passed far: the velocity limit counts.
    for (const double side : {1.0, -1.0}) {
        EXPECT_EQ(bench.decide(kZone, {side * 10.0, -side * 15.0, 0.0}, 0.0, d), FilterStatus::Infeasible);
        EXPECT_EQ(d.value[0], side * 4 * kPi);
    }
}

// What the law is good for: where velocity can be changed at once, the safety distance is kept.
TEST(VelocityDamper, KeepsTheSafetyDistanceWhereVelocityCanBeChangedAtOnce) {
    Bench bench("single_joint", "velocity_damper");
    const auto both = [](double size) {
        return JointBounds{JointVector::Constant(1, -size), JointVector::Constant(1, size)};
    };
    bench.arm.limits.acceleration = both(1e5);
    bench.arm.limits.jerk = both(1e9);
    for (unsigned seed = 1; seed <= 10; ++seed) {
        const LawOutcome outcome = bench.push(kZone, 20.0, 30.0, true, seed);
        EXPECT_EQ(outcome.infeasible, 0);
        EXPECT_LE(outcome.excess.velocity, 1e-9);
        EXPECT_EQ(outcome.excess.position, 0.0);
        EXPECT_LT(std::abs(outcome.end.q[0]), kPi - 0.045);
    }
}

TEST(VelocityDamper, JerkAndAccelerationHoldAndNothingElse) {
    expectRatesHeldUnderRandomLimits<VelocityDamper>("velocity_damper", 24, [](const JointLimits& limits) {
        const double range = limits.position.upper[0] - limits.position.lower[0];
        char zone[120];
        std::snprintf(zone, sizeof zone, "xi: %g, influence_rad: %g, safety_rad: %g", limits.velocity.upper[0] / 2,
                      0.3 * range + 0.01 * (3.0 * limits.acceleration.upper[0]), 0.02 * range);
        return std::string(zone);
    });
    expectRatesHeldOnTheArm<VelocityDamper>("velocity_damper", "");
}

TEST(VelocityDamper, Fault08ZonesGainsAndLimitsThatDoNotFitAreRefused) {
    Bench bench("single_joint", "velocity_damper", 0.01);
    expectContains(bench.findConfigureComplaint("influence_rad: 0.1, safety_rad: 0.1"),
                   {"plugin_block.influence_rad", "is not larger than safety_rad"});
    expectContains(bench.findConfigureComplaint("xi: 20, influence_rad: 0.2, safety_rad: 0.05"),
                   {"plugin_block.xi", "xi * tick_s is 0.2"});
    expectContains(bench.findConfigureComplaint("influence_rad: 4, safety_rad: 3.2"),
                   {"plugin_block.safety_rad", "the safety distances of joint0"});
    EXPECT_CONTAINS(bench.findConfigureComplaint("gamma: 200"), "gamma * tick_s is 2.0");
    EXPECT_CONTAINS(bench.findConfigureComplaint("xi: 0"), "xi");
    bench.arm.limits.jerk.upper[0] = kInfinity;
    EXPECT_CONTAINS(bench.findConfigureComplaint(""), "velocity_damper needs a finite jerk limit");
}

TEST(VelocityDamper, LoadsAsALibrary) {
    expectSameAsLibrary<VelocityDamper>("velocity_damper");
}

}  // namespace
}  // namespace viable
