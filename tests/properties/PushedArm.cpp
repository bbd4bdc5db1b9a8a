#include "PushedArm.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "Paths.h"

namespace viable {

Robot::Robot(const char* name)
    : description(loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name)),
      geometry(loadArmGeometry(description)),
      model(description) {}

Violation checkLimits(const MotionState& state, const JointLimits& limits, double allowed) {
    const auto beyond = [allowed](const JointVector& x, const JointBounds& b) {
        const double excess = std::max((x - b.upper).maxCoeff(), (b.lower - x).maxCoeff());
        return excess > allowed ? excess : 0.0;
    };
    if (const double e = beyond(state.q, limits.position); e > 0.0) return {"position", e};
    if (const double e = beyond(state.qd, limits.velocity); e > 0.0) return {"velocity", e};
    if (const double e = beyond(state.qdd, limits.acceleration); e > 0.0) return {"acceleration", e};
    return {};
}

JointVector Pusher::want(const MotionState& state, const Dynamics& dynamics) {
    const int n = static_cast<int>(state.q.size());
    if (ticksLeft_-- <= 0) {
        mode_ = random_.integer(0, 3);
        ticksLeft_ = static_cast<int>(random_.logUniform(1.0, 1500.0));
        goal_.resize(n);
        for (int i = 0; i < n; ++i) goal_[i] = mode_ == 1 ? random_.uniform(-3.0, 3.0) : random_.uniform(-1.0, 1.0);
        stiffness_ = random_.logUniform(5.0, 2000.0);
    }
    if (mode_ == 1) return stiffness_ * (goal_ - state.q) - 2.0 * std::sqrt(stiffness_) * state.qd;
    if (mode_ == 3) return dynamics.J.topRows<3>().transpose() * goal_.head<3>() * stiffness_;
    if (mode_ != 2) return stiffness_ * goal_.cwiseSign();
    JointVector wanted(n);
    for (int i = 0; i < n; ++i) wanted[i] = random_.uniform(-1.0, 1.0) * stiffness_;
    return wanted;
}

}  // namespace viable
