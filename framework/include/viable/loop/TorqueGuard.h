#pragma once

#include "viable/filter/CertifiedBrakingFilter.h"
#include "viable/log/TickRecord.h"
#include "viable/loop/GuardStatus.h"
#include "viable/robot/TorqueSender.h"
#include "viable/tracking/Nric.h"

namespace viable {

/** The limits that a TorqueGuard keeps, and its options. */
struct TorqueGuardOptions {
    /** Limits of the nominal arm; none: the robot's own. Position limits beyond 4 pi need robot.allowLargeAngles. */
    std::optional<JointLimits> limits;
    CertifiedBrakingOptions filter;
    /** The loop Nric makes the real arm follow the nominal one; false: the motors get the filter's
    torque alone. */
    bool hasRobustLoop = true;
    /** Gains of the robust loop; none: those of scaleGains(), which every pose within the limits can carry. */
    std::optional<NricOptions> robustGains;
    /** The robust loop adds at most twice the friction of RobotDescription::actuation and, with that at rest, a quarter
    of the torque limit. A load that lasts longer than a tenth of a second, such as a payload, counts beside that, up to as
    much again. So a joint that is held is not pushed with all that its motor has. A joint that does not answer to that
    stops the arm (TooFar). False: the loop may use all of the motor. */
    bool limitsAuthority = true;
    /** Farthest that a joint may be from its nominal one before the arm is stopped [rad, prismatic: m]; > 0,
    infinite: no limit. The robust loop pulls a joint beyond it back as if it were this far, and damps its speed as
    always. From there on the integral of the robust loop stands still, until start(): an arm that is blocked is not
    pushed harder and harder. */
    PerJoint largestDeviation = 0.1;
    /** Fastest plausible motion of a reading [rad/s, prismatic: m/s]; > 0. A joint's reading is not plausible if its
    speed is higher. It is not plausible either if it moved farther from its nominal place than this speed explains
    since the last reading. Two encoder counts are allowed on top. None: twice the velocity limit, or twice the speed
    at the start where that is higher. */
    std::optional<PerJoint> largestSpeed;
    /** Torques that the robot adds by itself, and the fastest change of torque that it accepts. The rate counts from
    the torque that holds the arm at the start. The robust loop knows the rate, so its integral does not wind up
    against it. With a rate below M x jerk, which the motion needs, the real arm falls behind: lower the jerk limits
    then. Let c be the inertiaRate of robustGains() [1/s]. The loop remains stable for sudden torques of about 2
    torqueRate / c [Nm]. Larger ones (a payload unknown at the start) can make it unstable: state the payload, or
    give lower gains. */
    TorqueConvention convention;

    /** The settings: the keywords of viable.Guard in Python. */
    template <class V>
    void describe(V& v) {
        filter.describe(v);
        v(hasRobustLoop, "robust_loop", "False: no robust loop, the motors get the filter's torque alone.");
        v(limitsAuthority, "limits_authority",
          "False: the robust loop may use all of the motor, not a quarter of it and twice the friction.");
        v(largestDeviation, "largest_deviation_rad", "rad",
          "Farthest that a joint may be from its nominal one before the arm is stopped.")
            .above(0)
            .orInfinite();
        v(largestSpeed, "largest_speed_radps", "rad/s",
          "Fastest plausible motion of a reading; none: twice the velocity limit, or twice the speed at the start.")
            .above(0)
            .orInfinite();
    }
};

/** Faults of a tick's reading. */
enum class ReadingFault : unsigned char {
    None,
    Malformed,  ///< wrong size or not finite, the external torque included
    Jumped,     ///< see TorqueGuardOptions::largestSpeed
};

/** The answer to one tick; vectors have one entry per joint. */
struct GuardedTorque {
    /** To be sent to the robot until the next tick [Nm, prismatic: N]; always finite. With the torques that the
    robot adds (TorqueGuardOptions::convention) the motors' torque is within robot.actuation.torqueLimit. */
    JointVector torque;
    GuardStatus status = GuardStatus::NotStarted;
    /** Which limit holds each joint back. */
    std::array<JointIntervention, kMaxJoints> acting{};
    /** If it is not None, the nominal arm plus the last good deviation replaced the reading. */
    ReadingFault readingFault = ReadingFault::None;
    /** The law's torque was unusable: the last good one was taken, before that gravity compensation. */
    bool lawFailed = false;
    /** A motor is at its torque limit: the real arm may fall behind. */
    bool motorsSaturated = false;
    /** The torque changes as fast as the robot accepts: likewise. */
    bool rateLimited = false;
};

/** Joint limits up to jerk inside your own control loop: your torque law in, motor torque out.

    TorqueGuard guard(loadRobot("robots/indy7"), 0.001);
    guard.start(readings());
    in every tick:
        motors(guard.step(readings(), [&](const MotionState& nominal, const Dynamics& arm, JointVector& tau_d) {
            tau_d = arm.M * (100.0 * (target - nominal.q) - 20.0 * nominal.qd) + arm.b;
        }).torque);

Method: the very loop of experiments (ControlLoop) with the filter CertifiedBrakingFilter, the robust loop Nric, and the
monitor of stops. The law moves a nominal arm, which has no friction and a known inertia, and whose limits are kept. The
robust loop keeps the real arm next to it. The guard calls the law in step(), so the law always sees the state that its
torque is for. No tick can be left half done, and step() catches exceptions of the law. Without a reading (bad, or a
missed tick) the robust loop's integral stands still and its last torque is held, which carries a payload on. The share
for friction, by the robot's description, fades as the nominal joint slows down; held, it would keep the real one
moving. The torque never grows, but nothing ties the real arm to the nominal one meanwhile. A robot with
RobotDescription::speedLimits is refused at the start: nothing here keeps them.
Guarantees: position, velocity, acceleration and jerk limits of the nominal arm, at every tick and between. They hold
for any law, readings and missed ticks (with `filter.recovery`: from the moment they are met). As long as there are
readings, the real arm is within `largestDeviation` of it, or the arm is stopped. Torques that are not finite or beyond
the motors' limits never come out. No stop takes a torque away in one tick. If the robust loop fails, its share goes to
zero evenly in 25 ms. With the status Failed the whole torque does. Both are slower where `convention` or the motorRate
of robustGains state a rate. A tick is `tick_s` long; measured time enters by missTicks() alone.
Real time: step() and missTicks() allocate, lock, log and throw nothing (but a law that throws costs time). A step takes
about 10 us for six joints on a PC. Constructor and start() are not for the loop.
Thread: one at a time; requestStop() from any, and from signal handlers. */
class TorqueGuard {
public:
    /** Throws Error (BadInput) with place, cause and remedy for a robot that is not complete (as built in code). It
    throws also for limits, gains or options of the wrong size or out of range at this tick.
    @param robot   from loadRobot(), or built in code
    @param tick_s  the period of your loop [s], 0.00001 to 0.1 */
    TorqueGuard(RobotDescription robot, double tick_s, TorqueGuardOptions options = {});
    ~TorqueGuard();
    TorqueGuard(TorqueGuard&&) noexcept;
    TorqueGuard& operator=(TorqueGuard&&) noexcept;

    /** From here on: the nominal arm is where the real one is. Before the first step(), and again after a stop.
    Throws Error (BadInput) for a malformed reading, and for robust gains that the sampled loop cannot carry in this
    pose. It throws also for a start from which no stop within the limits exists (unless `filter.recovery`). */
    void start(const JointState& measured);

    /** One tick.
    @param measured  joint positions [rad, prismatic: m] and velocities [rad/s, m/s], read just now, one entry per joint
                     (from a driver's array: `measured.q = Eigen::Map<const Eigen::VectorXd>(array, n)`)
    @param law       called at most once, as law(const MotionState& nominal, const Dynamics& dynamics, JointVector&
                     torque). It writes tau_d [Nm], one finite entry per joint, from the state of the nominal arm and
                     its dynamics there (see Dynamics). `torque` comes as NaN: what is forgotten counts as no torque.
    @return          valid until the next call */
    template <class Law>
    const GuardedTorque& step(const JointState& measured, Law&& law) noexcept {
        return callStep(measured, nullptr, law);
    }
    /** The same for an arm that measures external torques. They move the nominal arm, too. So the arm yields to a push
    within all limits, and the robust loop does not work against it.
    @param external  on each joint, read just now [Nm, prismatic: N]; not finite, beyond 1e9 or of the wrong size:
    the whole reading is unusable. Without a reading the last one stands. */
    template <class Law>
    const GuardedTorque& step(const JointState& measured, const JointVector& external, Law&& law) noexcept {
        return callStep(measured, &external, law);
    }

    /** `ticks` ticks passed without a step(), while the motors held the last torque. The nominal arm has followed
    its stop meanwhile, and the integral of the robust loop has stood still. Call it before the step() that comes
    late; 0 or less: nothing. After more than 1000 in a row (steps that wait for a reading counted) the arm is
    stopped for good. About 7 us for each tick, until the arm is stopped. */
    void missTicks(std::int64_t ticks) noexcept;

    /** Brakes the arm for good, from the next step() on. A request before start() stops the arm after it. */
    void requestStop() noexcept;

    GuardStop stopReason() const;
    /** The cause of a stop, in a sentence; empty without a stop. Valid until start(). */
    const char* stopMessage() const;

    int size() const;                   ///< joints
    const JointLimits& limits() const;  ///< in force
    /** In force; none without a robust loop. */
    const std::optional<NricOptions>& robustGains() const;
    const MotionState& nominal() const;  ///< the nominal arm's state at the next tick
    /** The full account of the last step(), for viable::Summary (no command). */
    const TickRecord& record() const;

private:
    /** A law without its type. */
    struct LawCall {
        const void* law;
        void (*call)(const void*, const MotionState&, const Dynamics&, JointVector&);
        template <class Call>
        static void run(const void* law, const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
            (*static_cast<const Call*>(law))(nominal, dynamics, torque);
        }
    };
    class LawController;
    class Arm;
    class HeldRobustLoop;
    struct Inside;

    template <class Law>
    const GuardedTorque& callStep(const JointState& measured, const JointVector* external, Law& law) noexcept {
        static_assert(
            std::is_invocable_v<Law&, const MotionState&, const Dynamics&, JointVector&>,
            "a law is called as law(const MotionState& nominal, const Dynamics& dynamics, JointVector& torque)");
        const auto call = [&law](const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
            law(nominal, dynamics, torque);
        };
        return runStep(measured, external, LawCall{&call, &LawCall::run<decltype(call)>});
    }
    const GuardedTorque& runStep(const JointState& measured, const JointVector* external, const LawCall& law) noexcept;

    std::unique_ptr<Inside> inside_;
};

}  // namespace viable
