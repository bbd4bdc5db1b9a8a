#include "PushedArm.h"

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

void PushedArm::scaleLimits(double jerk, double acceleration) {
    JointLimits& limits = description_.limits;
    for (JointVector* side : {&limits.jerk.lower, &limits.jerk.upper}) *side *= jerk;
    for (JointVector* side : {&limits.acceleration.lower, &limits.acceleration.upper}) *side *= acceleration;
}

void PushedArm::drawStart(double movingChance, double largestSpeed, double accelerationPerSpeed) {
    const JointBounds& range = description_.limits.position;
    const int n = description_.size();
    state_.q = description_.home;
    state_.qd.setZero(n);
    state_.qdd.setZero(n);
    if (random_.chance(0.7))
        for (int i = 0; i < n; ++i)
            state_.q[i] = random_.uniform(std::max(range.lower[i], -kPi), std::min(range.upper[i], kPi));
    if (!random_.chance(movingChance)) return;
    const double size = random_.logUniform(0.01, largestSpeed);
    for (int i = 0; i < n; ++i) {
        state_.qd[i] = size * random_.uniform(-1.0, 1.0);
        state_.qdd[i] = accelerationPerSpeed * size * random_.uniform(-1.0, 1.0);
    }
}

void PushedArm::drawOptions(double torqueShareChance, double leastShare) {
    options_.joints.kAlpha = random_.chance(0.7) ? kInfinity : random_.logUniform(2.0, 500.0);
    options_.joints.gamma = random_.logUniform(5.0, 500.0);
    constexpr Objective kObjectives[] = {Objective::Torque, Objective::Tool, Objective::Joint, Objective::Path};
    options_.joints.objective = kObjectives[random_.integer(0, 3)];
    options_.steers = random_.chance(0.8);
    if (random_.chance(torqueShareChance)) options_.torqueShare = random_.uniform(leastShare, 1.0);
    misses_ = random_.chance(0.3) ? random_.logUniform(0.001, 0.1) : 0.0;
}

bool PushedArm::configure(int ticks, const ArmGeometry* geometry) {
    robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
    torque_ = dynamics_.gravity;
    setup_.emplace(RunSetup{description_, description_.limits, kTick_s, ticks * kTick_s, state_, dynamics_.tool,
                            geometry, surroundingsFeed_.get(), peopleFeed_.get()});
    try {
        filter_.configure(*setup_, options_);
        return true;
    } catch (const Error&) {
        isRefusedAtRest = state_.qd.isZero(0.0) && !geometry && std::isinf(options_.torqueShare);
        return false;
    }
}

FilterStatus PushedArm::decide() {
    torque_ = dynamics_.M * pusher_.want(state_, dynamics_) + dynamics_.b;
    const FilterStatus status = filter_.filter({state_, torque_, dynamics_}, decision_);
    passed += status == FilterStatus::Passed;
    stopped += status == FilterStatus::StoppedByPlan;
    return status;
}

bool PushedArm::acts(LimitKind kind) const {
    const auto end = decision_.joints.begin() + description_.size();
    return std::any_of(decision_.joints.begin(), end, [kind](const auto& joint) { return joint.limit == kind; });
}

JointVector PushedArm::popJerks(std::array<GridStop, kMaxJoints>& left, bool& moves) const {
    JointVector jerk(description_.size());
    moves = false;
    for (int i = 0; i < jerk.size(); ++i) {
        GridStop& stop = left[static_cast<std::size_t>(i)];
        moves |= !stop.atRest();
        jerk[i] = stop.popJerk();
    }
    return jerk;
}

void PushedArm::followStop() {
    ++missed;
    bool moves = false;
    std::array<GridStop, kMaxJoints> left = decision_.stops;
    decision_.holdJerk(popJerks(left, moves));
    decision_.stops = left;
    filter_.skipTicks(1);
}

JointVector PushedArm::findTorque(const MotionState& state, const Dynamics& dynamics, const FilterDecision& decision) {
    HeldMotion motion;
    calcHeldMotion({state, dynamics.gravity, dynamics}, FilterStatus::Modified, decision, kTick_s, motion);
    return motion.torque;
}

Violation PushedArm::checkTorque(const JointVector& torque) const {
    for (Eigen::Index i = 0; i < torque.size(); ++i) {
        const double limit = options_.torqueShare * description_.actuation.torqueLimit[i];
        if (std::abs(torque[i]) > limit * (1.0 + kAllowedTorque))
            return {"torque beyond its limit", std::abs(torque[i]) - limit};
    }
    return {};
}

MotionState PushedArm::calcState(const MotionState& from, const JointVector& jerk, double t) {
    MotionState at = from;
    for (Eigen::Index i = 0; i < jerk.size(); ++i) {
        const AxisState s = advance({from.q[i], from.qd[i], from.qdd[i]}, jerk[i], t);
        at.q[i] = s.p;
        at.qd[i] = s.v;
        at.qdd[i] = s.a;
    }
    return at;
}

}  // namespace viable
