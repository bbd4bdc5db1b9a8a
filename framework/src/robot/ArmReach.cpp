#include "robot/ArmReach.h"

#include <algorithm>
#include <cmath>

namespace viable {

Eigen::AlignedBox3d calcReach(const RobotDescription& robot, const ArmGeometry& geometry, const JointLimits& limits) {
    Eigen::AlignedBox3d box(Eigen::Vector3d::Zero().eval());
    for (const LinkCapsule& capsule : geometry.capsules) {
        if (capsule.carrier < 0) continue;
        // Farthest point of the capsule from the origin of one moving frame after the other, towards the base.
        double distance = std::max(capsule.a.norm(), capsule.b.norm()) + capsule.radius;
        for (int i = capsule.carrier; i >= 0;) {
            const JointDescription& joint = robot.joints[i];
            if (joint.type == JointType::Prismatic)
                distance += std::max(std::abs(limits.position.lower[i]), std::abs(limits.position.upper[i]));
            const Eigen::Vector3d origin = joint.placement.translation();
            i = joint.parent;
            if (i >= 0) {
                distance += origin.norm();
                continue;
            }
            const Eigen::Vector3d ball = Eigen::Vector3d::Constant(distance);
            box.extend(Eigen::AlignedBox3d(origin - ball, origin + ball));
        }
    }
    return box;
}

}  // namespace viable
