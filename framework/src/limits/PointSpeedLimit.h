#pragma once

#include "viable/limits/ArmLimit.h"
#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** That points of an arm are no faster than RobotDescription::speedLimits. Shares no arithmetic with the filters:
velocities by the chain of transforms from the robot's description, one joint after the other. */
class PointSpeedLimit : public ArmLimit {
public:
    /** @param geometry  null where robot.speedLimits needs no capsules */
    PointSpeedLimit(RobotDescription robot, const ArmGeometry* geometry);

    LimitSample sample(const ArmSample& arm) override;

    /** The largest speed, and the largest share of a limit, of an arm in one state. */
    struct Fastest {
        double speed = 0.0, use = 0.0;
        int part = -1;  ///< that has the largest share
    };
    Fastest find(const JointVector& q, const JointVector& qd) const;
    const std::string& partName(int part) const { return parts_[part].name; }

private:
    struct Part {
        std::string name;
        LinkCapsule capsule;
        double limit;
        bool hasRegions;
    };

    RobotDescription robot_;
    std::vector<Part> parts_;
};

}  // namespace viable::detail
