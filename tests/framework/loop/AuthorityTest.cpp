#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "Paths.h"
#include "loop/Authority.h"
#include "viable/core/Numbers.h"

namespace viable {
namespace {

using detail::Authority;

constexpr double kTick_s = 1e-3;

/** Two joints, friction of 3 and 1 Nm and viscous 2 Nm, that may be pushed by 10 and 4 Nm. */
class AuthorityTest : public testing::Test {
protected:
    AuthorityTest() {
        sizes_.reach = pair(10.0, 4.0);
        sizes_.lasting = pair(6.0, 2.0);
        sizes_.friction = {pair(3.0, 1.0), pair(2.0, 2.0), pair(0.5, 0.5)};
        limits_.velocity = {pair(-2.0, -2.0), pair(2.0, 2.0)};
        loop_.kp = pair(20.0, 20.0);
        authority_.begin(sizes_, limits_, &loop_, kTick_s);
    }
    static JointVector pair(double a, double b) {
        JointVector v(2);
        v << a, b;
        return v;
    }
    /** One tick. Returns what is left of the torque. */
    JointVector tick(const JointVector& wanted, const JointState& real, const MotionState& nominal) {
        seen_ = real;
        authority_.update(nominal, seen_);
        JointVector torque = wanted;
        isCut_ = authority_.cut(torque);
        return torque;
    }

    detail::AuthoritySizes sizes_;
    JointLimits limits_ = JointLimits::unlimited(2);
    LinearErrorLoop loop_;
    Authority authority_;
    JointState seen_;
    bool isCut_ = false;
    const MotionState rest_{pair(0, 0), pair(0, 0), pair(0, 0)};
    const JointState still_{pair(0, 0), pair(0, 0)};
};

TEST_F(AuthorityTest, ChangesNothingWhileNothingIsCut) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    for (int k = 0; k < 2000; ++k) {
        const JointState real{pair(share(random), share(random)), pair(share(random), share(random))};
        const JointVector wanted = pair(3.9 * share(random), 1.9 * share(random));
        EXPECT_EQ(tick(wanted, real, rest_), wanted);
        EXPECT_EQ(seen_.q, real.q);
        EXPECT_EQ(seen_.qd, real.qd);
        ASSERT_FALSE(isCut_);
    }
}

TEST_F(AuthorityTest, NothingTakesTheTorqueBeyondWhatItSays) {
    std::mt19937 random(2);
    std::normal_distribution<double> any(0.0, 1e3);
    double largest = 0.0;
    for (int k = 0; k < 20000; ++k) {
        const JointState real{pair(any(random), any(random)), pair(any(random), any(random))};
        const JointVector torque = tick(pair(any(random), any(random)), real, rest_);
        // lasting + friction at the velocity limit + reach
        const double friction = 3.0 + 2.0 * (1.0 - std::exp(-2.0 / 0.5));
        ASSERT_LE(std::abs(torque[0]), 6.0 + friction + 10.0 + 1e-12);
        ASSERT_GE(torque[0], authority_.lowest()[0]);
        ASSERT_LE(torque[0], authority_.highest()[0]);
        largest = std::max(largest, std::abs(torque[0]));
    }
    EXPECT_GT(largest, 13.0);
}

TEST_F(AuthorityTest, WhatFreeMotionNeedsForLongerIsLearntAndWhatIsCutIsNot) {
    for (int k = 0; k < 3000; ++k) tick(pair(8.0, 0.0), still_, rest_);  // a payload: 5 Nm beyond friction
    EXPECT_NEAR(authority_.lasting()[0], 5.0, 0.05);
    EXPECT_EQ(authority_.lasting()[1], 0.0);
    for (int k = 0; k < 3000; ++k) EXPECT_NEAR(tick(pair(100.0, 0.0), still_, rest_)[0], 18.0, 0.05);
    EXPECT_NEAR(authority_.lasting()[0], 5.0, 0.05) << "held";
    for (int k = 0; k < 20000; ++k) tick(pair(12.9, 0.0), still_, rest_);
    EXPECT_EQ(authority_.lasting()[0], 6.0) << "no more than that";
}

TEST_F(AuthorityTest, AJointThatWasHeldIsPulledBackNoFasterThanItMayMove) {
    const JointState away{pair(-1.0, 0.0), pair(0.0, 0.0)};
    tick(pair(5.0, 0.0), away, rest_);
    EXPECT_EQ(seen_.q, away.q) << "nothing was cut yet";
    tick(pair(1e4, 0.0), away, rest_);
    EXPECT_TRUE(authority_.isHeld(0));
    EXPECT_FALSE(authority_.isHeld(1));
    MotionState nominal = rest_;
    for (const double speed : {0.0, 1.0, -2.0}) {
        nominal.qd[0] = speed;
        tick(pair(1.0, 0.0), away, nominal);
        EXPECT_LE(speed - 20.0 * seen_.q[0], 1.02 * 2.0 + 1e-12) << speed;  // nominal speed and pull
        EXPECT_NEAR(speed - 20.0 * seen_.q[0], 1.02 * 2.0, 1e-9) << speed;
    }
    tick(pair(1.0, 0.0), still_, rest_);
    EXPECT_FALSE(authority_.isHeld(0)) << "it is back";
}

TEST(AuthoritySizes, FollowFromMotorAndFriction) {
    for (const char* name : {"indy7", "panda", "ur5e", "planar_two_link"}) {
        const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name);
        LinearErrorLoop loop;
        loop.kr.setConstant(robot.size(), 0.0);
        loop.kp = loop.kr;
        const auto sizes = detail::calcAuthority(robot, robot.limits, kTick_s, &loop, nullptr);
        for (int i = 0; i < robot.size(); ++i) {
            const double motor = robot.actuation.torqueLimit[i];
            EXPECT_GE(sizes.reach[i], motor / 8.0 - 1e-9);
            EXPECT_LE(sizes.reach[i], motor / 4.0 + 1e-9);
            if (2.0 * robot.actuation.friction.coulomb[i] < motor / 8.0)
                EXPECT_NEAR(sizes.reach[i] + 2.0 * robot.actuation.friction.coulomb[i], motor / 4.0, 1e-9);
        }
    }
}

}  // namespace
}  // namespace viable
