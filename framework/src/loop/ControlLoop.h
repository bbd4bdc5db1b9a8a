#pragma once

#include <array>
#include <memory>

#include "host/IsolatedPlugin.h"
#include "host/PluginCall.h"
#include "host/PluginLoader.h"
#include "loop/FollowingWatch.h"
#include "loop/SensorCheck.h"
#include "loop/StopMonitor.h"
#include "simulation/CommandStream.h"
#include "tracking/TrackingBound.h"
#include "viable/log/TickRecord.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The plugins of a loop, configured. Robust loop and real plant may be null, both or none. */
struct LoopPlugins {
    PluginPtr<CommandSource> command{nullptr, nullptr};
    std::unique_ptr<CommandStream> stream;  ///< that the command comes over to the controller; null: none
    PluginPtr<NominalController> controller{nullptr, nullptr};
    PluginPtr<SafetyFilter> filter{nullptr, nullptr};
    PluginPtr<RobustLoop> robustLoop{nullptr, nullptr};
    PluginPtr<RealPlant> realPlant{nullptr, nullptr};
    /** By PluginKind: who is called, for messages; null: nobody watches. Must outlive the loop. A chain of filters
    watches its own. */
    std::array<PluginWatch*, kPluginKinds.size()> watches{};
};

/** Destroys them one by one, each under its watch. */
void destroyPlugins(LoopPlugins& plugins) noexcept;

/** Why the arm was braked to a stop before the end of the run. */
enum class StopReason : unsigned char {
    None,
    Requested,         ///< by the user (a signal)
    CommandFailed,     ///< no usable command for more than kMaxSubstitutedTicks, or it threw
    ControllerFailed,  ///< no usable torque for more than kMaxSubstitutedTicks, or it threw
    FilterFailed,      ///< no usable decision, or it threw
    FilterEnded,       ///< it ended the run itself after a tick without an admissible choice
    RobustLoopFailed,  ///< it threw or gave no usable torque
    GuaranteeBroken,   ///< a decision without a stop within the limits, from a filter that guarantees them
    TicksMissed,       ///< more than kMaxMissedTicks in a row were missed
    TrackingLost,      ///< the real arm, as measured, left the bound around the nominal one
    NotFollowing,      ///< there is no bound, and the real arm ran away or oscillated (see FollowingWatch)
    PlantFailed,       ///< the real plant failed: the loop ends at once, there is nothing to brake
    /** A measured position jumped farther than a joint can move, or there was no usable external torque for
    more than kMaxSubstitutedTicks. */
    SensorFailed,
};

/** How many ticks in a row a missing or unusable command or torque is replaced by the last good
 * one. */
inline constexpr int kMaxSubstitutedTicks = 10;

/** How many ticks in a row may be missed before the arm is braked for good. */
inline constexpr int kMaxMissedTicks = 1000;

/** A robust loop that is given up takes its torque to zero in this time [s], evenly: without a step, and soon enough that
what it did wrong does not go on. Slower where a rate is stated: RealArmOptions::robustRate, RealArmOptions::motorRate.
One that oscillates is asked meanwhile, and a falling share of its answer is given: so it damps until the arm is at rest or
the loop is gone. Of one that failed, or drives the arm away, the last torque goes. */
inline constexpr double kRelease_s = 0.025;

/** What a loop with a real arm does besides making it follow. */
struct RealArmOptions {
    /** The arm is braked for good in the tick in which |q_measured - q_nominal| of a joint is beyond
    `measured` of it; null: never. Must outlive the loop. */
    const TrackingBound* bound = nullptr;
    /** The external torque that the plant reports moves the nominal arm, too: the filter's desired torque is
    tau_d + tau_ext, and the motors get tau_c - tau_ext + tau_a. The plant must have such sensors. */
    bool feedsExternalTorque = false;
    /** A measured position that jumps (kJumpSpeeds) brakes the arm, and from there on the robust loop gets of that
    joint the nominal one plus the last good deviation: a wrong reading must not become a torque. False: somebody
    else judges the readings. */
    bool judgesReadings = true;
    /** The limits must stay as they are, since the real arm's were made from them: a command that changes them is
    answered with a stop. */
    bool fixesLimits = false;
    /** Without a bound: an arm that runs away or oscillates is braked for good. */
    bool watchesFollowing = false;
    /** Fastest change of a motor's whole torque while the robust loop's goes to zero (kRelease_s) [Nm/s]; of size 0: any. */
    JointVector motorRate{};
    /** Likewise of the robust loop's torque (LinearErrorLoop::torqueRate). */
    JointVector robustRate{};
};

class StageTimer;

/** The tick: command, dynamics, controller, filter, monitor, nominal plant, robust loop, real plant.

Guarantees: no torque that is not finite or beyond 1e9 Nm reaches a plant; the nominal arm advances by exactly
the configured tick. A plugin that throws or returns nonsense is answered with a stop of the nominal arm, which
the real arm follows: the stop that the monitor holds ready (see StopMonitor). Where that one was found safe, all
limits hold to the end; a decision of a filter that guarantees limits is only ever applied when it was. Otherwise the
stop keeps acceleration and jerk limits and knows nothing of the others.
Real time: tick() allocates, locks, throws and logs nothing as long as the plugins keep to that too.
Thread: tick() by one thread; requestStop() by that thread. */
class ControlLoop {
public:
    /** `setup` must outlive the loop (the plugins keep it, too). */
    ControlLoop(const RunSetup& setup, LoopPlugins plugins, const RealArmOptions& options = {});
    ~ControlLoop();

    /** Back to t = 0 at setup.start; with a plant that has a clock, a robot, at rest where it measures the real arm then: a
    difference would be a step of the robust loop's torque. Throws Error (BadInput) where that is beyond a position limit, and
    the filter does not recover. */
    void reset();

    /** One tick; `record` becomes its full account (state at its beginning, torques during it). A plant with a clock is
    waited for; ticks of it that were missed come first, one per call: as missTick(), but the motors have held the last
    torque, and there is no reading. */
    void tick(TickRecord& record) noexcept;

    /** A tick whose time passed before command, controller and filter could run: the nominal arm follows the stop
    held ready; robust loop and plant go on. */
    void missTick(TickRecord& record) noexcept;

    /** Brakes the nominal arm from the next tick on. The first reason stays, unless it was Requested and a
    failure follows. */
    void requestStop(StopReason reason, const char* message) noexcept { beginStop(reason, message); }

    /** From the next tick on the nominal arm follows the stop held ready and then rests: command, controller and filter do
    not run, and the command's time stands still. Robust loop and plant go on. resume() takes up the command where it
    was; both are as smooth as that stop and the filter's decisions: without a step of the torque where the filter guarantees
    its limits. Nobody looks at obstacles that move meanwhile. Each may be called between any two ticks. */
    void pause() noexcept { isPaused_ = true; }
    void resume() noexcept { isPaused_ = false; }
    bool isPaused() const { return isPaused_; }
    /** Paused, and come to rest. */
    bool isHolding() const { return isPaused_ && holdBegun_ && monitor_.atRest(nominal_); }

    /** Destroys the plant, which lets a robot hold itself; no tick may follow. */
    void letGoOfPlant() noexcept;

    bool isStopping() const { return stopReason_ != StopReason::None; }
    /** True when a stop has come to its end, or could not be made. Further ticks hold the arm where it is: the nominal
    arm at exact rest, the robust loop at work. */
    bool hasStopped() const;
    /** True when no stop can be made: the plant is gone, or the arithmetic is; or when a robot (a plant with a
    clock) goes on though it was told to brake, and is left to its own stop. */
    bool hasFailed() const { return ended_; }

    StopReason stopReason() const { return stopReason_; }
    const char* stopMessage() const { return stopMessage_; }  ///< what the plugin said, or what was wrong
    const char* stopRemedy() const { return stopRemedy_; }    ///< a sentence; may be empty
    double stopTime() const { return stopTime_; }             ///< [s]
    double time() const;                                      ///< of the next tick [s]
    /** What the command is asked for next: time() less the pauses [s]. */
    double commandTime() const;

    bool hasClock() const { return hasClock_; }  ///< the plant makes the ticks

    const MotionState& nominal() const { return nominal_; }  ///< at time()
    /** The nominal arm `after_s` after time() on the stop held ready, one that holds jerks. */
    void calcStop(double after_s, MotionState& state) const { monitor_.calcStop(nominal_, after_s, state); }

private:
    /** @param remedy  a literal */
    void beginStop(StopReason reason, const char* message, const char* remedy = "") noexcept;
    void lookAtPlant();
    void readState();
    void readExternalTorque();
    void checkTracking();
    void checkFollowing(std::int64_t elapsedTicks);
    void watchNominal();
    void holdIntegral();
    void leaveToRobot();
    void judgeReading();
    bool replaceStillReading(int joint);
    void takeCommand(double t);
    void takeLimits(double t);
    void decide(TickRecord& record, StageTimer& timer);
    /** @param missed  ticks before this one, in which it was not asked */
    void takeTorque(std::int64_t missed);
    void tellSkippedTicks();
    void countPause();
    void startAtReal();
    bool takeDecision();
    bool passMonitor();
    void followStop();
    void fillRecord(TickRecord& record, bool decided) const;
    void finishTick(TickRecord& record, StageTimer& timer, bool drives);
    void awaitPlant();
    void passTick(TickRecord& record, bool hasPlant) noexcept;
    void takeRobustTorque();
    bool askRobustLoop();
    void endRobustLoop(bool isAsked);
    void limitRelease(const JointVector& lastRobust, const JointVector& lastMotor);
    void drivePlant();
    /** Runs `call`, the work of a plugin of that kind; an exception becomes `faulted` and its text the stop message. */
    template <class Status, class Call>
    Status contain(PluginKind kind, Status faulted, const Call& call) noexcept;
    PluginWatch* findWatch(PluginKind kind) const { return plugins_.watches[static_cast<std::size_t>(kind)]; }

    const RunSetup& setup_;
    LoopPlugins plugins_;
    const RealArmOptions options_;
    RobotModel model_;
    int n_;

    std::int64_t tickIndex_ = 0;
    MotionState nominal_;
    JointState real_, actual_;
    Dynamics dynamics_;
    MotionCommand command_, newCommand_;
    MotionCommand received_;  // what has come of command_ over the stream
    ControllerOutput output_;
    JointVector desiredTorque_, wantedTorque_, robustTorque_, motorTorque_, appliedTorque_;
    JointVector externalTorque_;  // that acts on the nominal arm; empty: none is fed to it
    FilterDecision decision_;
    HeldMotion motion_;  // of decision_
    FilterStatus status_ = FilterStatus::Passed;
    StopMonitor monitor_;
    StopVerdict verdict_ = StopVerdict::Safe;
    JointLimits limits_;

    bool guarantees_ = false;  // the filter's word
    bool hasTorque_ = false;
    int missingCommands_ = 0;
    int missingTorques_ = 0;
    int missingExternalTorques_ = 0;
    SensorCheck sensors_;
    detail::FollowingWatch following_;
    JointState plausible_;  // what the robust loop gets of real_
    std::array<bool, kMaxJoints> isPlausible_{};
    bool isTrackingLost_ = false, isIntegralHeld_ = false;
    bool hasLeftLimits_ = false;  // the nominal arm, those that the bound is for
    double leftLimits_s_ = 0.0;   // when first
    std::int64_t substituted_ = 0;
    bool hasClock_ = false;               // the plant
    bool isRead_ = false;                 // the plant's clock, for a tick that is still to come
    std::int64_t ticksToMiss_ = 0;        // of the plant's clock, already passed
    bool hasReading_ = false;             // one has been looked at since reset()
    bool hasDriven_ = false;              // the plant, since reset(): motorTorque_ is what its motors were told last
    std::int64_t ticksSinceReading_ = 1;  // between the present reading and the one before
    int missedInRow_ = 0;
    std::int64_t skippedTicks_ =
        0;                          // missed or paused ones since the filter ran last; it has not been told of them yet
    std::int64_t pausedTicks_ = 0;  // since reset()
    bool isPaused_ = false;         // from the next tick on
    bool holdBegun_ = false;        // a tick of the pause has been taken

    StopReason stopReason_ = StopReason::None;
    double stopTime_ = 0.0;
    char stopMessage_[512] = "";
    const char* stopRemedy_ = "";
    bool stopBegun_ = false;        // a tick of the stop has been taken
    bool ended_ = false;            // see hasFailed()
    bool drifts_ = false;           // away though its motors had torque to spare
    bool robustLoopEnded_ = false;  // it failed, or swings: its torque goes to zero
    bool isLoopAsked_ = true;       // meanwhile
    int releaseTicks_ = 0;          // since then
    JointVector lostError_;         // when the tracking was lost, at least the bound
    JointVector releasedTorque_;    // at the beginning of a release without asking [Nm]
};

}  // namespace viable
