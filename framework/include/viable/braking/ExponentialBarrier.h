#pragma once

#include <array>

#include "viable/core/JointLimits.h"

namespace viable {

/** Bounds on one joint's jerk by exponential control barrier functions: one row per limit and side, each limit by
itself. Every pole of every barrier lies at -k.

Method (Nguyen and Sreenath 2016; S3 of the paper), for the upper side, the lower one is the mirror image:
    position      h = P - p:   h''' + 3 k h'' + 3 k^2 h' + k^3 h >= 0   <=>   j <= k^3 (P - p) - 3 k^2 v - 3 k a
    velocity      h = V - v:   h'' + 2 k h' + k^2 h >= 0                <=>   j <= k^2 (V - v) - 2 k a
    acceleration  h = A - a:   h' + k h >= 0                            <=>   j <= k (A - a)
A row that always holds keeps its limit under a condition at the start. There h, h' + k h and h'' + 2 k h' + k^2 h (as
far as the row has them) are not negative.
Assumes: continuous time, and rows that can hold. They do not contain the jerk limit or the other rows, so together
they may have no solution. */
struct ExponentialBarrierRows {
    static constexpr int kRows = 3;  ///< per side
    static constexpr std::array<LimitKind, kRows> kLimits{LimitKind::Position, LimitKind::Velocity,
                                                          LimitKind::Acceleration};

    std::array<double, kRows> lower;  ///< smallest jerk of each row, in the order of kLimits [rad/s^3]
    std::array<double, kRows> upper;  ///< largest jerk of each row [rad/s^3]
};

/** The rows at `state`; an unlimited quantity gives an infinite bound. No allocation, no throw.
@param k  [1/s], > 0 */
inline ExponentialBarrierRows calcExponentialBarrierRows(const AxisState& state, const AxisLimits& limits, double k) {
    const double position = 3.0 * k * (k * state.v + state.a);
    const double velocity = 2.0 * k * state.a;
    return {{k * k * k * (limits.positionLower - state.p) - position,
             k * k * (limits.velocityLower - state.v) - velocity, k * (limits.accelerationLower - state.a)},
            {k * k * k * (limits.positionUpper - state.p) - position,
             k * k * (limits.velocityUpper - state.v) - velocity, k * (limits.accelerationUpper - state.a)}};
}

}  // namespace viable
