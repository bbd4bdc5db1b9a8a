#include "robot/PoseSampling.h"

#include <algorithm>
#include <cmath>

namespace viable::detail {

JointBounds makeFinite(JointBounds position, const JointVector& reach) {
    for (int i = 0; i < position.lower.size(); ++i) {
        double &lower = position.lower[i], &upper = position.upper[i];
        if (std::isinf(lower)) lower = std::isinf(upper) ? -reach[i] : upper - 2.0 * reach[i];
        if (std::isinf(upper)) upper = lower + 2.0 * reach[i];
    }
    return position;
}

std::vector<JointVector> samplePoses(const JointLimits& limits, int count) {
    const int n = limits.size();
    const JointBounds range = makeFinite(limits.position, JointVector::Constant(n, kPi));
    std::mt19937 random(1);  // its numbers are the same everywhere
    std::vector<JointVector> poses(static_cast<std::size_t>(count), JointVector(n));
    for (int k = 0; k < count; ++k)
        for (int i = 0; i < n; ++i) {
            const double lower = range.lower[i], upper = range.upper[i];
            const double places[] = {lower, upper, std::clamp(0.0, lower, upper), 0.5 * (lower + upper)};
            const double share = drawShare(random);
            poses[static_cast<std::size_t>(k)][i] = k % 2 == 0 ? places[random() % 4] : lower + share * (upper - lower);
        }
    return poses;
}

}  // namespace viable::detail
