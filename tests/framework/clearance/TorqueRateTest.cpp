#include "clearance/TorqueScan.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "DrawnPath.h"
#include "SlidingArm.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;

// On random stops, from the edge of the limits and slower ones: the torque never changes faster than the bound, and the bound
// is not absurdly large.
TEST(TorqueRate, IsNeverExceededFromTickToTick) {
    std::mt19937 random(1);
    for (const RobotDescription& robot :
         {loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"), loadRobot(VIABLE_SOURCE_DIR "/robots/panda"),
          withPayload(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"), 7.0, {0.0, 0.0, 0.1}), makeSlidingArm()}) {
        const int n = robot.size();
        const ArmRecursion arm(robot);
        const detail::TorqueRate rate(robot);
        double largestUse = 0.0, ticks = 0.0, skipped = 0.0;
        for (int round = 0; round < 300; ++round) {
            const double size = round % 3 == 0 ? 1.0 : round % 3 == 1 ? 0.3 : 0.02;
            const AxisLimits limits{-3.0, 3.0, -2.5, 2.5, -12.0, 12.0, -40.0, 40.0};
            const detail::ArmPath path =
                DrawnPath{JointVector::Constant(n, 3.0), 2.5, 12.0, 40.0, limits}.draw(random, size, kTick_s);
            JointVector bound, q, qd, qdd, tau, before;
            rate.calcBound(calcExtremes(path), bound);
            for (std::int64_t tick = 0; tick <= path.ticks(); ++tick) {
                path.calcTick(tick, q, qd, qdd);
                arm.calcTorque(q, qd, qdd, tau);
                if (tick > 0) {
                    const JointVector use = ((tau - before) / kTick_s).cwiseAbs().cwiseQuotient(bound);
                    largestUse = std::max(largestUse, use.maxCoeff());
                    ticks += 1.0;
                    skipped += (0.2 * robot.actuation.torqueLimit).cwiseQuotient(bound * kTick_s).minCoeff();
                }
                before = tau;
            }
        }
        std::printf("  %s: at most %.3f of the bound; %.1f ticks to a fifth of the motors' torque\n",
                    robot.name.c_str(), largestUse, skipped / ticks);
        EXPECT_LE(largestUse, 1.0);
        EXPECT_GT(largestUse, 0.1);
    }
}

// The same for the torques of two paths, the second one branching off from the first: at no tick farther apart than the bound;
// and positions, velocities and accelerations as far apart as told, but for a little.
TEST(TorqueRate, TwoPathsAreNoFartherApartThanTold) {
    std::mt19937 random(2);
    for (const RobotDescription& robot : loadArms()) {
        const int n = robot.size();
        const ArmRecursion arm(robot);
        const detail::TorqueRate rate(robot);
        double largestUse = 0.0, apartUse = 0.0;
        for (int round = 0; round < 300; ++round) {
            const double size = round % 3 == 0 ? 1.0 : round % 3 == 1 ? 0.3 : 0.02;
            const AxisLimits limits{-3.0, 3.0, -2.5, 2.5, -12.0, 12.0, -40.0, 40.0};
            const DrawnPath drawn{JointVector::Constant(n, 3.0), 2.5, 12.0, 40.0, limits};
            const detail::ArmPath first = drawn.draw(random, size, kTick_s);
            const std::int64_t begin = round % 2 == 0 ? 1 : round % 50;
            const detail::ArmPath second = drawn.branchOff(first, begin, random, kTick_s);
            detail::ArmPath::Difference apart;
            second.calcDifference(first, begin, apart);
            detail::ArmPath::Extremes both = calcExtremes(second);
            both.position += apart.position;
            both.velocity += apart.velocity;
            both.acceleration += apart.acceleration;
            JointVector bound, q, qd, qdd, tau, wasQ, wasQd, wasQdd, was, largest = JointVector::Zero(n);
            rate.calcDifference(both, apart, bound);
            const std::int64_t last = std::max(first.ticks() - begin, second.ticks());
            for (std::int64_t tick = 0; tick <= last; ++tick) {
                second.calcTick(tick, q, qd, qdd);
                first.calcTick(tick + begin, wasQ, wasQd, wasQdd);
                ASSERT_TRUE(((q - wasQ).cwiseAbs().array() <= apart.position.array() + 1e-12).all());
                ASSERT_TRUE(((qd - wasQd).cwiseAbs().array() <= apart.velocity.array() + 1e-11).all());
                ASSERT_TRUE(((qdd - wasQdd).cwiseAbs().array() <= apart.acceleration.array() + 1e-10).all());
                largest = largest.cwiseMax((q - wasQ).cwiseAbs());
                arm.calcTorque(q, qd, qdd, tau);
                arm.calcTorque(wasQ, wasQd, wasQdd, was);
                largestUse = std::max(largestUse, (tau - was).cwiseAbs().cwiseQuotient(bound).maxCoeff());
            }
            apartUse += largest.sum() / apart.position.sum() / 300.0;
        }
        std::printf("  %s: at most %.3f of the bound; positions apart by %.3f of what is told\n", robot.name.c_str(),
                    largestUse, apartUse);
        EXPECT_LE(largestUse, 1.0);
        EXPECT_GT(largestUse, 0.1);
        EXPECT_GT(apartUse, 0.8);
    }
}

// Looks at stops until the torques of a tick are used up: what is not found good fails by its rate, where that is looked at. The joint
// that mends it is the one that leaves the least change when it alone moves as on another path, less than there is.
TEST(TorqueRate, WhatIsNotProvenFailsByRateAndTheJointThatIsNamedMendsIt) {
    std::mt19937 random(3);
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const int n = robot.size();
    const ArmRecursion arm(robot);
    const AxisLimits limits{-3.0, 3.0, -2.5, 2.5, -12.0, 12.0, -40.0, 40.0};
    const DrawnPath drawn{JointVector::Constant(n, 3.0), 2.5, 12.0, 40.0, limits};
    const JointVector none = JointVector::Constant(n, kInfinity), jerk = JointVector::Zero(n), otherJerk = none,
                      limit = 0.5 * robot.actuation.torqueLimit;
    const detail::TorqueRate rate(robot);
    detail::TorqueScan scan(robot, {none, limit}, kTick_s);
    detail::TorqueScan::Result result;
    int counts[4] = {};  // failed, too long, and of the failed ones: mended by a joint, by none
    for (int k = 0; k < 20000; ++k) {
        if (k % 20 == 0) scan.beginTick();
        const detail::ArmPath path = drawn.draw(random, k % 2 == 0 ? 0.5 : 0.02, kTick_s),
                              other = drawn.branchOff(path, 0, random, kTick_s);
        JointVector last, bound;
        scan.calcTorque(path, 0, last);
        result.proven = none;
        rate.calcBound(calcExtremes(path), bound);
        if ((bound.array() <= limit.array()).all()) continue;
        scan.scan(path, calcExtremes(path), 1.0, last, nullptr, 0, result);
        ASSERT_EQ(result.bearsTorque, !scan.failsByRate()) << k;
        if (result.bearsTorque) continue;
        ++counts[scan.faultCount() > 0 ? 0 : 1];
        if (k % 20 != 0 || scan.faultCount() == 0) continue;  // of the first all can be looked at
        const detail::TorqueScan::Fault fault = scan.fault(0);
        int expected = -1;
        double least = std::abs(fault.value);
        for (int i = 0; i < n; ++i) {
            JointVector q[2], qd[2], qdd[2], tau[2];
            for (int t = 0; t < 2; ++t) {
                path.calcTick(fault.tick - 1 + t, q[0], qd[0], qdd[0]);
                other.calcTick(std::min(fault.tick - 1 + t, other.ticks()), q[1], qd[1], qdd[1]);
                q[0][i] = q[1][i], qd[0][i] = qd[1][i], qdd[0][i] = qdd[1][i];
                arm.calcTorque(q[0], qd[0], qdd[0], tau[t]);
            }
            const double left = std::abs((tau[1] - tau[0])[fault.joint]);
            if (left < least) expected = i, least = left;
        }
        ASSERT_EQ(scan.findWorstJoint(path, jerk, other, otherJerk), expected) << k;
        ++counts[expected < 0 ? 3 : 2];
    }
    for (const int count : counts) EXPECT_GT(count, 5);
}

}  // namespace
}  // namespace viable
