#pragma once

#include "viable/plugin/Plugin.h"

namespace viable {

/** How the joint sensors of an arm tell what they read. */
enum class Encoder : unsigned char {
    Counts,  ///< positions in whole counts, velocities as their difference over a tick
    Exact,   ///< the truth
};

/** The arm that is really there, or an engine that stands for it. */
class RealPlant : public Plugin {
public:
    /** The state that the joint sensors report now. Valid after reset(). */
    virtual const JointState& measured() const = 0;

    /** The true state, where the plant can know it (a simulation); otherwise measured(). */
    virtual const JointState& actual() const = 0;

    /** Holds the commanded motor torque [Nm] for one tick. `applied` becomes the torque that the
    motors really gave after their limits. On Faulted the state stays as it was. */
    virtual TickStatus advance(const JointVector& torque, JointVector& applied) = 0;

    /** The torque that the surroundings put on each joint now, as sensors measure it [Nm]; null: the arm
    has no such sensors, which configure() has settled. Its value is valid after reset(). */
    virtual const JointVector* externalTorque() const { return nullptr; }

    /** How measured() is read. Valid after configure(). */
    virtual Encoder encoder() const { return Encoder::Counts; }
};

}  // namespace viable
