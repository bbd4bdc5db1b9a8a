#include "Tovzbp.h"

#include "LawBench.h"

namespace viable {
namespace {

using Bench = LawBench<Tovzbp>;

/** Where v = 0 on the way up under -J, then -A: Table II, types III and IV, by following the motion. */
double calcStopPosition(double p, double v, double a, double A, double J) {
    // v + a t - J t^2 / 2 = 0, the later root; but not beyond the time when a = -A.
    const double root = (a + std::sqrt(a * a + 2.0 * J * v)) / J, cruise = (a + A) / J;
    const double t = std::min(root, cruise);
    double end = p + v * t + a * t * t / 2.0 - J * t * t * t / 6.0;
    if (cruise < root) {
        const double left = v + a * t - J * t * t / 2.0;
        end += left * left / (2.0 * A);
    }
    return end;
}

// The row is alpha(h) + dh/dt >= 0 with h = P - p_f; here its gradients come from differences of a stop position
// that is found by following the motion, and nothing is shared with motion/Braking.
TEST(Tovzbp, PositionRowIsTheBarrierOfTheVelocityZeroingStop) {
    Bench bench("single_joint", "tovzbp");
    const double A = 3 * kPi, J = 4 * kPi, P = kPi, k = 5.0;
    std::mt19937 random(31);
    std::uniform_real_distribution<double> share(0.0, 1.0);
    int compared = 0, cruising = 0, coasting = 0;
    for (int i = 0; i < 10000; ++i) {
        const double v = 0.05 + 5.0 * share(random), a = A * (1.9 * share(random) - 0.95);
        const double h = 0.2 * share(random), p = P - h - (calcStopPosition(0, v, a, A, J));
        const auto stop = [&](double v1, double a1) { return calcStopPosition(p, v1, a1, A, J); };
        const double d = 1e-5, dv = (stop(v + d, a) - stop(v - d, a)) / (2 * d);
        const double da = (stop(v, a + d) - stop(v, a - d)) / (2 * d);
        if (da < 1e-3) continue;
        const double expected = (k * h - v - dv * a) / da;
        FilterDecision decision;
        const FilterStatus status = bench.decide("k_alpha: 5, gamma: 100", {p, v, a}, 1e3, decision);
        if (decision.joints[0].limit != LimitKind::Position) continue;  // another row is tighter
        EXPECT_EQ(status, FilterStatus::Modified);
        EXPECT_EQ(decision.joints[0].side, LimitSide::Upper);
        ASSERT_NEAR(decision.value[0], expected, 1e-5 * (J + std::abs(expected))) << v << " " << a;
        ++compared;
        cruising += v + a * a / (2 * J) > A * A / (2 * J);
        coasting += v + a * std::abs(a) / (2 * J) < 0.0;
        // And the mirror image.
        bench.decide("k_alpha: 5, gamma: 100", {-p, -v, -a}, -1e3, decision);
        ASSERT_NEAR(decision.value[0], -expected, 1e-5 * (J + std::abs(expected)));
        EXPECT_EQ(decision.joints[0].side, LimitSide::Lower);
    }
    EXPECT_GT(compared, 500);
    EXPECT_GT(cruising, 100);
    EXPECT_GT(coasting, 100);  // braking so hard that a = 0 would come after v = 0: sigma < 0
}

// S5 of the paper, Fig. 6.
TEST(Tovzbp, SwingsAtTheLimitForEver) {
    Bench bench("single_joint", "tovzbp");
    double lowest = kInfinity, highest = -kInfinity;
    int k = 0;
    const LawOutcome outcome = bench.follow(
        "k_alpha: 5, gamma: 100", 20.0, [](double) { return 2 * kPi; },
        [&](const MotionState& s, const FilterDecision&, const Tovzbp&) {
            if (k++ < 15000) return;
            lowest = std::min(lowest, s.q[0]);
            highest = std::max(highest, s.q[0]);
        });
    std::printf("  swings between %.4f and %.4f rad, limit %.4f; %d of %d ticks infeasible, first at %.3f s\n", lowest,
                highest, kPi, outcome.infeasible, outcome.ticks, outcome.firstInfeasible_s);
    EXPECT_GT(highest - lowest, 1.0);
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_LE(outcome.excess.acceleration, 1e-9);
}

TEST(Tovzbp, JerkAndAccelerationHoldUnderRandomLimits) {
    EXPECT_GT(expectRatesHeldUnderRandomLimits<Tovzbp>("tovzbp", 21,
                                                       [](const JointLimits&) { return "k_alpha: 5, gamma: 20"; }),
              0);
}

TEST(Tovzbp, JerkAndAccelerationHoldOnTheArm) {
    expectRatesHeldOnTheArm<Tovzbp>("tovzbp", "k_alpha: 5, gamma: 20");
}

TEST(Tovzbp, AStopBehindTheLimitIsInfeasibleAndBrakes) {
    Bench bench("single_joint", "tovzbp");
    FilterDecision decision;
    EXPECT_EQ(bench.decide("gamma: 100", {kPi - 0.01, 1.0, 0.0}, 100.0, decision), FilterStatus::Infeasible);
    EXPECT_EQ(decision.value[0], -4 * kPi);
    // As far as the acceleration limit lets it.
    EXPECT_EQ(bench.decide("gamma: 100", {kPi - 0.01, 1.0, -3 * kPi + 0.001}, 100.0, decision),
              FilterStatus::Infeasible);
    EXPECT_NEAR(decision.value[0], -1.0, 1e-9);
}

TEST(Tovzbp, Fault08GainsAndLimitsThatDoNotFitAreRefused) {
    Bench bench("single_joint", "tovzbp", 0.01);
    EXPECT_CONTAINS(bench.findConfigureComplaint("k_alpha: 101"), "k_alpha * tick_s is 1.01");
    EXPECT_CONTAINS(bench.findConfigureComplaint("gamma: 200"), "gamma * tick_s is 2.0");
    EXPECT_EQ(bench.findConfigureComplaint("k_alpha: 100, gamma: 199"), "");
    bench.arm.limits.jerk.lower[0] = -kInfinity;
    EXPECT_CONTAINS(bench.findConfigureComplaint(""), "the filter tovzbp needs a finite jerk limit");
}

TEST(Tovzbp, LoadsAsALibrary) {
    expectSameAsLibrary<Tovzbp>("tovzbp");
}

}  // namespace
}  // namespace viable
