#pragma once

#include "viable/plugin/Plugin.h"

namespace viable {

/** Kind of the joint sensors' readings. */
enum class Encoder : unsigned char {
    Counts,  ///< positions in whole counts, velocities as their difference over a tick
    Exact,   ///< the true state (a simulation)
};

/** The host asks a plant for these once, after configure(). */
struct PlantTraits {
    Encoder encoder = Encoder::Counts;
    int delayTicks = 0;  ///< from advance() until the motors give its torque, as far as the plant knows
    /** Fastest change of the motors' torque, one number per joint [Nm/s, prismatic: N/s], > 0; infinite or of size 0: as
    fast as asked for. */
    JointVector motorRate{};
    bool hasClock =
        false;  ///< a clock of the plant's own makes the ticks, as a robot's packets do, and read() is called
};

/** Contact of a simulated arm with obstacles at one time. */
struct ContactReport {
    int contacts = 0;                                 ///< places that touch
    Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< on the arm, all together, base frame [N]
    double pressing = 0.0;                            ///< sum of the normal forces [N]
    double depth = 0.0;                               ///< the largest [m]
    Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< the deepest, base frame [m]
    int carrier = -1;                                 ///< joint whose link that is on
    int obstacle = -1;                                ///< it touches: solids, then spheres, then the map
};

/** The arm that is really there, or an engine that stands for it. All cases of an experiment are configured before
the first one runs. So open a device that only one may hold at a time, such as a robot, in reset(). It may then throw
Error. */
class RealPlant : public Plugin {
public:
    using Traits = PlantTraits;
    virtual PlantTraits traits() const { return {}; }

    /** The state that the joint sensors report now. Valid after reset(). */
    virtual const JointState& measured() const = 0;

    /** The true state, where the plant can know it (a simulation); otherwise measured(). */
    virtual const JointState& actual() const = 0;

    /** Holds the commanded motor torque [Nm] for one tick. `applied` becomes the torque that the
    motors really gave after their limits. On Faulted the state stays as it was. */
    virtual TickStatus advance(const JointVector& torque, JointVector& applied) = 0;

    /** The external torque on each joint now, as sensors measure it [Nm]; null: the arm has no such sensors. This is
    settled after configure(), and the value is valid after reset(). */
    virtual const JointVector* externalTorque() const { return nullptr; }

    /** The contact of the arm now; null: it passes through all, or nobody can know. This is settled after configure(), and
    the value is valid after reset(). */
    virtual const ContactReport* contact() const { return nullptr; }

    /** With a clock only, once per tick and before measured(): waits for the plant's next tick, and measured() is
    the state there. `ticksPassed`: ticks of its clock since the last read() or reset(), at least 1. The host takes
    each one beyond 1 as a missed tick, in which the motors have held the last torque. Anything but Ok: the plant is
    gone, and the run ends. */
    virtual TickStatus read(std::int64_t& ticksPassed) {
        ticksPassed = 1;
        return TickStatus::Ok;
    }
};

}  // namespace viable
