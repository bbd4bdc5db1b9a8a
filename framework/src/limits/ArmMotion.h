#pragma once

#include <array>

#include "viable/robot/ArmGeometry.h"

namespace viable::detail {

/** An arm in one state, for judges of a run: places and velocities by the chain of transforms from the robot's description, one
joint after the other. Shares no arithmetic with the filters. */
class ArmMotion {
public:
    ArmMotion(const RobotDescription& robot, const JointVector& q, const JointVector& qd);

    struct Part {
        Eigen::Vector3d a, b;  ///< ends of the capsule's segment, base frame [m]
        double speed = 0.0;    ///< of its fastest point [m/s]
    };
    /** @param capsule  that a joint carries; its radius may be 0 */
    Part place(const LinkCapsule& capsule) const;

private:
    struct Frame {
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        Eigen::Vector3d turning = Eigen::Vector3d::Zero(), moving = Eigen::Vector3d::Zero();
    };
    std::array<Frame, kMaxJoints> frames_;
};

/** Half-way between two rows of a run, by the cubic through the positions and velocities of both.
@param h  from one to the other, > 0 [s] */
JointState calcHalfWay(const JointState& from, const JointState& to, double h);

}  // namespace viable::detail
