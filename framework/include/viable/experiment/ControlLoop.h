#pragma once

#include "viable/log/TickRecord.h"
#include "viable/motion/Braking.h"
#include "viable/plugin/NominalPlant.h"
#include "viable/plugin/PluginLoader.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The plugins of a loop, configured. Robust loop and real plant may be null, both or none. */
struct LoopPlugins {
    PluginPtr<CommandSource> command{nullptr, nullptr};
    PluginPtr<NominalController> controller{nullptr, nullptr};
    PluginPtr<SafetyFilter> filter{nullptr, nullptr};
    PluginPtr<RobustLoop> robustLoop{nullptr, nullptr};
    PluginPtr<RealPlant> realPlant{nullptr, nullptr};
};

/** Why the arm was braked to a stop before the end of the run. */
enum class StopReason : unsigned char {
    None,
    Requested,         ///< by the user (a signal)
    CommandFailed,     ///< no usable command for more than kMaxSubstitutedTicks, or it threw
    ControllerFailed,  ///< no usable torque for more than kMaxSubstitutedTicks, or it threw
    FilterFailed,      ///< no usable decision, or it threw
    RobustLoopFailed,  ///< it threw or gave no usable torque
    PromiseBroken,     ///< a limit was passed under a filter that promises it
    PlantFailed,       ///< the real plant failed: the loop ends at once, there is nothing to brake
};

/** How many ticks in a row a missing or unusable command or torque is replaced by the last good
 * one. */
inline constexpr int kMaxSubstitutedTicks = 10;

/** The tick: command, dynamics, controller, filter, nominal plant, robust loop, real plant.

Guarantees: no torque that is not finite or beyond 1e9 Nm reaches a plant; the nominal arm advances by exactly
the configured tick. A plugin that throws or returns nonsense is answered with a stop of the nominal arm, which
the real arm follows: within acceleration and jerk limits, planned on the tick grid, or, under a filter that
holds accelerations, at the acceleration limit. Such a stop knows nothing of position limits; a filter that
keeps them has left room for it.
Real time: tick() allocates, locks, throws and logs nothing as long as the plugins keep to that too.
Thread: tick() by one thread; requestStop() by that thread. */
class ControlLoop {
public:
    /** `setup` must outlive the loop (the plugins keep it, too). */
    ControlLoop(const RunSetup& setup, LoopPlugins plugins);
    ~ControlLoop();

    /** Back to t = 0 at setup.start. */
    void reset();

    /** One tick; `record` becomes its full account (state at its beginning, torques during it). */
    void tick(TickRecord& record) noexcept;

    /** Brakes the nominal arm from the next tick on. The first reason stays, unless it was Requested and a
    failure follows. */
    void requestStop(StopReason reason, const char* message) noexcept {
        beginStop(reason, message);
    }

    bool isStopping() const { return stopReason_ != StopReason::None; }
    /** True when a stop has come to its end, or could not be made: tick() must not be called any more. */
    bool hasStopped() const;

    StopReason stopReason() const { return stopReason_; }
    const char* stopMessage() const {
        return stopMessage_;
    }                                              ///< what the plugin said, or what was wrong
    double stopTime() const { return stopTime_; }  ///< [s]
    double time() const;  ///< of the next tick [s]

    const MotionState& nominal() const { return nominal_; }  ///< at time()

private:
    void beginStop(StopReason reason, const char* message) noexcept;
    void readPlant();
    void takeCommand(double t);
    void takeTorque();
    bool takeDecision();
    void planStop();
    void followStop();
    void takeRobustTorque();
    void drivePlant();
    /** Runs `call`; an exception becomes `faulted` and its text the stop message. */
    template <class Status, class Call>
    Status contain(Status faulted, StopReason reason, const Call& call) noexcept;

    const RunSetup& setup_;
    LoopPlugins plugins_;
    RobotModel model_;
    int n_;

    std::int64_t tickIndex_ = 0;
    MotionState nominal_;
    JointState real_, actual_;
    Dynamics dynamics_;
    MotionCommand command_, newCommand_;
    JointVector desiredTorque_, newTorque_, robustTorque_, motorTorque_, appliedTorque_;
    FilterDecision decision_;
    FilterStatus status_ = FilterStatus::Passed;

    bool hasTorque_ = false;
    int missingCommands_ = 0;
    int missingTorques_ = 0;
    std::int64_t substituted_ = 0;

    StopReason stopReason_ = StopReason::None;
    double stopTime_ = 0.0;
    char stopMessage_[512] = "";
    bool stopPlanned_ = false;
    bool ended_ = false;  // no stop is possible: the plant is gone or the arithmetic is
    HeldQuantity stopHeld_ = HeldQuantity::Jerk;
    std::array<GridStop, kMaxJoints> stops_;
    JointVector stopChoice_;
    bool robustLoopFailed_ = false;
};

}  // namespace viable
