#pragma once

#include <memory>
#include <random>

#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The real arm in simulation: the nominal multibody model with joint friction, payload and mass
error, motors that saturate, and encoders.

Method: M(q) qdd + b(q, qd) + f(qd) = tau, with M and b by Simbody (RobotModel) and the friction per
joint f(v) = s [ (Fc + (Fs - Fc) exp(-(v/vs)^2)) tanh(v/v0) + Fv1 (1 - exp(-|v|/Fv2)) sign v ] [Nm]
Each sub-step first finds the friction torque implicitly, from the velocity that it leaves behind
(Newton iterations on M (v+ - v) / h = tau - b - f(v+)), and then takes one Runge-Kutta step of
order 4 with that torque held. So a joint at rest under a load below Fc stays at rest, whatever the
slope at v = 0. Order: 4 without friction, 1 in the friction torque. Stable for any friction slope.
Not modelled: joint elasticity, backlash, motor dynamics, mechanical end stops.
Real time: no allocation, lock or throw after configure(). */
class SimbodyPlant : public RealPlant {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    const JointState& measured() const override { return measured_; }
    const JointState& actual() const override { return actual_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override;

private:
    struct FrictionLaw {
        double coulomb, breakaway, stribeckVelocity, smoothing, viscous, viscousVelocity;
        /** Torque and its slope (never below zero) at velocity v. */
        void calc(double v, double& torque, double& slope) const;
    };
    /** The friction torque over a sub-step from `v` when `push` = tau - b acts. */
    void calcFriction(const JointMatrix& M, const JointVector& v, const JointVector& push);
    bool step(const JointVector& torque);
    void measure(const JointState& before);
    double drawNormal();

    int n_ = 0;
    double tick_s_ = 0.0;
    double substep_s_ = 0.0;
    int substeps_ = 1;
    std::unique_ptr<RobotModel> model_;
    Dynamics dynamics_;
    JointVector torqueLimit_;
    FrictionLaw friction_[kMaxJoints];
    bool hasFriction_ = false;
    JointVector resolution_;  // of the encoder [rad]; 0: exact
    bool exactVelocity_ = true;
    double noise_ = 0.0;
    std::uint64_t seed_ = 0;
    std::mt19937_64 random_;

    JointState actual_, measured_, next_;
    JointVector frictionTorque_;
};

}  // namespace viable
