#pragma once

#include "viable/environment/Environment.h"
#include "viable/log/TickRecord.h"
#include "viable/loop/GuardStatus.h"

namespace viable {

/** The limits that a ReferenceGuard keeps, and its options. */
struct ReferenceGuardOptions {
    /** None: the robot's own; jerk limits finite. Position limits beyond 4 pi need robot.allowLargeAngles. */
    std::optional<JointLimits> limits;
    /** How targets become one for every tick. */
    BetweenSamples between = BetweenSamples::Extrapolate;
    /** In (0, 1]: of acceleration and jerk limits that the motion relative to the target may take (see Servo). */
    double share = 1.0;
    /** Time constant in which the target's velocity is smoothed before it is followed [s]. Infinite: a target counts
    as resting. 0: from the limits, as far as each joint could follow (see TargetVelocity). */
    double velocityFilter_s = 0.0;
    /** Accept a start outside the limits, or one that must leave them, and return within the limits. */
    bool recovery = false;
    /** Obstacles; with them, even without any, the arm is also kept clear of itself, and the robot needs a
    collision.yaml. New ones during the run: changeEnvironment(). */
    std::optional<Environment> environment;
    /** Older surroundings are not used: the arm follows its stop until newer ones come [s]. */
    double maxAge_s = std::numeric_limits<double>::infinity();

    /** The settings of a guard without obstacles: the keywords of viable.ReferenceGuard in Python. */
    template <class V>
    void describe(V& v) {
        v(between, "between", "hold|interpolate|extrapolate",
          "The target between two of them: the last one, straight to it within a period, or on as the last two went.");
        v(share, "share", "",
          "Share of the acceleration and jerk limits that the motion relative to the target may take.")
            .above(0)
            .upTo(1);
        v(velocityFilter_s, "velocity_filter_s", "s",
          "Time constant of the target's velocity; infinite: a target counts as resting; 0: from the limits.")
            .atLeast(0)
            .orInfinite();
        v(recovery, "recovery",
          "Accept a start outside the limits, or one that must leave them, and return within the limits.");
    }
};

/** The answer to one tick. */
struct GuardedReference {
    /** Place of the arm at the end of this tick [rad, rad/s, rad/s^2]. It is finite, but NaN with NotStarted. With
    Failed it is the last good one. */
    MotionState state;
    JointVector jerk;  ///< held in this tick, from the state before [rad/s^3]
    GuardStatus status = GuardStatus::NotStarted;
    /** Which limit holds each joint back from what the target asks for. */
    std::array<JointIntervention, kMaxJoints> acting{};
    /** The target was of the wrong size, not finite or beyond 1e7: the one before stands. */
    bool targetFailed = false;
};

/** Joint limits up to jerk for robots that take positions or velocities. Targets go in, a reference comes out. A stop
within all limits can follow it at every tick.

    ReferenceGuard guard(loadRobot("robots/indy7"), 0.001);
    guard.start({q, zero, zero});
    in every tick:
        const GuardedReference& next = hasNew ? guard.step(target) : guard.step();
        robot.command(next.state.q, next.state.qd);

Method: Servo leads each joint to its target as fast as the limits allow. A certified filter and the monitor of stops
stand behind it, in the loop of experiments (ControlLoop). The filter is CertifiedBrakingFilter. With surroundings or
speed limits of the robot's points it is WholeArmBrakingFilter, with the change measured in joint jerk. The same
reference goes to a simulation, a vendor's servo call or a trajectory file. No torques: the robot's masses, motors and
friction do not count and need not be known. Targets come when they come, 10 to 200 times a second or once (see
src/plugin/CommandReceiver.h). A target beyond a position limit counts as one at the limit.
Guarantees: position, velocity, acceleration and jerk limits of the reference, at every tick and between. They hold for
any targets and missed ticks (with `recovery`: from the moment they are met). With surroundings or speed limits, also
all guarantees of WholeArmBrakingFilter but torques. The real arm keeps them as well as it follows.
Real time: step(), missTicks() and changeLimits() allocate, lock, log and throw nothing. Constructor and start() are not
for the loop.
Thread: one at a time; requestStop() from any, and from signal handlers. */
class ReferenceGuard {
public:
    /** Throws Error (BadInput) with place, cause and remedy for limits or options of the wrong size or out of range at
    this tick. It throws also for jerk limits that are not finite, and for surroundings that cannot be read.
    @param robot   from loadRobot(), or built in code: joints, tool and, with surroundings, its folder
    @param tick_s  the period of your loop [s], 0.00001 to 0.1 */
    ReferenceGuard(RobotDescription robot, double tick_s, ReferenceGuardOptions options = {});
    ~ReferenceGuard();
    ReferenceGuard(ReferenceGuard&&) noexcept;
    ReferenceGuard& operator=(ReferenceGuard&&) noexcept;

    /** From here on: the reference begins where the robot is, which is the first target, too. Before the first
    step(), and again after a stop. Throws Error (BadInput) for a malformed state. Without `recovery` it throws also
    for one from which no stop within the limits exists, or that is too near to something. The limits and
    surroundings in force stay, these with the age that they had; not at the same time as changeEnvironment(). */
    void start(const MotionState& state);

    /** One tick. @return valid until the next call */
    const GuardedReference& step() noexcept;
    /** One tick, at which a new target has come. @param target  joint positions [rad, prismatic: m] */
    const GuardedReference& step(const JointVector& target) noexcept;

    /** The reference `after_s` >= 0 after its present state when no step() follows. It is then on the backup stop,
    which ends at rest. For drivers that take some points ahead. */
    void calcStop(double after_s, MotionState& state) const noexcept;

    /** `ticks` ticks passed without a step(), while the robot followed points of calcStop() that were sent ahead. A
    robot that holds its last set-point did not: continue with step(), late, or with start() where it has come to
    rest. After missTicks() it would jump. After more than 1000 ticks in a row the arm is stopped for good. Then
    state and calcStop() are those at the end of the missed ticks. */
    void missTicks(std::int64_t ticks) noexcept;

    /** New limits from the next step() on. A motion that cannot meet them at once returns within them as fast as its
    stop does. False, and nothing changes: they are not usable at this tick (see areUsable), a jerk limit is not
    finite, or the arm is being braked. At rest after a stop, and before start(), they are those of the next start().
    Large angles are not asked about here. */
    bool changeLimits(const JointLimits& limits) noexcept;

    /** Brakes the arm for good, from the next step() on. A request before start() stops the arm after it. */
    void requestStop() noexcept;

    GuardStop stopReason() const;
    /** The cause of a stop, in a sentence; empty without a stop. Valid until start(). */
    const char* stopMessage() const;

    int size() const;                   ///< joints
    const JointLimits& limits() const;  ///< in force
    /** New surroundings, for options with `environment`; not for the loop: it reads files and allocates. From one other
    thread, or between steps. Throws Error (BadInput). @param stamp_s  of the observation, since start() [s] */
    void changeEnvironment(const Environment& environment, double stamp_s);
    /** The full account of the last step(), for viable::Summary. Torques in it are of no meaning. */
    const TickRecord& record() const;

private:
    class Source;
    class TargetController;
    struct Inside;
    std::unique_ptr<Inside> inside_;
};

}  // namespace viable
