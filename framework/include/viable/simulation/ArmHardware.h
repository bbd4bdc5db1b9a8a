#pragma once

#include <array>
#include <cstdint>
#include <random>

#include "viable/core/JointTypes.h"
#include "viable/plugin/Parameters.h"
#include "viable/plugin/Plugin.h"
#include "viable/plugin/RealPlant.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** The ticks whose beginning lies in [from_s, until_s). */
class TickWindow {
public:
    /** Throws Error (BadInput) at the parameter `until` unless it is after `from`. */
    static TickWindow read(const Parameters& parameters, const char* from, const char* until, double tick_s);
    bool contains(std::int64_t tick) const { return tick >= first && tick < end; }

    std::int64_t first = 0;
    std::int64_t end = 0;
};

/** The position sensors of a simulated arm: whole counts, noise, and one faulty channel.

Method: reading = position + noise, rounded to whole counts; the velocity is the difference of two readings
over a tick, or with `encoder: exact` and without noise the true one. The noise is normal, cut at 4 standard
deviations, so that it has a bound. The fault then acts on the readings, and so on their difference:
    stuck  the channel stays at its last reading           sign  its reading is negated
    bias   sensor_fault_rad is added                       swap  it and the next joint's are exchanged
    spike  the same, in the first reading of the window    wrap  one turn is added
    nan    no number
(the true velocity, where that is reported, is 0 while stuck, negated, exchanged or no number.)
Real time: no allocation, lock or throw after configure(). */
class JointSensors {
public:
    /** Throws Error (BadInput) for a fault on a joint that the robot has not. */
    void configure(const RobotDescription& robot, double tick_s, const Parameters& parameters);

    /** The reading at t = 0, with the velocity as it is. */
    void reset(const JointState& truth);

    /** The reading at the end of a tick. */
    void read(const JointState& truth);

    const JointState& measured() const { return measured_; }
    /** As the parameter `encoder` says. */
    Encoder encoder() const { return encoder_; }

private:
    enum class Fault { None, Stuck, Bias, Sign, Spike, Swap, Wrap, Nan };

    double drawNormal();
    void takeReadings(const JointState& truth);
    void disturb(JointState& reading);

    int n_ = 0;
    double tick_s_ = 0.0;
    JointVector resolution_;  // [rad]; 0: exact
    Encoder encoder_ = Encoder::Counts;
    bool isVelocityExact_ = true;
    double noise_ = 0.0;
    std::uint64_t seed_ = 0;
    std::mt19937_64 random_;
    Fault fault_ = Fault::None;
    int faultJoint_ = 0;
    double faultSize_ = 0.0;
    TickWindow faultTicks_;

    std::int64_t tick_ = 0;
    JointState measured_;
};

/** Friction of one joint over the torque that its gear carries,
    f(v) = F(v) sign v + Fv1 (1 - exp(-|v| / Fv2)) sign v,
    F(v) = Fc + (Fs - Fc) exp(-(v / vs)^2) + mu |load|                                       [Nm]
where sign 0 is any value in [-1, 1]: what it takes to stay at rest. */
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

/** What a simulated arm has around its rigid bodies, the same for every engine: motors, friction figures, pushes, a
joint that blocks, sensors; and the description of the arm that is really there (masses, payload, base). A plant splices
kArmHardwareParameters into its own table (joinParameters) and asks, in this order: once configure() and reset(); per
tick
calcApplied(), per sub-step calcMotorTorque() and friction(), then endTick() where the tick succeeded.

Motors: the command of `delay_ticks` ticks ago (before the first arrives: the first), cut at the limit; then ripple,
A sin(p q), p periods per joint turn (prismatic: per metre).
Real time: no allocation, lock or throw after configure(). */
class ArmHardware {
public:
    static constexpr int kMaxDelay = 20;  ///< ticks

    /** Throws Error (BadInput) for joints that the robot has not and windows that end before they begin. */
    void configure(const RunSetup& setup, const Parameters& parameters);

    /** The arm with its real masses and payload, gravity as its tilted base sees it. */
    const RobotDescription& robot() const { return robot_; }
    int substeps() const { return substeps_; }
    double substep_s() const { return substep_s_; }

    void reset(const JointState& start);

    /** What the motors give in the coming tick, as their drives know it: without ripple [Nm]. */
    void calcApplied(const JointVector& command, JointVector& applied) const;
    /** The same at the gears' output with the joints at `q`: with ripple [Nm]. */
    JointVector calcMotorTorque(const JointVector& applied, const JointVector& q) const;

    bool hasFriction() const { return hasFriction_; }
    const FrictionLaw& friction(int joint) const { return friction_[static_cast<std::size_t>(joint)]; }

    /** What the surroundings put on the joints in the coming tick [Nm]; exact. */
    const JointVector& externalTorque() const { return external_; }
    /** The joint that does not turn in the coming tick, or -1. */
    int blockedJoint() const { return blockedTicks_.contains(tick_) ? blockedJoint_ : -1; }

    /** The tick is over. @param encoders  the true state on the side of the encoders */
    void endTick(const JointVector& command, const JointState& encoders);
    const JointState& measured() const { return sensors_.measured(); }
    Encoder encoder() const { return sensors_.encoder(); }
    int delayTicks() const { return delay_; }

private:
    void takePush() { external_ = pushTicks_.contains(tick_) ? push_ : JointVector::Zero(n_); }

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

/** The largest eigenvalue of M(q)^-1 diag(weight) over a fixed sample of poses within the position limits: with
dampings
as weights the fastest rate [1/s], with stiffnesses the square of the fastest frequency [1/s^2]. Takes some ms. */
double findFastestMode(const RobotDescription& robot, const JointVector& weight);

inline constexpr ParameterSpec kArmHardwareParameters[] = {
    parameter::integer("substeps", "1", "Integration steps per tick.").atLeast(1).upTo(1000),
    parameter::choice("friction", "robot|none", "robot",
                      "Friction figures of the robot's actuation.yaml, or none at all."),
    parameter::jointNumbers("friction_scale", "", "1.0", "Factor on all friction torques, Fc and Fv1.").atLeast(0),
    parameter::number("breakaway_ratio", "", "1.0",
                      "Stribeck: friction at standstill over Coulomb friction, Fs / Fc; 1 switches it "
                      "off.")
        .atLeast(1),
    parameter::number("stribeck_velocity_radps", "rad/s", "0.02", "vs: velocity over which that excess fades.")
        .above(0),
    parameter::jointNumbers("load_friction", "", "0.0",
                            "mu: dry friction grows by this share of the torque that the gear carries.")
        .atLeast(0)
        .below(1),
    parameter::number("payload_kg", "kg", "0.0", "Point mass at the tool that the nominal model does not know.")
        .atLeast(0)
        .upTo(1000),
    parameter::numbers("payload_offset_m", "m", 3, 3, "[0, 0, 0]", "Where it is, in the tool frame."),
    parameter::jointNumbers("mass_factor", "", "1.0",
                            "Real over nominal mass and inertia of the body behind each joint.")
        .above(0),
    parameter::numbers("base_tilt_rad", "rad", 2, 2, "[0, 0]",
                       "The base really stands turned about its x and then its y axis: gravity "
                       "comes from elsewhere.")
        .atLeast(-1.6)
        .upTo(1.6),
    parameter::number("torque_limit_factor", "", "1.0", "Motor torque available, as a share of the robot's figure.")
        .above(0)
        .orInfinite(),
    parameter::jointNumbers("torque_ripple_Nm", "Nm", "0.0", "Amplitude of the torque ripple, at the joint.")
        .atLeast(0),
    parameter::jointNumbers("torque_ripple_per_turn", "", "0",
                            "Its periods per joint turn; 0: two per motor turn, as strain wave gears have.")
        .atLeast(0),
    parameter::integer("delay_ticks", "0", "Ticks from a torque command to the motor.")
        .atLeast(0)
        .upTo(ArmHardware::kMaxDelay),
    parameter::jointNumbers("push_Nm", "Nm", "0.0",
                            "Torque of the surroundings on each joint, seen by the torque sensors.")
        .atLeast(-1e6)
        .upTo(1e6),
    parameter::number("push_from_s", "s", "0.0", "From when.").atLeast(0),
    parameter::number("push_until_s", "s", ".inf", "To when.").atLeast(0).orInfinite(),
    parameter::integer("blocked_joint", "-1", "A joint that blocks as by a brake, counted from 0; -1: none.")
        .atLeast(-1)
        .upTo(kMaxJoints - 1),
    parameter::number("blocked_from_s", "s", "0.0", "From when.").atLeast(0),
    parameter::number("blocked_until_s", "s", ".inf", "To when.").atLeast(0).orInfinite(),
    parameter::choice("encoder", "robot|exact", "robot",
                      "robot: positions in whole counts, velocity by their difference over a tick; "
                      "exact: the truth."),
    parameter::number("encoder_noise_rad", "rad", "0.0",
                      "Standard deviation of the position reading; cut at 4 of them.")
        .atLeast(0),
    parameter::integer("seed", "1", "Of the reading noise: same seed, same readings.").atLeast(0),
    parameter::choice("sensor_fault", "none|stuck|bias|sign|spike|swap|wrap|nan", "none",
                      "What goes wrong with one position reading: it stays, is offset, negated, "
                      "offset once, exchanged "
                      "with the next joint's, a turn too large, or NaN."),
    parameter::integer("sensor_fault_joint", "0", "At which joint, counted from 0.").atLeast(0).upTo(kMaxJoints - 1),
    parameter::number("sensor_fault_from_s", "s", "0.0", "From when.").atLeast(0),
    parameter::number("sensor_fault_until_s", "s", ".inf", "To when.").atLeast(0).orInfinite(),
    parameter::number("sensor_fault_rad", "rad", "0.0", "Size of a bias or spike."),
};

}  // namespace viable
