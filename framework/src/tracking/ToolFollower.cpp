#include "viable/tracking/ToolFollower.h"

#include <cmath>
#include <utility>

namespace viable {

void ToolFollower::configure(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                             const MotionState& start, const ToolFollowerOptions& options, const ArmGeometry* geometry,
                             std::shared_ptr<const ArmRecursion> recursion) {
    start_ = start.q;
    velocity_.configure(limits, tick_s, options.velocityFilter_s);
    reference_.configure(robot, limits, tick_s, findRest(limits), options.reference, geometry, std::move(recursion));
    servo_.configure(limits, tick_s, options.share);
    reset(start);
}

JointVector ToolFollower::findRest(const JointLimits& limits) const {
    JointVector rest = start_;
    for (int i = 0; i < rest.size(); ++i) {
        const double lower = limits.position.lower[i], upper = limits.position.upper[i];
        if (std::isfinite(lower) && std::isfinite(upper)) rest[i] = (lower + upper) / 2.0;
    }
    return rest;
}

void ToolFollower::reset(const MotionState& start) {
    const JointVector zero = JointVector::Zero(start.q.size());
    reference_.reset(start.q);
    servo_.reset(start);
    target_ = {start.q, zero, zero};
    velocity_.reset(start.q);
}

void ToolFollower::changeLimits(const JointLimits& limits) {
    reference_.changeLimits(limits, findRest(limits));
    servo_.changeLimits(limits);
    velocity_.changeLimits(limits);
}

void ToolFollower::skipTicks(std::int64_t ticks) {
    servo_.skipTicks(ticks);
    velocity_.forget();
}

void ToolFollower::calc(const MotionState& state, const Pose& command, const Surroundings* surroundings, double time_s,
                        JointVector& jerk) {
    reference_.advance(command, surroundings, time_s);
    if (reference_.isAtSpeedLimit()) velocity_.forget();  // it may stop at any moment: be able to stop with it
    target_.q = reference_.q();
    target_.qd = velocity_.calc(target_.q);
    servo_.calc(state, target_, jerk);
}

bool normalise(Pose& command) {
    const double norm = command.orientation.norm();
    if (!command.position.allFinite() || !(norm > 0.5 && norm < 2.0)) return false;
    command.orientation.normalize();
    return true;
}

}  // namespace viable
