#pragma once

#include "loop/FollowingWatch.h"
#include "loop/NominalArm.h"
#include "loop/SensorCheck.h"

namespace viable {

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
    /** Fastest change of a motor's whole torque while the robust loop's is cut or goes to zero (kRelease_s) [Nm/s]; of size 0:
    any. It goes before limitsAuthority. */
    JointVector motorRate{};
    /** Likewise of the robust loop's torque (LinearErrorLoop::torqueRate). */
    JointVector robustRate{};
    /** What the robust loop adds has an end (see detail::Authority). */
    bool limitsAuthority = false;
    /** Where the real tool touches something the nominal arm waits, and the tool presses with this force [N] (see
    detail::ToolTouch). 0: it does not. The plant must have torque sensors; not with a bound. */
    double contactForce = 0.0;
};

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
    torque, and there is no reading.
    @param isRead  false: what the plant reports stands for a reading, and says nothing of the arm */
    void tick(TickRecord& record, bool isRead = true) noexcept;

    /** A tick whose time passed before command, controller and filter could run: the nominal arm follows the stop
    held ready; robust loop and plant go on. */
    void missTick(TickRecord& record, bool isRead = true) noexcept { passTick(record, true, isRead); }

    /** Brakes the nominal arm from the next tick on. The first reason stays, unless it was Requested and a
    failure follows. */
    void requestStop(StopReason reason, const char* message) noexcept { loop_.beginStop(reason, message); }

    /** From the next tick on the nominal arm follows the stop held ready and then rests: command, controller and filter do
    not run, and the command's time stands still. Robust loop and plant go on. resume() takes up the command where it
    was; both are as smooth as that stop and the filter's decisions: without a step of the torque where the filter guarantees
    its limits. Nobody looks at obstacles that move meanwhile. Each may be called between any two ticks. */
    void pause() noexcept { nominalArm_.pause(); }
    void resume() noexcept { nominalArm_.resume(); }
    bool isPaused() const { return nominalArm_.isPaused(); }
    /** Paused, and come to rest. */
    bool isHolding() const { return nominalArm_.isHolding(); }

    /** Destroys the plant, which lets a robot hold itself; no tick may follow. */
    void releasePlant() noexcept;

    bool isStopping() const { return loop_.isStopping(); }
    /** True when a stop has come to its end, or could not be made. Further ticks hold the arm where it is: the nominal
    arm at exact rest, the robust loop at work where it can be. */
    bool hasStopped() const { return hasFailed() || nominalArm_.hasStopped(); }
    /** True when no stop can be made: the plant is gone, or the arithmetic is; or when a robot (a plant with a
    clock) goes on though it was told to brake, and is left to its own stop. */
    bool hasFailed() const { return loop_.hasEnded(); }

    StopReason stopReason() const { return loop_.reason(); }
    const char* stopMessage() const { return loop_.message(); }  ///< what the plugin said, or what was wrong
    const char* stopRemedy() const { return loop_.remedy(); }    ///< a sentence; may be empty
    double stopTime() const { return loop_.stopTime(); }         ///< [s]
    double time() const { return loop_.time(); }                 ///< of the next tick [s]
    /** What the command is asked for next: time() less the pauses [s]. */
    double commandTime() const { return nominalArm_.commandTime(); }

    bool hasClock() const { return hasClock_; }  ///< the plant makes the ticks

    const MotionState& nominal() const { return nominalArm_.state(); }  ///< at time()
    /** The nominal arm `after_s` after time() on the stop held ready, one that holds jerks. */
    void calcStop(double after_s, MotionState& state) const { nominalArm_.calcStop(after_s, state); }

private:
    void moveToReal(MotionState& start) const;
    void awaitPlant();
    void readPlant(bool isRead);
    void readState();
    const JointVector* findExternalTorque();
    void readExternalTorque();
    void checkReading();
    void passReading();
    void seeJoint(int joint);
    void dropReading(int joint, bool isInVain);
    bool replaceStillReading(int joint);
    bool isDriven(int joint) const;
    /** Its reading stopped at once. */
    bool isSuspect(int joint) const { return !options_.bound && isDriven(joint) && sensors_.isSuspect(joint); }
    void checkAnswers();
    void feelTouch();
    void checkTracking();
    void checkFollowing(std::int64_t elapsedTicks);
    void watchNominal();
    void holdIntegral();
    /** A robot that does not take torques for what they are goes on though it is told to brake: its own stop is better. */
    void releaseToRobot() {
        if (hasClock_) loop_.end();
    }
    void calcMotorTorque();
    void predictOpenJoints();
    bool askRobustLoop();
    void endRobustLoop(bool isAsked);
    void limitRates(const JointVector& lastRobust, const JointVector& lastMotor);
    void takeRobustTorque();
    void drivePlant();
    void passTick(TickRecord& record, bool hasPlant, bool isRead) noexcept;
    void fillRecord(TickRecord& record, bool hasReading) const;
    void finishTick(TickRecord& record, StageTimer& timer, bool drives);

    const RunSetup& setup_;
    LoopPlugins plugins_;
    const RealArmOptions options_;
    const int n_;
    LoopStatus loop_;
    NominalArm nominalArm_;

    // The plant's clock.
    bool hasClock_ = false;
    bool isRead_ = false;                 // for a tick that is still to come
    std::int64_t ticksToMiss_ = 0;        // already passed
    std::int64_t ticksSinceReading_ = 1;  // between the present reading and the one before
    int missedInRow_ = 0;

    // What is read.
    JointState real_, actual_;
    JointState plausible_;  // what the robust loop gets of real_
    std::array<bool, kMaxJoints> isPlausible_{};
    SensorCheck sensors_;
    bool hasReading_ = false;                   // one has been looked at since reset()
    std::unique_ptr<detail::ToolTouch> touch_;  // null: no contact is asked for
    JointVector ownTorque_;                     // the loop's share of that; of size 0: all of it
    ContactReport contact_;
    JointVector externalTorque_;  // that acts on the nominal arm; empty: none is fed to it
    int missingExternalTorques_ = 0;

    // Whether the arm follows.
    detail::FollowingWatch following_;
    bool isTrackingLost_ = false, isIntegralHeld_ = false;
    JointVector lostError_;       // when the tracking was lost, at least the bound
    bool hasLeftLimits_ = false;  // the nominal arm, those that the bound is for
    double leftLimits_s_ = 0.0;   // when first
    bool isWithheld_ = false;     // away, and the motors get the most that may be added
    bool drifts_ = false;         // away though its motors had torque to spare

    // What the motors are told.
    detail::Authority authority_;
    JointVector robustTorque_, motorTorque_, appliedTorque_;
    JointVector lastMotorTorque_;   // of the tick before
    bool hasDriven_ = false;        // since reset(): motorTorque_ is what the motors were told last
    bool robustLoopEnded_ = false;  // it failed, or swings: its torque goes to zero
    bool isLoopAsked_ = true;       // meanwhile
    int releaseTicks_ = 0;          // since then
    JointVector releasedTorque_;    // at the beginning of a release without asking [Nm]
};

}  // namespace viable
