#pragma once

#include <cmath>

namespace viable::detail {

inline double square(double x) {
    return x * x;
}

/** The target of a QP inside its bounds; not finite counts as 0, a bound that is NaN as none. */
inline double clampTarget(double target, double lower, double upper) {
    double x = std::isfinite(target) ? target : 0.0;
    if (x < lower) x = lower;
    if (x > upper) x = upper;
    return x;
}

}  // namespace viable::detail
