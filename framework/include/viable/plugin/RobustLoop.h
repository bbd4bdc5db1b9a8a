#pragma once

#include "viable/plugin/Plugin.h"

namespace viable {

/** A robust loop whose law is tau_a = -k_r (de + k_p e + k_i integral of e dt), e = q_real - q_nominal, with constant
gains: what a bound on the tracking error follows from. One entry per joint. */
struct LinearErrorLoop {
    JointVector kr;             ///< [Nms/rad]
    JointVector kp;             ///< [1/s]
    JointVector ki;             ///< [1/s^2]
    JointVector integralLimit;  ///< largest k_r k_i |integral| that it allows [Nm]; infinite: none of its own
    JointVector torqueRate;     ///< fastest change of tau_a [Nm/s]; infinite: none
};

/** Makes the real arm follow the nominal one in spite of friction, payload and model error. */
class RobustLoop : public Plugin {
public:
    /** The torque tau_a [Nm] added to the filter's. `real` is the measured state, `nominal` the
    nominal arm at the same instant. `filterTorque` is the motors' share of what moves the nominal arm: tau_c, and
    tau_c - tau_ext where an external torque is fed to it (the motors' limits are in setup.robot.actuation). On Ok,
    `torque` has one finite entry per joint; otherwise the host applies zero. */
    virtual TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                               JointVector& torque) = 0;

    /** The arm does not follow and is being braked: from the next compute() on whatever sums up the error
    stands still, until reset(). For loops without a sum there is nothing to do. */
    virtual void holdIntegral() {}

    /** The law, where it is linear in the error; null: no tracking bound follows from this loop. Valid after
    configure(), and constant from there on. */
    virtual const LinearErrorLoop* errorLoop() const { return nullptr; }
};

}  // namespace viable
