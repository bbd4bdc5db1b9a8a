#include "Balls.h"
#include "viable/loop/ReferenceGuard.h"

#include "CaseSupport.h"
#include "Joints.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable::test {
namespace {

using testing::makeTwoLinkArm;

constexpr double kTick_s = 1e-3;

MotionState atRest(const JointVector& q) {
    return {q, JointVector::Zero(q.size()), JointVector::Zero(q.size())};
}

/** A guarded two-link arm, and what its reference did. */
struct Guarded {
    explicit Guarded(const ReferenceGuardOptions& options = {})
        : robot(makeTwoLinkArm()), guard(robot, kTick_s, options), summary(robot.jointNames(), guard.limits(), false) {
        guard.start(atRest(robot.home));
    }
    const GuardedReference& note(const GuardedReference& next) {
        summary.add(guard.record());
        summary.addEnd(next.state, guard.record().time_s + kTick_s);
        return next;
    }
    const GuardedReference& step() { return note(guard.step()); }
    const GuardedReference& step(const JointVector& target) { return note(guard.step(target)); }

    RobotDescription robot;
    ReferenceGuard guard;
    Summary summary;
};

TEST(ReferenceGuard, ATargetIsReachedExactlyAndHeld) {
    Guarded arm;
    const JointVector target = joints(-1.5, 2.0);
    arm.step(target);
    int passed = 0;
    for (int k = 0; k < 4000; ++k) passed += arm.step().status == GuardStatus::Passed;
    EXPECT_GE(passed, 3800);
    const GuardedReference& end = arm.step();
    EXPECT_LT((end.state.q - target).lpNorm<Eigen::Infinity>(), 1e-12);
    EXPECT_LT(end.state.qd.lpNorm<Eigen::Infinity>(), 1e-12);
    EXPECT_FALSE(arm.summary.anyLimitBroken());
    EXPECT_GT(arm.summary.limit(LimitKind::Jerk)[0].worstUse, 0.99);
}

TEST(ReferenceGuard, SpeedLimitsOfTheRobotsPointsAreKept) {
    RobotDescription robot = makeTwoLinkArm();
    robot.speedLimits.tool = 0.3;
    ReferenceGuard guard(robot, kTick_s, {});
    RobotModel model(robot);
    Dynamics dynamics;
    guard.start(atRest(robot.home));
    double fastest = 0.0;
    for (int k = 0; k < 6000; ++k) {
        const GuardedReference& next =
            k % 1500 == 0 ? guard.step(k % 3000 == 0 ? joints(-1.5, 1.0) : joints(1.5, -1.0)) : guard.step();
        model.calcDynamics(next.state.q, next.state.qd, dynamics);
        fastest = std::max(fastest, (dynamics.J.topRows<3>() * next.state.qd).norm());
    }
    EXPECT_LE(fastest, 0.3 * (1.0 + 1e-9));
    EXPECT_GT(fastest, 0.28);
}

TEST(ReferenceGuard, HostileTargetsNeverLeadOutside) {
    for (const BetweenSamples between :
         {BetweenSamples::Hold, BetweenSamples::Interpolate, BetweenSamples::Extrapolate}) {
        ReferenceGuardOptions options;
        options.between = between;
        Guarded arm(options);
        std::mt19937_64 random(5);
        const auto draw = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
        for (int k = 0; k < 20000; ++k) {
            if (draw(0, 1) < 0.03)
                arm.step(draw(0, 1) < 0.5 ? joints(draw(-9, 9), draw(-9, 9)) : joints(draw(-1e7, 1e7), kNan));
            else
                arm.step();
            if (draw(0, 1) < 0.001) arm.guard.missTicks(40);
        }
        EXPECT_FALSE(arm.summary.anyLimitBroken());
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::None) << arm.guard.stopMessage();
    }
}

TEST(ReferenceGuard, AStreamAt30HzIsFollowed) {
    Guarded arm;
    const auto way = [](double t) { return joints(std::sin(t), 0.5 * std::cos(1.3 * t) - 0.5); };
    double worst = 0.0;
    for (int k = 0; k < 20000; ++k) {
        const double t = k * kTick_s;
        const GuardedReference& next = k % 33 == 0 ? arm.step(way(t)) : arm.step();
        if (k > 3000) worst = std::max(worst, (next.state.q - way(t)).lpNorm<Eigen::Infinity>());
    }
    EXPECT_FALSE(arm.summary.anyLimitBroken());
    EXPECT_LT(worst, 0.033);  // 1 rad/s: less than a sample's time of it
}

TEST(ReferenceGuard, AnUnusableTargetChangesNothing) {
    Guarded arm, other;
    for (int k = 0; k < 2000; ++k) {
        if (k == 0) {
            arm.step(joints(1.0, 1.0));
            other.step(joints(1.0, 1.0));
            continue;
        }
        const JointVector bad = k % 3 == 0   ? joints(kNan, 0.0)
                                : k % 3 == 1 ? JointVector(JointVector::Zero(3))
                                             : joints(1e300, 0.0);
        EXPECT_TRUE(arm.step(bad).targetFailed);
        EXPECT_FALSE(other.step().targetFailed);
        ASSERT_EQ(arm.guard.step(bad).state.q, other.guard.step().state.q);
    }
}

TEST(ReferenceGuard, TheStopAheadIsWhatMissedTicksFollow) {
    Guarded arm;
    arm.step(joints(2.0, 2.0));
    for (int k = 0; k < 300; ++k) arm.step();
    MotionState ahead, there, rest;
    arm.guard.calcStop(0.05, ahead);
    arm.guard.calcStop(100.0, rest);
    EXPECT_GT(ahead.qd[0], 0.1);
    EXPECT_EQ(rest.qd, JointVector(JointVector::Zero(2)));
    EXPECT_EQ(rest.qdd, JointVector(JointVector::Zero(2)));
    EXPECT_TRUE((rest.q.array() < arm.guard.limits().position.upper.array()).all());
    arm.guard.missTicks(50);
    arm.guard.calcStop(0.0, there);
    EXPECT_LT((there.q - ahead.q).lpNorm<Eigen::Infinity>(), 1e-13);
    EXPECT_LT((there.qd - ahead.qd).lpNorm<Eigen::Infinity>(), 1e-12);
    for (int k = 0; k < 4000; ++k) arm.step();
    EXPECT_LT((arm.step().state.q - joints(2.0, 2.0)).lpNorm<Eigen::Infinity>(), 1e-12);
}

TEST(ReferenceGuard, TooManyMissedTicksStopTheArm) {
    Guarded arm;
    arm.step(joints(2.0, 2.0));
    arm.guard.missTicks(1001);
    EXPECT_EQ(arm.step().status, GuardStatus::Stopped);
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::TicksMissed);
    expectContains(arm.guard.stopMessage(), {"1000 ticks"});
    arm.guard.start(atRest(arm.robot.home));
    EXPECT_EQ(arm.guard.step(joints(0.5, 0.5)).status, GuardStatus::Passed);
}

TEST(ReferenceGuard, ARequestFromAnotherThreadStopsTheArm) {
    Guarded arm;
    arm.step(joints(2.0, 2.0));
    for (int k = 0; k < 200; ++k) arm.step();
    std::thread([&] { arm.guard.requestStop(); }).join();
    EXPECT_EQ(arm.step().status, GuardStatus::Stopping);
    for (int k = 0; k < 2000; ++k) arm.step();
    EXPECT_EQ(arm.step(joints(-1.0, -1.0)).status, GuardStatus::Stopped);
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::Requested);
    EXPECT_EQ(arm.step().state.qd, JointVector(JointVector::Zero(2)));
    EXPECT_FALSE(arm.summary.anyLimitBroken());
}

TEST(ReferenceGuard, LimitsMayChangeAndAreMet) {
    Guarded arm;
    arm.step(joints(2.0, 2.0));
    for (int k = 0; k < 500; ++k) arm.step();
    JointLimits slow = arm.guard.limits();
    slow.velocity = {joints(-0.5, -0.5), joints(0.5, 0.5)};
    slow.position.upper = joints(1.8, 1.8);
    ASSERT_TRUE(arm.guard.changeLimits(slow));
    int recovering = 0;
    for (int k = 0; k < 6000; ++k) recovering += arm.guard.step().status == GuardStatus::Recovering;
    EXPECT_GT(recovering, 10);
    EXPECT_LT(recovering, 1000);
    EXPECT_LT((arm.guard.step().state.q - joints(1.8, 1.8)).lpNorm<Eigen::Infinity>(), 1e-9);
    JointLimits unusable = slow;
    unusable.jerk.upper[1] = kInfinity;
    EXPECT_FALSE(arm.guard.changeLimits(unusable));
    unusable = slow;
    unusable.velocity.lower[0] = 1.0;
    EXPECT_FALSE(arm.guard.changeLimits(unusable));
    EXPECT_EQ(arm.guard.limits().position.upper, slow.position.upper);
}

TEST(ReferenceGuard, WithRecoveryAStartOutsideIsLedBack) {
    const RobotDescription robot = makeTwoLinkArm();
    const MotionState outside = atRest(joints(2.7, 0.0));
    ReferenceGuard strict(robot, kTick_s);
    expectError({"joint0", "ReferenceGuardOptions::recovery"}, [&] { strict.start(outside); });
    EXPECT_EQ(strict.step().status, GuardStatus::NotStarted);
    ReferenceGuardOptions options;
    options.recovery = true;
    ReferenceGuard guard(robot, kTick_s, options);
    guard.start(outside);
    EXPECT_EQ(guard.step(joints(2.0, 0.0)).status, GuardStatus::Recovering);
    for (int k = 0; k < 3000; ++k) guard.step();
    EXPECT_LT((guard.step().state.q - joints(2.0, 0.0)).lpNorm<Eigen::Infinity>(), 1e-12);
}

TEST(ReferenceGuard, KeepsClearOfWhatStandsAroundAndMayCome) {
    const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/indy7"));
    ReferenceGuardOptions options;
    options.environment.emplace();
    Solid table;
    table.name = "table";
    table.kind = Solid::Kind::HalfSpace;
    table.pose.translation().z() = -0.1;
    options.environment->solids.push_back(table);
    ReferenceGuard guard(robot, kTick_s, options);
    guard.start(atRest(robot.home));
    JointVector low = robot.home;
    low[1] -= 1.2;  // the arm down to the table
    double least = kInfinity;
    guard.step(low);
    for (int k = 0; k < 6000; ++k) {
        guard.step();
        least = std::min(least, guard.record().reports[LimitKind::Clearance].margin);
    }
    EXPECT_GE(least, options.environment->safetyDistance_m - 1e-9);
    EXPECT_LT(least, 0.1);
    EXPECT_LT(guard.step().state.qd.lpNorm<Eigen::Infinity>(), 0.05);

    Environment empty;
    EXPECT_NO_THROW(guard.changeEnvironment(empty, 6.0));
    for (int k = 0; k < 6000; ++k) guard.step();
    EXPECT_LT((guard.step().state.q - low).lpNorm<Eigen::Infinity>(), 1e-9);
    ReferenceGuard blind(robot, kTick_s);
    expectError({"ReferenceGuardOptions::environment"}, [&] { blind.changeEnvironment(empty, 0.0); });
}

TEST(ReferenceGuard, ObstaclesThatAreNoneAreRefused) {
    const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/indy7"));
    ReferenceGuardOptions options;
    options.environment.emplace();
    Solid box;
    box.name = "forgotten";  // its size
    box.pose.translation().x() = 3.0;
    options.environment->solids.push_back(box);
    Solid scaled = box;
    scaled.name = "scaled";
    scaled.size.setOnes();
    scaled.pose.linear() *= 10.0;
    options.environment->solids.push_back(scaled);
    options.environment->spheres.push_back({"still", 0.1, {}, false});
    options.environment->safetyDistance_m = -1.0;
    expectError({"`forgotten` has an edge that is not above 0 m", "`scaled` has a pose", "`still` moves without",
                 "safetyDistance_m is -1"},
                [&] { ReferenceGuard(robot, kTick_s, options); });
    options.environment.emplace();
    ReferenceGuard guard(robot, kTick_s, options);
    Environment bad;
    bad.solids.push_back(box);
    expectError({"`forgotten`"}, [&] { guard.changeEnvironment(bad, 0.0); });
}

TEST(ReferenceGuard, MassesMotorsAndFrictionDoNotCount) {
    for (const double mass : {0.0, 1e9, kNan}) {
        RobotDescription robot = makeTwoLinkArm();
        for (JointDescription& joint : robot.joints) joint.body.mass = mass;
        robot.actuation = {};
        ReferenceGuard guard(robot, kTick_s), other(makeTwoLinkArm(), kTick_s);
        const MotionState start = atRest(JointVector::Zero(2));
        guard.start(start);
        other.start(start);
        for (int k = 0; k < 3000; ++k) {
            const JointVector target = joints(k / 500 % 2, -(k / 300 % 2));
            const GuardedReference& one = guard.step(target);
            const GuardedReference& two = other.step(target);
            ASSERT_EQ(one.state.q, two.state.q) << k;
            ASSERT_EQ(one.status, two.status) << k;
        }
    }
}

TEST(ReferenceGuard, WithoutAStartThereIsNoReference) {
    const RobotDescription robot = makeTwoLinkArm();
    ReferenceGuard guard(robot, kTick_s);
    const auto isNone = [&] {
        const GuardedReference& next = guard.step(joints(1.0, 1.0));
        return next.status == GuardStatus::NotStarted && next.state.q.size() == 2 && next.state.q.array().isNaN().all();
    };
    EXPECT_TRUE(isNone());
    const JointVector zero = JointVector::Zero(2);
    for (const MotionState& bad :
         {MotionState{joints(kNan, 0), zero, zero}, MotionState{JointVector::Zero(3), zero, zero},
          MotionState{zero, zero, JointVector()}, MotionState{zero, zero, joints(1e9, 0)}}) {
        guard.start(atRest(robot.home));
        EXPECT_THROW(guard.start(bad), Error);
        EXPECT_TRUE(isNone());
    }
}

TEST(ReferenceGuard, LimitsDoNotChangeWhileTheArmIsStopped) {
    Guarded arm;
    arm.step(joints(2.0, 2.0));
    for (int k = 0; k < 300; ++k) arm.step();
    arm.guard.requestStop();
    arm.step();
    JointLimits slow = arm.guard.limits();
    slow.jerk.upper /= 2.0;
    EXPECT_FALSE(arm.guard.changeLimits(slow));
    EXPECT_EQ(arm.guard.limits().jerk.upper, arm.robot.limits.jerk.upper);
}

TEST(ReferenceGuard, ATargetThatWasSentLastIsWhereTheArmRests) {
    Guarded arm;
    for (const double set : {0.2, 0.4, 0.6}) {
        arm.step(joints(set, 0.0));
        for (int k = 1; k < 1000; ++k) arm.step();
    }
    for (int k = 0; k < 40; ++k) {  // and a stream that ends in motion
        arm.step(joints(0.6 + 0.02 * k, 0.0));
        for (int i = 1; i < 40; ++i) arm.step();
    }
    for (int k = 0; k < 5000; ++k) arm.step();
    EXPECT_NEAR(arm.step().state.q[0], 0.6 + 0.02 * 39, 1e-12);
}

TEST(ReferenceGuard, SurroundingsMayComeFromAnotherThread) {
    const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/indy7"));
    ReferenceGuardOptions options;
    options.environment.emplace();
    ReferenceGuard guard(robot, kTick_s, options);
    guard.start(atRest(robot.home));
    std::atomic<bool> isDone{false};
    std::thread maker([&] {
        for (int k = 0; !isDone; ++k) {
            Environment next;
            next.solids.push_back(makeBall(Eigen::Vector3d(1.2 + 0.1 * std::sin(k), 0.0, 0.5), 0.1));
            guard.changeEnvironment(next, 0.0);
        }
    });
    JointVector target = robot.home;
    for (int k = 0; k < 3000; ++k) {
        target[0] = robot.home[0] + 0.5 * std::sin(0.005 * k);
        guard.step(target);
    }
    isDone = true;
    maker.join();
    EXPECT_EQ(guard.stopReason(), GuardStop::None) << guard.stopMessage();
    guard.start(atRest(robot.home));  // time begins anew, the surroundings stay
    guard.step(target);
    EXPECT_TRUE(guard.record().reports[LimitKind::Clearance].isKnown);
    EXPECT_GE(guard.record().reports[LimitKind::Clearance].age_s, 0.0);
}

TEST(ReferenceGuard, WhatIsWrongIsSaidWithItsPlace) {
    RobotDescription robot = makeTwoLinkArm();
    expectError({"ReferenceGuard: the tick is 2 s"}, [&] { ReferenceGuard(robot, 2.0); });
    expectError({"0 joints"}, [&] { ReferenceGuard(RobotDescription(), kTick_s); });
    ReferenceGuardOptions options;
    options.share = 0.0;
    expectError({"ReferenceGuardOptions::share"}, [&] { ReferenceGuard(robot, kTick_s, options); });
    options = {};
    options.limits = JointLimits::unlimited(2);
    expectError({"finite jerk limit"}, [&] { ReferenceGuard(robot, kTick_s, options); });
    options = {};
    options.environment.emplace();
    expectError({"collision.yaml"}, [&] { ReferenceGuard(robot, kTick_s, options); });
    ReferenceGuard guard(robot, kTick_s);
    expectError({"ReferenceGuard::start"}, [&] { guard.start(atRest(joints(kNan, 0.0))); });
    EXPECT_EQ(guard.step(joints(0, 0)).status, GuardStatus::NotStarted);
}

TEST(ReferenceGuard, ATickDoesNotAllocate) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/indy7"));
    for (const bool hasEnvironment : {false, true}) {
        ReferenceGuardOptions options;
        if (hasEnvironment) options.environment.emplace();
        ReferenceGuard guard(robot, kTick_s, options);
        guard.start(atRest(robot.home));
        JointVector target = robot.home;
        const JointLimits limits = guard.limits();
        MotionState ahead = atRest(target);
        const testing::AllocationCounter allocations;
        for (int k = 0; k < 20000; ++k) {
            target[k % 6] = robot.home[k % 6] + 0.5 * std::sin(0.01 * k);
            if (k % 30 == 0)
                guard.step(target);
            else
                guard.step();
            if (k % 500 == 0) guard.missTicks(3);
            if (k % 700 == 0) guard.changeLimits(limits);
            guard.calcStop(0.01, ahead);
        }
        EXPECT_EQ(allocations.count(), 0);
    }
}

}  // namespace
}  // namespace viable::test
