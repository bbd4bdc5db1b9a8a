#pragma once

#include <cmath>

#include "viable/core/JointTypes.h"

namespace viable::detail {

/** The joint whose |error| is beyond its bound by the largest factor; -1: all are within. */
inline int findFarthestBeyond(const JointVector& error, const JointVector& bound) {
    int farthest = -1;
    double largest = 1.0;
    for (int i = 0; i < error.size(); ++i) {
        const double size = std::abs(error[i]);
        if (size <= bound[i]) continue;
        const double share = size / bound[i];
        if (farthest >= 0 && !(share > largest)) continue;
        farthest = i;
        largest = share;
    }
    return farthest;
}

}  // namespace viable::detail
