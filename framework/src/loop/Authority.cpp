#include "loop/Authority.h"

#include "core/Text.h"
#include "tracking/InertiaSample.h"

namespace viable::detail {

/** Poses in which the gain of a loop that follows the inertia is looked for. */
constexpr int kGainPoses = 64;

/** Largest K_r of each joint [Nms/rad]. */
static JointVector findLargestGain(const RunSetup& setup, const LinearErrorLoop& loop) {
    if (std::isinf(loop.inertiaRate)) return loop.kr;
    JointVector largest = JointVector::Zero(setup.size());
    for (const PoseInertia& pose : sampleInertia(setup.robot, setup.limits, kGainPoses))
        largest = largest.cwiseMax(calcLoopGain(loop, pose.M).diagonal());
    return largest;
}

/** Largest force that joints pushed with those torques, each up to its own [Nm], press the tool with along x, y and z of the
base frame: what the weakest joint can hold [N]. Infinite along an axis that no joint moves the tool along. */
static Eigen::Vector3d calcToolForce(const JointVector& torque, const ToolJacobian& J) {
    constexpr double kNoLever = 1e-6;  // [m]
    Eigen::Vector3d force = Eigen::Vector3d::Constant(kInfinity);
    for (int axis = 0; axis < 3; ++axis)
        for (int i = 0; i < torque.size(); ++i)
            if (std::abs(J(axis, i)) > kNoLever) force[axis] = std::min(force[axis], torque[i] / std::abs(J(axis, i)));
    return force;
}

AuthoritySizes calcAuthority(const RunSetup& setup, const LinearErrorLoop* loop, const TrackingBound* bound) {
    const int n = setup.size();
    const Actuation& actuation = setup.robot.actuation;
    const JointVector none = JointVector::Zero(n);
    AuthoritySizes sizes{none, none, 0.0, loop ? loop->kp : none};
    if (bound && loop && bound->velocity.size() == n && bound->integralTorque.size() == n) {
        const JointVector noise = 2.0 / setup.tick_s * (bound->measured - bound->position);
        const JointVector error = bound->velocity + noise + loop->kp.cwiseProduct(bound->measured);
        sizes.reach = loop->kr.cwiseProduct(error) + bound->integralTorque;
        if (loop->friction.isActive()) sizes.reach += loop->friction.figures.coulomb + loop->friction.figures.viscous;
        return sizes;
    }
    sizes.friction = kFrictionFactor;
    const JointVector gain = loop ? findLargestGain(setup, *loop) : none;
    for (int i = 0; i < n; ++i) {
        const double motor = kMotorShare * actuation.torqueLimit[i];
        sizes.lasting[i] = std::max(0.5 * motor, motor - kFrictionFactor * actuation.friction.coulomb[i]);
        const double noise = 2.0 * setup.robot.encoderStep(i) * (1.0 / setup.tick_s + sizes.kp[i]);
        sizes.reach[i] = sizes.lasting[i] + gain[i] * noise;
    }
    return sizes;
}

Authority::Authority(const RunSetup& setup, AuthoritySizes sizes)
    : n_(setup.size()),
      heldTicks_(kHeldTicks + setup.delayTicks),
      wayTicks_(std::max(1, static_cast<int>(0.5 * kTakeBack_s / setup.tick_s))),
      tick_s_(setup.tick_s),
      sizes_(std::move(sizes)),
      torqueLimit_(setup.robot.actuation.torqueLimit),
      figures_(setup.robot.actuation.friction),
      ownFastest_(setup.limits.velocity) {
    reset();
}

void Authority::reset() {
    fastest_ = ownFastest_;
    for (JointVector* v : {&velocity_, &lasting_, &lowest_, &highest_, &last_, &excess_, &owed_, &pushedMomentum_,
                           &impliedMomentum_, &impliedTravel_})
        v->setZero(n_);
    for (auto* ticks : {&cutTicks_, &cutSide_, &pressedTicks_, &backTick_, &backTicks_}) ticks->fill(0);
    for (auto* flags : {&isHeld_, &isPressing_, &isOpen_, &hasAdded_}) flags->fill(false);
    isNear_.fill(true);
}

void Authority::widen(const JointLimits& limits) {
    if (n_ == 0) return;
    fastest_.lower = fastest_.lower.cwiseMin(limits.velocity.lower);
    fastest_.upper = fastest_.upper.cwiseMax(limits.velocity.upper);
}

void Authority::update(const MotionState& nominal, JointState& real) {
    const double share = std::min(1.0, tick_s_ / kVelocity_s);
    for (int i = 0; i < n_; ++i) {
        const double error = real.q[i] - nominal.q[i];
        velocity_[i] += share * (std::clamp(real.qd[i], fastest_.lower[i], fastest_.upper[i]) - velocity_[i]);
        const double lasting = calcLasting(i);
        highest_[i] = lasting + calcFriction(i, std::max(0.0, velocity_[i])) + sizes_.reach[i];
        lowest_[i] = lasting - calcFriction(i, std::max(0.0, -velocity_[i])) - sizes_.reach[i];
        isNear_[i] = true;
        const double kp = sizes_.kp[i];
        if (!isHeld_[i] || !(kp > 0.0)) continue;
        const double behind = std::max(0.0, kFastReturn * fastest_.upper[i] - nominal.qd[i]) / kp;
        const double ahead = std::max(0.0, nominal.qd[i] - kFastReturn * fastest_.lower[i]) / kp;
        isNear_[i] = error >= -behind && error <= ahead;
        if (!isNear_[i]) real.q[i] = nominal.q[i] + std::clamp(error, -behind, ahead);
    }
}

bool Authority::cut(const JointVector& nominal, JointVector& torque) {
    bool isChanged = false;
    for (int i = 0; i < n_; ++i) {
        const double wanted = torque[i];
        if (isOpen_[i]) {
            torque[i] = calcOpen(i);
            isChanged = true;
            continue;
        }
        const double beyondMotor = nominal[i] - std::clamp(nominal[i], -torqueLimit_[i], torqueLimit_[i]);
        const double highest = highest_[i] + std::max(0.0, -beyondMotor),
                     lowest = lowest_[i] - std::max(0.0, beyondMotor);
        const double given = torque[i] = std::clamp(wanted, lowest, highest);
        const int side = wanted > given ? 1 : wanted < given ? -1 : 0;
        cutTicks_[i] = side == 0 ? 0 : side == cutSide_[i] ? cutTicks_[i] + 1 : 1;
        cutSide_[i] = side;
        // What lasted against it may have been friction, which now acts the other way.
        const double turning = std::min(calcHold(i), std::max(0.0, given > 0.0 ? -calcLasting(i) : calcLasting(i)));
        const double push = given > 0.0 ? given - highest_[i] : lowest_[i] - given;
        isPressing_[i] = push + sizes_.reach[i] > turning + kPressing * sizes_.reach[i];
        if (side != 0) {
            isChanged = true;
            isHeld_[i] = isHeld_[i] || cutTicks_[i] >= heldTicks_;  // noise is cut, too, but not for long
            continue;
        }
        isHeld_[i] = isHeld_[i] && !isNear_[i];
        const double speed = std::abs(velocity_[i]);
        const double friction = std::tanh(speed / kStandstill) * calcFigure(i, speed);
        const double needed = given - std::copysign(friction, velocity_[i]);
        lasting_[i] += std::min(1.0, tick_s_ / kLasting_s) * (needed - lasting_[i]);
        // With a bound `reach` has what lasts, and an open joint needs it still.
        const double most = sizes_.friction > 0.0 ? sizes_.lasting[i] : sizes_.reach[i];
        lasting_[i] = std::clamp(lasting_[i], -most, most);
    }
    return isChanged;
}

void Authority::add(const JointVector& push, JointVector& torque) const {
    for (int i = 0; i < n_; ++i) {
        if (isOpen_[i]) continue;
        torque[i] = std::clamp(torque[i] + push[i], std::min(lowest_[i], torque[i]), std::max(highest_[i], torque[i]));
    }
}

/** d, and on the way there what is left of the torque before, down from it in wayTicks_; the impulse as a triangle over all of
it. */
double Authority::calcOpen(int joint) {
    int& tick = backTick_[joint];
    const int ticks = backTicks_[joint];
    if (tick >= ticks) return lasting_[joint];
    const double half = 0.5 * ticks, k = ++tick;
    const double weight = (k <= half ? k : ticks - k) / (half * half);
    const double back = excess_[joint] * std::max(0.0, 1.0 - k / wayTicks_) - owed_[joint] * weight;
    return std::clamp(lasting_[joint] + back, std::min(lowest_[joint], lasting_[joint]),
                      std::max(highest_[joint], lasting_[joint]));
}

void Authority::take(const JointVector& torque, const std::array<bool, kMaxJoints>& isStill,
                     const JointVector& inertia) {
    for (int i = 0; i < n_; ++i) {
        last_[i] = torque[i];
        hasAdded_[i] = hasAdded_[i] || torque[i] != 0.0;
        if (!isStill[i]) {
            pushedMomentum_[i] = impliedMomentum_[i] = impliedTravel_[i] = 0.0;
            pressedTicks_[i] = 0;
            continue;
        }
        pressedTicks_[i] = isPressing_[i] ? pressedTicks_[i] + 1 : 0;
        // What lasted may be gone since. Dry friction stops the joint where it can, and takes its most from one that moves.
        const double beyond = torque[i] - std::clamp(torque[i], std::min(0.0, lasting_[i]), std::max(0.0, lasting_[i]));
        const auto push = [&](double& momentum, double hold) {
            const double friction = std::clamp(beyond + momentum / tick_s_, -hold, hold);
            momentum += (beyond - friction) * tick_s_;
        };
        push(pushedMomentum_[i], calcHold(i));
        // Of a joint that stood, friction the other way may be in what lasted.
        push(impliedMomentum_[i], 2.0 * calcHold(i));
        if (inertia[i] > 0.0) impliedTravel_[i] += impliedMomentum_[i] / inertia[i] * tick_s_;
    }
}

void Authority::open(int joint, bool isInVain) {
    if (isOpen_[joint]) return;
    isOpen_[joint] = true;
    isHeld_[joint] = isPressing_[joint] = false;
    cutTicks_[joint] = pressedTicks_[joint] = backTick_[joint] = 0;
    excess_[joint] = last_[joint] - lasting_[joint];
    // A triangle of 2 `half` ticks has the peak owed / half. What the way down pushes beyond friction is owed, too.
    double owed = isInVain ? pushedMomentum_[joint] / tick_s_ : 0.0;
    const double hold = calcHold(joint), pushing = excess_[joint] - std::clamp(excess_[joint], -hold, hold);
    if (owed * pushing > 0.0) owed += 0.5 * (wayTicks_ - 1) * pushing * pushing / excess_[joint];
    const double most = kTakeBackShare * sizes_.reach[joint],
                 longest = std::clamp<double>(kTakeBackTicks, wayTicks_,
                                              std::max<double>(wayTicks_, 0.5 * kLasting_s / tick_s_));
    const double half = std::floor(most > 0.0 ? std::clamp(std::ceil(std::abs(owed) / most), 1.0 * wayTicks_, longest)
                                              : 1.0 * wayTicks_);
    owed_[joint] = std::clamp(owed, -sizes_.reach[joint] * half, sizes_.reach[joint] * half);
    backTicks_[joint] = 2 * static_cast<int>(half);
}

void limitMotorStep(const JointVector& nominal, const JointVector& last, const JointVector& step, JointVector& added) {
    for (int i = 0; i < added.size(); ++i) {
        const double total = std::clamp(nominal[i] + added[i], last[i] - step[i], last[i] + step[i]);
        if (total != nominal[i] + added[i]) added[i] = total - nominal[i];
    }
}

std::string tellPush(const RobotDescription& robot, const Authority& authority, const ToolJacobian& J) {
    std::string joints;
    JointVector most(robot.size());
    for (int i = 0; i < robot.size(); ++i) {
        const char* const name = robot.joints[i].name.c_str();
        const char* const unit = robot.slides(i) ? "N" : "Nm";
        most[i] = authority.limits(i) ? authority.calcMost(i) : kInfinity;
        if (!authority.limits(i)) {
            addItem(joints, format("%s any", name));
            continue;
        }
        const double rest = authority.calcRest(i), percent = 100.0 / robot.actuation.torqueLimit[i];
        addItem(joints, most[i] > rest ? format("%s %.3g %s at once and %.3g %s slowly (%.0f and %.0f %% of the motor)",
                                                name, rest, unit, most[i], unit, percent * rest, percent * most[i])
                                       : format("%s %.3g %s (%.0f %% of the motor)", name, rest, unit, percent * rest));
    }
    const Eigen::Vector3d force = calcToolForce(most, J);
    std::string axes;
    for (int axis = 0; axis < 3; ++axis)
        if (std::isfinite(force[axis])) addItem(axes, format("%.3g N along %c", force[axis], "xyz"[axis]));
    return "at most " + joints + " at rest" + (axes.empty() ? "" : "; the tool presses with at most " + axes);
}

}  // namespace viable::detail
