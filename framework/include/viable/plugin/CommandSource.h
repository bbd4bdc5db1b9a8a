#pragma once

#include "viable/plugin/Plugin.h"

namespace viable {

/** The motion that the arm shall follow now. */
struct MotionCommand {
    enum class Space : unsigned char { Joint, Tool };

    Space space = Space::Joint;
    JointVector q;                        ///< Joint: desired positions [rad]
    JointVector qd;                       ///< Joint: desired velocities [rad/s]
    Pose tool;                            ///< Tool: desired pose of the tool frame, base frame
    Vector6 toolTwist = Vector6::Zero();  ///< Tool: desired linear [m/s], angular velocity [rad/s]
};

/** The host asks a command source for these once, after configure(). */
struct CommandTraits {
    MotionCommand::Space space =
        MotionCommand::Space::Joint;  ///< the space of all commands; a controller must follow it
};

/** The source of the motion: a file, a generator, a device. */
class CommandSource : public Plugin {
public:
    using Traits = CommandTraits;
    virtual CommandTraits traits() const = 0;

    /** The command at time t [s] since reset, t >= 0, non-decreasing from call to call. On Ok,
    `out` is complete for the space of traits(); otherwise the host keeps the last good command. */
    virtual TickStatus sample(double t, MotionCommand& out) = 0;

    /** The nominal plant's limits from time t on, complete, or null: they stay as they are. Asked once per tick
    after sample(), same t; valid until the next call. Limits that are not usable at the tick (see areUsable), or
    that the filter cannot take over, make the host stop the arm. Real time, like sample(). */
    virtual const JointLimits* sampleLimits(double /*t*/) { return nullptr; }
};

/** The command between two of its samples. */
enum class BetweenSamples : unsigned char {
    Hold,         ///< the newest one, at rest
    Interpolate,  ///< straight to the newest one, there a period later: one sample behind
    Extrapolate,  ///< on from the newest one as the last two went, until the next is overdue; then back to it
};

/** "hold", "interpolate", "extrapolate". */
const char* getName(BetweenSamples between);

}  // namespace viable
