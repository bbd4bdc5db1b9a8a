#include "viable/simulation/ArmHardware.h"

#include <algorithm>
#include <cmath>

#include "robot/InertiaModes.h"
#include "robot/PoseSampling.h"
#include "viable/robot/RobotModel.h"

namespace viable {

double FrictionLaw::calcDry(double v, double load) const {
    const double x = v / stribeckVelocity;
    return coulomb + (breakaway - coulomb) * std::exp(-x * x) + loadShare * std::abs(load);
}

double FrictionLaw::calcDamping(double v) const {
    const double x = std::abs(v) / viscousVelocity;
    return viscous / viscousVelocity * (x > 0.0 ? -std::expm1(-x) / x : 1.0);
}

void ArmHardware::configure(const RunSetup& setup, const ArmHardwareOptions& options, const Parameters& parameters) {
    requireDynamics(setup.robot, parameters.resolved().place(), "a simulated real arm");
    n_ = setup.size();
    substeps_ = options.substeps;
    substep_s_ = setup.tick_s / substeps_;

    robot_ = withScaledMasses(setup.robot, options.massFactor.expand(n_));
    robot_ = withPayload(std::move(robot_), options.payload_kg, options.payloadOffset);
    const Eigen::Vector2d& tilt = options.baseTilt;
    const Eigen::Matrix3d base =
        (Eigen::AngleAxisd(tilt[0], Eigen::Vector3d::UnitX()) * Eigen::AngleAxisd(tilt[1], Eigen::Vector3d::UnitY()))
            .toRotationMatrix();
    if (tilt[0] != 0.0 || tilt[1] != 0.0) robot_.gravity = base.transpose() * setup.robot.gravity;

    const Actuation& actuation = robot_.actuation;
    torqueLimit_ = actuation.torqueLimit * options.torqueLimitFactor;
    ripple_ = options.torqueRipple.expand(n_);
    ripplePerRad_ = options.torqueRipplePerTurn.expand(n_);
    hasFriction_ = !options.isFrictionless;
    const PerJoint& scale = options.frictionScale;
    for (int i = 0; i < n_; ++i) {
        // Twice per turn of the wave generator: Kennedy and Desai, "Modeling and control of the Mitsubishi
        // PA-10 robot arm harmonic drive system", IEEE/ASME Trans. Mechatronics 10 (2005).
        if (ripplePerRad_[i] == 0.0) ripplePerRad_[i] = 2.0 * actuation.gearRatio[i];
        if (robot_.slides(i)) ripplePerRad_[i] *= 2.0 * EIGEN_PI;
        FrictionLaw& law = friction_[i];
        law.coulomb = scale[i] * actuation.friction.coulomb[i];
        law.breakaway = options.breakawayRatio * law.coulomb;
        law.stribeckVelocity = options.stribeckVelocity;
        law.loadShare = options.loadFriction[i];
        law.viscous = scale[i] * actuation.friction.viscous[i];
        law.viscousVelocity = actuation.friction.viscousVelocity[i];
    }

    push_ = options.push.expand(n_);
    pushTicks_ = TickWindow::make(options.pushFrom_s, options.pushUntil_s, setup.tick_s, parameters, "push");
    blockedJoint_ = options.blockedJoint;
    if (blockedJoint_ >= n_)
        throw badInput(parameters.place("blocked_joint"),
                       "there is no joint " + std::to_string(blockedJoint_) + "; the robot's joints are 0 to " +
                           std::to_string(n_ - 1),
                       "Joints are counted from 0; -1 blocks none.");
    blockedTicks_ =
        TickWindow::make(options.blockedFrom_s, options.blockedUntil_s, setup.tick_s, parameters, "blocked");
    delay_ = options.delayTicks;
    sensors_.configure(robot_, setup.tick_s, options.sensors, parameters);
}

void ArmHardware::reset(const JointState& start) {
    tick_ = 0;
    oldest_ = 0;
    updatePush();
    sensors_.reset(start);
}

void ArmHardware::calcApplied(const JointVector& command, JointVector& applied) const {
    const JointVector& arriving = delay_ > 0 && tick_ > 0 ? sent_[oldest_] : command;
    applied = arriving.cwiseMax(-torqueLimit_).cwiseMin(torqueLimit_);
}

JointVector ArmHardware::calcMotorTorque(const JointVector& applied, const JointVector& q) const {
    JointVector torque = applied;
    for (int i = 0; i < n_; ++i)
        if (ripple_[i] > 0.0) torque[i] += ripple_[i] * std::sin(ripplePerRad_[i] * q[i]);
    return torque;
}

void ArmHardware::endTick(const JointVector& command, const JointState& encoders) {
    if (delay_ > 0) {
        if (tick_ == 0) std::fill(sent_.begin(), sent_.begin() + delay_, command);
        sent_[oldest_] = command;
        oldest_ = (oldest_ + 1) % delay_;
    }
    ++tick_;
    updatePush();
    sensors_.read(encoders);
}

double findFastestMode(const RobotDescription& robot, const JointVector& weight) {
    constexpr int kPoses = 200;
    const int n = robot.size();
    // Within a turn in all: poses beyond repeat those inside.
    const JointBounds range{robot.limits.position.lower.cwiseMax(-kPi), robot.limits.position.upper.cwiseMin(kPi)};
    std::mt19937 random(1);  // its numbers are the same everywhere
    RobotModel model(robot);
    Dynamics dynamics;
    double fastest = 0.0;
    for (int k = 0; k < kPoses; ++k) {
        model.calcDynamics(detail::drawPose(range, random), JointVector::Zero(n), dynamics);
        fastest = std::max(fastest, detail::findModes(dynamics.M, weight).eigenvalues()[n - 1]);
    }
    return fastest;
}

}  // namespace viable
