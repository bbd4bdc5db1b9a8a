#include "loop/FollowingWatch.h"

#include "TestArm.h"

namespace viable {
namespace {

using detail::FollowingWatch;
using Cause = FollowingWatch::Cause;

struct FollowingWatchTest : ::testing::Test {
    FollowingWatchTest() {
        arm_.limits.velocity = {JointVector::Constant(6, -2.0), JointVector::Constant(6, 1.0)};
        begin();
    }
    void begin(int delayTicks = 0) {
        setup_.emplace(arm_.setup());
        setup_->delayTicks = delayTicks;
        watch_.begin(*setup_);
        nominal_ = arm_.start;
        real_ = {nominal_.q, nominal_.qd};
        asked_ = robust_ = given_ = JointVector::Zero(6);
    }
    Cause update(std::int64_t elapsedTicks = 1) {
        violation_ = watch_.update(real_, nominal_, {asked_, robust_, given_, authority_}, elapsedTicks);
        return violation_.cause;
    }
    double torqueLimit() const { return arm_.robot.actuation.torqueLimit[2]; }
    /** Time until something is found, at most a second; joint 2 swings about its nominal velocity. */
    double swing(double frequency_hz, double amplitude) {
        for (int tick = 0; tick < 1000; ++tick) {
            real_.qd[2] = nominal_.qd[2] + amplitude * std::sin(2.0 * kPi * frequency_hz * tick * 1e-3 + 0.1);
            if (update() != Cause::None) return tick * 1e-3;
        }
        return kInfinity;
    }

    /** Time from when the motor first is at its limit until something is found, infinite if nothing is: joint 2 under a velocity loop by differences over a tick, its gain
    `share` of the one from which on it is unstable. The motor makes `acceleration` at its limit; `holding` of that is
    what the nominal arm takes. */
    double runLoop(double share, double acceleration, double holding) {
        const double h = setup_->tick_s, limit = torqueLimit(), inertia = limit / acceleration;
        const int delay = setup_->delayTicks;
        const double gain = share * 2.0 * std::tan(kPi / (4.0 * (1.0 + delay))) / h * inertia;
        const double nominal = holding * limit;
        std::deque<double> sent(static_cast<std::size_t>(delay), nominal);
        double e = 1e-4, v = 0.0, last = 0.0;
        int ticksAtLimit = -1;  // since it was there first
        for (int tick = 0; tick < 500 * (1 + delay); ++tick) {
            real_.q[2] = nominal_.q[2] + e;
            real_.qd[2] = nominal_.qd[2] + (e - last) / h;
            if (update() != Cause::None) return ticksAtLimit * h;
            asked_[2] = std::clamp(nominal - gain * (e - last) / h, -limit, limit);
            robust_[2] = asked_[2] - nominal;
            if (ticksAtLimit >= 0 || std::abs(asked_[2]) == limit) ++ticksAtLimit;
            sent.push_back(asked_[2]);
            given_[2] = sent.front();
            sent.pop_front();
            const double a = (given_[2] - nominal) / inertia;
            last = e;
            e += h * (v + h * a / 2.0);
            v += h * a;
        }
        return kInfinity;
    }

    TestArm arm_{"indy7"};
    std::optional<RunSetup> setup_;
    FollowingWatch watch_;
    MotionState nominal_;
    JointState real_;
    JointVector asked_, robust_, given_;
    FollowingWatch::Violation violation_;
    const detail::Authority authority_;  // none
};

TEST_F(FollowingWatchTest, AJointThatRunsAwayIsSeenAtItsDistance) {
    const double allowed = FollowingWatch::kLag_s * 2.0;
    real_.q[3] += 0.999 * allowed;
    EXPECT_EQ(update(), Cause::None);
    real_.q[3] = nominal_.q[3] - 1.001 * allowed;
    EXPECT_EQ(update(), Cause::Drift);
    EXPECT_EQ(violation_.joint, 3);
    EXPECT_NEAR(violation_.error, 1.001 * allowed, 1e-12);
    EXPECT_EQ(violation_.allowed, allowed);
}

TEST_F(FollowingWatchTest, AMotorAtItsLimitIsTheCause) {
    asked_[1] = -arm_.robot.actuation.torqueLimit[1];
    given_ = asked_;
    for (int tick = 0; tick < 150; ++tick) EXPECT_EQ(update(), Cause::None);
    real_.q[4] += 1.0;
    EXPECT_EQ(update(), Cause::Saturation);
    EXPECT_EQ(violation_.joint, 4);
    EXPECT_EQ(violation_.motor, 1);
    // A weaker motor than is stated gives less than is asked for.
    begin();
    asked_[5] = 10.0;
    given_[5] = 5.0;
    for (int tick = 0; tick < 150; ++tick) update();
    real_.q[4] += 1.0;
    EXPECT_EQ(update(), Cause::Weakness);
    EXPECT_EQ(violation_.motor, 5);
}

TEST_F(FollowingWatchTest, OscillationIsSeenWithin50Milliseconds) {
    for (const double frequency : {60.0, 120.0, 250.0, 400.0})
        for (const bool isAtLimit : {false, true}) {
            begin();
            if (isAtLimit) asked_[2] = given_[2] = arm_.robot.actuation.torqueLimit[2];
            EXPECT_LE(swing(frequency, isAtLimit ? 3.0 : 12.0), 0.05) << frequency;
            EXPECT_EQ(violation_.cause, Cause::Oscillation);
            EXPECT_EQ(violation_.joint, 2);
        }
}

// Where it becomes unstable a loop with d ticks of delay swings with half-periods of 2 (1 + d) ticks.
TEST_F(FollowingWatchTest, Fault80OscillationUnderDelayAndLongTicksIsSeen) {
    for (const double tick_s : {0.001, 0.002, 0.004, 0.01})
        for (const int delay : {0, 1, 3, 6, 12, 20}) {
            arm_.tick_s = tick_s;
            begin(delay);
            const double acceleration = 0.5 / (tick_s * (1.0 + delay));  // swings of about 0.5 rad/s
            EXPECT_LE(runLoop(1.4, acceleration, 0.3), 250 * tick_s + 5.0 * watch_.halfPeriod())
                << tick_s << " " << delay;
            EXPECT_EQ(violation_.cause, Cause::Oscillation) << tick_s << " " << delay;
            EXPECT_EQ(violation_.joint, 2);
            begin(delay);
            EXPECT_EQ(runLoop(0.7, acceleration, 0.3), kInfinity) << tick_s << " " << delay;
        }
}

// Its motor makes so little of the arm that velocity and way stay small.
TEST_F(FollowingWatchTest, Fault80ALimitCycleAtTheTorqueLimitsIsSeenHoweverLittleTheArmMoves) {
    for (const double acceleration : {1.0, 33.0, 100.0, 400.0})
        for (const double holding : {0.0, 0.3, -0.6}) {
            begin();
            EXPECT_LE(runLoop(1.5, acceleration, holding), 0.25) << acceleration << " " << holding;
            EXPECT_EQ(violation_.cause, Cause::Oscillation);
            EXPECT_EQ(violation_.joint, 2);
            EXPECT_LT(violation_.error, FollowingWatch::kLeastSwingRadps);
            EXPECT_EQ(violation_.motor, 2);
        }
}

// Noise through the gain of a loop alone: the motor is at its limit in a third of the ticks, to and fro by chance.
TEST_F(FollowingWatchTest, NoiseThatSaturatesAMotorIsNoOscillation) {
    std::mt19937 random(4);
    for (const double holding : {0.0, 0.3, 0.6}) {
        begin();
        std::normal_distribution<double> noise(0.0, 0.7 * (1.0 - holding) * torqueLimit());
        double last = 0.0;
        int atLimit = 0;
        for (int tick = 0; tick < 100000; ++tick) {
            const double now = noise(random), nominal = holding * torqueLimit();
            asked_[2] = given_[2] = std::clamp(nominal - (now - last), -torqueLimit(), torqueLimit());
            robust_[2] = asked_[2] - nominal;
            last = now;
            atLimit += std::abs(asked_[2]) == torqueLimit();
            ASSERT_EQ(update(), Cause::None) << tick;
        }
        EXPECT_GT(atLimit, 15000);
    }
}

// What the nominal arm itself asks for is not the robust loop's doing, nor is a motor that is at its limit now and then.
TEST_F(FollowingWatchTest, MotorsAtTheirLimitsAloneAreNoOscillation) {
    for (int tick = 0; tick < 1000; ++tick) {
        // Beyond the limit, to which the robust loop cuts it.
        asked_[2] = given_[2] = (tick % 10 < 5 ? 1.0 : -1.0) * torqueLimit();
        robust_[2] = -0.5 * asked_[2];
        ASSERT_EQ(update(), Cause::None) << tick;
    }
    begin();
    for (int tick = 0; tick < 1000; ++tick) {
        asked_[2] = given_[2] = (tick % 20 < 1 ? 1.0 : tick % 20 < 2 ? -1.0 : 0.0) * torqueLimit();
        robust_[2] = asked_[2];
        ASSERT_EQ(update(), Cause::None) << tick;
    }
    begin();
    for (int tick = 0; tick < 1000; ++tick) {
        asked_[2] = given_[2] = (tick % 100 < 50 ? 1.0 : -1.0) * torqueLimit();
        robust_[2] = asked_[2];
        ASSERT_EQ(update(), Cause::None) << tick;
    }
}

// Ticks that were missed count: a sign that lasted over them belongs to no oscillation, and a motor was at its limit.
TEST_F(FollowingWatchTest, MissedTicksCount) {
    for (int half = 0; half < 12; ++half) {
        real_.qd[2] = nominal_.qd[2] + (half % 2 ? 12.0 : -12.0);
        EXPECT_EQ(update(30), Cause::None);
    }
    begin();
    asked_[1] = given_[1] = arm_.robot.actuation.torqueLimit[1];
    EXPECT_EQ(update(60), Cause::None);
    real_.q[4] += 1.0;
    EXPECT_EQ(update(), Cause::Saturation);
}

// A joint that was held swings when it is let go; the loop ends only for one that goes on swinging.
TEST_F(FollowingWatchTest, AJointThatComesBackFromAfarIsNotTakenForOneThatOscillates) {
    const auto swingOnce = [&] {  // and which way
        for (int k = 0; k < 10; ++k)
            if (update() == Cause::Oscillation) return true;
        real_.qd[2] = -real_.qd[2];
        return false;
    };
    for (const bool isFirst : {false, true}) {
        begin();
        real_.q[2] += isFirst ? 0.0 : 1.0;
        EXPECT_EQ(update(), isFirst ? Cause::None : Cause::Drift);
        real_.qd[2] = 12.0;
        for (int half = 0; half < 2; ++half) EXPECT_FALSE(swingOnce()) << half;
        real_.q[2] = nominal_.q[2] + 1.0;
        if (isFirst) {
            EXPECT_EQ(update(), Cause::Oscillation) << "away after two halves";
            continue;
        }
        EXPECT_FALSE(swingOnce());
        EXPECT_FALSE(swingOnce());
        swingOnce();
        EXPECT_EQ(update(), Cause::Oscillation) << "it goes on";
    }
}

TEST_F(FollowingWatchTest, AJointOfSmallRangeIsAwaySooner) {
    const double home = arm_.start.q[3];
    arm_.limits.position.lower[3] = home - 0.2;
    arm_.limits.position.upper[3] = home + 0.2;
    begin();
    const double allowed = 0.4 * FollowingWatch::kLargestShare;
    real_.q[3] += 0.999 * allowed;
    EXPECT_EQ(update(), Cause::None);
    real_.q[3] = nominal_.q[3] - 1.001 * allowed;
    EXPECT_EQ(update(), Cause::Drift);
}

TEST_F(FollowingWatchTest, ASlideHasItsOwnThresholds) {
    arm_.robot.joints[2].type = JointType::Prismatic;
    arm_.limits.velocity = {JointVector::Constant(6, -0.1), JointVector::Constant(6, 0.1)};
    begin();
    real_.q[2] += 0.99 * FollowingWatch::kLeastErrorM;
    EXPECT_EQ(update(), Cause::None);
    real_.q[2] += 0.02 * FollowingWatch::kLeastErrorM;
    EXPECT_EQ(update(), Cause::Drift);
    EXPECT_EQ(violation_.joint, 2);
    begin();
    EXPECT_LE(swing(100.0, 0.3), 0.05);
    EXPECT_EQ(violation_.cause, Cause::Oscillation);
    begin();
    EXPECT_EQ(swing(100.0, 0.19), kInfinity);
}

TEST_F(FollowingWatchTest, WhatIsSlowOrSmallOrACountIsNoOscillation) {
    for (const auto& [frequency, amplitude] : {std::pair(5.0, 6.0), std::pair(15.0, 6.0), std::pair(200.0, 3.5)}) {
        begin();
        EXPECT_EQ(swing(frequency, amplitude), kInfinity) << frequency << " " << amplitude;
    }
    // A slow joint.
    arm_.limits.velocity = {JointVector::Constant(6, -0.01), JointVector::Constant(6, 0.01)};
    begin();
    EXPECT_EQ(swing(250.0, 0.4), kInfinity);
    // Coarse encoders: their counts in a tick are larger than twice the velocity limit.
    arm_.robot.actuation.encoderCounts.setConstant(6, 4096.0);
    arm_.limits.velocity = {JointVector::Constant(6, -0.1), JointVector::Constant(6, 0.1)};
    begin();
    EXPECT_EQ(swing(250.0, 3.9 * arm_.robot.encoderStep(2) / 1e-3), kInfinity);
}

// White noise of the reading changes the sign of the velocity nearly every tick.
TEST_F(FollowingWatchTest, NoiseOfTheEncoderIsNoOscillation) {
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0.0, 1e-4);
    double last = 0.0;
    for (int tick = 0; tick < 20000; ++tick) {
        const double reading = noise(random);
        real_.qd[1] = (reading - last) / 1e-3;
        last = reading;
        ASSERT_EQ(update(), Cause::None) << tick;
    }
}

TEST_F(FollowingWatchTest, ASlowJointMayBeAwayByWhatFrictionMakes) {
    arm_.limits.velocity = {JointVector::Constant(6, -0.01), JointVector::Constant(6, 0.01)};
    begin();
    real_.q[0] += 0.049;
    EXPECT_EQ(update(), Cause::None);
    EXPECT_FALSE(watch_.runsAway(real_, nominal_));
    real_.q[0] += 0.052;
    EXPECT_EQ(update(), Cause::Drift);
    EXPECT_TRUE(watch_.runsAway(real_, nominal_));
}

TEST_F(FollowingWatchTest, LimitsThatBecomeWiderCountFromThenOn) {
    JointLimits wide = arm_.limits;
    wide.velocity.upper.setConstant(6, 10.0);
    watch_.widen(wide);
    real_.q[0] += 1.4;
    EXPECT_EQ(update(), Cause::None);
    watch_.widen(arm_.limits);  // tighter ones do not
    EXPECT_EQ(update(), Cause::None);
}

TEST_F(FollowingWatchTest, WithoutVelocityLimitsTheRangeCounts) {
    arm_.limits.velocity = JointLimits::unlimited(6).velocity;
    arm_.limits.position = {JointVector::Constant(6, -1.0), JointVector::Constant(6, 1.0)};
    arm_.limits.position.upper[5] = kInfinity;
    begin();
    real_.q[0] += 0.19;
    real_.q[5] += 0.9;
    EXPECT_EQ(update(), Cause::None);
    real_.q[0] += 0.02;
    EXPECT_EQ(update(), Cause::Drift);
    EXPECT_EQ(violation_.joint, 0);
}

}  // namespace
}  // namespace viable
