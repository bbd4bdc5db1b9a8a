#pragma once

#include "viable/robot/RobotDescription.h"

namespace viable::testing {

/** Two equal links of 0.4 m in a vertical plane, with limits on all quantities that are not symmetric, friction and
motor limits. */
inline RobotDescription makeTwoLinkArm() {
    const auto pair = [](double first, double second) {
        JointVector v(2);
        v << first, second;
        return v;
    };
    RobotDescription robot;
    robot.name = "two_link_arm";
    for (int i = 0; i < 2; ++i) {
        JointDescription joint;
        joint.name = "joint" + std::to_string(i);
        joint.childLink = "link" + std::to_string(i);
        joint.parent = i - 1;
        joint.placement = Eigen::Isometry3d::Identity();
        if (i > 0) joint.placement.translation() = Eigen::Vector3d(0.4, 0.0, 0.0);
        joint.axis = Eigen::Vector3d::UnitY();
        joint.body.mass = 3.0;
        joint.body.com = Eigen::Vector3d(0.2, 0.0, 0.0);
        joint.body.inertia = Eigen::Vector3d(0.005, 0.04, 0.04).asDiagonal();
        robot.joints.push_back(joint);
    }
    robot.toolParent = 1;
    robot.toolLink = "tool";
    robot.toolPlacement = Eigen::Isometry3d::Identity();
    robot.toolPlacement.translation() = Eigen::Vector3d(0.4, 0.0, 0.0);
    robot.limits.position = {pair(-2.5, -2.0), pair(2.5, 2.5)};
    robot.limits.velocity = {pair(-2.0, -2.5), pair(2.0, 2.5)};
    robot.limits.acceleration = {pair(-12.0, -14.0), pair(12.0, 14.0)};
    robot.limits.jerk = {pair(-40.0, -60.0), pair(40.0, 60.0)};
    robot.home = pair(0.3, -0.5);
    robot.actuation.gearRatio = pair(100, 100);
    robot.actuation.rotorInertia = pair(0.7, 0.6);
    robot.actuation.torqueLimit = pair(200, 100);
    robot.actuation.encoderCounts = pair(524288, 524288);
    robot.actuation.friction = {pair(4, 2), pair(6, 3), pair(0.5, 0.5)};
    return robot;
}

}  // namespace viable::testing
