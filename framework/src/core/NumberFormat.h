#pragma once

#include <cmath>
#include <cstdio>
#include <string>

#include "viable/core/JointLimits.h"

namespace viable::detail {

template <class... Arguments>
std::string format(const char* pattern, Arguments... arguments) {
    char text[512];
    std::snprintf(text, sizeof text, pattern, arguments...);
    return text;
}

/** Percent, with enough digits that a limit passed by a hair does not read as 100.00. */
inline std::string formatPercent(double share) {
    if (std::isinf(share)) return "inf";
    if (share > 1.0 + kOutsideShare && share < 1.0 + 5e-5)
        return share < 1.0 + 1e-6 ? ">100" : format("%.4f", 100.0 * share);
    return format(share < 10.0 ? "%.2f" : "%.0f", 100.0 * share);
}

/** Three digits, and no exponent where people read the number faster without. */
inline std::string formatPlain(double x) {
    const double size = std::abs(x);
    return format(size >= 1000.0 && size < 1e7 ? "%.0f" : "%.3g", x);
}

}  // namespace viable::detail
