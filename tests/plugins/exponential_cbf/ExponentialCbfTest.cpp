#include "ExponentialCbf.h"

#include "LawBench.h"
#include "viable/braking/ExponentialBarrier.h"

namespace viable {
namespace {

using Bench = LawBench<ExponentialCbf>;

const char* const kPapers = "k_alpha: 5, gamma: 100, on_infeasible: ";

std::string papers(const char* onInfeasible) {
    return std::string(kPapers) + onInfeasible;
}

/** (d/dt + k)^m h at the beginning, m = 3, 2, 1 for position, velocity, acceleration, by differences along the motion
under a jerk. @param sign  +1: upper limit, -1: lower */
double calcCondition(LimitKind kind, const AxisState& s, double jerk, double limit, double sign, double k) {
    const auto h = [&](double t) {
        const AxisState x = advance(s, jerk, t);
        const double value = kind == LimitKind::Position ? x.p : kind == LimitKind::Velocity ? x.v : x.a;
        return sign * (limit - value);
    };
    const double d = 1e-2;  // exact for cubics, but for rounding
    const double first = (8 * (h(d) - h(-d)) - (h(2 * d) - h(-2 * d))) / (12 * d);
    const double second = (h(d) - 2 * h(0) + h(-d)) / (d * d);
    const double third = (h(2 * d) - 2 * h(d) + 2 * h(-d) - h(-2 * d)) / (2 * d * d * d);
    if (kind == LimitKind::Position) return third + 3 * k * second + 3 * k * k * first + k * k * k * h(0);
    if (kind == LimitKind::Velocity) return second + 2 * k * first + k * k * h(0);
    return first + k * h(0);
}

TEST(ExponentialBarrier, RowsAreWhereTheBarrierConditionIsZero) {
    std::mt19937 random(41);
    std::uniform_real_distribution<double> number(-3.0, 3.0), limit(0.5, 4.0), pole(0.5, 20.0);
    for (int i = 0; i < 2000; ++i) {
        const AxisState s{number(random), number(random), number(random)};
        const AxisLimits l{
            -limit(random), limit(random), -limit(random), limit(random), -limit(random), limit(random), -10, 10};
        const double k = pole(random);
        const ExponentialBarrierRows rows = calcExponentialBarrierRows(s, l, k);
        const double lower[] = {l.positionLower, l.velocityLower, l.accelerationLower};
        const double upper[] = {l.positionUpper, l.velocityUpper, l.accelerationUpper};
        for (std::size_t r = 0; r < ExponentialBarrierRows::kRows; ++r) {
            const LimitKind kind = ExponentialBarrierRows::kLimits[r];
            const double size = 1e-7 * (1.0 + k * k * k), j = rows.upper[r];
            ASSERT_NEAR(calcCondition(kind, s, j, upper[r], 1.0, k), 0.0, size + 1e-7 * std::abs(j));
            ASSERT_GT(calcCondition(kind, s, j - 1.0, upper[r], 1.0, k),
                      0.5);  // below is admissible
            const double i2 = rows.lower[r];
            ASSERT_NEAR(calcCondition(kind, s, i2, lower[r], -1.0, k), 0.0, size + 1e-7 * std::abs(i2));
            ASSERT_GT(calcCondition(kind, s, i2 + 1.0, lower[r], -1.0, k), 0.5);
        }
    }
    const AxisLimits none{-kInfinity, kInfinity, -kInfinity, kInfinity, -kInfinity, kInfinity, -10, 10};
    const ExponentialBarrierRows open = calcExponentialBarrierRows({1, 2, 3}, none, 5.0);
    for (std::size_t r = 0; r < ExponentialBarrierRows::kRows; ++r) {
        EXPECT_EQ(open.lower[r], -kInfinity);
        EXPECT_EQ(open.upper[r], kInfinity);
    }
}

TEST(ExponentialCbf, TakesTheTightestRowAndSaysWhich) {
    Bench bench("single_joint", "exponential_cbf");
    const double k = 5.0, P = kPi, V = 2 * kPi, A = 3 * kPi, J = 4 * kPi;
    const auto decide = [&](const AxisState& s, double push) {
        FilterDecision decision;
        bench.decide(papers("stop"), s, push, decision);
        return decision;
    };
    FilterDecision d = decide({0, 0, 0}, 1e3);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Jerk);
    EXPECT_EQ(d.value[0], J);
    d = decide({-3, -1, A - 1}, 1e3);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Acceleration);
    EXPECT_NEAR(d.value[0], k * 1.0, 1e-12);
    d = decide({-3, V - 0.5, 0.5}, 1e3);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Velocity);
    EXPECT_NEAR(d.value[0], k * k * 0.5 - 2 * k * 0.5, 1e-12);
    d = decide({P - 0.1, 0.1, 0.2}, 1e3);
    EXPECT_EQ(d.joints[0].limit, LimitKind::Position);
    EXPECT_EQ(d.joints[0].side, LimitSide::Upper);
    EXPECT_NEAR(d.value[0], 125 * 0.1 - 75 * 0.1 - 15 * 0.2, 1e-12);
    d = decide({-P + 0.1, -0.1, -0.2}, -1e3);
    EXPECT_EQ(d.joints[0].side, LimitSide::Lower);
    EXPECT_NEAR(d.value[0], -(125 * 0.1 - 75 * 0.1 - 15 * 0.2), 1e-12);
}

/** The paper's S3 (26), Fig. 5. */
double targetOfFig5(double t) {
    return static_cast<int>(t / 2.0 + 1e-9) % 2 ? -2 * kPi : 2 * kPi;
}

TEST(ExponentialCbf, S3IsInfeasibleBeforeItsFirstSecondIsOver) {
    for (const double tick_s : {1e-2, 1e-3, 1e-4}) {
        Bench bench("single_joint", "exponential_cbf", tick_s);
        double untilThen = 0.0;
        bool wasFeasible = true;
        const LawOutcome outcome =
            bench.follow(papers("brake"), 2.0, targetOfFig5,
                         [&](const MotionState& s, const FilterDecision& d, const ExponentialCbf&) {
                             // An own evaluation of the row that breaks first.
                             const double row = 125 * (kPi - s.q[0]) - 75 * s.qd[0] - 15 * s.qdd[0];
                             if (wasFeasible && row < -4 * kPi) {
                                 wasFeasible = false;
                                 EXPECT_EQ(d.value[0], -4 * kPi);
                             } else if (wasFeasible) {
                                 untilThen += tick_s;
                             }
                         });
        std::printf("  tick %g s: no admissible jerk at %.4f s, then in %d of %d ticks\n", tick_s,
                    outcome.firstInfeasible_s, outcome.infeasible, outcome.ticks);
        EXPECT_GT(outcome.firstInfeasible_s, 0.6);
        EXPECT_LT(outcome.firstInfeasible_s, 1.1);
        EXPECT_NEAR(outcome.firstInfeasible_s, untilThen, 1e-9);
    }
}

TEST(ExponentialCbf, StopsAtTheFirstTickWithoutAJerkAndStartsAgainAfterAReset) {
    Bench bench("single_joint", "exponential_cbf");
    const auto filter = bench.make(papers("stop"));
    const Dynamics unit = makeUnitDynamics(1);
    const auto state = [](double p, double v, double a) {
        return MotionState{JointVector::Constant(1, p), JointVector::Constant(1, v), JointVector::Constant(1, a)};
    };
    const JointVector push = JointVector::Constant(1, 100.0);
    FilterDecision decision;
    EXPECT_EQ(filter->filter({state(0, 0, 0), push, unit}, decision), FilterStatus::Modified);
    EXPECT_EQ(filter->filter({state(3, 2, 0), push, unit}, decision), FilterStatus::Infeasible);
    EXPECT_EQ(decision.value[0], -4 * kPi);
    const JointVector before = decision.value;
    for (int k = 0; k < 3; ++k) EXPECT_EQ(filter->filter({state(0, 0, 0), push, unit}, decision), FilterStatus::Ended);
    EXPECT_EQ(decision.value, before);
    filter->reset(state(0, 0, 0));
    EXPECT_EQ(filter->filter({state(0, 0, 0), push, unit}, decision), FilterStatus::Modified);

    const auto goesOn = bench.make(papers("brake"));
    EXPECT_EQ(goesOn->filter({state(3, 2, 0), push, unit}, decision), FilterStatus::Infeasible);
    EXPECT_EQ(goesOn->filter({state(0, 0, 0), push, unit}, decision), FilterStatus::Modified);
    // Braking as far as the acceleration limit lets it.
    EXPECT_EQ(goesOn->filter({state(2, 5, -3 * kPi + 0.001), push, unit}, decision), FilterStatus::Infeasible);
    EXPECT_NEAR(decision.value[0], -1.0, 1e-9);
}

// What the law is good for: where neither jerk nor acceleration is scarce, a limit by itself is kept.
TEST(ExponentialCbf, KeepsAPositionLimitWhereJerkAndAccelerationAreNotScarce) {
    Bench bench("single_joint", "exponential_cbf");
    const auto none = [](double size) {
        return JointBounds{JointVector::Constant(1, -size), JointVector::Constant(1, size)};
    };
    bench.arm.limits.velocity = bench.arm.limits.acceleration = none(kInfinity);
    bench.arm.limits.jerk = none(1e6);
    double worst = 0.0;
    for (unsigned seed = 1; seed <= 10; ++seed) {
        const LawOutcome outcome = bench.push("k_alpha: 5, gamma: 100", 20.0, 30.0, true, seed);
        EXPECT_EQ(outcome.infeasible, 0);
        EXPECT_GT(outcome.modified, 1000);
        worst = std::max(worst, outcome.excess.position);
    }
    std::printf("  worst excess %.2g rad\n", worst);
    EXPECT_LE(worst, 1e-3);
}

TEST(ExponentialCbf, JerkAndAccelerationHoldEvenWhereItHasNoAnswer) {
    EXPECT_GT(expectRatesHeldUnderRandomLimits<ExponentialCbf>("exponential_cbf", 22,
                                                               [](const JointLimits&) { return papers("brake"); }),
              0);
    expectRatesHeldOnTheArm<ExponentialCbf>("exponential_cbf", "on_infeasible: brake");
}

TEST(ExponentialCbf, Fault08GainsAndLimitsThatDoNotFitAreRefused) {
    Bench bench("single_joint", "exponential_cbf", 0.01);
    EXPECT_CONTAINS(bench.findConfigureComplaint("on_infeasible: pray"), "pray");
    bench.expectMisfitsRefused();
}

TEST(ExponentialCbf, LoadsAsALibrary) {
    expectSameAsLibrary<ExponentialCbf>("exponential_cbf");
}

}  // namespace
}  // namespace viable
