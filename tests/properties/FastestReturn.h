#pragma once

#include "PathRange.h"

namespace viable {

/** Follows the fastest stop in continuous time; an acceleration beyond its limit is first brought to the limit at full
jerk. Returns its duration [s]. */
double followFastestStop(PathRange& path, const AxisLimits& limits);

/** The yardstick of a way back into the limits, which knows nothing of the law: the fastest stop in continuous time, then,
where that ends beyond a position limit, from rest to rest back to the limit, as fast as all limits allow. */
struct FastestReturn {
    /** @param stopLimits  of jerk and acceleration during the stop: `limits`, or those before a change */
    FastestReturn(const AxisState& s, const AxisLimits& stopLimits, const AxisLimits& limits, double tick_s);

    PathRange stop;
    double seconds;  ///< until it is at rest within the limits
    /** What one tick adds at most along the way: to position [rad], velocity [rad/s], acceleration [rad/s^2]. */
    double tickTravel[3];
};

}  // namespace viable
