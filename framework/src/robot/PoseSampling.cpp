#include "robot/PoseSampling.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "viable/robot/RobotModel.h"

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
            poses[k][i] = k % 2 == 0 ? places[random() % 4] : lower + share * (upper - lower);
        }
    return poses;
}

std::vector<PoseInertia> sampleInertia(const RobotDescription& robot, const JointLimits& limits, int count) {
    RobotModel model(robot);
    Dynamics dynamics;
    std::vector<PoseInertia> samples;
    samples.reserve(static_cast<std::size_t>(count));
    for (const JointVector& q : samplePoses(limits, count)) {
        model.calcDynamics(q, JointVector::Zero(robot.size()), dynamics);
        if (dynamics.M.allFinite() && dynamics.M.llt().info() == Eigen::Success) samples.push_back({q, dynamics.M});
    }
    return samples;
}

}  // namespace viable::detail
