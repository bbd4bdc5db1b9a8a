#include "SoftCbf.h"

#include "LawBench.h"

namespace viable {
namespace {

using Bench = LawBench<SoftCbf>;

TEST(SoftCbf, OneJointOneRowIsTheWeightedMean) {
    Bench bench("single_joint", "soft_cbf");
    // gamma 20 and a desired acceleration 0.1 above the present one: u_d = 2, which the position row does not allow.
    const AxisState s{kPi - 0.08, 0.1, 0.2};
    const double target = 20 * 0.1, bound = 125 * 0.08 - 75 * 0.1 - 15 * 0.2;
    ASSERT_LT(bound, target);
    for (const double w : {0.5, 10.0, 1000.0, 1e6}) {
        FilterDecision d;
        EXPECT_EQ(bench.decide("weight: " + std::to_string(w), s, 0.3, d), FilterStatus::Modified);
        EXPECT_NEAR(d.value[0], (target + w * bound) / (1 + w), 1e-9) << w;
        EXPECT_EQ(d.joints[0].limit, LimitKind::Position);
        EXPECT_EQ(d.joints[0].side, LimitSide::Upper);
        // The target is cut off at the jerk limit first.
        bench.decide("weight: " + std::to_string(w), s, 1e6, d);
        EXPECT_NEAR(d.value[0], (4 * kPi + w * bound) / (1 + w), 1e-9) << w;
    }
    FilterDecision d;  // inside all rows: bit for bit
    EXPECT_EQ(bench.decide("", {kPi - 0.1, 0.1, 0.2}, 0.21, d), FilterStatus::Passed);
    EXPECT_EQ(d.value[0], -20.0 * (0.2 - 0.21));
    EXPECT_EQ(d.joints[0].limit, LimitKind::None);
}

// Fast towards the limit and braking as hard as may be: the position row asks for a jerk downwards, the acceleration row
// for none. The answer is the weighted mean of both and of the target.
TEST(SoftCbf, RowsThatContradictEachOtherShareTheMiss) {
    Bench bench("single_joint", "soft_cbf");
    const AxisState s{kPi - 0.01, 2.0, -3 * kPi};
    const double upper = 125 * 0.01 - 75 * 2.0 + 45 * kPi, lower = 0.0;
    ASSERT_LT(upper, lower);
    FilterDecision d;
    EXPECT_EQ(bench.decide("weight: 1000", s, -3 * kPi, d), FilterStatus::Infeasible);
    EXPECT_NEAR(d.value[0], (0.0 + 1000 * (upper + lower)) / 2001, 1e-9);
}

/** The cost of a jerk, summed up as it is written in the header; of joint `i` its slope. */
struct Cost {
    JointMatrix M;
    JointVector target;
    std::vector<ExponentialBarrierRows> rows;
    double weight;

    double miss(int i, double x) const {
        double sum = 0.0;
        for (std::size_t r = 0; r < ExponentialBarrierRows::kRows; ++r)
            sum += std::max(0.0, x - rows[i].upper[r]) - std::max(0.0, rows[i].lower[r] - x);
        return sum;
    }
    double calcSlope(const JointVector& x, int i) const {
        const JointVector gradient = M.transpose() * (M * (x - target));
        return gradient[i] + weight * M.col(i).squaredNorm() * miss(i, x[i]);
    }
};

TEST(SoftCbf, TakesTheCheapestJerkInTheBox) {
    Bench bench("indy7", "soft_cbf");
    setPaperLimits(bench.arm);
    TestArm& arm = bench.arm;
    std::mt19937 random(51);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    int most = 0, modified = 0, infeasible = 0, atBounds = 0, violated = 0;
    long rounds = 0;
    double worst = 0.0;
    const int problems = 5000;
    for (int k = 0; k < problems; ++k) {
        MotionState s = arm.start;
        for (int i = 0; i < 6; ++i) {
            const AxisLimits l = arm.limits.axis(i);
            s.q[i] = l.positionLower + unit(random) * (l.positionUpper - l.positionLower);
            s.qd[i] = l.velocityUpper * (2 * unit(random) - 1);
            s.qdd[i] = l.accelerationUpper * (2 * unit(random) - 1);
        }
        const double weight = std::exp(std::log(1e6) * unit(random));
        const auto filter = bench.make("gamma: 20, weight: " + std::to_string(weight));
        Cost cost{arm.calcDynamics(s).M, {}, {}, std::stod(std::to_string(weight))};
        const JointVector wanted = s.qdd + makeRandomVector(6, 5.0, random);
        const Dynamics dynamics = arm.calcDynamics(s);
        JointVector torque, desired;
        calcInverseDynamics(dynamics, wanted, torque);
        ASSERT_TRUE(calcForwardDynamics(dynamics, torque, desired));
        cost.target = (20.0 * (desired - s.qdd)).cwiseMax(arm.limits.jerk.lower).cwiseMin(arm.limits.jerk.upper);
        for (int i = 0; i < 6; ++i)
            cost.rows.push_back(calcExponentialBarrierRows({s.q[i], s.qd[i], s.qdd[i]}, arm.limits.axis(i), 5.0));
        FilterDecision d;
        const FilterStatus status = filter->filter({s, torque, dynamics}, d);
        modified += status == FilterStatus::Modified;
        infeasible += status == FilterStatus::Infeasible;
        most = std::max(most, filter->rounds());
        rounds += filter->rounds();
        // Optimal: the slope is zero inside, and points outwards on a bound of the box.
        for (int i = 0; i < 6; ++i) {
            const double x = d.value[i], lower = arm.limits.jerk.lower[i], upper = arm.limits.jerk.upper[i];
            ASSERT_GE(x, lower);
            ASSERT_LE(x, upper);
            const double slope = cost.calcSlope(d.value, i);
            const double size = (1.0 + weight) * cost.M.col(i).squaredNorm() * upper;
            const double error = x == lower   ? std::max(0.0, -slope)
                                 : x == upper ? std::max(0.0, slope)
                                              : std::abs(slope);
            worst = std::max(worst, error / size);
            atBounds += x == lower || x == upper;
            violated += cost.miss(i, x) != 0.0;
        }
    }
    std::printf("  %d problems: %.2g rounds each, at most %d; optimal to %.1g of the size\n", problems,
                static_cast<double>(rounds) / problems, most, worst);
    EXPECT_LT(most, SoftCbf::kMaxRounds);
    EXPECT_LE(worst, 1e-9);
    EXPECT_GT(modified + infeasible, problems / 2);
    EXPECT_GT(atBounds, 1000);
    EXPECT_GT(violated, 1000);
}

// With a growing weight the slack goes to zero where the rows have a solution.
TEST(SoftCbf, MissesARowByOneOverTheWeight) {
    Bench bench("single_joint", "soft_cbf");
    const AxisState s{kPi - 0.1, 0.1, 0.2};
    const double bound = 125 * 0.1 - 75 * 0.1 - 15 * 0.2;
    for (const double w : {1e2, 1e3, 1e4, 1e5}) {
        FilterDecision d;
        bench.decide("weight: " + std::to_string(w), s, 100.0, d);
        EXPECT_NEAR((d.value[0] - bound) * (1 + w), 4 * kPi - bound, 1e-6);
    }
}

// The slack does not make infeasible rows feasible; it only gives a jerk all the same.
TEST(SoftCbf, SaysInfeasibleWhereTheRowsHaveNoSolution) {
    Bench bench("single_joint", "soft_cbf");
    std::mt19937 random(52);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    int infeasible = 0;
    for (int k = 0; k < 3000; ++k) {
        const AxisState s{kPi * unit(random), 2 * kPi * unit(random), 3 * kPi * unit(random)};
        const ExponentialBarrierRows rows = calcExponentialBarrierRows(s, bench.arm.limits.axis(0), 5.0);
        double lower = -4 * kPi, upper = 4 * kPi;
        for (std::size_t r = 0; r < 3; ++r) {
            lower = std::max(lower, rows.lower[r]);
            upper = std::min(upper, rows.upper[r]);
        }
        FilterDecision d;
        const FilterStatus status = bench.decide("", s, 10.0 * unit(random), d);
        EXPECT_EQ(status == FilterStatus::Infeasible, lower > upper);
        EXPECT_LE(std::abs(d.value[0]), 4 * kPi);
        infeasible += lower > upper;
    }
    EXPECT_GT(infeasible, 500);
    EXPECT_LT(infeasible, 2900);
}

TEST(SoftCbf, JerkHoldsAndThereIsAlwaysAnAnswer) {
    expectRatesHeldUnderRandomLimits<SoftCbf>(
        "soft_cbf", 23, [](const JointLimits&) { return ""; }, false);
    Bench six("indy7", "soft_cbf");
    setPaperLimits(six.arm);
    int most = 0;
    PushingCommand command(6, 40.0, true, 8);
    const LawOutcome outcome = six.run(
        "", 10.0, [&](const MotionState&) { return command.next(); },
        [&](const MotionState&, const FilterDecision&, const SoftCbf& filter) {
            most = std::max(most, filter.rounds());
        });
    EXPECT_LE(outcome.excess.jerk, 1e-9);
    EXPECT_EQ(outcome.allocations, 0);
    EXPECT_LT(most, SoftCbf::kMaxRounds);
    std::printf("  arm: %.2g rad, %.2g, %.2g, at most %d rounds\n", outcome.excess.position, outcome.excess.velocity,
                outcome.excess.acceleration, most);
}

TEST(SoftCbf, Fault08GainsAndLimitsThatDoNotFitAreRefused) {
    Bench bench("single_joint", "soft_cbf", 0.01);
    EXPECT_CONTAINS(bench.findConfigureComplaint("weight: 0"), "weight");
    bench.expectMisfitsRefused();
}

TEST(SoftCbf, LoadsAsALibrary) {
    expectSameAsLibrary<SoftCbf>("soft_cbf");
}

}  // namespace
}  // namespace viable
