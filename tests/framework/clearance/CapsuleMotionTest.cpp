#include "Paths.h"
#include "clearance/CapsuleMotion.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "DrawnPath.h"
namespace viable {
namespace {

using detail::ArmPath;
using detail::CapsuleMotion;

constexpr double kTick_s = 1e-3;
constexpr int kJoints = 6, kPoses = 1200;

class Draw {
public:
    explicit Draw(unsigned seed) : random_(seed) {}
    double share() { return std::uniform_real_distribution<double>(-1.0, 1.0)(random_); }
    Eigen::Vector3d vector(double size) { return size * Eigen::Vector3d(share(), share(), share()); }

    /** Chains and trees of turning and sliding joints. */
    RobotDescription robot() {
        RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
        const bool isTree = share() > 0.0;
        for (int i = 0; i < kJoints; ++i) {
            JointDescription& joint = robot.joints[static_cast<std::size_t>(i)];
            joint.parent = isTree ? static_cast<int>((0.5 + 0.499 * share()) * (i + 1)) - 1 : i - 1;
            joint.type = share() > 0.4 ? JointType::Prismatic : JointType::Revolute;
            joint.axis = vector(1.0).normalized();
            joint.placement.translation() = vector(0.3);
            joint.placement.linear() = Eigen::AngleAxisd(3.0 * share(), vector(1.0).normalized()).toRotationMatrix();
        }
        return robot;
    }
    std::vector<LinkCapsule> capsules() {
        std::vector<LinkCapsule> capsules;
        for (int k = 0; k < 10; ++k) {
            LinkCapsule capsule;
            capsule.link = 0;
            capsule.carrier = std::min(k, kJoints) - 1;
            capsule.a = vector(0.25);
            capsule.b = k % 4 == 0 ? capsule.a : vector(0.25);
            capsule.radius = 0.03 + 0.02 * share();
            capsules.push_back(capsule);
        }
        return capsules;
    }
    ArmPath path(const RobotDescription& robot, double size) {
        const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -40.0, 40.0};
        JointVector position(kJoints);
        for (int i = 0; i < kJoints; ++i)
            position[i] = robot.joints[static_cast<std::size_t>(i)].type == JointType::Prismatic ? 0.3 : 2.0;
        return DrawnPath{position, 3.0, 10.0, 40.0, limits}.draw(random_, size, kTick_s);
    }

private:
    std::mt19937 random_;
};

/** A segment's ends as seen from what a joint carries. */
std::array<Eigen::Vector3d, 2> findEnds(const CapsuleMotion::Pose& pose, std::size_t k, int base) {
    std::array<Eigen::Vector3d, 2> ends{pose.segments[k].a, pose.segments[k].b};
    if (base >= 0) {
        const auto at = static_cast<std::size_t>(base);
        for (Eigen::Vector3d& p : ends) p = pose.frames.rotation[at].transpose() * (p - pose.frames.origin[at]);
    }
    return ends;
}

// Levers, accelerations and ways against dense poses of random arms, every capsule from every joint that carries it: never
// too small, and somewhere nearly reached.
TEST(CapsuleMotion, BoundsHoldAtEveryPoseOfThePath) {
    Draw draw(3);
    double leverUse = 0.0, bendUse = 0.0, reachUse = 0.0;
    for (int round = 0; round < 60; ++round) {
        const RobotDescription robot = draw.robot();
        const std::vector<LinkCapsule> capsules = draw.capsules();
        std::vector<double> radii;
        for (const LinkCapsule& capsule : capsules) radii.push_back(capsule.radius);
        CapsuleMotion motion(robot, capsules, radii);
        const ArmRecursion arm(robot);
        const ArmPath path = draw.path(robot, round % 3 == 0 ? 1.0 : round % 3 == 1 ? 0.2 : 0.03);
        std::vector<CapsuleMotion::Pose> poses(kPoses + 1, motion.makePose());
        JointVector q;
        for (int t = 0; t <= kPoses; ++t) {
            path.calcPositions(path.duration() * t / kPoses, q);
            motion.calcPose(q, poses[static_cast<std::size_t>(t)]);
        }
        motion.setPath(calcExtremes(path), poses.front());
        const double step_s = path.duration() / kPoses;
        for (std::size_t k = 0; k < capsules.size(); ++k) {
            const int capsule = static_cast<int>(k);
            for (int i = 0; i < kJoints; ++i) {
                if (!arm.moves(i, capsules[k].carrier)) {
                    EXPECT_EQ(motion.lever(capsule)[i], 0.0);
                    continue;
                }
                if (arm.isPrismatic(i)) continue;
                double farthest = 0.0;
                for (const CapsuleMotion::Pose& pose : poses)
                    for (const Eigen::Vector3d& p : {pose.segments[k].a, pose.segments[k].b}) {
                        const auto at = static_cast<std::size_t>(i);
                        farthest = std::max(farthest, pose.frames.axis[at].cross(p - pose.frames.origin[at]).norm());
                    }
                ASSERT_LE(farthest + radii[k], motion.lever(capsule)[i] + 1e-12);
                leverUse = std::max(leverUse, (farthest + radii[k]) / motion.lever(capsule)[i]);
            }
            for (int base = capsules[k].carrier;; base = arm.parent(base)) {
                const double bend = motion.calcBend(capsule, base);
                std::vector<std::array<Eigen::Vector3d, 2>> ends;
                for (const CapsuleMotion::Pose& pose : poses) ends.push_back(findEnds(pose, k, base));
                for (std::size_t t = 1; t < kPoses; ++t)
                    for (std::size_t end = 0; end < 2; ++end) {
                        const double acceleration =
                            (ends[t - 1][end] - 2.0 * ends[t][end] + ends[t + 1][end]).norm() / (step_s * step_s);
                        ASSERT_LE(acceleration, bend * (1.0 + 1e-6) + 1e-4);
                        if (bend > 1e-3) bendUse = std::max(bendUse, acceleration / bend);
                    }
                for (const std::size_t from : {0, 100, 500, 1000})
                    for (const std::size_t to : {from + 4, from + 40, from + 200}) {
                        const double h = static_cast<double>(to - from) * step_s;
                        const double chord = motion.calcChord(capsule, base, poses[from], poses[to]);
                        const double reach = chord + h * h / 4.0 * bend;
                        for (std::size_t t = from; t <= to; ++t)
                            for (std::size_t end = 0; end < 2; ++end) {
                                const double way =
                                    (ends[t][end] - ends[from][end]).norm() + (ends[to][end] - ends[t][end]).norm();
                                ASSERT_LE(way, reach + 1e-12);
                                if (way > 1e-6) reachUse = std::max(reachUse, way / reach);
                            }
                    }
                if (base < 0) break;
            }
        }
    }
    std::printf("  largest use of the bounds: levers %.4f, accelerations %.4f, ways %.4f\n", leverUse, bendUse,
                reachUse);
    EXPECT_GT(leverUse, 0.999);
    EXPECT_GT(bendUse, 0.8);
    EXPECT_GT(reachUse, 0.99);
}

// A point that swings out and back between two times is where it was at both: only the acceleration tells.
TEST(CapsuleMotion, WhatGoesOutAndComesBackIsSeen) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/single_joint");
    LinkCapsule rod;
    rod.link = 0;
    rod.carrier = 0;
    rod.a.setZero();
    rod.b = 1e3 * robot.joints[0].axis.unitOrthogonal();  // so long that it bends little on its way
    rod.radius = 0.01;
    CapsuleMotion motion(robot, {rod}, {0.01});
    const double v = 1e-3, a = -0.02;  // back after 2 v / |a| = 0.1 s, at most v^2 / 2 |a| rad away
    ArmPath::Extremes extremes;
    extremes.position = JointVector::Constant(1, v * v / -a);
    extremes.velocity = JointVector::Constant(1, v);
    extremes.acceleration = JointVector::Constant(1, -a);
    extremes.jerk = JointVector::Zero(1);
    extremes.travel = JointVector::Constant(1, v * v / -a);
    CapsuleMotion::Pose pose = motion.makePose();
    motion.calcPose(JointVector::Zero(1), pose);
    motion.setPath(extremes, pose);
    const double farthest = 1e3 * v * v / (-2.0 * a), h = -2.0 * v / a;
    const double reach = motion.calcChord(0, -1, pose, pose) + h * h / 4.0 * motion.calcBend(0, -1);
    EXPECT_GE(reach, 2.0 * farthest);
    EXPECT_LE(reach, 2.0 * farthest * 1.06);
}

}  // namespace
}  // namespace viable
