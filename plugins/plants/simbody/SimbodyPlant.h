#pragma once

#include "viable/qp/BoxQp.h"
#include "viable/robot/RobotModel.h"
#include "viable/simulation/ArmContact.h"
#include "viable/simulation/ArmHardware.h"

namespace viable {

/** The real arm in simulation: the nominal multibody model with payload and mass error, inside the hardware of an
arm (ArmHardware: motors, friction, pushes, sensors), on request with backlash in its gears.

Method: M(q) qdd + b(q, qd) + f(qd) = tau + tau_e, with M and b by Simbody or on request by the recursion
(RobotModel), tau of the motors and tau_e of the surroundings, and the friction f of each joint as in FrictionLaw; its load is tau - f of the sub-step before, at
first b.
Each sub-step first finds the friction torque implicitly, from the velocity v+ that it leaves behind:
M (v+ - v) / h = tau + tau_e - b - f(v+), with F taken at v. For the dry parts that is a box QP (the dual of
Moreau's time stepping, 1988), for the saturating viscous parts a few rounds with f = c v+, c = f(v) / v
at the last v+. Then one Runge-Kutta step of order 4 is taken with that torque held. So a joint at rest
under a load below Fs stays exactly there.
Contact with the obstacles (ArmContact) is part of tau_e, at every stage of the Runge-Kutta step.
A joint that blocks stops in an impulse, which the others feel, and stays by the torque that this takes.
Backlash: rotor (with friction and encoder) and link are joined by a spring K and a damper with a gap between them:
    J_r w' = tau - f(w) - tau_g,  M_link qdd + b = tau_g + tau_e,  tau_g = K d + D d'  [Nm]
d: how far the rotor is beyond the half gap; the gear pushes and never pulls. The same Runge-Kutta step, f implicit in
w. Without backlash the gears are rigid and none of this is calculated.
Order: 4 without friction, 1 in the friction torque, 1 where a gap closes or opens. Stable for any friction.
Not modelled: motor dynamics, mechanical end stops.
Real time: no lock or throw after configure(), and no allocation unless a map is touched. */
class SimbodyPlant : public RealPlant {
public:
    /** Throws Error (BadInput) also for backlash with sub-steps too long for its springs, or without rotor inertia. */
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    const JointState& measured() const override { return hardware_.measured(); }
    PlantTraits traits() const override { return {hardware_.encoder(), hardware_.delayTicks(), motorRate_.rate()}; }
    const JointState& actual() const override { return link_; }  ///< behind the gears
    TickStatus advance(const JointVector& torque, JointVector& applied) override;
    const JointVector* externalTorque() const override { return &external_; }
    const ContactReport* contact() const override { return contact_.isOn() ? &contact_.report() : nullptr; }

private:
    struct TwoSides {
        JointState link, rotor;
    };
    void configureGears(const RunSetup& setup, const Parameters& parameters);
    /** The friction torque over a sub-step from `v` when `push` = tau - b acts. */
    void calcFriction(const JointMatrix& M, const JointVector& v, const JointVector& push);
    void calcRotorFriction(const JointVector& v, const JointVector& push);
    JointVector calcGearTorque(const TwoSides& s) const;
    /** Takes the blocked joint out of the equations: its acceleration is zero. */
    void holdBlocked(JointVector& torque);
    bool stopBlocked();
    bool step(const JointVector& motor);
    bool stepWithGears(const JointVector& motor);
    /** Adds what the surroundings do to the arm `after_s` after the beginning of the sub-step. */
    void addContact(double after_s, const JointState& arm, JointVector& torque) const;
    JointState encoders() const { return hasGears_ ? JointState{rotor_.q - zeroOffset_, rotor_.qd} : link_; }

    int n_ = 0;
    ArmHardware hardware_;
    MotorRate motorRate_;
    ArmContact contact_;
    double time_s_ = 0.0;   // at the beginning of the sub-step
    JointVector external_;  // push and contact now
    DynamicsEngine engine_ = DynamicsEngine::Simbody;
    std::unique_ptr<RobotModel> model_;  // with backlash without the rotors
    Dynamics dynamics_;
    Dynamics implicit_;  // of a sub-step with its viscous friction

    bool hasGears_ = false;
    JointVector rotorInertia_, halfGap_, stiffness_, damping_;
    JointVector zeroOffset_;  // rotor - link at the start: what the encoders were set by

    JointState link_, rotor_;
    TwoSides next_;
    JointVector frictionTorque_, load_, nextLoad_;
    BoxQp dryFriction_;
};

}  // namespace viable
