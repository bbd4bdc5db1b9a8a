#pragma once

namespace viable {

/** Share of the distance covered and its slope in normalised time. */
struct MinimumJerk {
    double value;  ///< 0 .. 1
    double slope;  ///< d value / d u, 0 .. kMinimumJerkPeakSlope
};

/** Largest slope, at half the distance: peak speed = this * distance / duration. */
inline constexpr double kMinimumJerkPeakSlope = 1.875;

/** The motion from 0 to 1 in u = 0 .. 1 that minimises the integral of the squared jerk. It is at rest with zero
acceleration at both ends: 10 u^3 - 15 u^4 + 6 u^5. (Flash and Hogan 1985, "The coordination of arm movements".)
Outside 0 .. 1: at rest at the nearer end. */
inline MinimumJerk calcMinimumJerk(double u) {
    if (!(u > 0.0)) return {0.0, 0.0};
    if (u >= 1.0) return {1.0, 0.0};
    return {u * u * u * (10.0 + u * (-15.0 + u * 6.0)), 30.0 * u * u * (1.0 - u) * (1.0 - u)};
}

/** The integral of calcMinimumJerk(u).value from 0 to u, for u in 0 .. 1; 1/2 at u = 1. */
inline double calcMinimumJerkIntegral(double u) {
    const double u2 = u * u;
    return u2 * u2 * (2.5 + u * (-3.0 + u));
}

}  // namespace viable
