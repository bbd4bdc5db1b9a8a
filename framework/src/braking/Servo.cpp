#include "viable/braking/Servo.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "braking/AxisServo.h"
#include "viable/braking/Braking.h"
#include "viable/core/Numbers.h"

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

void Servo::skipTicks(std::int64_t ticks) {
    for (int i = 0; i < impl_->n; ++i) impl_->joints[i].skipTicks(ticks);
}

void Servo::calc(const MotionState& state, const MotionState& target, JointVector& jerk) {
    jerk.resize(impl_->n);
    for (int i = 0; i < impl_->n; ++i)
        jerk[i] =
            impl_->joints[i].calc({state.q[i], state.qd[i], state.qdd[i]}, {target.q[i], target.qd[i], target.qdd[i]});
}

namespace {

/** Faster than so many times the velocity limit is a jump: more than rounding. */
constexpr double kJump = 1.0 + 1e-6;

/** From the velocity limit, in the longer of its two directions [s]. */
double calcStopTime(const AxisLimits& l) {
    const auto calc = [&](double v) {
        if (!std::isfinite(v)) return kInfinity;
        return calcStationaryStop(v, 0.0, l).duration();
    };
    return std::max(calc(l.velocityLower), calc(l.velocityUpper));
}

}  // namespace

void TargetVelocity::configure(const JointLimits& limits, double tick_s, double filter_s) {
    const int n = limits.size();
    tick_s_ = tick_s;
    limits_ = limits.velocity;
    share_.resize(n);
    for (int i = 0; i < n; ++i)
        share_[i] = tick_s / (tick_s + (filter_s > 0.0 ? filter_s : calcStopTime(limits.axis(i))));
    reset(JointVector::Zero(n));
}

void TargetVelocity::changeLimits(const JointLimits& limits) {
    limits_ = limits.velocity;
}

void TargetVelocity::reset(const JointVector& q) {
    last_ = q;
    smoothed_.setZero(q.size());
    velocity_.setZero(q.size());
}

const JointVector& TargetVelocity::calc(const JointVector& q) {
    for (Eigen::Index i = 0; i < q.size(); ++i) {
        const double velocity = (q[i] - last_[i]) / tick_s_;
        const bool isJump = velocity < kJump * limits_.lower[i] || velocity > kJump * limits_.upper[i];
        if (!isJump) smoothed_[i] += share_[i] * (velocity - smoothed_[i]);
        velocity_[i] = velocity == 0.0 ? 0.0 : smoothed_[i];
    }
    last_ = q;
    return velocity_;
}

}  // namespace viable
