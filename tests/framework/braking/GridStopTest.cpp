#include "viable/braking/GridStop.h"

#include <gtest/gtest.h>

#include "MotionTestSupport.h"
#include "viable/braking/Braking.h"

namespace viable {
namespace {

TEST(GridStop, StopsOnTheGridWithinAccelerationAndJerkLimits) {
    std::mt19937_64 random(3);
    std::vector<double> ratios;  // planned over fastest stop, both in ticks
    for (int k = 0; k < 20000; ++k) {
        const AxisLimits l = drawLimits(random);
        const double dt = drawLog(random, 5e-4, 1e-2);
        const double a = std::uniform_real_distribution<>(l.accelerationLower, l.accelerationUpper)(random);
        const double v = std::uniform_real_distribution<>(-3, 3)(random);
        if (std::min({-l.accelerationLower, l.accelerationUpper}) < std::max(-l.jerkLower, l.jerkUpper) * dt)
            continue;  // such limits are refused by checkLimits
        GridStop plan;
        ASSERT_TRUE(plan.plan(v, a, l, dt)) << "v " << v << " a " << a << " dt " << dt;
        const double bestTicks = calcStationaryStop(v, a, l).duration() / dt;
        ratios.push_back(plan.remainingTicks() / (bestTicks + 2.0));
        AxisState s{0, v, a};
        // Rounding of one part in 2^53 per tick, in acceleration and through it in velocity.
        const double ticks = plan.remainingTicks(), A = std::max(-l.accelerationLower, l.accelerationUpper);
        const double rounding = 0x1p-52 * ticks * (std::abs(v) + A * (1.0 + ticks * dt));
        while (!plan.atRest()) {
            const double j = plan.popJerk();
            ASSERT_GE(j, l.jerkLower * (1 + 1e-11));
            ASSERT_LE(j, l.jerkUpper * (1 + 1e-11));
            s = advance(s, j, dt);
            ASSERT_GE(s.a, l.accelerationLower * (1 + 1e-9));
            ASSERT_LE(s.a, l.accelerationUpper * (1 + 1e-9));
        }
        ASSERT_NEAR(s.v, 0.0, rounding);
        ASSERT_NEAR(s.a, 0.0, rounding);
        ASSERT_EQ(plan.popJerk(), 0.0);
    }
    std::sort(ratios.begin(), ratios.end());
    RecordProperty("median_ratio_to_fastest_stop", std::to_string(ratios[ratios.size() / 2]));
    RecordProperty("worst_ratio_to_fastest_stop", std::to_string(ratios.back()));
    EXPECT_LE(ratios[ratios.size() / 2], 1.05);
    EXPECT_LE(ratios[ratios.size() * 99 / 100], 2.0);
}

TEST(GridStop, NearTheSwitchingCurveItIsAsFastAsElsewhere) {
    // A braking arm rides along sigma = 0, where one phase is shorter than a tick.
    std::mt19937_64 random(4);
    std::vector<double> ratios;
    double worst = 0, worstV = 0, worstA = 0, worstDt = 0;
    for (int k = 0; k < 20000; ++k) {
        const double A = 4 * 3.14159, J = 12 * 3.14159, dt = drawLog(random, 1e-4, 4e-3);
        const AxisLimits l = makeLimits(A, A, J, J);
        const double a = -A * std::uniform_real_distribution<>(0.0, 1.0)(random);
        const double v = a * a / (2 * J) * (1.0 + 1e-2 * std::normal_distribution<>()(random)) +
                         1e-4 * std::normal_distribution<>()(random);
        GridStop plan;
        ASSERT_TRUE(plan.plan(v, a, l, dt));
        const double delay = plan.remainingTicks() - calcStationaryStop(v, a, l).duration() / dt;
        if (delay > worst) worst = delay, worstV = v, worstA = a, worstDt = dt;
        ratios.push_back(delay);
    }
    std::sort(ratios.begin(), ratios.end());
    RecordProperty("worst_delay_ticks", std::to_string(ratios.back()));
    EXPECT_LE(ratios[ratios.size() * 99 / 100], 4.0);
    if (ratios.back() > 8.0) std::printf("worst: v %.17g a %.17g dt %.17g\n", worstV, worstA, worstDt);
    EXPECT_LE(ratios.back(), 8.0);
    GridStop plan;  // two states that a greedy rounding segments to 789 and 526 ticks
    const AxisLimits l = makeLimits(4 * 3.14159265, 4 * 3.14159265, 12 * 3.14159265, 12 * 3.14159265);
    ASSERT_TRUE(plan.plan(1.872, -11.88, l, 1e-3));
    EXPECT_LE(plan.remainingTicks(), 330);
    ASSERT_TRUE(plan.plan(0.839, -7.95, l, 1e-3));
    EXPECT_LE(plan.remainingTicks(), 220);
}

TEST(GridStop, AbsurdStatesEndInAPlanToo) {
    const AxisLimits l = makeLimits(2, 2, 10, 10);
    for (double v : {1e9, 1e30, 1e100, -1e300}) {
        GridStop plan;
        plan.plan(v, 0.0, l, 1e-3);
        EXPECT_GT(plan.remainingTicks(), 0);
        EXPECT_TRUE(std::isfinite(plan.popJerk()));
    }
}

TEST(GridStop, AtRestIsEmptyAndFarOutsideStillStops) {
    const AxisLimits l = makeLimits(2, 2, 10, 10);
    GridStop plan;
    EXPECT_TRUE(plan.plan(0.0, 0.0, l, 1e-3));
    EXPECT_TRUE(plan.atRest());
    for (double a : {50.0, -50.0, 3.0}) {  // beyond the acceleration limit, as after a law without jerk limit
        AxisState s{0, 1.0, a};
        plan.plan(s.v, s.a, l, 1e-3);
        while (!plan.atRest()) {
            const double j = plan.popJerk();
            ASSERT_LE(std::abs(j), 10 * (1 + 1e-9));
            s = advance(s, j, 1e-3);
        }
        EXPECT_NEAR(s.v, 0.0, 1e-9);
        EXPECT_NEAR(s.a, 0.0, 1e-9);
    }
}

}  // namespace
}  // namespace viable
