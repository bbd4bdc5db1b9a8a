#pragma once

#include "robot/ArmRecursion.h"

namespace viable {

/** What acts on an arm besides gravity, for some time. */
struct Acting {
    JointVector torque;        ///< of motors and pushes [Nm]
    JointVector dry, viscous;  ///< sizes of the friction: f(v) = (dry + viscous (1 - exp(-|v| / v0))) sign v [Nm]
};

/** An arm with friction that may change at any time, by an integrator of its own: nothing of the plants is in it.

Method: M and b in the middle of a step; the velocities by the L-stable two-stage diagonally implicit Runge-Kutta method
of order 2 (Alexander, SIAM J. Numer. Anal. 14, 1977) with friction implicit, dry friction as the set-valued law that it
is. So steps may be long against inertia over damping. */
class DisturbedArm {
public:
    /** @param viscousVelocity  v0 of each joint [rad/s] */
    DisturbedArm(const RobotDescription& robot, const JointVector& viscousVelocity);

    void reset(const JointVector& q);
    void advance(const Acting& acting, double time_s);

    const JointVector& q() const { return q_; }
    const JointVector& v() const { return v_; }

private:
    /** x with M x + c f(x) = r; from `x`. */
    void solve(const Acting& acting, double c, const JointVector& r, JointVector& x) const;
    bool solveByModes(const Acting& acting, double c, const JointVector& r, JointVector& x) const;
    void solveJointByJoint(const Acting& acting, double c, const JointVector& r, JointVector& x) const;

    ArmRecursion arm_;
    int n_;
    JointVector viscousVelocity_;
    JointVector q_, v_, a_;
    JointMatrix M_;
};

}  // namespace viable
