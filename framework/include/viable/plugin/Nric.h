#pragma once

#include "viable/core/PerJoint.h"
#include "viable/plugin/RobustLoop.h"

namespace viable {

/** The gains of Nric, each >= 0: one number for all joints, or one each. The plugin's parameters have the same defaults
(a test compares them): the paper's for the Indy7. */
struct NricOptions {
    PerJoint kr = 600.0;  ///< on the whole error term [Nms/rad]
    PerJoint kp = 20.0;   ///< weight of the position error [1/s]
    PerJoint ki = 8.0;    ///< weight of the integral of the position error [1/s^2]
};

/** Pulls the real arm onto the nominal one (nonlinear robust internal-loop compensator, NRIC).

Method: tau_a = -K_r (de + K_p e + K_i integral of e dt),  e = q_real - q_nominal  (paper, eq. 7)
with one gain of each per joint. The sum tau_c + tau_a is kept inside the motor's torque limit,
and while it stands there the integral does not grow further (it may shrink).
Assumes: K_r dt < 2 x (joint inertia incl. the reflected rotor), else the sampled velocity loop is unstable.
Guarantees: |tau_c + tau_a| within the motor limits wherever |tau_c| is.
Real time: no allocation, lock or throw after configure(). */
class Nric : public RobustLoop {
public:
    /** Reads `k_r`, `k_p` and `k_i`. */
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    /** The same without an experiment file. Throws Error (BadInput) for gains of the wrong number, below 0 or not finite. */
    void configure(const RunSetup& setup, const NricOptions& options);

    void reset(const MotionState& start) override;
    TickStatus compute(const JointState& real, const MotionState& nominal,
                       const JointVector& filterTorque, JointVector& torque) override;

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    JointVector kr_, kp_, ki_, torqueLimit_;
    JointVector integral_;  // of e [rad s]
};

}  // namespace viable
