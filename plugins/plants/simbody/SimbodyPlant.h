#pragma once

#include <memory>
#include <random>

#include "viable/motion/BoxQp.h"
#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The real arm in simulation: the nominal multibody model with joint friction, payload and mass
error, motors that saturate, and encoders.

Method: M(q) qdd + b(q, qd) + f(qd) = tau, with M and b by Simbody (RobotModel) and per joint
    f(v) = F(v) sign v + Fv1 (1 - exp(-|v| / Fv2)) sign v,  F(v) = Fc + (Fs - Fc) exp(-(v / vs)^2)  [Nm]
where sign 0 is any value in [-1, 1]: what it takes to stay at rest.
Each sub-step first finds the friction torque implicitly, from the velocity v+ that it leaves behind:
M (v+ - v) / h = tau - b - f(v+), with F taken at v. For the dry parts that is a box QP (the dual of
Moreau's time stepping, 1988), for the saturating viscous parts a few rounds with f = c v+, c = f(v) / v
at the last v+. Then one Runge-Kutta step of order 4 is taken with that torque held. So a joint at rest
under a load below Fs stays exactly there.
Order: 4 without friction, 1 in the friction torque. Stable for any friction.
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
        double coulomb, breakaway, stribeckVelocity, viscous, viscousVelocity;
        /** F: the most that dry friction can give at velocity v. */
        double calcDry(double v) const;
        /** The viscous torque over v, > 0 also at v = 0. [Nms/rad] */
        double calcDamping(double v) const;
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
    BoxQp dryFriction_;
};

}  // namespace viable
