#pragma once

#include <cmath>

namespace viable::detail {

/** The length by which excesses over a limit are measured: half of its range; the limit itself, where there is one
side only; infinity without a limit. */
inline double calcLimitScale(double lower, double upper) {
    if (std::isfinite(lower) && std::isfinite(upper)) return (upper - lower) / 2.0;
    if (std::isfinite(lower)) return std::abs(lower);
    return std::abs(upper);
}

}  // namespace viable::detail
