#pragma once

#include <array>
#include <memory>

#include "MujocoModel.h"
#include "viable/plugin/RealPlant.h"
#include "viable/simulation/ArmHardware.h"
#include "viable/simulation/MotorRate.h"

namespace viable {

/** The real arm in simulation by MuJoCo, inside the same hardware as the plant `simbody` (ArmHardware): a second opinion
from another engine with an own reader of the URDF and an own treatment of dry friction.

Method: M(q) qdd + b(q, qd) + f(qd) = tau + tau_e with MuJoCo's M and b, rotor inertias as its armature, Runge-Kutta of
order 4. Dry friction is MuJoCo's friction-loss constraint with F (FrictionLaw) as its bound, F taken at the beginning of
each sub-step; the viscous part is its joint damping, c = f(v) / v taken there too. The constraint is soft, as hard as
MuJoCo allows (impedance 0.9999, time constant two sub-steps): a joint that should stick creeps with
    v = R f / b,  R = 1e-4 / M,  b = 1 / h                                                  [rad/s]
about 1e-7 rad/s per Nm of load and kg m^2 at h = 1 ms. A blocked joint is the same constraint without a bound.
Assumes: sub-steps short enough for the viscous friction; configure() refuses others.
Not modelled: joint elasticity, backlash, motor dynamics, mechanical end stops, contacts, the URDF's own limits, damping
and friction.
Real time: no allocation, lock or throw after configure(). */
class MujocoPlant : public RealPlant {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    const JointState& measured() const override { return hardware_.measured(); }
    PlantTraits traits() const override { return {hardware_.encoder(), hardware_.delayTicks(), motorRate_.rate()}; }
    const JointState& actual() const override { return actual_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override;
    const JointVector* externalTorque() const override { return &hardware_.externalTorque(); }

private:
    void findJoints(const std::string& source);
    void scaleMasses(const JointVector& factor);
    void configureFriction(const Parameters& parameters, double tick_s);
    void putState(const JointState& state);
    JointState readState() const;
    void step(const JointVector& applied);

    int n_ = 0;
    ArmHardware hardware_;
    MotorRate motorRate_;
    std::unique_ptr<MujocoModel> mujoco_;
    std::array<int, kMaxJoints> dof_{};  // MuJoCo's number of each joint

    JointState actual_;
    JointVector load_, nextLoad_;
};

}  // namespace viable
