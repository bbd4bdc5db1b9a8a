#include "loop/FreeArm.h"

#include <algorithm>
#include <cmath>

#include "core/RotationVector.h"
#include "viable/loop/NominalPlant.h"

namespace viable::detail {

FreeArm::FreeArm(const RunSetup& setup) : limits_(setup.limits), tick_s_(setup.tick_s), model_(setup.robot) {
    CertifiedBrakingOptions options;
    options.recovery = true;
    filter_.configure(setup, options, "`contact_force_N`");
    servo_.configure(setup.limits, setup.tick_s);
}

void FreeArm::wait(const ToolSurface& surface, const MotionState& nominal, const Dynamics& dynamics) {
    surface_ = surface;
    if (isOn_) return;
    dynamics_ = dynamics;
    isOn_ = true;
    isServed_ = false;
    state_ = target_ = nominal;
    filter_.reset(nominal);
}

void FreeArm::pause() {
    state_.qd.setZero();
    state_.qdd.setZero();
    filter_.reset(state_);
    isServed_ = false;
}

void FreeArm::changeLimits(const JointLimits& limits) {
    limits_ = limits;
    filter_.changeLimits(limits);
    servo_.changeLimits(limits);
}

const Dynamics& FreeArm::updateDynamics() {
    model_.calcDynamics(state_.q, state_.qd, dynamics_);
    return dynamics_;
}

bool FreeArm::move(const ControllerOutput& output) {
    decision_.clearReports();
    const JointVector* rate = output.hasAccelerationRate ? &output.accelerationRate : nullptr;
    const FilterStatus status = filter_.filter({state_, output.torque, dynamics_, rate}, decision_);
    return status == FilterStatus::Passed || status == FilterStatus::Modified || status == FilterStatus::Recovering;
}

/** The free tool's place, lifted to the surface. */
void FreeArm::findTarget(double beneath) {
    model_.calcDynamics(target_.q, target_.qd, ofTarget_);
    Vector6 step, twist = dynamics_.J * state_.qd, turning = dynamics_.J * state_.qdd;
    step.head<3>() = tool() + beneath * surface_.normal - ofTarget_.tool.position;
    step.tail<3>() = calcRotationVector(dynamics_.tool.orientation * ofTarget_.tool.orientation.conjugate());
    Vector6 rate = dynamics_.J * decision_.value;
    for (Vector6* part : {&twist, &turning, &rate})
        part->head<3>() -= surface_.normal.dot(part->head<3>()) * surface_.normal;
    target_.q += calcJointStep(ofTarget_.J, step, state_.q - target_.q);
    target_.qd = calcJointStep(ofTarget_.J, twist, state_.qd);
    target_.qdd = calcJointStep(ofTarget_.J, turning, state_.qdd);
    targetJerk_ = calcJointStep(ofTarget_.J, rate, decision_.value);
}

void FreeArm::lead(const MotionState& nominal, const Dynamics& dynamics, JointVector& jerk) {
    const double beneath = surface_.offset - surface_.normal.dot(tool());
    if (beneath > 0.0) {
        findTarget(beneath);
        followSurface(nominal, dynamics, jerk);
        isServed_ = false;
    } else {
        if (!isServed_) servo_.reset(nominal);
        isServed_ = true;
        target_ = state_;
        servo_.calc(nominal, target_, jerk);
    }
    isOn_ = beneath > 0.0 || (state_.q - nominal.q).cwiseAbs().maxCoeff() > kSame ||
            (state_.qd - nominal.qd).cwiseAbs().maxCoeff() > kSame;
    advanceNominal(decision_, tick_s_, state_);
}

/** The motion along the normal and the other one, each with its share of the limits. */
void FreeArm::followSurface(const MotionState& nominal, const Dynamics& dynamics, JointVector& jerk) {
    Vector6 out = Vector6::Zero();
    out.head<3>() = surface_.normal;
    const JointVector way = calcJointStep(dynamics.J, out, JointVector::Zero(nominal.q.size()));
    const auto along = [&](const JointVector& joints) { return surface_.normal.dot(dynamics.J.topRows<3>() * joints); };
    const double height = surface_.normal.dot(dynamics.tool.position) - surface_.offset;
    const JointVector lifted = height * way, lifting = along(nominal.qd) * way, turning = along(nominal.qdd) * way;
    const JointVector other = targetJerk_ + calcJerk({nominal.q - lifted - target_.q, nominal.qd - lifting - target_.qd,
                                                      nominal.qdd - turning - target_.qdd},
                                                     1.0 - kShare);
    jerk = other - way * along(other) + calcJerk({lifted, lifting, turning}, kShare);
}

/** Leads an error and its derivatives to zero, all joints alike, as three equal poles do where nothing is at its limit: a
velocity against the error, an acceleration to reach that, a jerk to reach that. Each is so bounded that the next can follow. */
JointVector FreeArm::calcJerk(const MotionState& error, double part) const {
    const auto bound = [&](JointVector wanted, double rate, const JointBounds& own, double slower,
                           const JointBounds& next) {
        double share = 1.0;
        for (Eigen::Index i = 0; i < wanted.size(); ++i) {
            const double most = part * std::min(std::min(own.upper[i], -own.lower[i]),
                                                std::min(next.upper[i], -next.lower[i]) / slower);
            if (std::abs(rate * wanted[i]) > most) share = std::min(share, most / std::abs(rate * wanted[i]));
        }
        return JointVector(share * rate * wanted);
    };
    const JointBounds& a = limits_.acceleration;
    const JointBounds& j = limits_.jerk;
    const JointVector velocity = bound(-error.q, kFollow / 3.0, limits_.velocity, kFollow / 3.0, a);
    const JointVector acceleration = bound(velocity - error.qd, kFollow, a, kFollow, j);
    return bound(acceleration - error.qdd, 3.0 * kFollow, j, 1.0, j);
}

}  // namespace viable::detail
