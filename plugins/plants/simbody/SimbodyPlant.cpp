#include "SimbodyPlant.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct SimbodyPlantOptions {
    ArmHardwareOptions hardware;
    bool isRecursive = false;
    MotorRateOptions motorRate;
    PerJoint backlash = 0.0, gearStiffness = 1e4;
    ContactOptions contact;

    template <class V>
    void describe(V& v) {
        hardware.describe(v);
        v(isRecursive, "dynamics", "simbody|recursion",
          "What computes M and b: Simbody, independent of the nominal arm's, or the nominal arm's recursion, the same "
          "to rounding and several times as fast.");
        motorRate.describe(v);
        v(backlash, "backlash_rad", "rad", "Width of the gap in each gear; where none has one, the gears are rigid.")
            .atLeast(0);
        v(gearStiffness, "gear_stiffness_Nmprad", "Nm/rad", "Of the gears where any has a gap.").above(0);
        contact.describe(v);
    }
};

/** Damping of a gear's spring, as a share of critical. */
constexpr double kGearDamping = 0.1;
/** Longest sub-step times the fastest frequency of rotors, springs and links; Runge-Kutta of order 4 is stable to
2.8, and at 1 it still follows the oscillation. */
constexpr double kGearStep = 1.0;

/** Rounds for the viscous friction. Each lowers the (convex) function whose minimum is v+, and even
the first takes energy out, so their number is a matter of accuracy only. */
constexpr int kViscousRounds = 3;

/** The inverse of the lower triangle of `L`. */
JointMatrix invertLower(const JointMatrix& L) {
    const int n = static_cast<int>(L.rows());
    JointMatrix inverse = JointMatrix::Zero(n, n);
    for (int k = 0; k < n; ++k) {
        inverse(k, k) = 1.0 / L(k, k);
        for (int i = k + 1; i < n; ++i) {
            double sum = 0.0;
            for (int j = k; j < i; ++j) sum -= L(i, j) * inverse(j, k);
            inverse(i, k) = sum / L(i, i);
        }
    }
    return inverse;
}

}  // namespace

void SimbodyPlant::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    const auto options = parameters.get<SimbodyPlantOptions>();
    hardware_.configure(setup, options.hardware, parameters);
    motorRate_.configure(setup, options.motorRate, options.hardware.torqueLimitFactor);
    halfGap_ = 0.5 * options.backlash.expand(n_);
    stiffness_ = options.gearStiffness.expand(n_);
    hasGears_ = halfGap_.maxCoeff() > 0.0;
    RobotDescription touching = hardware_.robot();
    if (hasGears_) touching.actuation.rotorInertia.setZero(n_);  // behind the gears
    contact_.configure(setup, touching, options.hardware.substeps, options.contact, parameters);
    engine_ = options.isRecursive ? DynamicsEngine::Recursion : DynamicsEngine::Simbody;
    if (hasGears_)
        configureGears(setup, parameters);
    else
        model_ = std::make_unique<RobotModel>(hardware_.robot(), engine_);
    reset(setup.start);
}

void SimbodyPlant::configureGears(const RunSetup& setup, const Parameters& parameters) {
    RobotDescription links = hardware_.robot();
    rotorInertia_ = links.actuation.rotorInertia;
    for (int i = 0; i < n_; ++i)
        if (!(rotorInertia_[i] > 0.0))
            throw badInput(
                parameters.place("backlash_rad"),
                "joint `" + links.joints[i].name + "` has no rotor inertia, and backlash lies between rotor and link",
                "Give rotor_inertia_kgm2 in the robot's actuation.yaml, or no backlash.");
    links.actuation.rotorInertia.setZero(n_);
    model_ = std::make_unique<RobotModel>(links, engine_);

    damping_.resize(n_);
    for (int i = 0; i < n_; ++i) {  // by the lightest that swings on this spring
        const JointVector alone = JointVector::Unit(n_, i);
        const double inertia = 1.0 / (1.0 / rotorInertia_[i] + findFastestMode(links, alone));
        damping_[i] = 2.0 * kGearDamping * std::sqrt(stiffness_[i] * inertia);
    }
    const double fastest =
        std::sqrt(stiffness_.cwiseQuotient(rotorInertia_).maxCoeff() + findFastestMode(links, stiffness_));
    const double needed = std::ceil(setup.tick_s * fastest / kGearStep);
    if (hardware_.substeps() < needed)
        throw badInput(
            parameters.place("substeps"),
            std::to_string(hardware_.substeps()) +
                " is too few for backlash: rotors and links swing on the gears' springs with up to " +
                std::to_string(std::lround(fastest / (2.0 * EIGEN_PI))) + " Hz",
            "Write substeps: " + std::to_string(std::lround(needed)) + " or more, or a smaller gear_stiffness_Nmprad.");
}

void SimbodyPlant::reset(const MotionState& start) {
    dryFriction_.reset();
    link_ = rotor_ = {start.q, start.qd};
    model_->calcDynamics(start.q, start.qd, dynamics_);
    load_ = dynamics_.b;
    zeroOffset_.setZero(n_);
    if (hasGears_)  // the gears carry the arm from the start
        for (int i = 0; i < n_; ++i) zeroOffset_[i] = load_[i] / stiffness_[i] + std::copysign(halfGap_[i], load_[i]);
    rotor_.q += zeroOffset_;
    hardware_.reset({start.q, start.qd});
    motorRate_.reset(start.q);
    contact_.reset();
    time_s_ = 0.0;
    external_ = hardware_.externalTorque();
}

void SimbodyPlant::calcFriction(const JointMatrix& M, const JointVector& v, const JointVector& push) {
    const double substep_s = hardware_.substep_s();
    JointVector dry(n_), damping(n_), after = v;
    for (int i = 0; i < n_; ++i) dry[i] = hardware_.friction(i).calcDry(v[i], nextLoad_[i]);
    // Without dry friction v+ = A^-1 h target; with it v+ = A^-1 h (target - f), and f in [-F, F]
    // minimises |L^-1 (f - target)|^2, A = L L': its optimality conditions are the friction law.
    JointVector target = push;
    target.noalias() += M.lazyProduct(v) / substep_s;
    const JointVector lower = -dry;
    implicit_.b.setZero(n_);
    for (int round = 0; round < kViscousRounds; ++round) {
        implicit_.M = M;
        for (int i = 0; i < n_; ++i) {
            damping[i] = hardware_.friction(i).calcDamping(after[i]);
            implicit_.M(i, i) += substep_s * damping[i];
        }
        // Where every joint moves on as it moves now, that is the optimum, and no QP is needed.
        for (int i = 0; i < n_; ++i) frictionTorque_[i] = std::copysign(dry[i], after[i]);
        JointVector moved;
        bool movesOn = calcForwardDynamics(implicit_, substep_s * (target - frictionTorque_), moved);
        for (int i = 0; movesOn && i < n_; ++i) movesOn = moved[i] * after[i] > 0.0;
        if (!movesOn) {
            const Eigen::LLT<JointMatrix> factor(implicit_.M);
            dryFriction_.solve(invertLower(factor.matrixLLT()), target, lower, dry, frictionTorque_);
            moved = substep_s * (target - frictionTorque_);
            factor.solveInPlace(moved);
        }
        after = moved;
    }
    frictionTorque_ += damping.cwiseProduct(after);
}

void SimbodyPlant::calcRotorFriction(const JointVector& v, const JointVector& push) {
    const double h = hardware_.substep_s();
    for (int i = 0; i < n_; ++i) {
        const FrictionLaw& law = hardware_.friction(i);
        const double momentum = rotorInertia_[i] * v[i] + h * push[i];
        const double free = std::max(std::abs(momentum) - h * law.calcDry(v[i], nextLoad_[i]), 0.0);
        double after = v[i];
        for (int round = 0; round < kViscousRounds; ++round)
            after = std::copysign(free / (rotorInertia_[i] + h * law.calcDamping(after)), momentum);
        frictionTorque_[i] = (momentum - rotorInertia_[i] * after) / h;
    }
}

JointVector SimbodyPlant::calcGearTorque(const TwoSides& s) const {
    JointVector torque(n_);
    for (int i = 0; i < n_; ++i) {
        const double twist = s.rotor.q[i] - s.link.q[i];
        const double beyond = std::abs(twist) - halfGap_[i];
        const double side = std::copysign(1.0, twist);
        const double force = stiffness_[i] * beyond + damping_[i] * (side * (s.rotor.qd[i] - s.link.qd[i]));
        const bool pulls = halfGap_[i] > 0.0 && force < 0.0;  // without a gap both flanks touch
        torque[i] = beyond > 0.0 && !pulls ? side * force : 0.0;
    }
    return torque;
}

void SimbodyPlant::holdBlocked(JointVector& torque) {
    const int k = hardware_.blockedJoint();
    if (k < 0) return;
    dynamics_.M.row(k).setZero();
    dynamics_.M.col(k).setZero();
    dynamics_.M(k, k) = 1.0;
    dynamics_.b[k] = 0.0;
    torque[k] = 0.0;
}

bool SimbodyPlant::stopBlocked() {
    const int k = hardware_.blockedJoint();
    JointVector& v = next_.link.qd;
    if (k < 0 || v[k] == 0.0) return true;
    model_->calcDynamics(next_.link.q, v, dynamics_);
    if (!isFinite(dynamics_, n_)) return false;
    JointVector change = JointVector::Unit(n_, k);  // of the velocities by an impulse at joint k
    const Eigen::LLT<JointMatrix> factor(dynamics_.M);
    if (factor.info() != Eigen::Success) return false;
    factor.solveInPlace(change);
    v -= v[k] / change[k] * change;
    v[k] = 0.0;
    return true;
}

bool SimbodyPlant::step(const JointVector& motor) {
    const double h = hardware_.substep_s();
    JointVector& q = next_.link.q;
    JointVector& v = next_.link.qd;
    JointVector k1v, k2v, k3v, k4v;

    model_->calcDynamics(q, v, dynamics_);
    if (!isFinite(dynamics_, n_)) return false;
    const JointVector driving = motor + hardware_.externalTorque();
    JointVector torque = driving;
    addContact(0.0, next_.link, torque);
    holdBlocked(torque);
    frictionTorque_.setZero(n_);
    if (hardware_.hasFriction()) calcFriction(dynamics_.M, v, torque - dynamics_.b);
    nextLoad_ = motor - frictionTorque_;
    JointVector net = torque - frictionTorque_;

    if (!calcForwardDynamics(dynamics_, net, k1v)) return false;
    const JointVector k2q = v + h / 2.0 * k1v;
    const auto accelerate = [&](double after_s, const JointVector& atQ, const JointVector& atV, JointVector& out) {
        model_->calcDynamics(atQ, atV, dynamics_);
        if (contact_.isOn()) {
            net = driving - frictionTorque_;
            addContact(after_s, {atQ, atV}, net);
        }
        holdBlocked(net);
        return calcForwardDynamics(dynamics_, net, out);
    };
    if (!accelerate(h / 2.0, q + h / 2.0 * v, k2q, k2v)) return false;
    const JointVector k3q = v + h / 2.0 * k2v;
    if (!accelerate(h / 2.0, q + h / 2.0 * k2q, k3q, k3v)) return false;
    const JointVector k4q = v + h * k3v;
    if (!accelerate(h, q + h * k3q, k4q, k4v)) return false;
    q += h / 6.0 * (v + 2.0 * k2q + 2.0 * k3q + k4q);
    v += h / 6.0 * (k1v + 2.0 * k2v + 2.0 * k3v + k4v);
    return q.allFinite() && v.allFinite();
}

bool SimbodyPlant::stepWithGears(const JointVector& motor) {
    const double h = hardware_.substep_s();
    frictionTorque_.setZero(n_);
    nextLoad_ = calcGearTorque(next_);
    if (hardware_.hasFriction()) calcRotorFriction(next_.rotor.qd, motor - nextLoad_);

    const auto calcRate = [&](double after_s, const TwoSides& s, TwoSides& rate) {
        const JointVector gear = calcGearTorque(s);
        rate.rotor.q = s.rotor.qd;
        rate.rotor.qd = (motor - frictionTorque_ - gear).cwiseQuotient(rotorInertia_);
        rate.link.q = s.link.qd;
        JointVector torque = gear + hardware_.externalTorque();
        addContact(after_s, s.link, torque);
        model_->calcDynamics(s.link.q, s.link.qd, dynamics_);
        holdBlocked(torque);
        return calcForwardDynamics(dynamics_, torque, rate.link.qd);
    };
    const auto move = [](const TwoSides& s, double time, const TwoSides& rate) {
        return TwoSides{{s.link.q + time * rate.link.q, s.link.qd + time * rate.link.qd},
                        {s.rotor.q + time * rate.rotor.q, s.rotor.qd + time * rate.rotor.qd}};
    };
    TwoSides k1, k2, k3, k4;
    if (!calcRate(0.0, next_, k1) || !calcRate(h / 2.0, move(next_, h / 2.0, k1), k2) ||
        !calcRate(h / 2.0, move(next_, h / 2.0, k2), k3) || !calcRate(h, move(next_, h, k3), k4))
        return false;
    next_ = move(next_, h / 6.0, k1);
    next_ = move(next_, h / 3.0, k2);
    next_ = move(next_, h / 3.0, k3);
    next_ = move(next_, h / 6.0, k4);
    return isFinite(next_.link, n_) && isFinite(next_.rotor, n_);
}

void SimbodyPlant::addContact(double after_s, const JointState& arm, JointVector& torque) const {
    if (contact_.isOn()) contact_.addTorque(time_s_ + after_s, arm, torque);
}

TickStatus SimbodyPlant::advance(const JointVector& torque, JointVector& applied) {
    if (!isFinite(torque, n_)) return TickStatus::InvalidInput;
    hardware_.calcApplied(torque, applied);
    motorRate_.limit(applied);
    next_ = {link_, rotor_};
    nextLoad_ = load_;
    if (!stopBlocked()) return TickStatus::Faulted;
    for (int i = 0; i < hardware_.substeps(); ++i) {
        const JointState& driven = hasGears_ ? next_.rotor : next_.link;
        const JointVector motor = hardware_.calcMotorTorque(applied, driven.q);
        if (!(hasGears_ ? stepWithGears(motor) : step(motor))) return TickStatus::Faulted;
        time_s_ += hardware_.substep_s();
        if (contact_.isOn() && !contact_.endStep(time_s_, next_.link)) return TickStatus::Faulted;
    }
    link_ = next_.link;
    rotor_ = next_.rotor;
    load_ = nextLoad_;
    hardware_.endTick(torque, encoders());
    motorRate_.endTick(applied);
    external_ = hardware_.externalTorque();
    if (contact_.isOn()) external_ += contact_.torque();
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::RealPlant, viable::SimbodyPlant, "simbody",
              "The arm in simulation: Simbody's multibody model with friction, payload, backlash, motors and sensors.",
              viable::SimbodyPlantOptions)
