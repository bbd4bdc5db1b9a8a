#include "clearance/SpeedCheck.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "DrawnPath.h"
#include "SlidingArm.h"
#include "limits/PointSpeedLimit.h"

namespace viable {
namespace {

using detail::ArmPath;
using detail::SpeedCheck;

constexpr double kTick_s = 1e-3;

ArmPath drawPath(int n, std::mt19937& random, double size, double jerk) {
    const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -jerk, jerk};
    return DrawnPath{JointVector::Constant(n, 1.5), 3.0, 10.0, jerk, limits}.draw(random, size, kTick_s);
}

/** The largest speed of points on the capsules' surfaces, by differences of places. */
double sampleSpeed(const RobotDescription& robot, const ArmGeometry& geometry, const ArmPath& path, double t,
                   std::mt19937& random) {
    constexpr double kStep_s = 1e-5;
    constexpr int kPoints = 40;
    const ArmRecursion arm(robot);
    ArmRecursion::Frames before, after;
    JointVector q;
    path.calcPositions(t - kStep_s, q);
    arm.calcFrames(q, before);
    path.calcPositions(t + kStep_s, q);
    arm.calcFrames(q, after);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> share(0.0, 1.0);
    double most = 0.0;
    for (const LinkCapsule& capsule : geometry.capsules) {
        if (capsule.carrier < 0) continue;
        const auto k = static_cast<std::size_t>(capsule.carrier);
        for (int point = 0; point < kPoints; ++point) {
            const double s = point % 3 == 0 ? 0.0 : point % 3 == 1 ? 1.0 : share(random);
            const Eigen::Vector3d out(normal(random), normal(random), normal(random));
            const Eigen::Vector3d p = capsule.a + s * (capsule.b - capsule.a) + capsule.radius * out.normalized();
            const Eigen::Vector3d way =
                after.origin[k] + after.rotation[k] * p - before.origin[k] - before.rotation[k] * p;
            most = std::max(most, way.norm() / (2.0 * kStep_s));
        }
    }
    return most;
}

// What is proven along a path against code that shares none of it, at a thousand times of the path: never too little, and not
// far off. And that code against points on the surfaces, by differences of their places.
TEST(SpeedCheck, NoPointIsFasterThanIsProvenAtAnyTime) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    for (RobotDescription robot : loadArms()) {
        const ArmGeometry geometry = loadArmGeometry(robot);
        const int n = robot.size();
        double tooLittle = 0.0, farthest = 0.0, sampled = 0.0;
        int inRegion = 0;
        constexpr int kPaths = 200, kTimes = 1000;
        for (int round = 0; round < kPaths; ++round) {
            robot.speedLimits = {};
            robot.speedLimits.arm = 0.25;
            if (round % 4 == 1) robot.speedLimits = {kInfinity, 0.25, {}};
            if (round % 4 >= 2) {
                const Eigen::Vector3d centre(share(random), share(random), share(random));
                const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5);
                robot.speedLimits.regions.push_back({"box", centre - half, centre + half, 0.05});
            }
            SpeedCheck check(robot, &geometry, kTick_s);
            const detail::PointSpeedLimit checker(robot, &geometry);
            const ArmPath path = drawPath(n, random,
                                          round % 3 == 0   ? 1.0
                                          : round % 3 == 1 ? 0.2
                                                           : 0.02,
                                          round % 2 == 0 ? 40.0 : 4000.0);
            SpeedCheck::Result result;
            check.beginTick();
            check.examine(path, calcExtremes(path), {kInfinity, kInfinity, kInfinity}, false, result);
            EXPECT_TRUE(result.isKept);
            double most = 0.0;
            JointVector q, qd;
            for (int k = 0; k <= kTimes; ++k) {
                // Half of them where the path begins: there it is fast.
                const double t = path.duration() * (k % 2 == 0 ? k : 0.1 * k) / kTimes;
                path.calcMotion(t, q, qd);
                const detail::PointSpeedLimit::Fastest found = checker.find(q, qd);
                most = std::max(most, found.use);
                if (k % 100 != 3 || robot.speedLimits.arm == kInfinity) continue;
                const double speed = sampleSpeed(robot, geometry, path, t, random);
                if (speed < 1e-3) continue;
                sampled = std::max(sampled, speed / found.speed);
            }
            tooLittle = std::max(tooLittle, most - result.proven * (1.0 + 1e-12));
            if (most > 0.6) farthest = std::max(farthest, result.proven / most);
            inRegion += !robot.speedLimits.regions.empty() && result.fastest.limit == 0.05;
            EXPECT_GE(result.proven, result.seen - 1e-12);
        }
        std::printf(
            "  %s: proven at most %.3f times what was seen, never less (%.1g); points at most %.6f of the judge's "
            "speed; %d "
            "paths judged in a region\n",
            robot.name.c_str(), farthest, tooLittle, sampled, inRegion);
        EXPECT_LE(tooLittle, 1e-12);
        EXPECT_LT(farthest, 1.05);
        EXPECT_LT(sampled, 1.0 + 1e-6);
        EXPECT_GT(sampled, 0.95);
        EXPECT_GT(inRegion, 5);
    }
}

// Two joints whose motions cancel at the tip: when one stops before the other the tip becomes faster than it was at first.
TEST(SpeedCheck, AStopAlongWhichAPointBecomesFasterIsNotTakenForSlow) {
    RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    robot.speedLimits.arm = 0.25;
    const ArmGeometry geometry = loadArmGeometry(robot);
    const int n = robot.size();
    SpeedCheck check(robot, &geometry, kTick_s);
    const detail::PointSpeedLimit checker(robot, &geometry);
    MotionState s{robot.home, JointVector::Zero(n), JointVector::Zero(n)};
    std::mt19937 random(2);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    int rising = 0;
    for (int round = 0; round < 3000; ++round) {
        for (int i = 0; i < n; ++i) {
            s.q[i] = 1.5 * share(random);
            s.qd[i] = 0.5 * share(random);
        }
        std::array<GridStop, kMaxJoints> stops;
        for (int i = 0; i < n; ++i) {  // joints that stop at very different times
            const double jerk = i % 2 == 0 ? 4.0 : 400.0;
            const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -jerk, jerk, -jerk, jerk};
            stops[static_cast<std::size_t>(i)] = planStop(s, i, 0.0, limits, kTick_s);
        }
        ArmPath path;
        path.set(s, JointVector::Zero(n), stops, kTick_s);
        const double first = checker.find(s.q, s.qd).use;
        double most = 0.0;
        JointVector q, qd;
        for (int k = 0; k <= 400; ++k) {
            path.calcMotion(path.duration() * k / 400, q, qd);
            most = std::max(most, checker.find(q, qd).use);
        }
        if (!(first < 0.97 && most > 1.0)) continue;
        ++rising;
        SpeedCheck::Result result;
        check.beginTick();
        check.examine(path, calcExtremes(path), {}, round % 2 == 0, result);
        EXPECT_FALSE(result.isKept) << round << ": " << first << " rises to " << most;
    }
    EXPECT_GT(rising, 20);
}

}  // namespace
}  // namespace viable
