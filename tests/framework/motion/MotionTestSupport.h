#pragma once

#include <cmath>
#include <limits>
#include <random>

#include "viable/core/JointLimits.h"

namespace viable {

inline constexpr double kInf = std::numeric_limits<double>::infinity();

/** Acceleration limits -Ad..Au [rad/s^2] and jerk limits -Jd..Ju [rad/s^3], no others. */
inline AxisLimits makeLimits(double Ad, double Au, double Jd, double Ju) {
    return {-kInf, kInf, -kInf, kInf, -Ad, Au, -Jd, Ju};
}

inline double drawUniform(std::mt19937_64& random, double low, double high) {
    return std::uniform_real_distribution<>(low, high)(random);
}

/** Log-uniform. */
inline double drawLog(std::mt19937_64& random, double low, double high) {
    return low * std::pow(high / low, drawUniform(random, 0.0, 1.0));
}

inline AxisLimits drawLimits(std::mt19937_64& random) {
    const double Ad = drawLog(random, 0.1, 30), Au = drawLog(random, 0.1, 30);
    const double Jd = drawLog(random, 1, 300), Ju = drawLog(random, 1, 300);
    return makeLimits(Ad, Au, Jd, Ju);
}

}  // namespace viable
