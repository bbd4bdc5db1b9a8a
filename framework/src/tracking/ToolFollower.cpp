#include "tracking/ToolFollower.h"

#include <cmath>

#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** The lead beyond the way in which a joint stops from its velocity limit [ticks at that limit]: a stop on the grid of ticks is longer than
that of continuous time. */
constexpr double kLeadTicks = 3.0;
/** The rest of the lead of an arm that is led shrinks by e in this share of its longest stop, down to a
least share; it grows by e in a whole one. */
constexpr double kShrinking = 0.25, kLeastLead = 0.02;

/** How far a joint goes until it has stopped [rad]. */
double calcWay(double v, double a, const AxisLimits& limits) {
    return std::isfinite(v) ? calcStationaryStop(v, a, limits).displacement : v;
}

double calcSpeed(double way, const AxisLimits& l) {
    return way > 0.0 ? l.velocityUpper : -l.velocityLower;
}

/** About how long a joint takes for this way, from rest to rest [s]. */
double calcTime(double way, const AxisLimits& l) {
    const double v = calcSpeed(way, l), size = std::abs(way);
    const double a = std::min(l.accelerationUpper, -l.accelerationLower), j = std::min(l.jerkUpper, -l.jerkLower);
    return std::max({size / v, 2.0 * std::sqrt(size / a), std::cbrt(32.0 * size / j)});
}

}  // namespace

void ToolFollower::configure(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                             const MotionState& start, const ToolFollowerOptions& options, const ArmGeometry* geometry,
                             std::shared_ptr<const ArmRecursion> recursion) {
    start_ = start.q;
    tick_s_ = tick_s;
    share_ = options.share;
    updateLimits(limits);
    velocity_.configure(limits, tick_s, options.velocityFilter_s);
    reference_.configure(robot, limits, tick_s, findRest(limits), options.reference, geometry, std::move(recursion));
    servo_.configure(limits, tick_s, options.share);
    reset(start);
}

void ToolFollower::updateLimits(const JointLimits& limits) {
    stopLimits_ = limits;
    for (JointBounds* bounds : {&stopLimits_.acceleration, &stopLimits_.jerk}) {
        bounds->lower *= share_;
        bounds->upper *= share_;
    }
    lead_ = limits.velocity;
    for (int i = 0; i < limits.size(); ++i) {
        const AxisLimits axis = stopLimits_.axis(i);
        for (double* v : {&lead_.lower[i], &lead_.upper[i]}) *v = calcWay(*v, 0.0, axis) + kLeadTicks * tick_s_ * *v;
    }
    const double longest_s = calcLongestStop(limits);
    together_.setOnes(limits.size());
    for (int i = 0; i < limits.size(); ++i) {
        double stop_s = 0.0;
        for (const double v : {limits.velocity.lower[i], limits.velocity.upper[i]})
            if (std::isfinite(v)) stop_s = std::max(stop_s, calcStationaryStop(v, 0.0, limits.axis(i)).duration());
        if (stop_s > 0.0) together_[i] = longest_s / stop_s;
    }
    stopTicks_ = calcLongestStopTicks(limits, tick_s_);
    tremble_.configure(4 * stopTicks_);
    shrink_ = longest_s > 0.0 ? std::exp(-tick_s_ / (kShrinking * longest_s)) : 1.0;
    grow_ = longest_s > 0.0 ? std::exp(tick_s_ / longest_s) : 1.0;
    around_ = lead_;
    stop_.setZero(limits.size());
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
    tremble_.reset(start.q);
    stoodTicks_ = 0;
    leadShare_ = 1.0;
}

void ToolFollower::changeLimits(const JointLimits& limits) {
    updateLimits(limits);
    reference_.changeLimits(limits, findRest(limits));
    servo_.changeLimits(limits);
    velocity_.changeLimits(limits);
}

void ToolFollower::skipTicks(std::int64_t ticks) {
    servo_.skipTicks(ticks);
    velocity_.forget();
}

void ToolFollower::findAround(const MotionState& state, bool isTool, bool stands) {
    for (int i = 0; i < state.q.size(); ++i) {
        const double stop = state.q[i] + calcWay(state.qd[i], state.qdd[i], stopLimits_.axis(i));
        const double pace = isTool ? 1.0 + leadShare_ * (together_[i] - 1.0) : 1.0;
        const double share = stands ? leadShare_ * pace : pace;
        const auto scale = [&](double lead, double v) {
            const double least = kLeadTicks * tick_s_ * v;
            return share != 1.0 && std::isfinite(v) ? least + share * (lead - least) : lead;
        };
        around_.lower[i] = std::min(state.q[i], stop) + scale(lead_.lower[i], stopLimits_.velocity.lower[i]);
        around_.upper[i] = std::max(state.q[i], stop) + scale(lead_.upper[i], stopLimits_.velocity.upper[i]);
        stop_[i] = stop;
    }
}

void ToolFollower::keepPace(const MotionState& state) {
    double longest_s = 0.0, farthest = 0.0, speed = 0.0, rate = 0.0;
    for (int i = 0; i < state.q.size(); ++i) {
        const AxisLimits axis = stopLimits_.axis(i);
        const double way = target_.q[i] - state.q[i], time_s = calcTime(way, axis);
        if (!(time_s > longest_s)) continue;
        longest_s = time_s;
        farthest = std::abs(way);
        speed = calcSpeed(way, axis);
        rate = std::max((state.qd[i] - target_.qd[i]) / way, 1.0 / time_s);
    }
    if (longest_s == 0.0) return;
    for (int i = 0; i < state.q.size(); ++i) {
        const AxisLimits axis = stopLimits_.axis(i);
        double& target = target_.q[i];
        const double way = target - state.q[i];
        const double share = calcSpeed(way, axis) / speed;  // turns and slides alike
        const double same = farthest * (std::isfinite(share) && std::isfinite(speed) ? share : 1.0);
        const double faster = 1.0 - calcTime(std::copysign(same, way), axis) / longest_s;
        if (!(faster > 0.0)) continue;
        const double v = std::clamp(rate * way / faster, axis.velocityLower, axis.velocityUpper);
        const double end = state.q[i] + calcWay(v, 0.0, axis) + kLeadTicks * tick_s_ * v;
        target = way > 0.0 ? std::min(target, std::max(end, stop_[i])) : std::max(target, std::min(end, stop_[i]));
    }
}

template <class Goal>
void ToolFollower::lead(const MotionState& state, const Goal& goal, const Surroundings* surroundings, double time_s,
                        JointVector& jerk) {
    constexpr bool isTool = std::is_same_v<Goal, Pose>;
    leadShare_ = std::clamp(leadShare_ * (servo_.isLed() ? shrink_ : grow_), kLeastLead, 1.0);
    const bool stands = !isTool || stoodTicks_ >= stopTicks_;
    findAround(state, isTool, stands);
    const JointVector& q = reference_.q();
    if (stands && servo_.isLed() && (q.array() < around_.lower.array() || q.array() > around_.upper.array()).any())
        isTool ? reference_.reset(stop_) : reference_.moveTo(stop_);  // a tool's rest ends, joints go on one by one
    reference_.advance(goal, surroundings, time_s, &around_);
    stoodTicks_ = reference_.hasNewGoal() ? 0 : stoodTicks_ + 1;
    if (stoodTicks_ == 0) tremble_.reset(state.q);
    if (reference_.isHeldBack()) {
        reference_.leapTo(stop_, goal);
        if (stands && servo_.isLed() && tremble_.find(state.q) && (!isTool || reference_.isBarred()))
            reference_.rest(stop_);
        velocity_.forget();  // it may stop at any moment: be able to stop with it
    }
    target_.q = reference_.q();
    target_.qd = velocity_.calc(target_.q);
    if (isTool) keepPace(state);
    servo_.calc(state, target_, jerk);
}

template void ToolFollower::lead(const MotionState&, const Pose&, const Surroundings*, double, JointVector&);
template void ToolFollower::lead(const MotionState&, const JointVector&, const Surroundings*, double, JointVector&);

bool normalise(Pose& command) {
    const double norm = command.orientation.norm();
    if (!command.position.allFinite() || !(norm > 0.5 && norm < 2.0)) return false;
    command.orientation.normalize();
    return true;
}

}  // namespace viable
