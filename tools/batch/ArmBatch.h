#pragma once

#include "viable/environment/Environment.h"
#include "viable/filter/CertifiedBrakingFilter.h"
#include "viable/loop/GuardStatus.h"

namespace viable {

/** What an action of an ArmBatch is; one number per joint, but for tools. */
enum class BatchAction : unsigned char {
    Torque,        ///< tau_d of the nominal arm [Nm]
    Acceleration,  ///< what that torque is to cause, M a + b [rad/s^2]
    Target,        ///< a joint target that rests, led to as fast as the limits allow (Servo) [rad]
    /** The tool's pose, led to as the plugin tool_servo does with its defaults (ToolFollower): position [m] and quaternion
    x, y, z, w of a length from 0.5 to 2, base frame; 7 numbers. */
    ToolPose,
    ToolPosition,  ///< the same of a tool whose orientation is free: 3 numbers [m]
};

struct ArmBatchOptions {
    /** Of all arms at first; none: the robot's own. Position limits beyond 4 pi need robot.allowLargeAngles. */
    std::optional<JointLimits> limits;
    /** With Target only `recovery` and `kAlpha` count: the servo asks for jerks that are admissible. */
    CertifiedBrakingOptions filter;
    BatchAction action = BatchAction::Torque;
    /** With it, an empty one too, WholeArmBrakingFilter keeps each arm clear of these surroundings and of itself, and within the
    speed limits of its points. All arms share the surroundings; each has them as they are at its own time since reset().
    Needs the robot's collision.yaml (loadArmGeometry). */
    std::optional<Environment> environment;
    /** A real arm behind each nominal one: the `real_plant` block of an experiment file, values of it drawn anew for each arm
    where they are `~uniform(...)` and the like (see experiments/README.md), of run number arm. Such as
    `{plugin: simbody, dynamics: recursion, payload_kg: "~uniform(0, 2)"}`; empty: none.
    Nric with the gains of scaleGains() keeps it next to the nominal arm. What it adds has an end, as in a run (MATH 11). Nobody
    stops an arm that is held. */
    std::string plant;
    std::uint64_t seed = 1;                         ///< of the draws
    std::vector<std::filesystem::path> pluginPath;  ///< where the plant is searched (PluginLoader)
    int threads = 0;                                ///< at most so many; 0: one per core

    /** The settings: keywords of viable.Batch in Python. */
    template <class V>
    void describe(V& v) {
        v(action, "action", "torque|acceleration|target|tool_pose|tool_position",
          "What an action is: torque [Nm]; acceleration, M a + b is the torque [rad/s^2]; target, a joint target that "
          "rests, led to as fast as the limits allow [rad]; tool_pose, (n, 7): the tool's position [m] and quaternion "
          "x, y, z, w in the base frame, led to as tool_servo does; tool_position, (n, 3): its orientation is free.");
        filter.describe(v);
        v(seed, "seed", "Seed of the plants' draws.");
        v(threads, "threads", "At most so many threads; 0: one per core.").atLeast(0);
    }
};

/** Where the arms are; each array one row per arm, a row one number per joint. */
struct ArmBatchState {
    // The nominal arms, whose limits are guaranteed.
    std::vector<double> q;       ///< [rad, prismatic: m]
    std::vector<double> qd;      ///< [rad/s]
    std::vector<double> qdd;     ///< [rad/s^2]
    std::vector<double> jerk;    ///< held in the last tick [rad/s^3]
    std::vector<double> torque;  ///< tau_c, what moved the nominal arm in the last tick [Nm]
    /** Least distance of the path of the stop held ready to a position limit [rad], infinite where there is none; negative
    while recovering. To 1e-6 of the limit. */
    std::vector<double> margin;
    /** Which limit held a joint back, in the last tick of the step in which one did: LimitKind, negative for the lower
    side; 0: none did. */
    std::vector<signed char> acting;
    /** Per arm: the stop held ready after the last tick brings the arm no nearer than this to the surroundings and to itself
    [m], at any time of it; negative inside, infinite where nothing can be met. As far as it matters: what is known to be far
    is not measured. NaN where nobody looked: without an environment, and from reset() to the first tick. */
    std::vector<double> clearance;
    // The real arms, as measured; of size 0 without a plant.
    std::vector<double> realQ;        ///< [rad]
    std::vector<double> realQd;       ///< [rad/s]
    std::vector<double> motorTorque;  ///< given in the last tick [Nm]
    /** One per arm, the gravest of the step's ticks: NotStarted, Passed, Limited, Recovering, Waiting (the action was of no
    use, and the arm braked), Failed (its plant failed, and it stands until reset()). */
    std::vector<GuardStatus> status;
};

/** Many arms of one robot, each with its limits up to jerk, for learning: actions in, guarded motion out.

    ArmBatch batch(loadRobot("robots/indy7"), 4096, 0.001);
    batch.step(actions, 10);  // 10 ticks with the same actions, 4096 x 6 numbers
    batch.state().q           // 4096 x 6

Method: in each tick and arm the nominal arm's dynamics, CertifiedBrakingFilter's law and the closed form of the motion, as
in the loop of experiments (ControlLoop), whose numbers these are to the last bit. There is no monitor of stops behind it.
Guarantees: position, velocity, acceleration and jerk limits of every nominal arm, at every tick and between, whatever the
actions are (with `filter.recovery`: from the moment they are met). With an environment also that of
WholeArmBrakingFilter. Results do not depend on the number of threads, nor
on the floating-point modes of the caller, nor on the other arms.
Memory: some 20 kB an arm, with Target 35 kB, with tools 50 kB, with a plant 70 kB, with an environment 0.6 MB more. Time for six joints: 1 to 2 us an arm, tick and core, with
Target 3 us, with tools 5 us, with a plant 7 us, with an environment 10 to 50 us.
Thread: one at a time; step() makes threads of its own and ends them. */
class ArmBatch {
public:
    /** All arms at rest at robot.home. Throws Error (BadInput) for what TorqueGuard refuses, for a home pose from which no stop
    within the limits exists (with an environment: that also keeps clear; choose another robot.home), and for a plant that cannot be made.
    @param arms    1 to 1,000,000
    @param tick_s  [s], 0.00001 to 0.1 */
    ArmBatch(RobotDescription robot, int arms, double tick_s, ArmBatchOptions options = {});
    ~ArmBatch();
    ArmBatch(ArmBatch&&) noexcept;
    ArmBatch& operator=(ArmBatch&&) noexcept;

    int size() const;        ///< arms
    int joints() const;      ///< of each
    int actionSize() const;  ///< numbers of an action: joints(), 7 for ToolPose, 3 for ToolPosition
    double tick_s() const;
    const JointLimits& limits(int arm) const;
    const ArmBatchState& state() const;
    /** What was drawn for the plants: the value of each arm, as text, by key. */
    const std::map<std::string, std::vector<std::string>>& draws() const;

    /** Puts arms to new states, nominal and real ones; the others go on. Throws Error (BadInput), with the arm's number, for a
    state that is malformed and, without recovery, for one from which no stop within the limits exists, or with an environment none that keeps clear; no arm has moved then.
    Where a plant throws or gives no reading, its arm is Failed, all others are put, and that is thrown on.
    @param arms    their numbers, each once
    @param starts  one per entry of `arms` */
    void reset(const std::vector<int>& arms, const std::vector<MotionState>& starts);

    /** The places in `starts` of those that reset() would refuse without recovery; `arms` and `starts` as there. In threads. */
    std::vector<int> findUnusable(const std::vector<int>& arms, const std::vector<MotionState>& starts) const;

    /** New limits of an arm from now on, approached as fast as jerk allows where its motion cannot meet them at once. Throws
    Error (BadInput) where they are not usable (see checkLimits). */
    void changeLimits(int arm, const JointLimits& limits) { changeLimits(std::vector<int>{arm}, {limits}); }
    /** The same of several arms, one entry each; all or none. */
    void changeLimits(const std::vector<int>& arms, const std::vector<JointLimits>& limits);

    /** `ticks` ticks of every arm with the same actions. An arm whose action holds what is not finite or beyond 1e100 (targets:
    1e7), or a quaternion that is none, brakes along its stop meanwhile.
    @param actions  size() x actionSize() numbers, a row per arm */
    void step(const double* actions, int ticks);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
