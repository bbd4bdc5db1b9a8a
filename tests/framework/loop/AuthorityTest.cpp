#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "TestArm.h"
#include "loop/Authority.h"
#include "viable/core/Numbers.h"

namespace viable {
namespace {

using detail::Authority;
using detail::AuthoritySizes;

JointVector pair(double a, double b) {
    JointVector v(2);
    v << a, b;
    return v;
}

/** Two joints, twice their friction 3 and 1 Nm and viscous 2 Nm, that may be pushed by 10 and 4 Nm. */
class AuthorityTest : public testing::Test {
protected:
    AuthorityTest() {
        arm_.limits.velocity = {pair(-2.0, -2.0), pair(2.0, 2.0)};
        setup_.emplace(arm_.setup());
        arm_.robot.actuation.friction = {pair(1.5, 0.5), pair(1.0, 1.0), pair(0.5, 0.5)};
        authority_ = Authority(*setup_, {pair(10.0, 4.0), pair(6.0, 2.0), 2.0, pair(20.0, 20.0)});
    }
    /** One tick. Returns what is left of the torque. */
    JointVector tick(const JointVector& wanted, const JointState& real, const MotionState& nominal,
                     bool isStill = false) {
        seen_ = real;
        authority_.update(nominal, seen_);
        JointVector torque = wanted;
        isCut_ = authority_.cut(pair(0, 0), torque);
        std::array<bool, kMaxJoints> still{};
        still[0] = isStill;
        authority_.take(torque, still, pair(1.0, 1.0));
        return torque;
    }

    TestArm arm_{"planar_two_link"};
    std::optional<RunSetup> setup_;
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
        const JointVector wanted = pair(10.0 * share(random), 4.0 * share(random));
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
        if (random() % 1000 == 0) authority_.open(0);
        if (random() % 2000 == 0) authority_.reset();
        // lasting + friction at the velocity limit + reach
        const double friction = 3.0 + 2.0 * (1.0 - std::exp(-2.0 / 0.5));
        ASSERT_LE(std::abs(torque[0]), 6.0 + friction + 10.0 + 1e-12);
        largest = std::max(largest, std::abs(torque[0]));
    }
    EXPECT_GT(largest, 13.0);
}

TEST_F(AuthorityTest, WhatFreeMotionNeedsForLongerIsLearntAndWhatIsCutIsNot) {
    const auto most = [&] {  // of a joint at rest, seen on a copy
        Authority copy = authority_;
        JointState seen = still_;
        copy.update(rest_, seen);
        JointVector torque = pair(1e3, 1e3);
        copy.cut(pair(0, 0), torque);
        return torque;
    };
    for (int k = 0; k < 5000; ++k) tick(pair(5.0, 0.0), still_, rest_);  // a payload
    EXPECT_NEAR(most()[0], 5.0 + 3.0 + 10.0, 0.05);
    EXPECT_EQ(most()[1], 1.0 + 4.0);
    for (int k = 0; k < 3000; ++k) EXPECT_NEAR(tick(pair(100.0, 0.0), still_, rest_)[0], 18.0, 0.05);
    EXPECT_NEAR(most()[0], 18.0, 0.05) << "held";
    for (int k = 0; k < 20000; ++k) tick(pair(12.9, 0.0), still_, rest_);
    EXPECT_EQ(most()[0], 6.0 + 3.0 + 10.0) << "no more than that";
}

TEST_F(AuthorityTest, AJointThatWasHeldIsPulledBackNoFasterThanItMayMove) {
    const JointState away{pair(-1.0, 0.0), pair(0.0, 0.0)};
    tick(pair(5.0, 0.0), away, rest_);
    EXPECT_EQ(seen_.q, away.q) << "nothing was cut yet";
    for (int k = 0; k < 5; ++k) tick(pair(1e4, 0.0), away, rest_);
    MotionState nominal = rest_;
    for (const double speed : {0.0, 1.0, -2.0}) {
        nominal.qd[0] = speed;
        tick(pair(1.0, 0.0), away, nominal);
        EXPECT_NEAR(speed - 20.0 * seen_.q[0], 1.02 * 2.0, 1e-9) << speed;  // nominal speed and pull
    }
    tick(pair(1.0, 0.0), still_, rest_);
    tick(pair(1.0, 0.0), away, rest_);
    EXPECT_EQ(seen_.q, away.q) << "it was back";
}

TEST_F(AuthorityTest, WhatIsTakenOffANominalTorqueBeyondTheMotorIsNoPush) {
    const double limit = arm_.robot.actuation.torqueLimit[0];
    JointState seen = still_;
    authority_.update(rest_, seen);
    JointVector torque = pair(-80.0, 0.0);
    EXPECT_FALSE(authority_.cut(pair(limit + 80.0, 0.0), torque));
    torque = pair(-120.0, 0.0);
    EXPECT_TRUE(authority_.cut(pair(limit + 80.0, 0.0), torque));
    EXPECT_DOUBLE_EQ(torque[0], -80.0 - 13.0);
}

TEST_F(AuthorityTest, WhatWasPushedInVainIsTakenBackInFullAndWithoutAStep) {
    for (int k = 0; k < 9000; ++k) tick(pair(2.0, 0.0), still_, rest_);
    double impulse = 0.0, last = 2.0;
    for (int k = 0; k < 6; ++k) {
        last = tick(pair(1e3, 0.0), still_, rest_, true)[0];
        impulse += last - 2.0;
    }
    authority_.open(0);
    double largestStep = 0.0;
    for (int k = 0; k < 40; ++k) {
        const double torque = tick(pair(2.0, 0.0), still_, rest_)[0];
        impulse += torque - 2.0;
        largestStep = std::max(largestStep, std::abs(torque - last));
        last = torque;
    }
    EXPECT_NEAR(impulse, 0.0, 0.6);      // of some 66 Nm ticks
    EXPECT_LE(largestStep, 0.2 * 11.0);  // of the push
    EXPECT_NEAR(last, 2.0, 1e-6);
}

TEST(AuthoritySizes, FollowFromMotorAndFriction) {
    for (const char* name : {"indy7", "panda", "ur5e", "planar_two_link"}) {
        TestArm arm(name);
        const RunSetup setup = arm.setup();
        const AuthoritySizes sizes = detail::calcAuthority(setup, nullptr, nullptr);
        const Authority authority(setup, sizes);
        for (int i = 0; i < arm.size(); ++i) {
            const double motor = arm.robot.actuation.torqueLimit[i];
            EXPECT_GE(sizes.reach[i], motor / 8.0 - 1e-9);
            EXPECT_LE(sizes.reach[i], motor / 4.0 + 1e-9);
            if (2.0 * arm.robot.actuation.friction.coulomb[i] < motor / 8.0)
                EXPECT_NEAR(authority.calcRest(i), motor / 4.0, 1e-9);
        }
    }
}

// A motor without a figure has no end, and neither has what is added to it.
TEST(AuthoritySizes, OfAMotorWithoutALimitAreInfinite) {
    TestArm arm("planar_two_link");
    arm.robot.actuation.torqueLimit[1] = kInfinity;
    const RunSetup setup = arm.setup();
    const Authority authority(setup, detail::calcAuthority(setup, nullptr, nullptr));
    EXPECT_TRUE(authority.limits(0));
    EXPECT_FALSE(authority.limits(1));
}

}  // namespace
}  // namespace viable
