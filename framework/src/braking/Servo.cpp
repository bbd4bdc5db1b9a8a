#include "viable/braking/Servo.h"

#include <array>

#include "braking/AxisServo.h"

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

void Servo::skipTicks(std::int64_t ticks) {
    for (int i = 0; i < impl_->n; ++i) impl_->joints[i].skipTicks(ticks);
}

void Servo::calc(const MotionState& state, const MotionState& target, JointVector& jerk) {
    jerk.resize(impl_->n);
    for (int i = 0; i < impl_->n; ++i)
        jerk[i] =
            impl_->joints[i].calc({state.q[i], state.qd[i], state.qdd[i]}, {target.q[i], target.qd[i], target.qdd[i]});
}

}  // namespace viable
