#pragma once

#include "viable/braking/Braking.h"
#include "viable/braking/GridStop.h"

namespace viable::detail {

// Bounds on the jerk of one tick from the upper side; those from the lower one by mirror().

AxisState mirror(const AxisState& s);
AxisLimits mirror(const AxisLimits& l);
GridStop mirror(const GridStop& stop);

/** What bounds velocity from above: where a > 0, its peak at full jerk plus a dt/2, as much as the grid may add to the
peak; else v. Greedy at the bare peak, a joint would ring about its limit for ever: near a = 0 the sampled peak is the
trapezoidal rule, whose pole is -1. With this term acceleration comes down to zero smoothly, a+ = a^2 / (2 J dt) at last. */
inline double calcUpperPeak(const AxisState& s, const AxisLimits& limits, double tick_s) {
    return s.a > 0.0 ? s.v + s.a / 2.0 * (s.a / -limits.jerkLower + tick_s) : s.v;
}
inline double calcLowerPeak(const AxisState& s, const AxisLimits& limits, double tick_s) {
    return s.a < 0.0 ? s.v + s.a / 2.0 * (s.a / -limits.jerkUpper + tick_s) : s.v;
}

/** The largest jerk of this tick after which calcUpperPeak() does not pass `peak`: of
v + (a + a+) dt/2 + a+/2 (a+/J + dt) <= peak the root a+ where it is positive, else v+ alone counts. */
double calcVelocityBound(const AxisState& s, double peak, const AxisLimits& limits, double tick_s);

/** The largest jerk in [least, most] after which the fastest stop in continuous time does not end beyond the upper
position bound: no grid plan can do better by more than a hair. Newton's method from `most`; the stop position is
convex in the jerk, so that it comes down to the root and not past it. `fastest` gets the stop there. */
double calcContinuousBound(const AxisState& s, double least, double most, const AxisLimits& limits,
                           double positionUpper, double tick_s, StationaryStop& fastest);

}  // namespace viable::detail
