#pragma once

#include "loop/FreeArm.h"
#include "loop/LoopStatus.h"
#include "loop/StageTimer.h"
#include "loop/StopMonitor.h"
#include "viable/loop/NominalPlant.h"

namespace viable {

/** Torques [Nm] and accelerations [rad/s^2] beyond 1e9 are no arm's: a few ticks later the arithmetic would overflow. */
bool isBounded(const JointVector& v, int n);

/** The nominal arm's half of a tick. Command, controller and filter are asked, the monitor examines the decision, and the
arm advances by it in closed form. Without a decision that may be applied, it follows the stop that the monitor holds
ready.

Guarantees: a decision of a filter that guarantees limits is only applied where it has a stop within them.
A plugin that throws, or goes on giving nothing of use, is a reason to stop (LoopStatus::beginStop).
Real time: no allocation, lock or throw after reset(). */
class NominalArm {
public:
    /** All must outlive it. @param fixesLimits  a command that changes the limits is answered with a stop
    @param canWait  wait() may be called */
    NominalArm(const RunSetup& setup, const LoopPlugins& plugins, LoopStatus& loop, bool fixesLimits, bool canWait);

    /** Back to t = 0 at `start`, with command, controller and filter. Throws Error (PluginFailed). */
    void reset(const MotionState& start);

    /** From now on it waits where the real tool is held, at `surface`; each tick anew, as long as waits() (see FreeArm). */
    void wait(const detail::ToolSurface& surface) { freeArm_->wait(surface, state_, dynamics_); }
    bool waits() const { return freeArm_ && freeArm_->isOn(); }
    void endWait() { freeArm_->end(); }
    /** Where the command leads the tool to: the waiting arm is not there [m]. */
    const Eigen::Vector3d& wantedTool() const { return waits() ? freeArm_->tool() : dynamics_.tool.position; }

    /** Decides how the arm moves in this tick. @param external  torque that acts on it, too [Nm]; of size 0: none */
    void decide(const JointVector& external, StageTimer& timer);
    /** The same where command, controller and filter have no time: it follows the stop.
    @param reachesMotors  only such a tick is part of a stop */
    void missTick(bool reachesMotors, StageTimer& timer);
    /** Writes what was decided; `record` becomes complete but for the real arm. */
    void fillRecord(TickRecord& record) const;
    /** To the end of the tick. */
    void advance() { advanceNominal(decision_, setup_.tick_s, state_); }

    void pause() { isPaused_ = true; }
    void resume() { isPaused_ = false; }
    bool isPaused() const { return isPaused_; }
    bool isHolding() const { return isPaused_ && holdBegun_ && monitor_.atRest(state_); }
    /** A stop has come to its end. */
    bool hasStopped() const { return stopBegun_ && monitor_.atRest(state_); }
    /** What the command is asked for next: the loop's time less the pauses [s]. */
    double commandTime() const { return static_cast<double>(loop_.tick() - pausedTicks_) * setup_.tick_s; }

    const MotionState& state() const { return state_; }     ///< before advance(): at the tick's beginning
    const Dynamics& dynamics() const { return dynamics_; }  ///< of the last tick that decided
    const HeldMotion& motion() const { return motion_; }    ///< of the last decision
    const JointLimits& limits() const { return limits_; }   ///< in force
    bool hasNewLimits() const { return hasNewLimits_; }     ///< since this tick
    /** `after_s` after state(), on the stop held ready, one that holds jerks. */
    void calcStop(double after_s, MotionState& state) const { monitor_.calcStop(state_, after_s, state); }

private:
    bool asksPlugins() const { return !isPaused_ && !loop_.isStopping(); }
    void readCommand(double t);
    void readLimits(double t);
    /** @param missed  ticks before this one, in which it was not asked */
    void readTorque(std::int64_t missed);
    void tellSkippedTicks();
    void followFreeArm();
    void rest();
    /** False: there is no decision that may be applied. */
    bool askFilter(const JointVector& external);
    bool passMonitor();
    void followStop();

    const RunSetup& setup_;
    const LoopPlugins& plugins_;
    LoopStatus& loop_;
    const bool fixesLimits_;
    RobotModel model_;
    const int n_;

    MotionState state_;
    Dynamics dynamics_;
    MotionCommand command_, newCommand_;
    MotionCommand received_;  // what has come of command_ over the stream
    ControllerOutput output_;
    JointVector desiredTorque_, wantedTorque_, removedTorque_;
    FilterDecision decision_;
    HeldMotion motion_;                         // of decision_
    std::unique_ptr<detail::FreeArm> freeArm_;  // null: it never waits
    FilterStatus status_ = FilterStatus::Passed;
    StopMonitor monitor_;
    StopVerdict verdict_ = StopVerdict::Safe;
    JointLimits limits_;
    bool hasNewLimits_ = false;

    bool guarantees_ = false;  // the filter's word
    bool hasTorque_ = false;
    int missingCommands_ = 0, missingTorques_ = 0;
    std::int64_t substituted_ = 0;   // torques
    std::int64_t skippedTicks_ = 0;  // since the filter ran last; it has not been told of them yet
    std::int64_t pausedTicks_ = 0;   // since reset()
    bool isPaused_ = false;          // from the next tick on
    bool holdBegun_ = false;         // a tick of the pause has been taken
    bool stopBegun_ = false;         // a tick of the stop has been taken
};

}  // namespace viable
