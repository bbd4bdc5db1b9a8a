#include "AccelerationViability.h"

#include "LawBench.h"

namespace viable {
namespace {

/** By how much the sampled law may pass a position limit, joint by joint the largest [rad].

With h = P - p - v^2 / (2 B), A the acceleration and B the deceleration limit towards P, and x held
for one tick, h+ = h - (1 + x / B) (v dt + x dt^2 / 2). The row (16) makes (1 + x / B) v <= k h for
v > 0, so h+ >= (1 - k dt) h - (1 + A / B) A dt^2 / 2, from v <= 0 the same with k = 0. Once h < 0,
x = -B keeps it as it is until the joint stands, and then it may not move on. Only a velocity limit
that a tick of braking passes, V < B dt, keeps that last tick from braking fully: v dt / 2 <=
B dt^2 / 2 more. */
double calcOvershootBound(const JointLimits& limits, double tick_s) {
    double bound = 0.0;
    for (int i = 0; i < limits.size(); ++i) {
        const double A = limits.acceleration.upper[i], B = -limits.acceleration.lower[i];
        const double up = (1.0 + A / B) * A + (-limits.velocity.lower[i] < B * tick_s ? B : 0.0);
        const double down = (1.0 + B / A) * B + (limits.velocity.upper[i] < A * tick_s ? A : 0.0);
        bound = std::max(bound, std::max(up, down) * tick_s * tick_s / 2.0);
    }
    return bound;
}

using Bench = LawBench<AccelerationViability>;

struct AccelerationViabilityTest : ::testing::Test {
    static constexpr const char* kName = "acceleration_viability";

    /** The limits hold and the run was worth looking at. */
    static void expectHeld(const LawOutcome& outcome, const JointLimits& limits, double tick_s) {
        EXPECT_LE(outcome.excess.velocity, 1e-9);
        EXPECT_LE(outcome.excess.acceleration, 1e-9);
        EXPECT_LE(outcome.excess.position, calcOvershootBound(limits, tick_s) + 1e-12);
        EXPECT_EQ(outcome.infeasible, 0);
        EXPECT_GT(outcome.modified, 100);
    }
};

TEST_F(AccelerationViabilityTest, SingleJointStaysInsideButForTheJerk) {
    Bench bench("single_joint", kName);
    for (const bool bangBang : {false, true})
        for (unsigned seed = 1; seed <= 20; ++seed) {
            const LawOutcome outcome = bench.push("k_alpha: 5", 20.0, 30.0, bangBang, seed);
            SCOPED_TRACE("seed " + std::to_string(seed));
            expectHeld(outcome, bench.arm.limits, bench.arm.tick_s);
            EXPECT_GT(outcome.excess.jerk, 10.0);  // times the limit, at the least
        }
}

TEST_F(AccelerationViabilityTest, ArmStaysInsideButForTheJerk) {
    Bench bench("indy7", kName);
    for (const bool bangBang : {false, true}) {
        const LawOutcome outcome = bench.push("k_alpha: 5", 20.0, 40.0, bangBang, 7);
        expectHeld(outcome, bench.arm.limits, bench.arm.tick_s);
        EXPECT_GT(outcome.excess.jerk, 10.0);
    }
}

// A joint that is pushed at its limit for ever must not creep through it, whatever the remainder of
// velocity with which it arrives there.
TEST_F(AccelerationViabilityTest, PushingForEverDoesNotCreepThroughTheLimit) {
    Bench bench("single_joint", kName);
    TestArm& arm = bench.arm;
    const Dynamics unit = makeUnitDynamics(1);
    std::mt19937 random(11);
    for (int k = 0; k < 200; ++k) {
        const auto filter = bench.make("k_alpha: 5");
        MotionState state = arm.start;
        const double side = k % 2 ? 1.0 : -1.0;
        state.q[0] = side * std::uniform_real_distribution<double>(2.0, kPi)(random);
        const JointVector torque = JointVector::Constant(1, 100.0 * side);
        FilterDecision decision;
        LimitExcess excess;
        double stood = 0.0;
        for (int tick = 0; tick < 20000; ++tick) {
            ASSERT_EQ(filter->filter({state, torque, unit}, decision), FilterStatus::Modified);
            const JointVector jerk = calcJerk(decision, state.qdd, arm.tick_s);
            advanceNominal(decision, arm.tick_s, state);
            excess.observe(jerk, state, arm.limits);
            if (tick == 10000) stood = state.q[0];
        }
        ASSERT_LE(excess.position, calcOvershootBound(arm.limits, arm.tick_s) + 1e-12) << "start " << k;
        ASSERT_NEAR(state.q[0], stood, 1e-4);
        ASSERT_GT(side * state.q[0], kPi - 1e-3);  // and the range is used to its end
    }
}

TEST_F(AccelerationViabilityTest, RandomLimitsIncludingOnesThatATickCrossesAreHeld) {
    std::mt19937 random(12);
    const auto draw = [&](double low, double high) {  // evenly in the logarithm
        return std::exp(std::uniform_real_distribution<double>(std::log(low), std::log(high))(random));
    };
    Bench bench("single_joint", kName);
    TestArm& arm = bench.arm;
    for (int k = 0; k < 300; ++k) {
        arm.tick_s = k % 3 == 0 ? 0.004 : 0.001;
        // Down to velocity limits that half a tick of full acceleration passes.
        arm.limits.velocity.upper[0] = draw(1e-3, 10.0);
        arm.limits.velocity.lower[0] = -draw(1e-3, 10.0);
        arm.limits.acceleration.upper[0] = draw(0.5, 50.0);
        arm.limits.acceleration.lower[0] = -draw(0.5, 50.0);
        arm.limits.position.upper[0] = draw(0.01, 3.0);
        arm.limits.position.lower[0] = -draw(0.01, 3.0);
        const LawOutcome outcome = bench.push("k_alpha: 5", 5.0, 100.0, true, 100 + k);
        SCOPED_TRACE("limits " + std::to_string(k));
        EXPECT_LE(outcome.excess.velocity, 1e-9);
        EXPECT_LE(outcome.excess.acceleration, 1e-9);
        EXPECT_LE(outcome.excess.position, calcOvershootBound(arm.limits, arm.tick_s) + 1e-12);
    }
}

TEST_F(AccelerationViabilityTest, OvershootShrinksWithTheSquareOfTheTick) {
    double worst[2] = {};
    for (int i = 0; i < 2; ++i) {
        Bench bench("single_joint", kName, i == 0 ? 0.01 : 0.001);
        for (unsigned seed = 1; seed <= 10; ++seed) {
            const LawOutcome outcome = bench.push("k_alpha: 5", 20.0, 30.0, true, seed);
            worst[i] = std::max(worst[i], outcome.excess.position);
            EXPECT_LE(outcome.excess.position, calcOvershootBound(bench.arm.limits, bench.arm.tick_s) + 1e-12);
        }
    }
    RecordProperty("overshoot_at_10_ms_rad", std::to_string(worst[0]));
    EXPECT_LE(worst[1], worst[0]);
}

TEST_F(AccelerationViabilityTest, AdmissibleTorquePassesBitForBit) {
    for (const char* robot : {"single_joint", "indy7"}) {
        Bench bench(robot, kName);
        TestArm& arm = bench.arm;
        const auto filter = bench.make();
        std::mt19937 random(5);
        for (int k = 0; k < 200; ++k) {
            MotionState state = arm.start;
            state.q += makeRandomVector(arm.size(), 0.2, random);
            state.qd = makeRandomVector(arm.size(), 0.2, random);
            const Dynamics dynamics = arm.calcDynamics(state);
            JointVector torque;
            calcInverseDynamics(dynamics, makeRandomVector(arm.size(), 2.0, random), torque);
            FilterDecision decision;
            ASSERT_EQ(filter->filter({state, torque, dynamics}, decision), FilterStatus::Passed);
            ASSERT_EQ(calcTorque({state, torque, dynamics}, FilterStatus::Passed, decision), torque);
            EXPECT_EQ(decision.held, HeldQuantity::Acceleration);
            for (int i = 0; i < arm.size(); ++i) EXPECT_EQ(decision.joints[i].limit, LimitKind::None);
        }
    }
}

TEST_F(AccelerationViabilityTest, SaysWhichLimitActs) {
    Bench bench("single_joint", kName);
    TestArm& arm = bench.arm;
    const Dynamics unit = makeUnitDynamics(1);
    const auto filter = bench.make();
    const double A = 3.0 * kPi, P = kPi, V = 2.0 * kPi;
    const auto decide = [&](double q, double qd, double push) {
        MotionState state = arm.start;
        state.q[0] = q;
        state.qd[0] = qd;
        FilterDecision decision;
        EXPECT_EQ(filter->filter({state, JointVector::Constant(1, push), unit}, decision), FilterStatus::Modified);
        return decision;
    };
    FilterDecision d = decide(0.0, 0.0, 100.0);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Acceleration);
    EXPECT_EQ(d.joints[0].side, LimitSide::Upper);
    EXPECT_DOUBLE_EQ(d.value[0], A);

    d = decide(-3.0, -V + 0.001, -100.0);
    EXPECT_EQ(d.joints[0].side, LimitSide::Lower);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Position);  // 4 pi^2 / 6 pi > 0.14: it must brake
    EXPECT_DOUBLE_EQ(d.value[0], A);

    d = decide(-3.0, V - 0.001, 100.0);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Velocity);
    EXPECT_NEAR(d.value[0], 1.0, 1e-9);

    // Equation (16): A (alpha(h) / v - 1).
    d = decide(3.0, 0.5, 100.0);
    const double h = P - 3.0 - 0.25 / (2.0 * A);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Position);
    EXPECT_NEAR(d.value[0], A * (5.0 * h / 0.5 - 1.0), 1e-9);
}

TEST_F(AccelerationViabilityTest, Fault08TooSteepAlphaForTheTickIsRefused) {
    Bench bench("indy7", kName, 0.01);
    expectContains(
        bench.findConfigureComplaint("k_alpha: 101"),
        {"experiment.yaml:1:", "plugin_block.k_alpha", "k_alpha * tick_s is 1.01", "allowed (0, 1]", "1 / tick_s"});
    EXPECT_EQ(bench.findConfigureComplaint("k_alpha: 100"), "");
    EXPECT_CONTAINS(bench.findConfigureComplaint("k_alpha: 0"), "k_alpha");
    EXPECT_CONTAINS(bench.findConfigureComplaint("k_alpha: -1"), "k_alpha");
}

TEST_F(AccelerationViabilityTest, UnlimitedAccelerationIsRefused) {
    Bench bench("single_joint", kName);
    bench.arm.limits.acceleration.upper[0] = kInfinity;
    EXPECT_CONTAINS(bench.findConfigureComplaint(""), "finite acceleration limit");
}

TEST_F(AccelerationViabilityTest, RefusesWhatIsNotFiniteOrOfTheWrongSize) {
    Bench bench("indy7", kName);
    expectNoTraceOfBadInput(bench.arm, [&] { return bench.make(); });
}

TEST_F(AccelerationViabilityTest, Fault29HugeAndTinyTorquesKeepTheLimits) {
    Bench bench("indy7", kName);
    AbsurdTorques torques(bench.arm.size());
    const auto next = [&](const MotionState&, const Dynamics&) { return torques.next(); };
    expectHeld(bench.drive("", 20.0, next), bench.arm.limits, bench.arm.tick_s);
}

TEST_F(AccelerationViabilityTest, ResetGivesTheSameAnswersAgain) {
    Bench bench("indy7", kName);
    expectSameAnswersAfterReset(*bench.make(), bench.arm);
}

TEST_F(AccelerationViabilityTest, LoadsAsALibrary) {
    expectSameAsLibrary<AccelerationViability>(kName);
}

}  // namespace
}  // namespace viable
