#include "limits/ArmMotion.h"

#include <algorithm>
#include <cmath>

namespace viable::detail {

ArmMotion::ArmMotion(const RobotDescription& robot, const JointVector& q, const JointVector& qd) {
    for (std::size_t i = 0; i < robot.joints.size(); ++i) {
        const JointDescription& joint = robot.joints[i];
        const auto at = static_cast<Eigen::Index>(i);
        const Frame base = joint.parent < 0 ? Frame() : frames_[joint.parent];
        Frame& frame = frames_[i];
        frame = base;
        frame.pose = base.pose * joint.placement;
        const Eigen::Vector3d axis = frame.pose.linear() * joint.axis;
        if (joint.type == JointType::Prismatic)
            frame.pose = frame.pose * Eigen::Translation3d(q[at] * joint.axis);
        else
            frame.pose = frame.pose * Eigen::AngleAxisd(q[at], joint.axis);
        frame.moving += base.turning.cross(frame.pose.translation() - base.pose.translation());
        (joint.type == JointType::Prismatic ? frame.moving : frame.turning) += qd[at] * axis;
    }
}

ArmMotion::Part ArmMotion::place(const LinkCapsule& capsule) const {
    const Frame& frame = frames_[capsule.carrier];
    Part part{frame.pose * capsule.a, frame.pose * capsule.b, 0.0};
    const double rate = frame.turning.norm();
    for (const Eigen::Vector3d* end : {&part.a, &part.b}) {
        const Eigen::Vector3d v = frame.moving + frame.turning.cross(*end - frame.pose.translation());
        const double along = rate > 0.0 ? frame.turning.dot(v) / rate : v.norm();
        const double across = rate > 0.0 ? frame.turning.cross(v).norm() / rate : 0.0;
        part.speed = std::max(part.speed, std::hypot(along, across + rate * capsule.radius));
    }
    return part;
}

JointState calcHalfWay(const JointState& from, const JointState& to, double h) {
    return {0.5 * (from.q + to.q) + h / 8.0 * (from.qd - to.qd), 1.5 / h * (to.q - from.q) - 0.25 * (from.qd + to.qd)};
}

}  // namespace viable::detail
