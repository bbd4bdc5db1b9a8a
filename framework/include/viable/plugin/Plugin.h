#pragma once

#include "viable/config/Settings.h"
#include "viable/robot/Dynamics.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** Ticks of control loops [s]. */
inline constexpr double kShortestTick_s = 1e-5;
inline constexpr double kLongestTick_s = 0.1;

struct ArmGeometry;
struct Environment;
class PeopleFeed;
class SurroundingsFeed;

/** Data that every plugin gets before the run. Lives as long as the plugin. */
struct RunSetup {
    const RobotDescription& robot;
    /** Limits of the nominal plant, checked (see checkLimits). Robust loop and real plant act on the real arm and
    get its limits. They are the same, but with `hold_on: real` the nominal ones follow from the robust loop. */
    JointLimits limits;
    double tick_s = 0.0;  ///< the configured tick; the loop never uses measured time
    double duration_s = 0.0;
    MotionState start;  ///< nominal and real arm at t = 0, at rest or moving
    Pose startTool;     ///< tool pose there
    /** The parts of the arm that can hit something; null: not known, or not needed. */
    const ArmGeometry* geometry = nullptr;
    /** The surroundings; null: nothing. Only the safety filter of a run may take from it. The controller, which is
    called in the same thread, may view what the filter took. */
    SurroundingsFeed* surroundings = nullptr;
    /** People who may come near; null: nobody. One safety filter of a run may take from it. */
    PeopleFeed* people = nullptr;

    /** Ticks from a torque to the motors of the real plant; 0 where there is none, or for the plant itself. */
    int delayTicks = 0;
    JointVector motorRate{};  ///< PlantTraits::motorRate of it; of size 0 where there is none, or for the plant itself
    /** The obstacles that really stand around, for plants that touch them; null: nothing is known. */
    const Environment* environment = nullptr;

    int size() const { return robot.size(); }
};

/** Result of a plugin's work in one tick. Anything but Ok makes the host treat the output as unusable. */
enum class TickStatus : unsigned char {
    Ok,
    InvalidInput,  ///< an input had the wrong size or was not finite; the output was not written
    Faulted,       ///< the plugin cannot go on
};

/** When a tick is. */
struct Tick {
    double time_s = 0.0;      ///< since reset(); a whole number of RunSetup::tick_s
    std::int64_t missed = 0;  ///< ticks in a row just before this one in which no plugin was called
};

/** The common base of the five kinds of plugin.

Life: constructed (cheap, no arguments), configure() once, reset() once or more, then one tick function per tick,
destroyed. Only configure() may throw Error and allocate. Functions of a tick and reset() must not throw, allocate,
lock, log or touch files. Not thread-safe: the host calls from one thread at a time. */
class Plugin {
public:
    virtual ~Plugin() = default;

    /** Called once. `parameters` are complete and in range by the plugin's own declaration; throw
    badInput(parameters.place("..."), ...) for what a declaration cannot say. */
    virtual void configure(const RunSetup& setup, const Parameters& parameters) = 0;

    /** Back to t = 0 at the given state; same inputs must then give the same outputs again. */
    virtual void reset(const MotionState& start) = 0;
};

}  // namespace viable
