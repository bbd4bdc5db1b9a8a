
#include "Joints.h"
#include "TestArm.h"
#include "loop/SensorCheck.h"

namespace viable {
namespace {

using detail::Authority;
using detail::AuthoritySizes;
using detail::limitMotorStep;
using test::joints;

/** Two joints, twice their friction 3 and 1 Nm and viscous 2 Nm, that may be pushed by 10 and 4 Nm. */
struct AuthorityTest : testing::Test {
    AuthorityTest() {
        arm_.limits.velocity = {joints(-2.0, -2.0), joints(2.0, 2.0)};
        setup_.emplace(arm_.setup());
        arm_.robot.actuation.friction = {joints(1.5, 0.5), joints(1.0, 1.0), joints(0.5, 0.5)};
        authority_ = Authority(*setup_, sizes_);
    }
    /** One tick. Returns what is left of the torque. */
    JointVector tick(const JointVector& wanted, const JointState& real, const MotionState& nominal,
                     bool isStill = false) {
        seen_ = real;
        authority_.update(nominal, seen_);
        JointVector torque = wanted;
        isCut_ = authority_.cut(joints(0, 0), torque);
        std::array<bool, kMaxJoints> still{};
        still[0] = isStill;
        authority_.take(torque, still, joints(1.0, 1.0));
        return torque;
    }

    /** `lasting` has been added to the first joint for long. */
    void reset(double lasting) {
        authority_.reset();
        for (int k = 0; k < 9000; ++k) tick(joints(lasting, 0.0), still_, rest_);
    }

    const AuthoritySizes sizes_{joints(10.0, 4.0), joints(6.0, 2.0), 2.0, joints(20.0, 20.0)};
    TestArm arm_{"planar_two_link"};
    std::optional<RunSetup> setup_;
    Authority authority_;
    JointState seen_;
    bool isCut_ = false;
    const MotionState rest_{joints(0, 0), joints(0, 0), joints(0, 0)};
    const JointState still_{joints(0, 0), joints(0, 0)};
};

TEST_F(AuthorityTest, ChangesNothingWhileNothingIsCut) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    for (int k = 0; k < 2000; ++k) {
        const JointState real{joints(share(random), share(random)), joints(share(random), share(random))};
        const JointVector wanted = joints(10.0 * share(random), 4.0 * share(random));
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
        const JointState real{joints(any(random), any(random)), joints(any(random), any(random))};
        const JointVector torque = tick(joints(any(random), any(random)), real, rest_);
        if (random() % 1000 == 0) authority_.open(0, random() % 2 == 0);
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
        JointVector torque = joints(1e3, 1e3);
        copy.cut(joints(0, 0), torque);
        return torque;
    };
    for (int k = 0; k < 5000; ++k) tick(joints(5.0, 0.0), still_, rest_);  // a payload
    EXPECT_NEAR(most()[0], 5.0 + 3.0 + 10.0, 0.05);
    EXPECT_EQ(most()[1], 1.0 + 4.0);
    for (int k = 0; k < 3000; ++k) EXPECT_NEAR(tick(joints(100.0, 0.0), still_, rest_)[0], 18.0, 0.05);
    EXPECT_NEAR(most()[0], 18.0, 0.05) << "held";
    for (int k = 0; k < 20000; ++k) tick(joints(12.9, 0.0), still_, rest_);
    EXPECT_EQ(most()[0], 6.0 + 3.0 + 10.0) << "no more than that";
}

TEST_F(AuthorityTest, AJointThatWasHeldIsPulledBackNoFasterThanItMayMove) {
    const JointState away{joints(-1.0, 0.0), joints(0.0, 0.0)};
    tick(joints(5.0, 0.0), away, rest_);
    EXPECT_EQ(seen_.q, away.q) << "nothing was cut yet";
    for (int k = 0; k < 5; ++k) tick(joints(1e4, 0.0), away, rest_);
    MotionState nominal = rest_;
    for (const double speed : {0.0, 1.0, -2.0}) {
        nominal.qd[0] = speed;
        tick(joints(1.0, 0.0), away, nominal);
        EXPECT_NEAR(speed - 20.0 * seen_.q[0], 1.02 * 2.0, 1e-9) << speed;  // nominal speed and pull
    }
    tick(joints(1.0, 0.0), still_, rest_);
    tick(joints(1.0, 0.0), away, rest_);
    EXPECT_EQ(seen_.q, away.q) << "it was back";
}

TEST_F(AuthorityTest, WhatIsTakenOffANominalTorqueBeyondTheMotorIsNoPush) {
    const double limit = arm_.robot.actuation.torqueLimit[0];
    JointState seen = still_;
    authority_.update(rest_, seen);
    JointVector torque = joints(-80.0, 0.0);
    EXPECT_FALSE(authority_.cut(joints(limit + 80.0, 0.0), torque));
    torque = joints(-120.0, 0.0);
    EXPECT_TRUE(authority_.cut(joints(limit + 80.0, 0.0), torque));
    EXPECT_DOUBLE_EQ(torque[0], -80.0 - 13.0);
}

// The real joint, of 1 kg m^2, moves under a reading that is stuck. Its dry friction is any up to twice the figure.
TEST_F(AuthorityTest, WhatWasPushedInVainIsTakenBackWithoutAStepAndWithoutThrowingTheJointBack) {
    for (const double dry : {3.0, 1.5, 0.0}) {
        reset(2.0);
        double speed = 0.0, fastest = 0.0, slowest = 0.0, last = 2.0, largestStep = 0.0;
        const auto move = [&](double torque) {
            const double push = torque - 2.0, friction = std::clamp(push + speed / 1e-3, -dry, dry);
            speed += (push - friction) * 1e-3;
            fastest = std::max(fastest, speed);
            slowest = std::min(slowest, speed);
        };
        for (int k = 0; k < 6; ++k) move(last = tick(joints(1e3, 0.0), still_, rest_, true)[0]);
        authority_.open(0, true);
        for (int k = 0; k < 40; ++k) {
            const double torque = tick(joints(2.0, 0.0), still_, rest_)[0];
            move(torque);
            largestStep = std::max(largestStep, std::abs(torque - last));
            last = torque;
        }
        EXPECT_GT(fastest, 0.05);
        EXPECT_LE(speed, (dry > 0.0 ? 0.2 : 0.5) * fastest) << dry;
        EXPECT_GE(slowest, -0.15 * fastest) << dry;
        EXPECT_LE(largestStep, 0.2 * 13.0) << dry;  // of the push
        EXPECT_NEAR(last, 2.0, 1e-6);
    }
}

// What a joint takes that rests, or that somebody leads, was no push in vain.
TEST_F(AuthorityTest, AJointThatRestedOrWasLedIsNotThrown) {
    const auto findLargest = [&] {  // beyond d, in the direction that takes back
        double largest = 0.0;
        for (int k = 0; k < 400; ++k) largest = std::max(largest, 2.0 - tick(joints(2.0, 0.0), still_, rest_)[0]);
        return largest;
    };
    reset(2.0);
    for (int k = 0; k < 60000; ++k) tick(joints(2.3, 0.0), still_, rest_, true);
    authority_.open(0, true);
    EXPECT_LE(findLargest(), 1e-6) << "a minute at rest";
    reset(2.0);
    for (int k = 0; k < 2000; ++k) tick(joints(1e3, 0.0), still_, rest_, false);
    authority_.open(0, true);
    EXPECT_LE(findLargest(), 1e-6) << "led, and cut all the while";
    reset(2.0);
    for (int k = 0; k < 60000; ++k) tick(joints(1e3, 0.0), still_, rest_, true);
    authority_.open(0, false);
    EXPECT_LE(findLargest(), 1e-6) << "a jump says nothing of what was pushed";
    reset(2.0);
    for (int k = 0; k < 60000; ++k) tick(joints(1e3, 0.0), still_, rest_, true);
    double impulse = 0.0;
    authority_.open(0, true);
    for (int k = 0; k < 400; ++k) impulse += std::max(0.0, 2.0 - tick(joints(2.0, 0.0), still_, rest_)[0]);
    EXPECT_LE(impulse, 10.0 * Authority::kTakeBackTicks + 1e-6) << "whatever was pushed";
}

TEST_F(AuthorityTest, WhatIsTakenBackTakesATenthOfASecondOrTwoTicksAtMost) {
    for (const double tick_s : {1e-4, 1e-3, 4e-3, 1e-2, 0.1}) {
        setup_->tick_s = tick_s;
        authority_ = Authority(*setup_, sizes_);
        for (int k = 0; k < 1000; ++k) tick(joints(1e3, 0.0), still_, rest_, true);
        authority_.open(0, true);
        double impulse = 0.0;
        int ticks = 0;
        for (int k = 0; k < 5000; ++k) {
            const double torque = tick(joints(0.0, 0.0), still_, rest_)[0];
            if (k == 0) EXPECT_LT(torque, 13.0) << "it comes down from the first tick on";
            impulse += std::min(0.0, torque);
            if (std::abs(torque) > 1e-9) ticks = k + 1;
        }
        EXPECT_LE(ticks, std::max(2.0, 0.1 / tick_s + 1e-6)) << tick_s;
        EXPECT_LT(impulse, 0.0) << tick_s;
        EXPECT_GE(impulse, -10.0 * ticks) << tick_s;
    }
}

TEST_F(AuthorityTest, TellsWhatAJointThatReadsTheSameMustHaveDone) {
    reset(0.0);
    for (int k = 0; k < 1000; ++k) tick(joints(5.9, 1.9), still_, rest_, true);
    EXPECT_EQ(authority_.impliedTravel(0), 0.0) << "twice its dry friction, both ways, may hold it";
    reset(0.0);
    for (int k = 0; k < 5; ++k) {
        EXPECT_FALSE(authority_.isPressed(0)) << k;
        tick(joints(1e3, 0.0), still_, rest_, true);
    }
    EXPECT_TRUE(authority_.isPressed(0));
    EXPECT_NEAR(authority_.impliedTravel(0), 7.0 * 15 * 1e-6, 1e-12);  // 13 less 6 Nm on 1 kg m^2, 5 ticks
    tick(joints(1e3, 0.0), still_, rest_, false);
    EXPECT_FALSE(authority_.isPressed(0)) << "it moved";
    EXPECT_EQ(authority_.impliedTravel(0), 0.0);
    reset(0.0);
    for (int k = 0; k < 50; ++k) tick(joints(7.9, 0.0), still_, rest_, true);
    EXPECT_FALSE(authority_.isPressed(0)) << "less than half of its reach beside friction";
    for (const double way : {1.0, -1.0}) {
        reset(-2.25 * way);  // dry friction, half more than the figure
        for (int k = 0; k < 50; ++k) {
            tick(joints(way * (-2.25 + 3.0 + 6.5), 0.0), still_, rest_, true);
            EXPECT_FALSE(authority_.isPressed(0)) << "friction turns round, too: " << k;
        }
        reset(-2.25 * way);
        for (int k = 0; k < 5; ++k) tick(joints(way * (3.0 + 5.1), 0.0), still_, rest_, true);
        EXPECT_TRUE(authority_.isPressed(0));
    }
    arm_.robot.actuation.friction.coulomb[0] = 2.6;  // its reach of 10 Nm is less than four times that
    authority_ = Authority(*setup_, sizes_);
    reset(-5.3);
    for (int k = 0; k < 500; ++k) tick(joints(1e3, 0.0), still_, rest_, true);
    EXPECT_FALSE(authority_.isPressed(0)) << "so much friction may hold it (MATH 11)";
    arm_.robot.actuation.friction.coulomb[0] = 1.5;
    authority_ = Authority(*setup_, sizes_);
    for (const double after : {4.0, 0.0, -2.9, -5.9, 10.9}) {
        reset(5.0);
        for (int k = 0; k < 1000; ++k) tick(joints(after, 0.0), still_, rest_, true);
        EXPECT_EQ(authority_.impliedTravel(0), 0.0) << "what lasted may be gone: " << after;
    }
    reset(5.0);
    tick(joints(-6.1, 0.0), still_, rest_, true);
    EXPECT_LT(authority_.impliedTravel(0), 0.0);
    EXPECT_TRUE(authority_.hasAdded(0));
    EXPECT_FALSE(authority_.hasAdded(1));
}

TEST_F(AuthorityTest, WhatIsAddedGivesWayToTheMotorsRate) {
    JointVector added = joints(5.0, 0.1);
    limitMotorStep(joints(1.0, 0.3), joints(2.0, 0.25), joints(0.5, 0.5), added);
    EXPECT_EQ(added, joints(1.5, 0.1)) << "the second changes in no bit";
    limitMotorStep(joints(9.0, 0.3), joints(2.0, 0.25), joints(0.5, 0.0), added);
    EXPECT_EQ(added, joints(-6.5, 0.25 - 0.3));
}

TEST_F(AuthorityTest, WiderLimitsCountUntilTheReset) {
    const auto findFriction = [&] {  // at all the speed that counts
        for (int k = 0; k < 200; ++k) tick(joints(1e3, 0.0), {joints(0, 0), joints(100.0, 0.0)}, rest_);
        return tick(joints(1e3, 0.0), {joints(0, 0), joints(100.0, 0.0)}, rest_)[0] - 10.0;
    };
    const auto calcFigure = [](double speed) { return 3.0 + 2.0 * (1.0 - std::exp(-speed / 0.5)); };
    EXPECT_NEAR(findFriction(), calcFigure(2.0), 1e-6);
    arm_.limits.velocity = {joints(-2.0, -2.0), joints(3.0, 2.0)};
    authority_.widen(arm_.limits);
    EXPECT_NEAR(findFriction(), calcFigure(3.0), 1e-6);
    authority_.reset();
    EXPECT_NEAR(findFriction(), calcFigure(2.0), 1e-6);
    Authority().widen(arm_.limits);  // one without limits has none to widen
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

/** Readings of one joint: what a check makes of them. */
struct SensorCheckTest : testing::Test {
    void begin(double largestGrowth) {
        const JointVector any = JointVector::Constant(1, kInfinity);
        const auto of = [](double value) { return JointVector(JointVector::Constant(1, value)); };
        check_.begin({SensorCheck::Reference::LastReading, of(0.01), any, any, of(1e-6), of(2e-5), of(largestGrowth)},
                     of(0.0));
        nominal_ = {of(0.0), of(0.0), of(0.0)};
        real_ = {of(0.0), of(0.0)};
    }
    /** The reading, and the nominal joint, after one tick. */
    void take(double q, double nominal) {
        real_.q[0] = q;
        nominal_.q[0] = nominal;
        check_.take(0, real_, nominal_);
    }
    bool isPlausible(double q) {
        real_.q[0] = q;
        return check_.isPlausible(0, real_, nominal_);
    }
    SensorCheck check_;
    MotionState nominal_;
    JointState real_;
};

TEST_F(SensorCheckTest, AReadingThatStopsAtOnceIsSuspectOnlyWhereTheNominalJointGoesOnThatWay) {
    for (const double side : {1.0, -1.0})
        for (const double on : {1.0, 0.0, -1.0}) {  // onwards, stops as well, goes back
            for (const double step : {5e-5, 1e-5}) {
                begin(0.0);
                for (int k = 1; k <= 20; ++k) take(side * step * k, side * step * k);
                EXPECT_FALSE(check_.isSuspect(0));
                for (int k = 1; k <= 4; ++k) take(side * step * 20, side * (step * 20 + on * 5e-5 * k));
                EXPECT_EQ(check_.isSuspect(0), on > 0.0 && step > 2e-5) << side << " " << on << " " << step;
                EXPECT_NEAR(check_.lastStep(0), step, 1e-15);
                EXPECT_EQ(check_.findStillTravel(0), 0.0) << "after 4 ticks";
                take(side * step * 20, side * (step * 20 + on * 5e-5 * 5));
                EXPECT_NEAR(check_.findStillTravel(0), std::abs(on) * 5e-5 * 5, 1e-12);
            }
        }
}

TEST_F(SensorCheckTest, TicksWithoutAReadingMakeNoMotionOfASlowJointAndNoFault) {
    begin(0.0);
    for (int k = 1; k <= 20; ++k) {  // 1e-5 a tick, every tenth is read
        check_.miss(9);
        take(1e-4 * k, 1e-4 * k);
    }
    take(2e-3, 2e-3 + 1e-4);
    EXPECT_FALSE(check_.isSuspect(0)) << "1e-5 in a tick is slow";
    EXPECT_EQ(check_.stillTicks(0), 1);
    check_.miss(100);
    EXPECT_EQ(check_.stillTicks(0), 1) << "no news is no change";
    EXPECT_TRUE(isPlausible(2e-3 + 0.9));
    EXPECT_FALSE(isPlausible(2e-3 + 1.02));
}

TEST_F(SensorCheckTest, WhatSwingsMayDoMoreUpToAnEnd) {
    for (const double most : {0.0, 0.5}) {
        begin(most);
        take(0.005, 0.0);
        EXPECT_EQ(isPlausible(0.005 + 0.1), most > 0.0) << "30 times 0.005";
        EXPECT_FALSE(isPlausible(0.005 + 0.17));
        take(0.105, 0.0);
        EXPECT_EQ(isPlausible(0.105 + 0.5), most > 0.0);
        EXPECT_FALSE(isPlausible(0.105 + 0.52)) << "not 3 rad";
        EXPECT_NEAR(check_.largestChange(0), 0.01 + most, 1e-12);
        begin(most);
        check_.miss(99);
        take(0.1, 0.0);
        EXPECT_FALSE(isPlausible(0.1 + 0.05)) << "0.1 in 100 ticks is no swing";
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
