#include "loop/Authority.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "robot/PoseSampling.h"
#include "tracking/InertiaSample.h"

namespace viable::detail {

namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

/** Poses in which the gain of a loop that follows the inertia is looked for. */
constexpr int kGainPoses = 64;

/** Largest K_r of each joint [Nms/rad]. */
JointVector findLargestGain(const RunSetup& setup, const LinearErrorLoop& loop) {
    if (std::isinf(loop.inertiaRate)) return loop.kr;
    JointVector largest = JointVector::Zero(setup.size());
    for (const PoseInertia& pose : sampleInertia(setup.robot, setup.limits, kGainPoses))
        largest = largest.cwiseMax(calcLoopGain(loop, pose.M).diagonal());
    return largest;
}

}  // namespace

AuthoritySizes calcAuthority(const RunSetup& setup, const LinearErrorLoop* loop, const TrackingBound* bound) {
    const int n = setup.size();
    const Actuation& actuation = setup.robot.actuation;
    const JointVector none = JointVector::Zero(n);
    AuthoritySizes sizes{none, none, {none, none, JointVector::Ones(n)}, loop ? loop->kp : none};
    if (bound && loop) {
        const JointVector noise = 2.0 / setup.tick_s * (bound->measured - bound->position);
        const JointVector error = bound->velocity + noise + loop->kp.cwiseProduct(bound->measured);
        sizes.reach = loop->kr.cwiseProduct(error) + bound->integralTorque;
        if (loop->friction.isActive()) sizes.reach += loop->friction.figures.coulomb + loop->friction.figures.viscous;
        return sizes;
    }
    sizes.friction = {kFrictionFactor * actuation.friction.coulomb, kFrictionFactor * actuation.friction.viscous,
                      actuation.friction.viscousVelocity};
    const JointVector gain = loop ? findLargestGain(setup, *loop) : none;
    for (int i = 0; i < n; ++i) {
        const double motor = kMotorShare * actuation.torqueLimit[i];
        sizes.lasting[i] = std::max(0.5 * motor, motor - sizes.friction.coulomb[i]);
        const double noise = 2.0 * setup.robot.encoderStep(i) * (1.0 / setup.tick_s + sizes.kp[i]);
        sizes.reach[i] = sizes.lasting[i] + gain[i] * noise;
    }
    return sizes;
}

Authority::Authority(const RunSetup& setup, AuthoritySizes sizes)
    : n_(setup.size()),
      answerTicks_(kAnswerTicks + setup.delayTicks),
      tick_s_(setup.tick_s),
      sizes_(std::move(sizes)),
      fastest_(setup.limits.velocity),
      least_(n_),
      backTicks_(std::max(2, static_cast<int>(kTakeBack_s / setup.tick_s))) {
    constexpr double kCounts = 4.0;
    for (int i = 0; i < n_; ++i) least_[i] = kCounts * setup.robot.encoderStep(i) / tick_s_;
    reset();
}

void Authority::reset() {
    for (JointVector* v :
         {&velocity_, &lasting_, &lowest_, &highest_, &frictionLowest_, &frictionHighest_, &pushed_, &deviation_,
          &goodDeviation_, &firstError_, &base_, &impulse_, &last_, &excess_, &owed_})
        v->setZero(n_);
    cutTicks_.fill(0);
    cutSide_.fill(0);
    backTick_.fill(0);
    isHeld_.fill(false);
    isNear_.fill(true);
    isPressed_.fill(false);
    isDeaf_.fill(false);
}

void Authority::widen(const JointLimits& limits) {
    fastest_.lower = fastest_.lower.cwiseMin(limits.velocity.lower);
    fastest_.upper = fastest_.upper.cwiseMax(limits.velocity.upper);
}

/** [Nm]; `speed` >= 0. */
double Authority::calcFriction(int joint, double speed) const {
    const JointFriction& f = sizes_.friction;
    return f.coulomb[joint] - f.viscous[joint] * std::expm1(-speed / f.viscousVelocity[joint]);
}

double Authority::calcRest(int joint) const {
    return sizes_.reach[joint] + calcFriction(joint, 0.0);
}

/** Whether a joint that is cut answers. */
void Authority::listen(int joint, double velocityError) {
    const std::size_t at = index(joint);
    isDeaf_[at] = false;
    if (cutTicks_[at] == 0) {
        goodDeviation_[joint] = deviation_[joint];  // of the tick before: this one's may cause the cut
        return;
    }
    if (cutTicks_[at] == 1) firstError_[joint] = velocityError;
    if (cutTicks_[at] < answerTicks_) return;
    const double worse = cutSide_[at] * (firstError_[joint] - velocityError);
    const double fastest = std::max(-fastest_.lower[joint], fastest_.upper[joint]);
    const double most = std::max(kWorse * (std::isfinite(fastest) ? fastest : 0.0), least_[joint]);
    isDeaf_[at] = worse > most || (worse >= 0.0 && cutTicks_[at] >= kSlowAnswer * answerTicks_);
}

void Authority::update(const MotionState& nominal, JointState& real) {
    const double share = std::min(1.0, tick_s_ / kVelocity_s);
    for (int i = 0; i < n_; ++i) {
        const std::size_t at = index(i);
        const double error = real.q[i] - nominal.q[i];
        listen(i, real.qd[i] - nominal.qd[i]);
        deviation_[i] = error;
        velocity_[i] += share * (std::clamp(real.qd[i], fastest_.lower[i], fastest_.upper[i]) - velocity_[i]);
        frictionHighest_[i] = calcFriction(i, std::max(0.0, velocity_[i]));
        frictionLowest_[i] = -calcFriction(i, std::max(0.0, -velocity_[i]));
        highest_[i] = lasting_[i] + frictionHighest_[i] + sizes_.reach[i];
        lowest_[i] = lasting_[i] + frictionLowest_[i] - sizes_.reach[i];
        isNear_[at] = true;
        const double kp = sizes_.kp[i];
        if (!isHeld_[at] || !(kp > 0.0)) continue;
        const double behind = std::max(0.0, kFastReturn * fastest_.upper[i] - nominal.qd[i]) / kp;
        const double ahead = std::max(0.0, nominal.qd[i] - kFastReturn * fastest_.lower[i]) / kp;
        isNear_[at] = error >= -behind && error <= ahead;
        if (!isNear_[at]) real.q[i] = nominal.q[i] + std::clamp(error, -behind, ahead);
    }
}

bool Authority::cut(JointVector& torque) {
    bool isChanged = false;
    for (int i = 0; i < n_; ++i) {
        const std::size_t at = index(i);
        const double wanted = torque[i];
        const double beyond = wanted - std::clamp(wanted, frictionLowest_[i], frictionHighest_[i]);
        const double push = beyond - lasting_[i];
        isPressed_[at] = std::abs(push) > kPressing * sizes_.reach[i];
        if (isPressed_[at]) pushed_[i] = push;
        double given = std::clamp(wanted, lowest_[i], highest_[i]);
        const int side = wanted > given ? 1 : wanted < given ? -1 : 0;
        cutTicks_[at] = side == 0 ? 0 : side == cutSide_[at] ? cutTicks_[at] + 1 : 1;
        cutSide_[at] = side;
        if (side != 0) {
            isHeld_[at] = true;
            pushed_[i] = given - lasting_[i];
        } else {
            isHeld_[at] = isHeld_[at] && !isNear_[at];
            lasting_[i] += std::min(1.0, tick_s_ / kLasting_s) * push;
            lasting_[i] = std::clamp(lasting_[i], -sizes_.lasting[i], sizes_.lasting[i]);
        }
        if (backTick_[at] > 0) {
            // Down from the excess in the first half; the impulse as a triangle over all of it.
            const double half = 0.5 * backTicks_, k = backTick_[at];
            const double weight = (k <= half ? k : backTicks_ - k) / (half * half);
            given += excess_[i] * std::max(0.0, 1.0 - k / half) - owed_[i] * weight;
            given = std::clamp(given, lowest_[i], highest_[i]);
            backTick_[at] = backTick_[at] < backTicks_ ? backTick_[at] + 1 : 0;
        }
        isChanged |= given != wanted;
        torque[i] = given;
    }
    return isChanged;
}

void Authority::take(const JointVector& torque, const std::array<bool, kMaxJoints>& isStill) {
    for (int i = 0; i < n_; ++i) {
        if (isCut(i) || isStill[index(i)]) {
            impulse_[i] += torque[i] - base_[i];
        } else {
            base_[i] = torque[i];
            impulse_[i] = 0.0;
        }
        last_[i] = torque[i];
    }
}

void Authority::takeBack(int joint) {
    excess_[joint] = last_[joint] - base_[joint];
    owed_[joint] = impulse_[joint] + 0.25 * backTicks_ * excess_[joint];  // with what the way down adds
    backTick_[index(joint)] = 1;
    impulse_[joint] = 0.0;
    isHeld_[index(joint)] = false;
}

}  // namespace viable::detail
