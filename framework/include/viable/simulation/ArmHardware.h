#pragma once

#include <array>
#include <memory>
#include <random>

#include "viable/plugin/RealPlant.h"

namespace viable {

class ArmRecursion;

/** The ticks whose beginning lies in [from_s, until_s). */
class TickWindow {
public:
    /** Throws Error (BadInput) at the parameter `<what>_until_s` unless it is after `<what>_from_s`. */
    static TickWindow make(double from_s, double until_s, double tick_s, const Parameters& parameters,
                           const std::string& what);
    bool contains(std::int64_t tick) const { return tick >= first && tick < end; }

    std::int64_t first = 0;
    std::int64_t end = 0;
};

/** A fault of one position reading. */
enum class SensorFault : unsigned char { None, Stuck, Bias, Sign, Spike, Swap, Wrap, Nan };

struct JointSensorOptions {
    Encoder encoder = Encoder::Counts;
    double noise_rad = 0.0;
    std::uint64_t seed = 1;
    SensorFault fault = SensorFault::None;
    int faultJoint = 0;
    double faultFrom_s = 0.0, faultUntil_s = kInfinity, fault_rad = 0.0;

    template <class V>
    void describe(V& v) {
        v(encoder, "encoder", "robot|exact",
          "robot: positions in whole counts, velocity by their difference over a tick; exact: the truth.");
        v(noise_rad, "encoder_noise_rad", "rad", "Standard deviation of the position reading; cut at 4 of them.")
            .atLeast(0);
        v(seed, "seed", "Of the reading noise: same seed, same readings.").atLeast(0);
        v(fault, "sensor_fault", "none|stuck|bias|sign|spike|swap|wrap|nan",
          "What goes wrong with one position reading: it stays, is offset, negated, offset once, exchanged with the "
          "next joint's, a turn too large, or NaN.");
        v(faultJoint, "sensor_fault_joint", "At which joint, counted from 0.").atLeast(0).upTo(kMaxJoints - 1);
        v(faultFrom_s, "sensor_fault_from_s", "s", "From when.").atLeast(0);
        v(faultUntil_s, "sensor_fault_until_s", "s", "To when.").atLeast(0).orInfinite();
        v(fault_rad, "sensor_fault_rad", "rad", "Size of a bias or spike.");
    }
};

/** The position sensors of a simulated arm: whole counts, noise, and one faulty channel.

Method: reading = position + noise, rounded to whole counts. The velocity is the difference of two readings over a tick,
or with `encoder: exact` and without noise the true one. The noise is normal, cut at 4 standard deviations, so that it
has a bound. The fault then acts on the readings, and so on their difference:
    stuck  the channel stays at its last reading           sign  its reading is negated
    bias   sensor_fault_rad is added                       swap  it and the next joint's are exchanged
    spike  the same, in the first reading of the window    wrap  one turn is added
    nan    no number
(the true velocity, where that is reported, is 0 while stuck, negated, exchanged or no number.)
Real time: no allocation, lock or throw after configure(). */
class JointSensors {
public:
    /** Throws Error (BadInput) for a fault on a joint that the robot has not. @param parameters  where `options` were written */
    void configure(const RobotDescription& robot, double tick_s, const JointSensorOptions& options,
                   const Parameters& parameters);

    /** The reading at t = 0, with the velocity as it is. */
    void reset(const JointState& truth);

    /** The reading at the end of a tick. */
    void read(const JointState& truth);

    const JointState& measured() const { return measured_; }
    /** As the parameter `encoder` says. */
    Encoder encoder() const { return options_.encoder; }

private:
    double drawNormal();
    void updateReadings(const JointState& truth);
    void disturb(JointState& reading);

    int n_ = 0;
    double tick_s_ = 0.0;
    JointVector resolution_;  // [rad]; 0: exact
    JointSensorOptions options_;
    bool isVelocityExact_ = true;
    std::mt19937_64 random_;
    TickWindow faultTicks_;

    std::int64_t tick_ = 0;
    JointState measured_;
};

/** Friction of one joint over the torque that its gear carries,
    f(v) = F(v) sign v + Fv1 (1 - exp(-|v| / Fv2)) sign v,
    F(v) = Fc + (Fs - Fc) exp(-(v / vs)^2) + mu |load|                                       [Nm]
Here sign 0 is any value in [-1, 1] that keeps the joint at rest. */
struct FrictionLaw {
    double coulomb = 0.0;           ///< Fc [Nm]
    double breakaway = 0.0;         ///< Fs [Nm]
    double stribeckVelocity = 1.0;  ///< vs [rad/s]
    double loadShare = 0.0;         ///< mu
    double viscous = 0.0;           ///< Fv1 [Nm]
    double viscousVelocity = 1.0;   ///< Fv2 [rad/s]

    /** F: the largest dry friction at velocity `v` with `load` [Nm] on the gear. */
    double calcDry(double v, double load) const;
    /** The viscous torque over v, > 0 also at v = 0. [Nms/rad] */
    double calcDamping(double v) const;
};

struct ArmHardwareOptions {
    static constexpr int kMaxDelay = 20;  ///< ticks

    int substeps = 1;
    bool isFrictionless = false;
    PerJoint frictionScale = 1.0;
    double breakawayRatio = 1.0, stribeckVelocity = 0.02;
    PerJoint loadFriction = 0.0;
    double payload_kg = 0.0;
    Eigen::Vector3d payloadOffset = Eigen::Vector3d::Zero();
    PerJoint massFactor = 1.0;
    Eigen::Vector2d baseTilt = Eigen::Vector2d::Zero();
    double torqueLimitFactor = 1.0;
    PerJoint torqueRipple = 0.0, torqueRipplePerTurn = 0.0;
    int delayTicks = 0;
    PerJoint push = 0.0;
    double pushFrom_s = 0.0, pushUntil_s = kInfinity;
    int blockedJoint = -1;
    double blockedFrom_s = 0.0, blockedUntil_s = kInfinity;
    JointSensorOptions sensors;

    template <class V>
    void describe(V& v) {
        v(substeps, "substeps", "Integration steps per tick.").atLeast(1).upTo(1000);
        v(isFrictionless, "friction", "robot|none", "Friction figures of the robot's actuation.yaml, or none at all.");
        v(frictionScale, "friction_scale", "", "Factor on all friction torques, Fc and Fv1.").atLeast(0);
        v(breakawayRatio, "breakaway_ratio", "",
          "Stribeck: friction at standstill over Coulomb friction, Fs / Fc; 1 switches it off.")
            .atLeast(1);
        v(stribeckVelocity, "stribeck_velocity_radps", "rad/s", "vs: velocity over which that excess fades.").above(0);
        v(loadFriction, "load_friction", "",
          "mu: dry friction grows by this share of the torque that the gear carries.")
            .atLeast(0)
            .below(1);
        v(payload_kg, "payload_kg", "kg", "Point mass at the tool that the nominal model does not know.")
            .atLeast(0)
            .upTo(1000);
        v(payloadOffset, "payload_offset_m", "m", "Where it is, in the tool frame.");
        v(massFactor, "mass_factor", "", "Real over nominal mass and inertia of the body behind each joint.").above(0);
        v(baseTilt, "base_tilt_rad", "rad",
          "The base really stands turned about its x and then its y axis: gravity comes from elsewhere.")
            .atLeast(-1.6)
            .upTo(1.6);
        v(torqueLimitFactor, "torque_limit_factor", "", "Motor torque available, as a share of the robot's figure.")
            .above(0)
            .orInfinite();
        v(torqueRipple, "torque_ripple_Nm", "Nm", "Amplitude of the torque ripple, at the joint.").atLeast(0);
        v(torqueRipplePerTurn, "torque_ripple_per_turn", "",
          "Its periods per joint turn; 0: two per motor turn, as strain wave gears have.")
            .atLeast(0);
        v(delayTicks, "delay_ticks", "Ticks from a torque command to the motor.").atLeast(0).upTo(kMaxDelay);
        v(push, "push_Nm", "Nm", "Torque of the surroundings on each joint, seen by the torque sensors.")
            .atLeast(-1e6)
            .upTo(1e6);
        v(pushFrom_s, "push_from_s", "s", "From when.").atLeast(0);
        v(pushUntil_s, "push_until_s", "s", "To when.").atLeast(0).orInfinite();
        v(blockedJoint, "blocked_joint", "A joint that blocks as by a brake, counted from 0; -1: none.")
            .atLeast(-1)
            .upTo(kMaxJoints - 1);
        v(blockedFrom_s, "blocked_from_s", "s", "From when.").atLeast(0);
        v(blockedUntil_s, "blocked_until_s", "s", "To when.").atLeast(0).orInfinite();
        sensors.describe(v);
    }
};

/** The parts of a simulated arm around its rigid bodies, the same for every engine: motors, friction figures, pushes, a
joint that blocks, sensors. It also describes the arm that is really there: masses, payload, base.

A plant describes ArmHardwareOptions among its own. It calls configure() and reset() once. In each tick it calls
calcApplied(), in each sub-step calcMotorTorque() and friction(). A tick that succeeded ends with endTick().

Motors: the command of `delay_ticks` ticks ago (before the first arrives: the first), cut at the limit. Then ripple is
added, A sin(p q), p periods per joint turn (prismatic: per metre).
Real time: no allocation, lock or throw after configure(). */
class ArmHardware {
public:
    static constexpr int kMaxDelay = ArmHardwareOptions::kMaxDelay;

    /** Throws Error (BadInput) for joints that the robot has not and windows that end before they begin.
    @param parameters  where `options` were written */
    void configure(const RunSetup& setup, const ArmHardwareOptions& options, const Parameters& parameters);

    /** The arm with its real masses and payload, gravity as its tilted base sees it. */
    const RobotDescription& robot() const { return robot_; }
    int substeps() const { return substeps_; }
    double substep_s() const { return substep_s_; }

    void reset(const JointState& start);

    /** Torque of the motors in the coming tick, as their drives know it: without ripple [Nm]. */
    void calcApplied(const JointVector& command, JointVector& applied) const;
    /** The same at the gears' output with the joints at `q`: with ripple [Nm]. */
    JointVector calcMotorTorque(const JointVector& applied, const JointVector& q) const;

    bool hasFriction() const { return hasFriction_; }
    const FrictionLaw& friction(int joint) const { return friction_[static_cast<std::size_t>(joint)]; }

    /** External torque on the joints in the coming tick [Nm]; exact. */
    const JointVector& externalTorque() const { return external_; }
    /** The joint that does not turn in the coming tick, or -1. */
    int blockedJoint() const { return blockedTicks_.contains(tick_) ? blockedJoint_ : -1; }

    /** The tick is over. @param encoders  the true state on the side of the encoders */
    void endTick(const JointVector& command, const JointState& encoders);
    const JointState& measured() const { return sensors_.measured(); }
    Encoder encoder() const { return sensors_.encoder(); }
    int delayTicks() const { return delay_; }

private:
    void updatePush() { external_ = pushTicks_.contains(tick_) ? push_ : JointVector::Zero(n_); }

    int n_ = 0;
    int substeps_ = 1;
    double substep_s_ = 0.0;
    RobotDescription robot_;
    JointVector torqueLimit_;
    JointVector ripple_, ripplePerRad_;
    std::array<FrictionLaw, kMaxJoints> friction_;
    bool hasFriction_ = false;
    JointVector push_, external_;
    TickWindow pushTicks_, blockedTicks_;
    int blockedJoint_ = -1;
    JointSensors sensors_;

    std::int64_t tick_ = 0;
    int delay_ = 0;
    std::array<JointVector, kMaxDelay> sent_;  // the last delay_ commands, a ring; the oldest at oldest_
    int oldest_ = 0;
};

struct MotorRateOptions {
    PerJoint rate = kInfinity;

    template <class V>
    void describe(V& v) {
        v(rate, "motor_rate_Nmps", "Nm/s",
          "Fastest change of a motor's torque, from what holds the nominal arm at the start.")
            .above(0)
            .orInfinite();
    }
};

/** How fast the motors of a simulated arm can change their torque: as robots do that cut faster changes off
(TorqueConvention::torqueRate). A plant has MotorRateOptions beside ArmHardwareOptions, and per tick
cuts what ArmHardware::calcApplied() gave, then endTick() where the tick succeeded. It tells the host (PlantTraits::motorRate):
the robust loop learns it, and the summary counts the ticks in which it acted.
Real time: no allocation, lock or throw after configure(). */
class MotorRate {
public:
    /** @param torqueLimitFactor  as ArmHardwareOptions has it */
    void configure(const RunSetup& setup, const MotorRateOptions& options, double torqueLimitFactor);
    /** [Nm/s] */
    const JointVector& rate() const { return rate_; }
    /** The motors hold the nominal arm at rest at q, as far as their limits let them. */
    void reset(const JointVector& q);

    /** @param torque  within the motors' limits [Nm]; then what they reach in the coming tick, within them, too */
    void limit(JointVector& torque) const;
    void endTick(const JointVector& torque) { last_ = torque; }

private:
    std::shared_ptr<const ArmRecursion> arm_;  // null: any change
    JointVector rate_;                         // [Nm/s]
    JointVector largestStep_, last_;           // [Nm]
    JointVector torqueLimit_;                  // as ArmHardware has it [Nm]
};

/** The largest eigenvalue of M(q)^-1 diag(weight) over a fixed sample of poses within the position limits. With
dampings as weights it is the fastest rate [1/s], with stiffnesses the square of the fastest frequency [1/s^2]. Takes
some ms. */
double findFastestMode(const RobotDescription& robot, const JointVector& weight);

}  // namespace viable
