#pragma once

#include "viable/plugin/RobustLoop.h"

namespace viable {

/** Pulls the real arm onto the nominal one (nonlinear robust internal-loop compensator, NRIC).

Method: tau_a = -K_r (de + K_p e + K_i integral of e dt),  e = q_real - q_nominal  (paper, eq. 7)
with one gain of each per joint. The sum tau_c + tau_a is kept inside the motor's torque limit,
and while it stands there the integral does not grow further (it may shrink).
Assumes: K_r dt < 2 x
(joint inertia incl. the reflected rotor), else the sampled velocity loop is unstable. Guarantees:
|tau_c + tau_a| within the motor limits wherever |tau_c| is.
Real time: no allocation, lock or throw
after configure(). */
class Nric : public RobustLoop {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
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
