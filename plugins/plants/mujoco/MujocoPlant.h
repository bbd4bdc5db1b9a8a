#pragma once

#include "MujocoModel.h"
#include "viable/simulation/ArmContact.h"
#include "viable/simulation/ArmHardware.h"

namespace viable {

/** The real arm in simulation by MuJoCo, inside the same hardware as the plant `simbody` (ArmHardware): a second opinion
from another engine with an own reader of the URDF and an own treatment of dry friction.

Method: M(q) qdd + b(q, qd) + f(qd) = tau + tau_e with MuJoCo's M and b, rotor inertias as its armature, Runge-Kutta of
order 4. Dry friction is MuJoCo's friction-loss constraint with F (FrictionLaw) as its bound, F taken at the beginning of
each sub-step; the viscous part is its joint damping, c = f(v) / v taken there too. The constraint is soft, as hard as
MuJoCo allows (impedance 0.9999, time constant two sub-steps): a joint that should stick creeps with
    v = R f / b,  R = 1e-4 / M,  b = 1 / h                                                  [rad/s]
about 1e-7 rad/s per Nm of load and kg m^2 at h = 1 ms. A blocked joint is the same constraint without a bound.
Contact: a ball at the tool, on request also the capsules of the arm, meet the obstacles by MuJoCo's collision detection.
Forces are MuJoCo's constraint a + R f = aref in an elliptic cone f_t <= mu f_n, solved with the joints' friction. In the
normal's direction aref = R (k x + 3/2 c k x x'), x the depth and R = 1e4 A, A the largest inverse mass of that part of
the arm [1/kg]. So the force is Hunt and Crossley's as in ArmContact, within 1e-4 of the net force. Along the surface
R = 1e-4 A and aref = -v / T, T = 1 ms or two sub-steps. What sticks creeps with R f T, and friction acts at once,
without a spring.
MuJoCo 2.2.2 stops the depth in a box at the radius, which is corrected. How deep a ball is in a cylinder is found by
ArmContact::findShortest, as MuJoCo's depth there is up to five times too large.
Assumes: sub-steps short enough for the viscous friction and the contact's stiffness; configure() refuses others, contact
with maps, contact by Hertz and capsules against cylinders. A tick with more than 100 contacts is Faulted.
Not modelled: joint elasticity, backlash, motor dynamics, mechanical end stops, the URDF's own limits, damping, friction
and collision shapes.
Real time: no allocation, lock or throw after configure(). */
class MujocoPlant : public RealPlant {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    const JointState& measured() const override { return hardware_.measured(); }
    PlantTraits traits() const override { return {hardware_.encoder(), hardware_.delayTicks(), motorRate_.rate()}; }
    const JointState& actual() const override { return actual_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override;
    const JointVector* externalTorque() const override { return &external_; }
    const ContactReport* contact() const override { return carriers_.empty() ? nullptr : &report_; }

private:
    void findJoints(const std::string& source);
    void scaleMasses(const JointVector& factor);
    void configureFriction(const Parameters& parameters, double tick_s);
    std::vector<MujocoShape> listShapes(const RunSetup& setup, const ContactOptions& options,
                                        const Parameters& parameters);
    void configureContact(const RunSetup& setup, const ContactOptions& options, const Parameters& parameters);
    void putState(const JointState& state);
    JointState readState() const;
    struct Touch {
        std::size_t obstacle;
        int carrier;
        double side;  // of MuJoCo's force and velocity: 1 where they are the arm's, -1 where the obstacle's
    };
    Touch readTouch(const mjContact& contact) const;
    void correctDepths();
    /** MuJoCo's acceleration in its present state. @param time_s  of the run */
    void accelerate(double time_s);
    void step(const JointVector& applied, double time_s);
    /** On the joints, after accelerate(). */
    JointVector calcContactTorque() const;
    void reportContacts();

    int n_ = 0;
    ArmHardware hardware_;
    MotorRate motorRate_;
    std::unique_ptr<MujocoModel> mujoco_;
    std::array<int, kMaxJoints> dof_{};  // MuJoCo's number of each joint

    JointState actual_;
    JointVector load_, nextLoad_;

    std::vector<int> carriers_;        // the joint of each shape of the arm; these follow the obstacles'. Empty: none
    std::vector<std::size_t> shapes_;  // by MuJoCo's geom
    std::vector<Solid> solids_;
    std::vector<MovingSphere> spheres_;  // they follow the solids
    double dissipation_ = 0.0, slipRate_ = 0.0;
    double time_s_ = 0.0;
    ContactReport report_;
    JointVector external_;  // push and contact now
};

}  // namespace viable
