#include "robot/ArmReach.h"

#include <gtest/gtest.h>

#include <random>

namespace viable {
namespace {

JointDescription describeJoint(int parent, JointType type, const Eigen::Vector3d& origin, const Eigen::Vector3d& axis) {
    JointDescription joint;
    joint.parent = parent;
    joint.type = type;
    joint.placement = Eigen::Translation3d(origin) * Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized());
    joint.axis = axis.normalized();
    return joint;
}

/** Two branches on one base; in the first a joint slides. */
RobotDescription makeRobot() {
    RobotDescription robot;
    robot.joints = {describeJoint(-1, JointType::Revolute, {0.1, -0.2, 0.3}, {0, 0, 1}),
                    describeJoint(0, JointType::Prismatic, {0.3, 0.1, 0.2}, {1, 1, 0}),
                    describeJoint(1, JointType::Revolute, {0, 0.2, -0.3}, {0, 1, 2}),
                    describeJoint(-1, JointType::Prismatic, {-2, 0, 0}, {1, 0, 0})};
    const JointVector lower = (JointVector(4) << -3.0, -0.4, -3.0, -0.2).finished();
    const JointVector upper = (JointVector(4) << 3.0, 0.1, 3.0, 0.5).finished();
    robot.limits = JointLimits::unlimited(4);
    robot.limits.position = {lower, upper};
    return robot;
}

ArmGeometry makeGeometry() {
    ArmGeometry geometry;
    geometry.links = {"base", "hand", "cart"};
    geometry.capsules = {{0, -1, {9, 9, 9}, {9, 9, 9}, 1.0},
                         {1, 2, {0.1, 0, 0}, {0.2, 0.3, 0.1}, 0.05},
                         {2, 3, {0, 0, 0}, {0, 0, 0.4}, 0.1}};
    return geometry;
}

Eigen::Isometry3d calcFrame(const RobotDescription& robot, const JointVector& q, int i) {
    if (i < 0) return Eigen::Isometry3d::Identity();
    const JointDescription& joint = robot.joints[static_cast<std::size_t>(i)];
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    if (joint.type == JointType::Prismatic)
        motion.translate(q[i] * joint.axis);
    else
        motion.rotate(Eigen::AngleAxisd(q[i], joint.axis));
    return calcFrame(robot, q, joint.parent) * joint.placement * motion;
}

TEST(ArmReach, NoPoseWithinTheLimitsLeavesTheBox) {
    const RobotDescription robot = makeRobot();
    const ArmGeometry geometry = makeGeometry();
    const Eigen::AlignedBox3d box = calcReach(robot, geometry, robot.limits);
    EXPECT_TRUE(box.contains(Eigen::Vector3d(0, 0, 0)));
    EXPECT_FALSE(box.contains(Eigen::Vector3d(9, 9, 9)));  // what does not move does not count
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    double farthest = 0.0;
    for (int k = 0; k < 20000; ++k) {
        JointVector q(4);
        for (int i = 0; i < 4; ++i) {
            const double lower = robot.limits.position.lower[i];
            q[i] = lower + unit(random) * (robot.limits.position.upper[i] - lower);
        }
        for (const LinkCapsule& capsule : geometry.capsules) {
            if (capsule.carrier < 0) continue;
            for (const Eigen::Vector3d& end : {capsule.a, capsule.b}) {
                const Eigen::Vector3d p = calcFrame(robot, q, capsule.carrier) * end;
                const Eigen::Vector3d size = Eigen::Vector3d::Constant(capsule.radius);
                ASSERT_TRUE(box.contains(p + size) && box.contains(p - size)) << p.transpose();
                if (capsule.link == 1)
                    farthest = std::max(farthest, (p - robot.joints[0].placement.translation()).norm());
            }
        }
    }
    // The first branch: from its joint at (0.1, -0.2, 0.3) two offsets, a travel of up to 0.4 m, the capsule's far end.
    const double ball = Eigen::Vector3d(0.3, 0.1, 0.2).norm() + 0.4 + Eigen::Vector3d(0, 0.2, -0.3).norm() +
                        Eigen::Vector3d(0.2, 0.3, 0.1).norm() + 0.05;
    EXPECT_NEAR(box.max().y(), -0.2 + ball, 1e-12);
    EXPECT_LT(farthest, ball);
    EXPECT_GT(farthest, 0.4 * ball);                            // poses that segment the arm were among them
    EXPECT_NEAR(box.min().x(), -2.0 - 0.4 - 0.1 - 0.5, 1e-12);  // the cart, its size, its travel
}

TEST(ArmReach, AJointThatSlidesForeverReachesForever) {
    RobotDescription robot = makeRobot();
    robot.limits.position.upper[1] = kInfinity;
    const Eigen::AlignedBox3d box = calcReach(robot, makeGeometry(), robot.limits);
    EXPECT_EQ(box.max().z(), kInfinity);
    EXPECT_EQ(box.min().y(), -kInfinity);
}

}  // namespace
}  // namespace viable
