#pragma once

#include "viable/core/JointTypes.h"

namespace viable {

/** Position [rad], velocity [rad/s] and acceleration [rad/s^2] of one joint. */
struct AxisState {
    double p = 0.0;
    double v = 0.0;
    double a = 0.0;
};

/** The state after jerk `j` [rad/s^3] is held for `t` [s]; exact (paper, eq. 17). */
inline AxisState advance(const AxisState& s, double j, double t) {
    return {s.p + t * (s.v + t * (s.a / 2.0 + t * j / 6.0)), s.v + t * (s.a + t * j / 2.0), s.a + t * j};
}

}  // namespace viable
