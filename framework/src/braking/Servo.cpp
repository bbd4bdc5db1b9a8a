#include "viable/braking/Servo.h"

#include <algorithm>
#include <cmath>

#include "braking/AxisServo.h"
#include "viable/braking/Braking.h"

namespace viable {

struct Servo::Impl {
    int n = 0;
    std::array<AxisServo, kMaxJoints> joints;
};

Servo::Servo() : impl_(std::make_unique<Impl>()) {}
Servo::~Servo() = default;
Servo::Servo(Servo&&) noexcept = default;
Servo& Servo::operator=(Servo&&) noexcept = default;

void Servo::configure(const JointLimits& limits, double tick_s, double share) {
    impl_->n = limits.size();
    for (int i = 0; i < impl_->n; ++i) impl_->joints[i].configure(limits.axis(i), tick_s, share);
}

void Servo::reset(const MotionState& start) {
    for (int i = 0; i < impl_->n; ++i) impl_->joints[i].reset({start.q[i], start.qd[i], start.qdd[i]});
}

void Servo::changeLimits(const JointLimits& limits) {
    for (int i = 0; i < impl_->n; ++i) impl_->joints[i].changeLimits(limits.axis(i));
}

bool Servo::isLed() const {
    return std::any_of(impl_->joints.data(), impl_->joints.data() + impl_->n,
                       [](const AxisServo& joint) { return joint.isLed(); });
}

void Servo::skipTicks(std::int64_t ticks) {
    for (int i = 0; i < impl_->n; ++i) impl_->joints[i].skipTicks(ticks);
}

void Servo::calc(const MotionState& state, const MotionState& target, JointVector& jerk) {
    jerk.resize(impl_->n);
    for (int i = 0; i < impl_->n; ++i)
        jerk[i] =
            impl_->joints[i].calc({state.q[i], state.qd[i], state.qdd[i]}, {target.q[i], target.qd[i], target.qdd[i]});
}

/** A target's velocity is smoothed over this share of the time in which the joint stops from its limit, and may grow with
this share of the deceleration of that stop. */
constexpr double kSmoothing = 0.5, kGrowth = 0.5;

static double calcStopTime(double v, const AxisLimits& l) {
    return std::isfinite(v) ? calcStationaryStop(v, 0.0, l).duration() : kInfinity;
}

void TargetVelocity::configure(const JointLimits& limits, double tick_s, double filter_s) {
    tick_s_ = tick_s;
    filter_s_ = filter_s;
    changeLimits(limits);
    reset(JointVector::Zero(limits.size()));
}

void TargetVelocity::changeLimits(const JointLimits& limits) {
    const int n = limits.size();
    limits_ = limits.velocity;
    share_.resize(n);
    growth_ = limits_;
    for (int i = 0; i < n; ++i) {
        const AxisLimits l = limits.axis(i);
        const double lower_s = calcStopTime(l.velocityLower, l), upper_s = calcStopTime(l.velocityUpper, l);
        const bool isGiven = filter_s_ > 0.0;
        share_[i] = tick_s_ / (tick_s_ + (isGiven ? filter_s_ : kSmoothing * std::max(lower_s, upper_s)));
        growth_.lower[i] = isGiven ? -kInfinity : kGrowth * tick_s_ * l.velocityLower / lower_s;
        growth_.upper[i] = isGiven ? kInfinity : kGrowth * tick_s_ * l.velocityUpper / upper_s;
        if (std::isinf(l.velocityLower)) growth_.lower[i] = -kInfinity;  // it has no share then
        if (std::isinf(l.velocityUpper)) growth_.upper[i] = kInfinity;
    }
}

void TargetVelocity::reset(const JointVector& q) {
    last_ = q;
    smoothed_.setZero(q.size());
    velocity_.setZero(q.size());
}

const JointVector& TargetVelocity::calc(const JointVector& q) {
    for (Eigen::Index i = 0; i < q.size(); ++i) {
        const double velocity = (q[i] - last_[i]) / tick_s_;
        // Faster than the limit is a jump, or the catching up after one: for this tick it counts as the limit.
        const double believed = std::clamp(velocity, limits_.lower[i], limits_.upper[i]);
        const double next = smoothed_[i] + share_[i] * (believed - smoothed_[i]);
        // Growth counts from where it was, or from zero where it turns round.
        const double from = next * smoothed_[i] > 0.0 ? smoothed_[i] : 0.0;
        const bool isSlower = std::abs(next) < std::abs(from);
        smoothed_[i] = isSlower ? next : std::clamp(next, from + growth_.lower[i], from + growth_.upper[i]);
        velocity_[i] = velocity == 0.0 ? 0.0 : smoothed_[i];
    }
    last_ = q;
    return velocity_;
}

}  // namespace viable
