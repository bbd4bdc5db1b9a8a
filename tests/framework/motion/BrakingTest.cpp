#include "viable/motion/Braking.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "viable/motion/TripleIntegrator.h"

namespace viable {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

AxisLimits makeLimits(double Ad, double Au, double Jd, double Ju) {
    return {-kInf, kInf, -kInf, kInf, -Ad, Au, -Jd, Ju};
}

double drawLog(std::mt19937_64& random, double low, double high) {
    return low * std::pow(high / low, std::uniform_real_distribution<>()(random));
}

AxisLimits drawLimits(std::mt19937_64& random) {
    return makeLimits(drawLog(random, 0.1, 30), drawLog(random, 0.1, 30), drawLog(random, 1, 300),
                      drawLog(random, 1, 300));
}

/** The state at the end of the three phases, integrated one by one. */
AxisState followStop(const AxisState& s, const StationaryStop& stop, const AxisLimits& l) {
    const bool upper = stop.side == LimitSide::Upper;
    const AxisState s1 = advance(s, stop.jerk, stop.T1);
    const AxisState s2 = advance(s1, 0.0, stop.T2);
    return advance(s2, upper ? l.jerkUpper : l.jerkLower, stop.T3);
}

TEST(StationaryStop, EndsAtRestWhereItSaysWithinTheLimits) {
    std::mt19937_64 random(1);
    int cruises = 0;
    for (int k = 0; k < 200000; ++k) {
        const AxisLimits l = drawLimits(random);
        const double a =
            std::uniform_real_distribution<>(l.accelerationLower, l.accelerationUpper)(random);
        const double v = std::uniform_real_distribution<>(-5, 5)(random);
        const StationaryStop stop = calcStationaryStop(v, a, l);
        cruises += stop.cruises;
        ASSERT_GE(stop.T1, 0.0);
        ASSERT_GE(stop.T2, 0.0);
        ASSERT_GE(stop.T3, 0.0);
        const AxisState end = followStop({0.0, v, a}, stop, l);
        const double scale = 1.0 + std::abs(stop.displacement) + std::abs(v) + std::abs(a);
        ASSERT_NEAR(end.v, 0.0, 1e-11 * scale) << "v " << v << " a " << a;
        ASSERT_NEAR(end.a, 0.0, 1e-11 * scale);
        ASSERT_NEAR(end.p, stop.displacement, 1e-11 * scale * (1.0 + stop.T1 + stop.T2 + stop.T3));
        const double a1 = a + stop.jerk * stop.T1;
        ASSERT_GE(a1, l.accelerationLower - 1e-9);
        ASSERT_LE(a1, l.accelerationUpper + 1e-9);
    }
    EXPECT_GT(cruises, 20000);  // both sides of V = A^2 / J were met
    EXPECT_LT(cruises, 180000);
}

TEST(StationaryStop, GradientsMatchFiniteDifferencesAndTheIdentityOfThePolicy) {
    std::mt19937_64 random(2);
    int compared = 0;
    for (int k = 0; k < 50000; ++k) {
        const AxisLimits l = drawLimits(random);
        const double a = 0.9 * std::uniform_real_distribution<>(l.accelerationLower,
                                                                l.accelerationUpper)(random);
        const double v = std::uniform_real_distribution<>(-5, 5)(random);
        const StationaryStop stop = calcStationaryStop(v, a, l);
        const double J = stop.jerk;  // braking at full jerk leaves the stop position where it is
        const double scale =
            std::abs(v) + std::abs(stop.gradientV * a) + std::abs(stop.gradientA * J);
        ASSERT_NEAR(v + stop.gradientV * a + stop.gradientA * J, 0.0, 1e-10 * scale);
        const double h = 1e-6;
        const StationaryStop stops[] = {
            calcStationaryStop(v + h, a, l), calcStationaryStop(v - h, a, l),
            calcStationaryStop(v, a + h, l), calcStationaryStop(v, a - h, l)};
        bool sameType = true;
        for (const StationaryStop& other : stops)
            sameType &= other.side == stop.side && other.cruises == stop.cruises;
        if (!sameType || stop.T1 < 1e-3 || stop.T3 < 1e-2)
            continue;  // the gradient jumps on the switching curves
        ++compared;
        const double dv = (stops[0].displacement - stops[1].displacement) / (2 * h);
        const double da = (stops[2].displacement - stops[3].displacement) / (2 * h);
        ASSERT_NEAR(dv, stop.gradientV, 1e-5 * (1.0 + stop.gradientV));
        ASSERT_NEAR(da, stop.gradientA, 1e-5 * (1.0 + stop.gradientA));
    }
    EXPECT_GT(compared, 30000);
}

TEST(StationaryStop, SymmetricLimitsGiveTheTypesOfTableOne) {
    const double A = 2.0, J = 10.0;
    const AxisLimits l = makeLimits(A, A, J, J);
    // Type III: T1 = (a + sqrt((a^2 + 2 J v) / 2)) / J, T3 = sqrt(...) / J.
    const StationaryStop three = calcStationaryStop(0.1, 0.5, l);
    const double w = std::sqrt((0.25 + 2 * J * 0.1) / 2);
    EXPECT_EQ(three.side, LimitSide::Upper);
    EXPECT_FALSE(three.cruises);
    EXPECT_NEAR(three.T1, (0.5 + w) / J, 1e-14);
    EXPECT_NEAR(three.T3, w / J, 1e-14);
    // Type IV exactly when sqrt((a^2 + 2 J v) / 2) > A.
    const double border = (2 * A * A - 0.25) / (2 * J);
    EXPECT_FALSE(calcStationaryStop(border * 0.999, 0.5, l).cruises);
    EXPECT_TRUE(calcStationaryStop(border * 1.001, 0.5, l).cruises);
    // Types II and I are the mirror image.
    const StationaryStop two = calcStationaryStop(-0.1, -0.5, l);
    EXPECT_EQ(two.side, LimitSide::Lower);
    EXPECT_DOUBLE_EQ(two.displacement, -three.displacement);
    EXPECT_DOUBLE_EQ(two.gradientA, three.gradientA);
    EXPECT_TRUE(calcStationaryStop(-border * 1.001, -0.5, l).cruises);
}

TEST(StationaryStop, WorksWithoutAnAccelerationLimit) {
    const AxisLimits l = makeLimits(kInf, kInf, 10, 10);
    const StationaryStop stop = calcStationaryStop(100.0, 0.0, l);
    EXPECT_FALSE(stop.cruises);
    EXPECT_NEAR(followStop({0, 100.0, 0}, stop, l).v, 0.0, 1e-10);
}

TEST(StationaryStop, IsContinuousAcrossItsSwitchingCurves) {
    const AxisLimits l = makeLimits(3, 2, 20, 10);
    for (double a : {-2.5, -1.0, 0.5, 1.5}) {
        // sigma = 0
        const double v0 = -a * std::abs(a) / (2.0 * (a > 0 ? 20 : 10));
        const StationaryStop above = calcStationaryStop(std::nextafter(v0, kInf), a, l);
        const StationaryStop below = calcStationaryStop(std::nextafter(v0, -kInf), a, l);
        EXPECT_NEAR(above.displacement, below.displacement, 1e-7);
        EXPECT_TRUE(std::isfinite(above.gradientA) && std::isfinite(below.gradientA));
    }
}

TEST(GridStop, StopsOnTheGridWithinAccelerationAndJerkLimits) {
    std::mt19937_64 random(3);
    std::vector<double> ratios;  // planned over fastest stop, both in ticks
    for (int k = 0; k < 20000; ++k) {
        const AxisLimits l = drawLimits(random);
        const double dt = drawLog(random, 5e-4, 1e-2);
        const double a =
            std::uniform_real_distribution<>(l.accelerationLower, l.accelerationUpper)(random);
        const double v = std::uniform_real_distribution<>(-3, 3)(random);
        if (std::min({-l.accelerationLower, l.accelerationUpper}) <
            std::max(-l.jerkLower, l.jerkUpper) * dt)
            continue;  // such limits are refused by checkLimits
        GridStop plan;
        ASSERT_TRUE(plan.plan(v, a, l, dt)) << "v " << v << " a " << a << " dt " << dt;
        const StationaryStop best = calcStationaryStop(v, a, l);
        const double bestTicks = (best.T1 + best.T2 + best.T3) / dt;
        ratios.push_back(plan.remainingTicks() / (bestTicks + 2.0));
        AxisState s{0, v, a};
        // Rounding of one part in 2^53 per tick, in acceleration and through it in velocity.
        const double ticks = plan.remainingTicks();
        const double A = std::max(-l.accelerationLower, l.accelerationUpper);
        const double rounding = 0x1p-52 * ticks * (std::abs(v) + A * (1.0 + ticks * dt));
        while (!plan.atRest()) {
            const double j = plan.takeJerk();
            ASSERT_GE(j, l.jerkLower * (1 + 1e-11));
            ASSERT_LE(j, l.jerkUpper * (1 + 1e-11));
            s = advance(s, j, dt);
            ASSERT_GE(s.a, l.accelerationLower * (1 + 1e-9));
            ASSERT_LE(s.a, l.accelerationUpper * (1 + 1e-9));
        }
        ASSERT_NEAR(s.v, 0.0, rounding);
        ASSERT_NEAR(s.a, 0.0, rounding);
        ASSERT_EQ(plan.takeJerk(), 0.0);
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
        const StationaryStop best = calcStationaryStop(v, a, l);
        const double delay = plan.remainingTicks() - (best.T1 + best.T2 + best.T3) / dt;
        if (delay > worst) worst = delay, worstV = v, worstA = a, worstDt = dt;
        ratios.push_back(delay);
    }
    std::sort(ratios.begin(), ratios.end());
    RecordProperty("worst_delay_ticks", std::to_string(ratios.back()));
    EXPECT_LE(ratios[ratios.size() * 99 / 100], 4.0);
    if (ratios.back() > 8.0)
        std::printf("worst: v %.17g a %.17g dt %.17g\n", worstV, worstA, worstDt);
    EXPECT_LE(ratios.back(), 8.0);
    GridStop plan;  // two states that a greedy rounding stretches to 789 and 526 ticks
    const AxisLimits l =
        makeLimits(4 * 3.14159265, 4 * 3.14159265, 12 * 3.14159265, 12 * 3.14159265);
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
        EXPECT_TRUE(std::isfinite(plan.takeJerk()));
    }
}

TEST(GridStop, AtRestIsEmptyAndFarOutsideStillStops) {
    const AxisLimits l = makeLimits(2, 2, 10, 10);
    GridStop plan;
    EXPECT_TRUE(plan.plan(0.0, 0.0, l, 1e-3));
    EXPECT_TRUE(plan.atRest());
    for (double a :
         {50.0, -50.0, 3.0}) {  // beyond the acceleration limit, as after a law without jerk limit
        AxisState s{0, 1.0, a};
        plan.plan(s.v, s.a, l, 1e-3);
        while (!plan.atRest()) {
            const double j = plan.takeJerk();
            ASSERT_LE(std::abs(j), 10 * (1 + 1e-9));
            s = advance(s, j, 1e-3);
        }
        EXPECT_NEAR(s.v, 0.0, 1e-9);
        EXPECT_NEAR(s.a, 0.0, 1e-9);
    }
}

}  // namespace
}  // namespace viable
