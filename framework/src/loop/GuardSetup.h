#pragma once

#include "loop/ControlLoop.h"
#include "viable/environment/Environment.h"
#include "viable/loop/GuardStatus.h"

// What the guards of own loops have in common: checks of what they are given once, and words for what comes out.

namespace viable::detail {

/** "joint `name`" */
std::string quoteJoint(const RobotDescription& robot, int joint);

/** Checks robot, tick and limits. Throws Error (BadInput).
@param guard   its name, for messages
@param robot   must outlive the result
@param limits  none: the robot's own
@return with a start that nobody can refuse: at rest amid the position limits */
RunSetup makeGuardSetup(const char* guard, const RobotDescription& robot, double tick_s,
                        const std::optional<JointLimits>& limits);

/** Refuses a robot with speed limits of its points: for guards that keep joint limits alone. Throws Error (BadInput). */
void refuseSpeedLimits(const char* guard, const RobotDescription& robot);

/** Refuses an environment with people. Throws Error (BadInput).
@param where  of it, for the message
@param who    "a reference guard keeps" */
void refusePeople(const char* where, const Environment& environment, const char* who);

/** Checks a start and puts it into `setup`, with its tool pose. Throws Error (BadInput).
@return the dynamics there */
Dynamics checkGuardStart(const char* guard, const MotionState& start, RunSetup& setup);

/** What the last tick of a guard's loop came to. */
GuardStatus findStatus(const ControlLoop& loop, const TickRecord& record);

/** Why a guard's loop was stopped; LibraryFailed for what no plugin of a guard does. */
GuardStop toGuardStop(StopReason reason);

/** For a loop that does not own its plugins. */
template <class Interface>
PluginPtr<Interface> lend(Interface& plugin) {
    return PluginPtr<Interface>(&plugin, [](void*) {});
}

}  // namespace viable::detail
