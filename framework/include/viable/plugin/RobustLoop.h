#pragma once

#include "viable/plugin/Plugin.h"

namespace viable {

/** Friction that a robust loop cancels at the nominal velocity, where it is smooth and no matter of stability. */
struct FrictionFeed {
    JointFriction figures;  ///< sizes 0: nothing is fed forward
    JointVector speed;      ///< up to it [rad/s] the Coulomb part grows in proportion to the velocity; > 0

    bool isActive() const { return speed.size() > 0; }
    /** [Nm] at the velocity v [rad/s] of a joint; requires isActive(). */
    double calc(int joint, double v) const;
    /** [Nm] of every joint. */
    JointVector calc(const JointVector& qd) const;
};

/** The law tau_a = friction(qd_nominal) - K_r (de + k_p e + k_i integral of e dt) on e = q_real - q_nominal around a
pose, with one number per joint. The stability check (calcMargins) uses it, and a tracking bound follows from it
(calcTrackingBound). */
struct LinearErrorLoop {
    JointVector kr;             ///< K_r = diag(k_r) [Nms/rad], or its bound, see inertiaRate
    JointVector kp;             ///< [1/s]
    JointVector ki;             ///< [1/s^2]
    JointVector integralLimit;  ///< limit of k_r k_i |integral| [Nm]; infinite: none
    JointVector torqueRate;     ///< limit of the change of tau_a [Nm/s]; infinite: none
    /** c [1/s]: K_r = (diag(k_r)^-1 + (c M(q))^-1)^-1 with the nominal arm's inertia at its pose. So K_r is below c M, by
    which every velocity error decays at c in every pose, and below diag(k_r). Infinite: K_r = diag(k_r). No tracking
    bound is known where it is finite. */
    double inertiaRate = std::numeric_limits<double>::infinity();
    FrictionFeed friction;
    /** Limit of the change of tau_c + tau_a [Nm/s]; infinite or of size 0: none. No tracking bound is known where it
    is finite. */
    JointVector motorRate;
};

/** The host asks a robust loop for these once, after configure(). */
struct RobustTraits {
    /** The linear law that it is, as long as neither of the law's limits nor a motor's acts. None: it is none, and no
    tracking bound is known for it. */
    std::optional<LinearErrorLoop> errorLoop;
};

/** Makes the real arm follow the nominal one in spite of friction, payload and model error. */
class RobustLoop : public Plugin {
public:
    using Traits = RobustTraits;
    virtual RobustTraits traits() const { return {}; }

    /** The torque tau_a [Nm] added to the filter's. `real` is the measured state, `nominal` the nominal arm at the
    same instant. `filterTorque` is the motors' share of the torque that moves the nominal arm: tau_c. With an
    external torque fed to the arm it is tau_c - tau_ext. The motors' limits are in setup.robot.actuation. `torque` comes
    as what was added in the tick before. The host may have given less than it was asked for (MATH 11), and a sum should not
    grow against that. On Ok, `torque` has one finite entry per joint; otherwise the host applies zero. */
    virtual TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                               JointVector& torque) = 0;

    /** The arm does not follow and is being braked: from the next compute() on whatever sums up the error
    stands still, until reset(). For loops without a sum there is nothing to do. */
    virtual void holdIntegral() {}
};

}  // namespace viable
