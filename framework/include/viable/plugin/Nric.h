#pragma once

#include "viable/core/PerJoint.h"
#include "viable/plugin/RobustLoop.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** The gains of Nric, each >= 0: one number for all joints, or one each. The plugin's parameters have
the same defaults (a test compares them): the paper's for the Indy7. */
struct NricOptions {
    PerJoint kr = 600.0;  ///< on the whole error term [Nms/rad]
    PerJoint kp = 20.0;   ///< weight of the position error [1/s]
    PerJoint ki = 8.0;    ///< weight of the integral of the position error [1/s^2]
};

/** Gains that the arm can carry in every pose within its position limits.

Method: sampled, the loop's velocity error is v+ = (I - M^-1 K_r dt) v, which swings up once an
eigenvalue of M(q)^-1 K_r dt passes 2. So K_r = s diag(d), with d_i the least inertia that joint i
moves with the other joints free, min over q of 1 / (M(q)^-1)_ii, and s such that the largest of those
eigenvalues over all poses is 1, half of what is stable; a payload adds inertia, so it adds to the
distance. K_p = 100 1/s and K_i = 100 1/s^2 (experiments/panda_asymmetric_limits.yaml), but K_p dt
<= 0.1, and K_i <= K_p / 4 x the slowest velocity loop, min over q of K_r / M_ii(q). And never
stiffer than the paper's 600, 20 and 8 on the Indy7: K_r <= 600, K_r K_p <= 600 x 20, K_r K_i <= 600 x 8.
Assumes: inertias as described. The poses are a fixed sample of 1000, at corners and in between.
@param tick_s  > 0
@return        one gain per joint; finite, and zero for an arm without a usable inertia matrix
Not for a loop: it takes some 10 ms. */
NricOptions scaleNric(const RobotDescription& robot, const JointLimits& limits, double tick_s);

/** Pulls the real arm onto the nominal one (nonlinear robust internal-loop compensator, NRIC).

Method: tau_a = -K_r (de + K_p e + K_i integral of e dt),  e = q_real - q_nominal  (paper, eq. 7)
with one gain of each per joint. The sum tau_c + tau_a is kept inside the motor's torque limit,
and while it stands there the integral does not grow further (it may shrink).
Assumes: K_r dt < 2 x (joint inertia incl. the reflected rotor), else the sampled velocity loop is
unstable.
Guarantees: |tau_c + tau_a| within the motor limits wherever |tau_c| is.
Real time: no allocation, lock or throw after configure(). */
class Nric : public RobustLoop {
public:
    /** Reads `k_r`, `k_p` and `k_i`. */
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    /** The same without an experiment file. Throws Error (BadInput) for gains of the wrong number, below
    0 or not finite. */
    void configure(const RunSetup& setup, const NricOptions& options);

    void holdIntegral() override { isIntegralHeld_ = true; }

    void reset(const MotionState& start) override;
    TickStatus compute(const JointState& real, const MotionState& nominal,
                       const JointVector& filterTorque, JointVector& torque) override;

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    JointVector kr_, kp_, ki_, torqueLimit_;
    JointVector integral_;  // of e [rad s]
    bool isIntegralHeld_ = false;
};

}  // namespace viable
