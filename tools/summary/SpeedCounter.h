#pragma once

#include "summary/Summary.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** Judges the speeds of a run's arms against RobotDescription::speedLimits while it goes on, outside of the ticks: in the rows and
half-way between them, there by the cubic through both rows' positions and velocities. Shares no arithmetic with the filters:
velocities by the chain of transforms from the robot's description, one joint after the other. */
class SpeedCounter {
public:
    /** @param geometry  null where robot.speedLimits needs no capsules */
    SpeedCounter(RobotDescription robot, const ArmGeometry* geometry, bool hasRealArm);

    /** Allocates nothing. */
    void add(const TickRecord& record);
    /** The state that the last tick led to; of the real arm no record holds it. */
    void addEnd(const MotionState& nominal, double time_s);

    const Speeds& speeds() const { return speeds_; }

    /** The largest speed, and the largest share of a limit, of an arm in one state. */
    struct Fastest {
        double speed = 0.0, use = 0.0;
        int part = -1;  ///< that has the largest share
    };
    Fastest find(const JointVector& q, const JointVector& qd) const;
    const std::string& partName(int part) const { return parts_[static_cast<std::size_t>(part)].name; }

private:
    struct Part {
        std::string name;
        LinkCapsule capsule;
        double limit;
        bool hasRegions;
    };
    /** One arm on its way through the run. */
    struct Way {
        JointState last;
        double time_s = 0.0, use = 0.0;         // use: since the last row
        bool hasBegun = false, hasGap = false;  // hasGap: rows without a reading since
    };

    void follow(Way& way, SpeedRecord& record, const JointState& state, double time_s);
    void judge(Way& way, SpeedRecord& record, const JointVector& q, const JointVector& qd, double time_s);
    static void finishTick(Way& way, SpeedRecord& record);

    RobotDescription robot_;
    std::vector<Part> parts_;
    Speeds speeds_;
    Way nominal_, real_;
};

}  // namespace viable::detail
