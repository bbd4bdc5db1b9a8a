#pragma once

#include "viable/motion/Braking.h"
#include "viable/motion/DesiredJerk.h"
#include "viable/motion/TripleIntegrator.h"
#include "viable/plugin/IntervalChoice.h"

namespace viable {

/** Keeps position, velocity, acceleration and jerk limits by the time-optimal stationary braking
policy (TOSBP; C2 and S4 of the paper), faithful to the paper with its slips corrected.

Method: the jerk j of each joint, nearest to the desired one (14) in torque (13), subject to
    position       j <= -J + alpha(h_p) / (dp_f/da),  h_p = P - p_f,  types III and IV      (18, 21)
    velocity       j <= -J + J alpha(h_v) / a,  h_v = V - v - a^2 / (2 J),  for a > 0           (19)
    acceleration   -A <= a + j dt <= A                                                (in place of 22)
    jerk           -J <= j <= J
and the mirror image below; p_f is the position where the stationary stop (Table I) ends,
alpha(h) = k_alpha h.
Assumes: continuous time. With jerk held over a tick a stop may come to lie beyond its limit (h < 0),
where the row has no solution at all, or rows contradict each other: such ticks are reported as
Infeasible, and the joint brakes by the policy's own jerk as far as acceleration and jerk limits let it.
Guarantees: jerk and acceleration limits at every tick; position and velocity only approximately.
Real time: no allocation, lock or throw after configure(). */
class Tosbp : public SafetyFilter {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    bool promisesLimits() const override { return false; }
    FilterStatus filter(const MotionState& nominal, const JointVector& torque,
                        const Dynamics& dynamics, FilterDecision& decision) override;

private:
    /** The admissible jerks of one joint in one tick. */
    struct Rows {
        JointInterval jerk;  ///< the braking jerk alone where the rows had no solution
        bool empty;          ///< they did
    };
    Rows calcRows(const AxisState& state, const AxisLimits& limits) const;

    int n_ = 0;
    double tick_s_ = 0.0;
    double kAlpha_ = 0.0;
    JointLimits limits_;
    DesiredJerk desiredJerk_;
    IntervalChoice choice_;
    JointVector desiredAcceleration_, desired_, jerk_;
};

}  // namespace viable
