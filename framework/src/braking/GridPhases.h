#pragma once

#include <algorithm>
#include <cmath>

#include "viable/braking/Braking.h"
#include "viable/braking/GridStop.h"

namespace viable::detail {

/** No phase of a stop is longer: states that would need it are no arm's. */
inline constexpr std::int64_t kMaxPhaseTicks = 1'000'000'000'000;

/** Overshoot of acceleration and jerk limits that counts as rounding, relative; jerks are clamped. */
inline constexpr double kPlanRounding = 1e-13;

/** Ticks as an integer of 0 to kMaxPhaseTicks, whatever arithmetic made of them. */
inline std::int64_t toPhaseTicks(double ticks) {
    if (!(ticks > 0.0)) return 0;
    return ticks < static_cast<double>(kMaxPhaseTicks) ? static_cast<std::int64_t>(ticks) : kMaxPhaseTicks;
}

/** Seconds as whole ticks, rounded up; a hair above a whole number counts as that number. */
inline std::int64_t roundUpToTicks(double seconds, double tick_s) {
    return toPhaseTicks(std::ceil(seconds / tick_s - 1e-9));
}

/** Seconds as whole ticks, rounded down; a hair below a whole number counts as that number. */
inline std::int64_t roundDownToTicks(double seconds, double tick_s) {
    return toPhaseTicks(seconds / tick_s + 1e-9);
}

/** A stop in three phases of whole ticks (MATH 4, grid plan): acceleration goes to a1, stays there, goes
back to zero, and velocity reaches zero with it. Phases 1 and 3 have at least one tick. */
struct GridPhases {
    std::int64_t n1 = 1, n2 = 0, n3 = 1;
    double a1 = 0.0;            ///< [rad/s^2]
    double j1 = 0.0, j3 = 0.0;  ///< [rad/s^3]
    bool fitsAcceleration = false, fitsFirst = false, fitsLast = false;

    /** Solves a1, j1 and j3 for the start (v, a); true when they keep the limits. */
    bool solve(double v, double a, const AxisLimits& limits, double tick_s) {
        const double t1 = static_cast<double>(n1) * tick_s;
        const double t2 = static_cast<double>(n2) * tick_s;
        const double t3 = static_cast<double>(n3) * tick_s;
        a1 = -(v + a * t1 / 2.0) / (t1 / 2.0 + t2 + t3 / 2.0);
        j1 = (a1 - a) / t1;
        j3 = -a1 / t3;
        constexpr double slack = 1.0 + kPlanRounding;
        const auto within = [](double x, double lower, double upper) {
            return x >= lower * slack && x <= upper * slack;
        };
        fitsAcceleration = within(a1, limits.accelerationLower, limits.accelerationUpper);
        fitsFirst = within(j1, limits.jerkLower, limits.jerkUpper);
        fitsLast = within(j3, limits.jerkLower, limits.jerkUpper);
        j1 = std::clamp(j1, limits.jerkLower, limits.jerkUpper);
        j3 = std::clamp(j3, limits.jerkLower, limits.jerkUpper);
        return fitsAcceleration && fitsFirst && fitsLast;
    }
};

/** Phases of the stationary stop, rounded up, then mended until acceleration and jerk limits hold. */
inline bool planQuickly(double v, double a, const AxisLimits& limits, double tick_s, GridPhases& g) {
    const StationaryStop stop = calcStationaryStop(v, a, limits);
    g.n1 = std::max<std::int64_t>(1, roundUpToTicks(stop.T1, tick_s));
    g.n2 = roundUpToTicks(stop.T2, tick_s);
    g.n3 = std::max<std::int64_t>(1, roundUpToTicks(stop.T3, tick_s));
    constexpr int kRepairRounds = 6;
    for (int round = 0; round < kRepairRounds; ++round) {
        if (g.solve(v, a, limits, tick_s)) return true;
        if (!g.fitsAcceleration) ++g.n2;
        if (!g.fitsFirst) ++g.n1;
        if (!g.fitsLast) ++g.n3;
    }
    return false;
}

inline GridStop makeStop(const GridPhases& g) {
    GridStop stop;
    stop.set({{{g.n1, g.j1}, {g.n2, 0.0}, {g.n3, g.j3}}});
    return stop;
}

}  // namespace viable::detail
