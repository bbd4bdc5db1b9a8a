#include "Tosbp.h"

#include "LawBench.h"

namespace viable {
namespace {

struct Bench : LawBench<Tosbp> {
    explicit Bench(const std::string& robot, double tick_s = 1e-3) : LawBench(robot, "tosbp", tick_s) {}
};

double calcLargest(const JointBounds& bounds) {
    return std::max(bounds.upper.maxCoeff(), -bounds.lower.minCoeff());
}

/** What sampling costs, as the largest drift over `duration_s`.

Velocity: the row (19) is there for a > 0 only. From a = -e <= 0 one tick may take +J, the next
takes -J; together the velocity peak has grown by at most J dt^2 in two ticks, so pushing for ever
creeps through the limit with J dt / 2 at most. Position: the same one integral further, J dt^2 / 2,
and on top the sampling of the approach itself, of the size of A dt^2. */
double calcVelocityDrift(const JointLimits& limits, double tick_s, double duration_s) {
    const double J = calcLargest(limits.jerk);
    return J * tick_s * duration_s / 2.0 + J * tick_s * tick_s;
}
double calcPositionDrift(const JointLimits& limits, double tick_s, double duration_s) {
    const double J = calcLargest(limits.jerk), A = calcLargest(limits.acceleration);
    return J * tick_s * tick_s * duration_s / 2.0 + A * tick_s * tick_s;
}

void expectHeld(const LawOutcome& outcome, const JointLimits& limits, double tick_s) {
    const double duration_s = outcome.ticks * tick_s;
    EXPECT_EQ(outcome.holdingJerk, outcome.ticks);
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_LE(outcome.excess.acceleration, 1e-9);
    EXPECT_LE(outcome.excess.velocity, calcVelocityDrift(limits, tick_s, duration_s));
    EXPECT_LE(outcome.excess.position, calcPositionDrift(limits, tick_s, duration_s));
}

double drawLogarithmic(double low, double high, std::mt19937& random) {
    return std::exp(std::uniform_real_distribution<double>(std::log(low), std::log(high))(random));
}

/** Limits of a single joint; `above`: V > A^2 / J, so that braking reaches the acceleration limit
(types I and IV). */
void drawLimits(JointLimits& limits, bool above, bool symmetric, std::mt19937& random) {
    const double A = drawLogarithmic(1.0, 30.0, random), J = drawLogarithmic(10.0, 1000.0, random);
    const double share = above ? drawLogarithmic(1.05, 4.0, random) : drawLogarithmic(0.1, 0.95, random);
    const double V = share * A * A / J, way = V * V / A + V * A / J;
    const auto setBoth = [&](JointBounds& bounds, double size) {
        std::uniform_real_distribution<double> factor(0.5, 1.0);
        bounds.upper[0] = symmetric ? size : size * factor(random);
        bounds.lower[0] = symmetric ? -size : -size * factor(random);
    };
    setBoth(limits.acceleration, A);
    setBoth(limits.jerk, J);
    setBoth(limits.velocity, V);
    setBoth(limits.position, way * drawLogarithmic(0.5, 4.0, random));
}

TEST(Tosbp, SingleJointUnderRandomLimitsOnBothSidesOfTheCruiseLine) {
    Bench bench("single_joint");
    const TestArm& arm = bench.arm;
    std::mt19937 random(21);
    double worstPosition = 0.0, worstVelocity = 0.0;
    long ticks = 0, infeasible = 0;
    for (int k = 0; k < 400; ++k) {
        drawLimits(bench.arm.limits, k % 2 == 0, (k / 2) % 2 == 0, random);
        const LawOutcome outcome =
            bench.push("k_alpha: 5, gamma: 20", 20.0, 3.0 * calcLargest(arm.limits.acceleration), (k / 4) % 2 == 0, k);
        SCOPED_TRACE("limits " + std::to_string(k));
        expectHeld(outcome, arm.limits, arm.tick_s);
        ASSERT_FALSE(HasFailure());
        EXPECT_GT(outcome.modified, 100);
        worstPosition = std::max(worstPosition, outcome.excess.position);
        worstVelocity = std::max(worstVelocity, outcome.excess.velocity);
        ticks += outcome.ticks;
        infeasible += outcome.infeasible;
    }
    std::printf("  worst excess: %.2g rad, %.2g of the velocity limit; %ld of %ld ticks empty\n", worstPosition,
                worstVelocity, infeasible, ticks);
    EXPECT_LE(worstPosition, 2e-3);
    EXPECT_LE(worstVelocity, 0.03);
    EXPECT_GT(infeasible, 0);  // the rows do contradict each other, and the filter says so
    EXPECT_LT(infeasible, ticks / 10);
}

TEST(Tosbp, ArmUnderThePapersLimits) {
    for (const bool bangBang : {false, true}) {
        Bench bench("indy7");
        setPaperLimits(bench.arm);
        const LawOutcome outcome = bench.push("k_alpha: 5, gamma: 20", 20.0, 40.0, bangBang, 8);
        expectHeld(outcome, bench.arm.limits, bench.arm.tick_s);
        EXPECT_GT(outcome.modified, 1000);
        std::printf("  worst excess: %.2g rad, %.2g of the velocity limit; %d of %d ticks empty\n",
                    outcome.excess.position, outcome.excess.velocity, outcome.infeasible, outcome.ticks);
    }
}

// A limit of the sampled law, kept on purpose (the filter reproduces the paper): pushed for ever,
// it creeps through the velocity limit, and not faster than derived above.
TEST(Tosbp, PushedForEverCreepsThroughTheVelocityLimitAtTheDerivedRate) {
    Bench bench("single_joint");
    bench.arm.limits.position = {JointVector::Constant(1, -kInfinity), JointVector::Constant(1, kInfinity)};
    const LawOutcome outcome =
        bench.run("k_alpha: 5, gamma: 100", 60.0, [](const MotionState&) { return JointVector::Constant(1, 100.0); });
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_LE(outcome.excess.acceleration, 1e-9);
    EXPECT_EQ(outcome.holdingJerk, outcome.ticks);
    const double V = 2.0 * kPi;
    EXPECT_LE(V * outcome.excess.velocity, calcVelocityDrift(bench.arm.limits, bench.arm.tick_s, 60.0));
    EXPECT_GT(outcome.excess.velocity, 0.0);
}

/** The paper's S4 (26): qdd_d = 5 (2 pi - q) - qd for 8 s (Fig. 6). */
struct S4 {
    LawOutcome outcome;
    double firstPastStop_s = -1.0;   ///< when the stop first lay behind the limit, h_p < 0
    double firstBrokenRow_s = -1.0;  ///< when (18) with (21), as printed, first asked for j < -J
    int brakesThere = 0, ticksPastStop = 0, signChanges = 0;
};

S4 runS4(double tick_s) {
    S4 result;
    const double J = 4.0 * kPi;
    double last = 0.0;
    int k = 0;
    const auto look = [&](const MotionState& s, const FilterDecision& d, const Tosbp&) {
        // An own evaluation of the stop III (it never cruises with these numbers) and of the row
        // as printed, for v > 0 and a > 0 near the limit.
        const double v = s.qd[0], a = s.qdd[0];
        if (v + a * std::abs(a) / (2.0 * J) > 0.0) {
            const double a1 = std::sqrt(a * a / 2.0 + J * v), T1 = (a + a1) / J, T3 = a1 / J;
            const double stop = s.q[0] + v * T1 + a * T1 * T1 / 2 - J * T1 * T1 * T1 / 6 + J * T3 * T3 * T3 / 6;
            const double h = kPi - stop, dpdv = T1 + T3 / 2, dpda = T1 * (T1 / 2 + T3 / 2);
            if (h < -1e-12) {
                ++result.ticksPastStop;
                result.brakesThere += d.value[0] == -J;
                if (result.firstPastStop_s < 0.0) result.firstPastStop_s = k * tick_s;
                const double row = (5.0 * h - v - dpdv * a) / dpda;
                if (row < -J && result.firstBrokenRow_s < 0.0) result.firstBrokenRow_s = k * tick_s;
            }
        }
        result.signChanges += d.value[0] * last < 0.0;
        last = d.value[0];
        ++k;
    };
    Bench bench("single_joint", tick_s);
    result.outcome = bench.follow(
        "k_alpha: 5, gamma: 100", 8.0, [](double) { return 2.0 * kPi; }, look);
    EXPECT_NEAR(result.outcome.end.q[0], kPi, 1e-3);  // it is at the limit and stays there (Fig. 6)
    return result;
}

// The row asks for less than -J as soon as a tick leaves a stop behind the limit (h_p < 0): those
// ticks have no admissible jerk, are counted, and brake at -J. With the paper's data that begins in
// the fourth second at 1 ms, earlier at coarser and later at finer ticks.
TEST(Tosbp, Fault33S4RestingOnTheLimitRunsOutOfAdmissibleJerksAndBrakes) {
    const S4 coarse = runS4(1e-2), usual = runS4(1e-3), fine = runS4(1e-4);
    std::printf("  first tick without an admissible jerk at %.2f s (10 ms), %.2f s (1 ms), %.2f s (0.1 ms)\n",
                coarse.firstBrokenRow_s, usual.firstBrokenRow_s, fine.firstBrokenRow_s);
    std::printf("  position passed by %.2g, %.2g, %.2g rad\n", coarse.outcome.excess.position,
                usual.outcome.excess.position, fine.outcome.excess.position);
    for (const S4* s4 : {&coarse, &usual, &fine}) {
        EXPECT_EQ(s4->outcome.holdingJerk, s4->outcome.ticks);
        EXPECT_EQ(s4->outcome.infeasible, s4->ticksPastStop);
        EXPECT_EQ(s4->brakesThere, s4->ticksPastStop);
        EXPECT_GT(s4->ticksPastStop, 0);
        EXPECT_EQ(s4->firstBrokenRow_s, s4->firstPastStop_s);
        EXPECT_LE(s4->outcome.excess.jerk, 1e-9);
        EXPECT_LE(s4->outcome.excess.acceleration, 1e-9);
        EXPECT_EQ(s4->outcome.excess.velocity, 0.0);
        EXPECT_GT(s4->signChanges, 100);  // it chatters there
    }
    EXPECT_LT(coarse.firstBrokenRow_s, usual.firstBrokenRow_s);
    EXPECT_LT(usual.firstBrokenRow_s, fine.firstBrokenRow_s);
    EXPECT_NEAR(usual.firstBrokenRow_s, 3.5, 0.25);
    EXPECT_LE(usual.outcome.excess.position, 1.7e-5);
    EXPECT_LE(fine.outcome.excess.position, usual.outcome.excess.position / 10.0);
}

TEST(Tosbp, AdmissibleDesiredJerkPassesBitForBit) {
    for (const char* robot : {"single_joint", "indy7"}) {
        Bench bench(robot);
        const TestArm& arm = bench.arm;
        const auto filter = bench.make("gamma: 20");
        std::mt19937 random(5);
        for (int k = 0; k < 200; ++k) {
            const MotionState state = makeRandomState(arm, 0.05, 0.1, 0.3, random);
            const Dynamics dynamics = bench.arm.calcDynamics(state);
            JointVector first, second, desired[2];
            const JointVector aim = state.qdd + makeRandomVector(arm.size(), 0.3, random);
            calcInverseDynamics(dynamics, aim, first);
            calcInverseDynamics(dynamics, aim + makeRandomVector(arm.size(), 0.004, random), second);
            ASSERT_TRUE(calcForwardDynamics(dynamics, first, desired[0]));
            ASSERT_TRUE(calcForwardDynamics(dynamics, second, desired[1]));
            FilterDecision decision;
            filter->reset(state);
            // In the first tick there is no quotient yet, in the second there is one (14).
            ASSERT_EQ(filter->filter({state, first, dynamics}, decision), FilterStatus::Passed);
            ASSERT_EQ(decision.value, JointVector(-20.0 * (state.qdd - desired[0])));
            ASSERT_EQ(filter->filter({state, second, dynamics}, decision), FilterStatus::Passed);
            ASSERT_EQ(decision.value,
                      JointVector((desired[1] - desired[0]) / arm.tick_s - 20.0 * (state.qdd - desired[1])));
            for (int i = 0; i < arm.size(); ++i) EXPECT_EQ(decision.joints[i].limit, LimitKind::None);
        }
    }
}

TEST(Tosbp, SaysWhichLimitActs) {
    Bench bench("single_joint");
    const auto decide = [&](double q, double qd, double qdd, double push) {
        FilterDecision decision;
        bench.decide("", {q, qd, qdd}, push, decision);
        return decision.joints[0];
    };
    EXPECT_EQ(decide(0, 0, 0, 0.1).limit, LimitKind::None);
    EXPECT_EQ(decide(0, 0, 0, 100.0).limit, LimitKind::Jerk);
    JointIntervention joint = decide(-1.0, -3.0, 3 * kPi - 0.001, 100.0);
    EXPECT_EQ(joint.limit, LimitKind::Acceleration);
    EXPECT_EQ(joint.side, LimitSide::Upper);
    joint = decide(-3.0, 2 * kPi - 0.1, 1.0, 100.0);
    EXPECT_EQ(joint.limit, LimitKind::Velocity);
    EXPECT_EQ(joint.side, LimitSide::Upper);
    joint = decide(-kPi + 0.01, -0.1, -0.5, -100.0);
    EXPECT_EQ(joint.limit, LimitKind::Position);
    EXPECT_EQ(joint.side, LimitSide::Lower);
}

TEST(Tosbp, Fault08GainsThatTheTickCannotCarryAreRefused) {
    Bench bench("indy7", 0.01);
    expectContains(bench.findConfigureComplaint("k_alpha: 101"),
                   {"experiment.yaml:1:", "plugin_block.k_alpha", "k_alpha * tick_s is 1.01", "allowed (0, 1]"});
    expectContains(bench.findConfigureComplaint("gamma: 200"),
                   {"plugin_block.gamma", "gamma * tick_s is 2.0", "allowed (0, 2)", "below 2 / tick_s"});
    EXPECT_EQ(bench.findConfigureComplaint("k_alpha: 100, gamma: 199"), "");
    EXPECT_CONTAINS(bench.findConfigureComplaint("k_alpha: 0"), "k_alpha");
    EXPECT_CONTAINS(bench.findConfigureComplaint("gamma: -20"), "gamma");
}

TEST(Tosbp, UnlimitedJerkIsRefused) {
    Bench bench("single_joint");
    bench.arm.limits.jerk.lower[0] = -kInfinity;
    expectContains(bench.findConfigureComplaint(""), {"finite jerk limit", "limits.jerk_radps3"});
}

TEST(Tosbp, RefusesWhatIsNotFiniteOrOfTheWrongSizeAndStaysAsItWas) {
    Bench bench("indy7");
    expectNoTraceOfBadInput(bench.arm, [&] { return bench.make(); });
}

TEST(Tosbp, Fault29HugeTinyAndAlternatingTorquesKeepTheLimits) {
    Bench bench("indy7");
    AbsurdTorques torques(bench.arm.size());
    const auto next = [&](const MotionState&, const Dynamics&) { return torques.next(); };
    expectHeld(bench.drive("gamma: 1999, k_alpha: 1000", 20.0, next), bench.arm.limits, bench.arm.tick_s);
}

TEST(Tosbp, Fault30SetPointJumpsThroughJointPdKeepTheLimits) {
    for (const char* robot : {"single_joint", "indy7"})
        for (const double jump : {2.0 * kPi, 1e6}) {
            Bench bench(robot);
            JumpingSetPoint setPoint(bench.arm, jump);
            const auto next = [&](const MotionState& s, const Dynamics& d) { return setPoint.next(s, d); };
            const LawOutcome outcome = bench.drive("gamma: 100", 20.0, next);
            expectHeld(outcome, bench.arm.limits, bench.arm.tick_s);
            EXPECT_GT(outcome.modified, 1000);
        }
}

TEST(Tosbp, ResetGivesTheSameAnswersAgain) {
    Bench bench("indy7");
    expectSameAnswersAfterReset(*bench.make(), bench.arm);
}

TEST(Tosbp, LoadsAsALibrary) {
    expectSameAsLibrary<Tosbp>("tosbp");
}

}  // namespace
}  // namespace viable
