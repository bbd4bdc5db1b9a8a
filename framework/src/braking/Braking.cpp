#include "viable/braking/Braking.h"

#include <algorithm>
#include <cmath>

// Derivation, upper side (the lower one is its mirror image). Jd, Ju: size of the jerk downwards
// and upwards, Ad: size of the deceleration limit. Phase 1 takes a to a1 < 0 with -Jd.
//
// Stationary policy: phase 3 takes a1 to 0 with +Ju and uses up the velocity a1^2 / (2 Ju). Without
// a cruise the velocities add up to zero when
//     a1^2 = K (v + a^2 / (2 Jd)),   K = 2 Jd Ju / (Jd + Ju);
// with one (|a1| would exceed Ad) a1 = -Ad and T2 = v1 / Ad - T3 / 2 with v1 the velocity after
// phase 1. Differentiating the displacement, every term but these cancels, with and without cruise:
//     d/dv = T1 + T2 + T3 / 2,     d/da = T1 (T1 / 2 + T2 + T3 / 2).
//
// Velocity-zeroing policy: the same without phase 3, so K = 2 Jd, T2 = v1 / Ad and T3 = 0 in the
// gradients.
//
// Both satisfy v + a d/dv - Jd d/da = 0: braking at full jerk leaves the stop position where it is.

namespace viable {

namespace {

/** The magnitudes that matter for one direction of braking. */
struct BrakingSizes {
    double Jd, Ju, Ad;
};

/** -a1 of a stop without cruise; K as above. */
double calcBrakingAcceleration(double v, double a, const BrakingSizes& s, double K) {
    return std::sqrt(std::max(0.0, K * (v + a * a / (2.0 * s.Jd))));
}

double calcFirstPhaseDisplacement(double v, double a, const BrakingSizes& s, double T1) {
    return T1 * (v + T1 * (a / 2.0 - s.Jd * T1 / 6.0));
}

StationaryStop calcUpperStationaryStop(double v, double a, const BrakingSizes& s) {
    StationaryStop stop;
    stop.jerk = -s.Jd;
    const double w = calcBrakingAcceleration(v, a, s, 2.0 * s.Jd * s.Ju / (s.Jd + s.Ju));
    if (w > s.Ad) {
        stop.cruises = true;
        stop.T1 = std::max(0.0, (a + s.Ad) / s.Jd);
        stop.T3 = s.Ad / s.Ju;
        const double v1 = v + a * stop.T1 - s.Jd * stop.T1 * stop.T1 / 2.0;
        stop.T2 = std::max(0.0, v1 / s.Ad - stop.T3 / 2.0);
    } else {
        stop.T1 = std::max(0.0, (a + w) / s.Jd);
        stop.T3 = w / s.Ju;
    }
    const double T1 = stop.T1, T2 = stop.T2, T3 = stop.T3;
    const double a1 = -s.Ju * T3;
    const double v2 = s.Ju * T3 * T3 / 2.0;  // velocity at the beginning of phase 3
    stop.displacement = calcFirstPhaseDisplacement(v, a, s, T1) +
                        T2 * (v2 - a1 * T2 / 2.0)     // cruise, seen from its end
                        + s.Ju * T3 * T3 * T3 / 6.0;  // phase 3, seen from its end
    stop.gradientV = T1 + T2 + T3 / 2.0;
    stop.gradientA = T1 * (T1 / 2.0 + T2 + T3 / 2.0);
    return stop;
}

VelocityZeroingStop calcUpperVelocityZeroingStop(double v, double a, const BrakingSizes& s) {
    VelocityZeroingStop stop;
    stop.jerk = -s.Jd;
    const double w = calcBrakingAcceleration(v, a, s, 2.0 * s.Jd);
    if (w > s.Ad) {
        stop.cruises = true;
        stop.T1 = std::max(0.0, (a + s.Ad) / s.Jd);
        const double v1 = v + a * stop.T1 - s.Jd * stop.T1 * stop.T1 / 2.0;
        stop.T2 = std::max(0.0, v1 / s.Ad);
        stop.endAcceleration = -s.Ad;
    } else {
        // For a < 0 the sum a + w cancels; (w + a)(w - a) = 2 Jd v does not.
        stop.T1 = std::max(0.0, a < 0.0 ? 2.0 * v / (w - a) : (a + w) / s.Jd);
        stop.endAcceleration = -w;
    }
    const double T1 = stop.T1, T2 = stop.T2;
    stop.displacement = calcFirstPhaseDisplacement(v, a, s, T1);
    if (stop.cruises) stop.displacement += s.Ad * T2 * T2 / 2.0;  // seen from its end
    stop.gradientV = T1 + T2;
    stop.gradientA = T1 * (T1 / 2.0 + T2);
    return stop;
}

/** The side that sigma tells. */
LimitSide findSide(double v, double a, const AxisLimits& limits) {
    return calcVelocityPeak(v, a, limits) >= 0.0 ? LimitSide::Upper : LimitSide::Lower;
}

/** The stop of a side, from the one that knows the upper side. */
template <class Stop>
Stop calcBySide(double v, double a, const AxisLimits& limits, LimitSide side,
                Stop (*calcUpper)(double, double, const BrakingSizes&)) {
    const double Jd = -limits.jerkLower, Ju = limits.jerkUpper;
    if (side == LimitSide::Upper) return calcUpper(v, a, {Jd, Ju, -limits.accelerationLower});
    Stop stop = calcUpper(-v, -a, {Ju, Jd, limits.accelerationUpper});
    stop.side = LimitSide::Lower;
    stop.jerk = -stop.jerk;
    stop.displacement = -stop.displacement;
    return stop;
}

}  // namespace

StationaryStop calcStationaryStop(double v, double a, const AxisLimits& limits) {
    return calcBySide(v, a, limits, findSide(v, a, limits), calcUpperStationaryStop);
}

double calcLongestStop(const JointLimits& limits) {
    double longest_s = 0.0;
    for (int i = 0; i < limits.size(); ++i) {
        const AxisLimits axis = limits.axis(i);
        for (const double v : {axis.velocityLower, axis.velocityUpper}) {
            if (!std::isfinite(v)) continue;
            // Where the jerk has no limit, at the deceleration limit from the start.
            const double braking = v > 0.0 ? -axis.accelerationLower : axis.accelerationUpper;
            const bool isJerkLimited = std::isfinite(axis.jerkLower) && std::isfinite(axis.jerkUpper);
            const double stop_s = isJerkLimited ? calcStationaryStop(v, 0.0, axis).duration() : std::abs(v) / braking;
            if (std::isfinite(stop_s)) longest_s = std::max(longest_s, stop_s);
        }
    }
    return longest_s;
}

std::int64_t calcLongestStopTicks(const JointLimits& limits, double tick_s) {
    const double stop_s = calcLongestStop(limits);
    return 1 + std::llround((stop_s > 0.0 ? stop_s : 1.0) / tick_s);
}

VelocityZeroingStop calcVelocityZeroingStop(double v, double a, const AxisLimits& limits) {
    return calcVelocityZeroingStop(v, a, limits, findSide(v, a, limits));
}

VelocityZeroingStop calcVelocityZeroingStop(double v, double a, const AxisLimits& limits, LimitSide side) {
    VelocityZeroingStop stop = calcBySide(v, a, limits, side, calcUpperVelocityZeroingStop);
    if (stop.side == LimitSide::Lower) stop.endAcceleration = -stop.endAcceleration;
    return stop;
}

double calcVelocityPeak(double v, double a, const AxisLimits& limits) {
    const double J = a > 0.0 ? -limits.jerkLower : limits.jerkUpper;
    return v + a * std::abs(a) / (2.0 * J);
}

}  // namespace viable
