#include "tracking/JointFollower.h"

#include <cmath>
#include <utility>

#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** Nearer to its goal the reference is there, but for rounding [rad, m]. */
constexpr double kThere = 1e-12;

}  // namespace

void JointFollower::configure(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                              const MotionState& start, double share, const ArmGeometry* geometry) {
    servo_.configure(limits, tick_s, share);
    range_ = limits.position;
    guide_.reset();
    if (geometry) {
        ToolFollowerOptions options;
        options.share = share;
        guide_.emplace().configure(robot, limits, tick_s, start, options, geometry);
        longest_ = calcLongestStopTicks(limits, tick_s);
    }
    reset(start);
}

void JointFollower::reset(const MotionState& start) {
    servo_.reset(start);
    ticksLeft_ = 0;
    wasGuided_ = false;
}

void JointFollower::skipTicks(std::int64_t ticks) {
    servo_.skipTicks(ticks);
    if (guide_) guide_->skipTicks(ticks);
}

void JointFollower::calc(const MotionState& state, const MotionState& target, const Surroundings* surroundings,
                         double time_s, JointVector& jerk) {
    if (ticksLeft_ == 0) {
        if (std::exchange(wasGuided_, false)) servo_.reset(state);
        servo_.calc(state, target, jerk);
        if (!guide_ || !servo_.isLed()) return;
        guide_->reset(state);
        ticksLeft_ = longest_;
    }
    goal_ = target.q.cwiseMax(range_.lower).cwiseMin(range_.upper);
    guide_->calc(state, goal_, surroundings, time_s, jerk);
    const bool isFree = !guide_->isLed() && (guide_->reference().q() - goal_).cwiseAbs().maxCoeff() <= kThere;
    ticksLeft_ = isFree ? ticksLeft_ - 1 : longest_;
    wasGuided_ = true;
}

}  // namespace viable
