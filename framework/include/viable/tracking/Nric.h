#pragma once

#include <array>
#include <memory>

#include "viable/plugin/RobustLoop.h"

namespace viable {

/** Gains and bounds of Nric: one number for all joints, or one each. Gains, each >= 0, are the paper's for the
Indy7: those of another arm follow from scaleGains(), as the plugin's defaults do. */
struct NricOptions {
    PerJoint kr = 600.0;  ///< on the whole error term [Nms/rad]
    PerJoint kp = 20.0;   ///< weight of the position error [1/s]
    PerJoint ki = 8.0;    ///< weight of the integral of the position error [1/s^2]
    /** Largest torque of the integral part, K_r K_i |integral| [Nm, prismatic: N]; > 0. The motor's torque
    limit where that is less. */
    PerJoint integralLimit = std::numeric_limits<double>::infinity();
    /** Fastest change of tau_a [Nm/s, prismatic: N/s]; > 0. */
    PerJoint torqueRate = std::numeric_limits<double>::infinity();
    /** See LinearErrorLoop [1/s]; > 0. */
    double inertiaRate = std::numeric_limits<double>::infinity();
    /** Fastest change of the whole torque of the motor, tau_c + tau_a, from what holds the arm at the start [Nm/s,
    prismatic: N/s]; > 0. */
    PerJoint motorRate = std::numeric_limits<double>::infinity();
    /** Fed forward at the nominal velocity; see scaleFriction(). */
    FrictionFeed friction = {};
};

/** The settings of the plugin: gains follow from the arm where they are not given. */
struct NricSettings {
    std::optional<PerJoint> kr, kp, ki;
    PerJoint integralLimit = NricOptions().integralLimit, torqueRate = NricOptions().torqueRate;
    PerJoint motorRate = NricOptions().motorRate;
    PerJoint frictionScale = 0.0;
    std::filesystem::path frictionFile;

    template <class V>
    void describe(V& v) {
        v(kr, "k_r", "Nms/rad", "Gain on the whole error term; auto: what the arm can carry.").atLeast(0).orAuto();
        v(kp, "k_p", "1/s", "Weight of the position error; auto: as k_r and the arm allow.").atLeast(0).orAuto();
        v(ki, "k_i", "1/s^2", "Weight of the integral of the position error; likewise.").atLeast(0).orAuto();
        v(integralLimit, "integral_limit_Nm", "Nm",
          "Largest torque of the integral, k_r k_i |integral|; the motor's limit where that is less.")
            .above(0)
            .orInfinite();
        v(torqueRate, "torque_rate_Nmps", "Nm/s", "Fastest change of the loop's torque.").above(0).orInfinite();
        v(motorRate, "motor_rate_Nmps", "Nm/s",
          "Fastest change of the motor's whole torque, the filter's and the loop's; no tracking bound covers it.")
            .above(0)
            .orInfinite();
        v(frictionScale, "friction_scale", "",
          "Factor on the friction figures that are fed forward at the nominal velocity; 0: none.")
            .atLeast(0);
        v(frictionFile, "friction_file",
          "Those figures: an actuation.yaml, as of `viable identify`; the robot's own when empty.");
    }
};

/** The feed-forward of `figures` times `scale`, one number per joint. The Coulomb part passes zero in the kFeedTicks
ticks that the joint takes at its acceleration limit. So it changes by no more than its double in those. */
FrictionFeed scaleFriction(const JointFriction& figures, const PerJoint& scale, const JointLimits& limits,
                           double tick_s);
inline constexpr double kFeedTicks = 5.0;

/** Constant gains that the arm can carry in every pose within its position limits.

Method: sampled, the loop's velocity error is v+ = (I - M^-1 K_r dt) v, which becomes unstable once an eigenvalue of
M(q)^-1 K_r dt passes 2. So K_r = s diag(d). Here d_i is the least inertia that joint i moves with the other joints
free, min over q of 1 / (M(q)^-1)_ii. The factor s makes the largest of those eigenvalues over all poses 1, half of what
is stable. A payload adds inertia, so it adds to the distance. K_p = 100 1/s and K_i = 100 1/s^2
(experiments/panda_asymmetric_limits.yaml). But K_p dt <= 0.1, and K_i <= K_p / 4 x the slowest velocity loop, min over
q of K_r / M_ii(q). And never stiffer than the paper's 600, 20 and 8 on the Indy7: K_r <= 600, K_r K_p <= 600 x 20, K_r
K_i <= 600 x 8. All of it is lowered, by a half at most, where the margins (calcMargins) are enough then. If the inertia
of a joint differs much from pose to pose, such gains oscillate in the heavy ones. Then scaleGains() gives gains that
follow the inertia.
Assumes: inertias as described. The poses are a fixed sample of 1000, at corners and in between.
@param tick_s  > 0
@return        one gain per joint; finite, and zero for an arm without a usable inertia matrix
Not for a loop: it takes some 10 ms. */
NricOptions scaleNric(const RobotDescription& robot, const JointLimits& limits, double tick_s);

class ArmRecursion;

/** Pulls the real arm onto the nominal one (nonlinear robust internal-loop compensator, NRIC).

Method: tau_a = -K_r (de + K_p e + K_i integral of e dt),  e = q_real - q_nominal  (paper, eq. 7). Each joint has one
gain of each. With a finite inertiaRate K_r follows the arm's inertia (LinearErrorLoop). With `friction` the loop adds
the friction that the nominal velocity would meet. The rest of the true friction f(v) is f(v) - f(v_n), which damps, and
the error of the figures (MATH 10).
Bounds: the integral's share of a joint's torque, |(K_r)_ii K_i integral|, ends at integralLimit, and at the motor's
torque limit at the latest. Per tick tau_a changes by at most torqueRate x tick, from zero at the start. The sum tau_c +
tau_a is kept inside the motor's torque limit, and changes by motorRate x tick per tick at most. While these cut the
torque, the integral does not grow further against them (it may shrink). Nor does it while the host gives less. If
nothing is cut, tau_a is that of eq. 7 to the last bit.
Assumes: K_r dt < 2 x (joint inertia incl. the reflected rotor), else the sampled velocity loop is unstable. A
torqueRate below K_r T / (2 x inertia) slows the loop down. A joint that was held while the loop pressed with T [Nm]
then overshoots. Far below that rate it becomes unstable. The same holds for motorRate, of which tau_c takes its part.
Guarantees: |tau_c + tau_a| within the motor limits wherever |tau_c| is; |integral| as above. The change of tau_a in a
tick is at most torqueRate x tick or, at the motor's limits, the change of tau_c. It is zero as long as e, de and the
friction fed forward are.
Real time: no allocation, lock or throw after configure(). */
class Nric : public RobustLoop {
public:
    /** Reads NricSettings; gains that are `auto` by scaleGains(). */
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    /** The same without an experiment file. Throws Error (BadInput) for options of the wrong number, gains
    below 0 or not finite, and bounds that are not above 0. */
    void configure(const RunSetup& setup, const NricOptions& options);

    void holdIntegral() override { isIntegralHeld_ = true; }
    RobustTraits traits() const override { return {loop_}; }

    void reset(const MotionState& start) override;
    TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override;

private:
    void setGain(const JointVector& q);
    void takeGiven(const JointVector& given);

    int n_ = 0;
    std::shared_ptr<const ArmRecursion> arm_;  // null if it is not needed
    bool followsInertia_ = false, limitsMotorRate_ = false, feedsFriction_ = false;
    JointMatrix gain_;           // K_r
    JointVector integralLimit_;  // limit of its torque [Nm]
    double tick_s_ = 0.0;
    LinearErrorLoop loop_;
    JointVector torqueLimit_;
    JointVector largestStep_;                         // change of the torque in a tick [Nm]
    JointVector largestMotorStep_, lastMotorTorque_;  // for the sum tau_c + tau_a [Nm]
    JointVector integral_;                            // integral of e [rad s]
    JointVector lastTorque_;                          // tau_a of the tick before [Nm]
    std::array<int, kMaxJoints> withheld_{};          // ticks in a row that the host gave less; < 0: on the other side
    bool isIntegralHeld_ = false;
};

}  // namespace viable
