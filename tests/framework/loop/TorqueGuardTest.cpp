#include "viable/loop/TorqueGuard.h"

#include <sstream>

#include "../../../framework/examples/own_loop/SimulatedRobot.h"
#include "CaseSupport.h"
#include "Joints.h"
#include "TestArm.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/TwoLinkArm.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;

using test::catchError;
using test::joints;
using testing::makeTwoLinkArm;

JointState atHome(const RobotDescription& robot) {
    return {robot.home, JointVector::Zero(robot.size())};
}

TorqueGuard startAtHome(const RobotDescription& robot, const TorqueGuardOptions& options = {}) {
    TorqueGuard guard(robot, kTick_s, options);
    guard.start(atHome(robot));
    return guard;
}

/** The nominal arm, as an arm would report it that follows it exactly, `off` away. */
JointState followExactly(const TorqueGuard& guard, double off = 0.0) {
    return {guard.nominal().q + JointVector::Constant(guard.size(), off), guard.nominal().qd};
}

/** A law that drives to `target`. */
struct Spring {
    JointVector target;
    void operator()(const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) const {
        torque = dynamics.M * (100.0 * (target - nominal.q) - 20.0 * nominal.qd) + dynamics.b;
    }
};

/** Torques of full size that jump from one side to the other, each joint when it likes. */
class BangBang {
public:
    BangBang(int n, double size, unsigned seed) : command_(n, size, true, seed) {}
    void operator()(const MotionState&, const Dynamics&, JointVector& torque) { torque = command_.next(); }

private:
    PushingCommand command_;
};

/** The nominal arm has kept every limit of `guard` in all that was shown. */
class LimitKeeper {
public:
    explicit LimitKeeper(const TorqueGuard& guard)
        : guard_(guard), summary_(std::vector<std::string>(guard.size(), "joint"), guard.limits(), true) {}
    void add() {
        summary_.add(guard_.record());
        summary_.addEnd(guard_.nominal(), guard_.record().time_s + kTick_s);
    }
    void expectKept() const {
        EXPECT_FALSE(summary_.anyLimitBroken());
        for (LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
            EXPECT_EQ(summary_.ticksOutside(kind), 0) << getName(kind, LimitSide::Neither);
    }
    /** The law has pressed against it. */
    void expectUsed(LimitKind kind, double share) const {
        EXPECT_GT(summary_.limit(kind)[summary_.worstJoint(kind)].worstUse, share);
    }

private:
    const TorqueGuard& guard_;
    Summary summary_;
};

bool isWithinMotors(const GuardedTorque& out, const RobotDescription& robot) {
    return isFinite(out.torque, robot.size()) &&
           (out.torque.cwiseAbs().array() <= robot.actuation.torqueLimit.array()).all();
}

/** Steps until the arm is stopped; every torque fit for the motors, every limit kept. Returns the steps. */
template <class Law>
int runUntilStopped(TorqueGuard& guard, const RobotDescription& robot, Law law) {
    LimitKeeper keeper(guard);
    for (int k = 1; k < 5000; ++k) {
        const GuardedTorque& out = guard.step(followExactly(guard), law);
        EXPECT_TRUE(isWithinMotors(out, robot));
        keeper.add();
        if (out.status != GuardStatus::Stopped) continue;
        keeper.expectKept();
        return k;
    }
    ADD_FAILURE() << "it does not stop";
    return 0;
}

/** At speed towards a target that is far beyond the limits. */
struct MovingArm {
    explicit MovingArm(TorqueGuardOptions options = {})
        : robot(makeTwoLinkArm()), guard(robot, kTick_s, std::move(options)) {
        guard.start(atHome(robot));
        for (int k = 0; k < 300; ++k) guard.step(followExactly(guard), spring);
        EXPECT_GT(guard.nominal().qd.minCoeff(), 0.5);
    }
    RobotDescription robot;
    TorqueGuard guard;
    Spring spring{joints(5.0, 5.0)};
};

// --- The same as in experiments -------------------------------------------------------------------

struct Variant {
    const char* name;
    std::vector<std::string> overrides;
    TorqueGuardOptions options;
    bool misses;
};

TEST(TorqueGuard, GivesTheTorquesOfAnExperimentBitForBit) {
    TorqueGuardOptions paper;
    paper.robustGains = NricOptions{};
    TorqueGuardOptions gains;
    gains.filter.kAlpha = 5.0;
    gains.filter.gamma = 100.0;
    gains.robustGains = NricOptions{300.0, 10.0, 2.0};
    TorqueGuardOptions plain;
    plain.hasRobustLoop = false;
    plain.largestDeviation = kInfinity;
    const Variant variants[] = {
        {"defaults", {"filter={plugin: certified_braking}"}, paper, false},
        {"gains",
         {"filter={plugin: certified_braking, k_alpha: 5, gamma: 100}",
          "robust_loop={plugin: nric, k_r: 300, k_p: 10, k_i: 2}"},
         gains,
         false},
        {"without robust loop", {"filter={plugin: certified_braking}", "robust_loop={plugin: none}"}, plain, false},
        {"missed ticks", {"filter={plugin: certified_braking}"}, paper, true},
    };
    for (const Variant& variant : variants) {
        SCOPED_TRACE(variant.name);
        test::TestLoop experiment(test::kTeleoperation, variant.overrides);
        const CasePlan& plan = experiment.experiment.cases[0];
        TorqueGuardOptions options = variant.options;
        options.limits = plan.limits;
        TorqueGuard guard(plan.robot, plan.tick_s, options);
        guard.start({plan.start.q, plan.start.qd});
        TickRecord record;
        int limited = 0;
        for (int k = 0; k < 4000; ++k) {
            if (variant.misses && k % 97 == 96) {
                for (int i = 0; i < 7; ++i) experiment.loop.missTick(record);
                guard.missTicks(7);
            }
            experiment.loop.tick(record);
            const GuardedTorque& out =
                guard.step(record.real, [&](const MotionState& nominal, const Dynamics&, JointVector& torque) {
                    ASSERT_EQ(nominal.q, record.nominal.q);
                    ASSERT_EQ(nominal.qd, record.nominal.qd);
                    ASSERT_EQ(nominal.qdd, record.nominal.qdd);
                    torque = record.desiredTorque;
                });
            ASSERT_FALSE(HasFatalFailure()) << "tick " << k;
            const TickRecord& own = guard.record();
            ASSERT_EQ(own.filterTorque, record.filterTorque) << "tick " << k;
            ASSERT_EQ(own.nominal.jerk, record.nominal.jerk) << "tick " << k;
            ASSERT_EQ(own.status, record.status) << "tick " << k;
            for (int i = 0; i < guard.size(); ++i) {
                ASSERT_EQ(out.acting[i].limit, record.joints[i].limit) << "tick " << k;
                ASSERT_EQ(out.acting[i].side, record.joints[i].side) << "tick " << k;
            }
            ASSERT_EQ(out.readingFault, ReadingFault::None) << "tick " << k;
            if (!variant.misses) {  // what the arm did meanwhile the guard cannot know
                ASSERT_EQ(own.robustTorque, record.robustTorque) << "tick " << k;
                ASSERT_EQ(out.torque, record.motorTorque) << "tick " << k;
            }
            limited += out.status == GuardStatus::Limited;
        }
        EXPECT_GT(limited, 1000);
    }
}

// --- Limits ---------------------------------------------------------------------------------------

TEST(TorqueGuard, LimitsHoldForAHundredThousandTicksOfBangBangTorques) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuardOptions options;
    options.limitsAuthority = false;  // the reading does not answer what the robust loop does
    TorqueGuard guard = startAtHome(robot, options);
    BangBang law(2, 300.0, 1);
    LimitKeeper keeper(guard);
    for (int k = 0; k < 100000; ++k) {
        const GuardedTorque& out = guard.step(followExactly(guard, 0.001), law);
        ASSERT_TRUE(isWithinMotors(out, robot));
        ASSERT_LE(out.status, GuardStatus::Limited) << k;
        keeper.add();
    }
    keeper.expectKept();
    for (LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
        keeper.expectUsed(kind, kind == LimitKind::Acceleration ? 0.5 : 0.999);
}

TEST(TorqueGuard, LimitsHoldWithTicksMissedAtRandom) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuard guard = startAtHome(robot);
    BangBang law(2, 300.0, 2);
    LimitKeeper keeper(guard);
    std::mt19937 random(3);
    double time_s = 0.0;
    for (int k = 0; k < 20000; ++k) {
        const int late = random() % 50 == 0 ? static_cast<int>(random() % 300) : 0;
        for (int i = 0; i < late; ++i) {
            guard.missTicks(1);
            keeper.add();
        }
        guard.missTicks(-late);  // nothing
        ASSERT_LE(guard.step(followExactly(guard), law).status, GuardStatus::Limited) << k;
        time_s += kTick_s * late;
        ASSERT_NEAR(guard.record().time_s, time_s, 1e-6);
        time_s += kTick_s;
        keeper.add();
    }
    keeper.expectKept();
    keeper.expectUsed(LimitKind::Velocity, 0.999);
}

TEST(TorqueGuard, ARobotWithSpeedLimitsThatItDoesNotKeepIsRefused) {
    RobotDescription robot = testing::makeTwoLinkArm();
    robot.speedLimits.tool = 0.3;
    TorqueGuard guard(robot, kTick_s);
    expectError({"speed limits", "ReferenceGuard"}, [&] {
        guard.start({robot.home, JointVector::Zero(robot.size())});
    });
}

TEST(TorqueGuard, MoreThanAThousandMissedTicksStopTheArm) {
    MovingArm arm;
    arm.guard.missTicks(kMaxMissedTicks);
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::None);
    EXPECT_EQ(arm.guard.step(followExactly(arm.guard), arm.spring).status, GuardStatus::Limited);
    arm.guard.missTicks(std::numeric_limits<std::int64_t>::max());  // a clock gone wrong
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::TicksMissed);
    EXPECT_CONTAINS(arm.guard.stopMessage(), "more than 1000 ticks in a row were missed");
    runUntilStopped(arm.guard, arm.robot, arm.spring);
}

// --- Laws that fail -------------------------------------------------------------------------------

TEST(TorqueGuard, AnUnusableTorqueIsReplacedTenTimesThenTheArmStops) {
    const auto writeNan = [](JointVector& torque) { torque[1] = kNan; };
    const auto writeInfinity = [](JointVector& torque) { torque[0] = -kInfinity; };
    const auto writeTooFew = [](JointVector& torque) { torque.resize(1); };
    const auto writeTooMany = [](JointVector& torque) { torque.setZero(kMaxJoints); };
    const std::pair<const char*, std::function<void(JointVector&)>> faults[] = {
        {"nan", writeNan},
        {"infinity", writeInfinity},
        {"too few", writeTooFew},
        {"too many", writeTooMany},
        {"nothing written", [](JointVector& torque) { torque.setConstant(2, kNan); }}};
    for (const auto& [name, fault] : faults) {
        SCOPED_TRACE(name);
        MovingArm arm;
        const auto bad = [&, f = &fault](const MotionState& nominal, const Dynamics& dynamics, JointVector& torque) {
            EXPECT_TRUE(torque.size() == 2 && std::isnan(torque[0]) && std::isnan(torque[1]));
            arm.spring(nominal, dynamics, torque);
            (*f)(torque);
        };
        for (int k = 0; k < kMaxSubstitutedTicks; ++k) {
            const JointVector last = arm.guard.record().desiredTorque;
            const GuardedTorque& out = arm.guard.step(followExactly(arm.guard), bad);
            EXPECT_TRUE(out.lawFailed);
            EXPECT_EQ(out.status, GuardStatus::Limited);
            EXPECT_TRUE(isWithinMotors(out, arm.robot));
            EXPECT_EQ(arm.guard.record().desiredTorque, last);
        }
        EXPECT_FALSE(arm.guard.step(followExactly(arm.guard), arm.spring).lawFailed);
        for (int k = 0; k < kMaxSubstitutedTicks; ++k) arm.guard.step(followExactly(arm.guard), bad);
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::None);
        EXPECT_EQ(arm.guard.step(followExactly(arm.guard), bad).status, GuardStatus::Stopping);
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::LawFailed);
        EXPECT_CONTAINS(arm.guard.stopMessage(), "no usable torque");
        EXPECT_GT(runUntilStopped(arm.guard, arm.robot, arm.spring), 100);
    }
}

TEST(TorqueGuard, BeforeTheFirstGoodTorqueGravityIsTaken) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuard guard = startAtHome(robot);
    JointVector gravity;
    const GuardedTorque& out = guard.step(
        atHome(robot), [&](const MotionState&, const Dynamics& dynamics, JointVector&) { gravity = dynamics.gravity; });
    EXPECT_TRUE(out.lawFailed);
    EXPECT_LT((out.torque - gravity).norm(), 1e-9);
    EXPECT_GT(gravity.norm(), 1.0);
}

TEST(TorqueGuard, WhatALawThrowsStopsTheArmWithinItsLimits) {
    for (const bool isException : {true, false}) {
        MovingArm arm;
        int calls = 0;
        const auto law = [&](const MotionState&, const Dynamics&, JointVector&) {
            ++calls;
            if (isException) throw std::runtime_error("the solver has lost its way");
            throw 42;
        };
        const GuardedTorque& out = arm.guard.step(followExactly(arm.guard), law);
        EXPECT_EQ(out.status, GuardStatus::Stopping);
        EXPECT_TRUE(out.lawFailed);
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::LawFailed);
        EXPECT_CONTAINS(arm.guard.stopMessage(),
                        isException ? "it threw: the solver has lost its way" : "other than a std::exception");
        EXPECT_GT(runUntilStopped(arm.guard, arm.robot, law), 100);
        EXPECT_EQ(calls, 1);
    }
}

// --- Readings -------------------------------------------------------------------------------------

struct BadReading {
    const char* name;
    ReadingFault fault;
    std::function<void(JointState&)> spoil;
};

std::vector<BadReading> listBadReadings() {
    return {{"nan", ReadingFault::Malformed, [](JointState& r) { r.q[1] = kNan; }},
            {"infinite velocity", ReadingFault::Malformed, [](JointState& r) { r.qd[0] = kInfinity; }},
            {"no numbers", ReadingFault::Malformed, [](JointState& r) { r = {}; }},
            {"too few", ReadingFault::Malformed, [](JointState& r) { r.q.conservativeResize(1); }},
            {"too many", ReadingFault::Malformed, [](JointState& r) { r.qd.setZero(kMaxJoints); }},
            {"a turn", ReadingFault::Jumped, [](JointState& r) { r.q[0] += 6.28; }},
            {"a little too far", ReadingFault::Jumped, [](JointState& r) { r.q[1] -= 0.006; }},
            {"too fast", ReadingFault::Jumped, [](JointState& r) { r.qd[1] = 5.1; }},
            {"huge", ReadingFault::Jumped, [](JointState& r) { r.q.setConstant(2, 1e300); }}};
}

TEST(TorqueGuard, ABadReadingBrakesTheNominalArmUntilTheNextGoodOne) {
    for (const BadReading& bad : listBadReadings()) {
        SCOPED_TRACE(bad.name);
        MovingArm arm;
        JointVector before = arm.guard.step(followExactly(arm.guard, 0.001), arm.spring).torque;
        for (int k = 0; k < kMaxSubstitutedTicks; ++k) {
            JointState reading = followExactly(arm.guard, 0.001);
            bad.spoil(reading);
            bool wasCalled = false;
            const GuardedTorque& out =
                arm.guard.step(reading, [&](const MotionState&, const Dynamics&, JointVector&) { wasCalled = true; });
            EXPECT_EQ(out.status, GuardStatus::Waiting);
            EXPECT_EQ(out.readingFault, bad.fault);
            EXPECT_FALSE(wasCalled);
            // The robust torque goes on; the nominal one braking at the jerk limit changes by 1 Nm or so per tick.
            EXPECT_LT((out.torque - before).cwiseAbs().maxCoeff(), 2.0);
            before = out.torque;
        }
        const GuardedTorque& out = arm.guard.step(followExactly(arm.guard, 0.001), arm.spring);
        EXPECT_EQ(out.status, GuardStatus::Limited);
        EXPECT_EQ(out.readingFault, ReadingFault::None);
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::None);
    }
}

TEST(TorqueGuard, WithoutReadingsTheArmStopsForGoodAndNoneIsPlausibleLater) {
    for (const BadReading& bad : listBadReadings()) {
        SCOPED_TRACE(bad.name);
        MovingArm arm;
        LimitKeeper keeper(arm.guard);
        GuardStatus status = GuardStatus::Passed;
        JointVector last = arm.guard.step(followExactly(arm.guard, 0.001), arm.spring).torque;
        for (int k = 0; k < 3000; ++k) {
            JointState reading = followExactly(arm.guard, 0.001);
            bad.spoil(reading);
            const GuardedTorque& out = arm.guard.step(reading, arm.spring);
            ASSERT_TRUE(isWithinMotors(out, arm.robot));
            ASSERT_LT((out.torque - last).cwiseAbs().maxCoeff(), 2.0) << k;
            last = out.torque;
            status = out.status;
            keeper.add();
            ASSERT_EQ(arm.guard.stopReason(), k < kMaxSubstitutedTicks ? GuardStop::None : GuardStop::NoReadings);
        }
        EXPECT_EQ(status, GuardStatus::Stopped);
        keeper.expectKept();
        EXPECT_CONTAINS(arm.guard.stopMessage(), "the last 11 readings");
        // A good one is not taken either: nobody knows what the sensors are worth.
        EXPECT_EQ(arm.guard.step(followExactly(arm.guard, -0.002), arm.spring).readingFault, ReadingFault::None);
        EXPECT_LT((arm.guard.record().motorTorque - last).cwiseAbs().maxCoeff(), 2.0);
        // Until the next start.
        arm.guard.start(followExactly(arm.guard));
        EXPECT_EQ(arm.guard.step(followExactly(arm.guard), arm.spring).status, GuardStatus::Limited);
    }
}

TEST(TorqueGuard, AfterMissedTicksAJointMayBeFartherAway) {
    MovingArm arm;
    arm.guard.step(followExactly(arm.guard), arm.spring);
    arm.guard.missTicks(9);  // ten ticks at twice 2 rad/s: up to 40 mrad
    EXPECT_EQ(arm.guard.step(followExactly(arm.guard, 0.03), arm.spring).readingFault, ReadingFault::None);
    EXPECT_EQ(arm.guard.step(followExactly(arm.guard, 0.0), arm.spring).readingFault, ReadingFault::Jumped);
}

TEST(TorqueGuard, AnArmThatFallsBehindIsStoppedByName) {
    TorqueGuardOptions options;
    options.limitsAuthority = false;  // else an arm that does not answer is stopped before
    MovingArm arm(options);
    double behind = 0.0;
    GuardStatus status = GuardStatus::Passed;
    for (int k = 0; k < 2000 && status != GuardStatus::Stopped; ++k) {
        behind += 0.0005;
        JointState reading = followExactly(arm.guard);
        reading.q[1] -= behind;
        const GuardedTorque& out = arm.guard.step(reading, arm.spring);
        ASSERT_EQ(out.readingFault, ReadingFault::None);
        ASSERT_TRUE(isWithinMotors(out, arm.robot));
        status = out.status;
        ASSERT_EQ(arm.guard.stopReason(), behind > 0.1 ? GuardStop::TooFar : GuardStop::None) << behind;
    }
    EXPECT_EQ(status, GuardStatus::Stopped);
    expectContains(arm.guard.stopMessage(),
                   {"joint `joint1` is -0.1", " rad from its nominal place, allowed is 0.1 rad. Find what blocks",
                    "or raise TorqueGuardOptions::largestDeviation"});
}

TEST(TorqueGuard, AFarJointIsPulledNoHarderThanTheLargestDeviationAsks) {
    // Not in the tick, and not ever: the integral stands still.
    TorqueGuardOptions options;
    options.largestDeviation = 0.002;
    options.robustGains = NricOptions{100.0, 20.0, 500.0};  // an integral that would be seen
    MovingArm arm(options);
    arm.guard.missTicks(20);  // the joints may have gone anywhere meanwhile
    for (int k = 0; k < 500; ++k) {
        ASSERT_EQ(arm.guard.step(followExactly(arm.guard, 0.05), arm.spring).readingFault, ReadingFault::None);
        for (int i = 0; i < 2; ++i) ASSERT_NEAR(arm.guard.record().robustTorque[i], -100.0 * 20.0 * 0.002, 1e-9);
        ASSERT_NEAR(arm.guard.record().actual.q[0], arm.guard.record().nominal.q[0] + 0.05, 1e-12);
    }
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::TooFar);
}

// --- Robots that add torques by themselves ---------------------------------------------------------

/** Two seconds of a sway of a shipped robot: a guard, and an arm that adds to what it is sent. */
struct ConventionRun {
    ConventionRun(const char* name, const TorqueConvention& convention, bool hasFriction = true)
        : robot(loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name)) {
        RobotDescription shown = robot;
        if (!hasFriction) {
            shown.actuation.friction.coulomb.setZero(robot.size());
            shown.actuation.friction.viscous.setZero(robot.size());
        }
        SimulatedRobot arm(shown, kTick_s, true);
        RobotModel model(robot);
        Dynamics dynamics;
        TorqueGuardOptions options;
        options.convention = convention;
        TorqueGuard guard(robot, kTick_s, options);
        guard.start(arm.read());
        model.calcDynamics(arm.read().q, JointVector::Zero(robot.size()), dynamics);
        JointVector last = dynamics.gravity;
        if (convention.addsGravity) last.setZero();
        for (int k = 0; k < 2000; ++k) {
            guard.missTicks(arm.waitForTick());
            const JointVector target = robot.home.array() + 0.3 * (1.0 - std::cos(0.002 * k));
            JointState reading = arm.read();
            if (k % 200 == 150) reading.q[0] = kNan;
            model.calcDynamics(arm.read().q, arm.read().qd, dynamics);
            const GuardedTorque& out = guard.step(reading, Spring{target});
            JointVector motors = out.torque;
            if (convention.addsGravity) motors += dynamics.gravity;
            arm.drive(motors);
            largestMotor =
                std::max(largestMotor, (motors.cwiseAbs().array() / robot.actuation.torqueLimit.array()).maxCoeff());
            rate = std::max(rate, (out.torque - last).lpNorm<Eigen::Infinity>() / kTick_s);
            rateLimited += out.rateLimited;
            last = out.torque;
            sent.push_back(out.torque);
            gravity.push_back(dynamics.gravity);
            nominal.push_back(guard.nominal().q);
            farthest = std::max(farthest, (arm.read().q - guard.nominal().q).lpNorm<Eigen::Infinity>());
        }
        EXPECT_EQ(guard.stopReason(), GuardStop::None) << guard.stopMessage();
    }

    RobotDescription robot;
    std::vector<JointVector> sent, gravity, nominal;
    double rate = 0.0, farthest = 0.0, largestMotor = 0.0;
    int rateLimited = 0;
};

TEST(TorqueGuard, ARobotThatAddsGravityIsSentTheRestAndMovesTheSame) {
    TorqueConvention adds;
    adds.addsGravity = true;
    const ConventionRun plain("panda", {}), compensated("panda", adds);
    for (std::size_t k = 0; k < plain.sent.size(); ++k) {
        ASSERT_LE((plain.nominal[k] - compensated.nominal[k]).lpNorm<Eigen::Infinity>(), 1e-12);
        // The last good reading stands for one that is of no use: its gravity is that of a pose near by.
        const double near = k < 150 ? 1e-9 : k % 200 == 150 ? 0.5 : 1e-4;
        ASSERT_LE((plain.sent[k] - compensated.sent[k] - compensated.gravity[k]).lpNorm<Eigen::Infinity>(), near) << k;
    }
    EXPECT_GT(plain.gravity[0].lpNorm<Eigen::Infinity>(), 10.0);
    EXPECT_LT(compensated.farthest, 0.02);
}

TEST(TorqueGuard, ARobotThatAddsFrictionIsNotPaidForItTwice) {
    TorqueConvention adds;
    adds.addsFriction = true;
    const ConventionRun compensated("indy7", adds, false), plain("indy7", {});
    EXPECT_LT(compensated.farthest, plain.farthest);
    // Its motors spend the largest friction of their own: what is left is the limit.
    RobotDescription robot = plain.robot;
    const RobotDescription shown = withConvention(robot, adds);
    for (int i = 0; i < robot.size(); ++i) {
        const double friction = robot.actuation.friction.coulomb[i] + robot.actuation.friction.viscous[i];
        EXPECT_GT(friction, 1.0);
        EXPECT_DOUBLE_EQ(shown.actuation.torqueLimit[i], robot.actuation.torqueLimit[i] - friction);
    }
    TorqueGuardOptions options;
    options.convention = adds;
    options.robustGains = NricOptions{600.0, 20.0, 0.0};
    options.largestDeviation = kInfinity;
    options.largestSpeed = kInfinity;
    options.limitsAuthority = false;
    TorqueGuard guard = startAtHome(robot, options);
    JointState far = atHome(robot);
    far.q.array() -= 3.0;
    const GuardedTorque& out = guard.step(far, Spring{robot.home});
    EXPECT_TRUE(out.motorsSaturated);
    EXPECT_LE((out.torque - shown.actuation.torqueLimit).lpNorm<Eigen::Infinity>(), 1e-9);
}

TEST(TorqueGuard, TheTorqueChangesNoFasterThanTheRobotAccepts) {
    for (const char* name : {"indy7", "ur5e"}) {
        SCOPED_TRACE(name);
        const ConventionRun free(name, {});
        EXPECT_GT(free.rate, 1200.0);  // else nothing is tried
        EXPECT_EQ(free.rateLimited, 0);
        for (const bool addsGravity : {false, true}) {
            TorqueConvention convention;
            convention.addsGravity = addsGravity;
            convention.torqueRate = 1000.0;
            const ConventionRun limited(name, convention);
            EXPECT_LE(limited.rate, 1000.0 * (1.0 + 1e-9));
            EXPECT_GT(limited.rateLimited, 0);
            EXPECT_LT(limited.farthest, 1.2 * free.farthest);
            EXPECT_LE(limited.largestMotor, 1.0);
        }
    }
}

// --- Without readings: an arm that moves by itself -------------------------------------------------

/** A robot with friction and a payload that the guard knows nothing of, in a sway or held at home. */
struct SwayingArm {
    SwayingArm(const char* name, bool sways, double seconds)
        : robot(loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name)),
          arm(robot, kTick_s, true),
          guard(robot, kTick_s),
          amplitude(sways ? 0.3 : 0.0) {
        guard.start(arm.read());
        largestRobustTorque.setZero(robot.size());
        run(seconds);
        EXPECT_EQ(guard.stopReason(), GuardStop::None);
        EXPECT_LT(deviation(), 0.02);
    }
    /** @param readings  else every one is NaN */
    void run(double seconds, bool readings = true) {
        for (const double end = time + seconds; time < end; time += kTick_s) {
            guard.missTicks(arm.waitForTick());
            JointState reading = arm.read();
            if (!readings) reading.q.setConstant(robot.size(), kNan);
            const JointVector target = robot.home.array() + amplitude * (1.0 - std::cos(2.0 * time));
            const GuardedTorque& out = guard.step(reading, Spring{target});
            arm.drive(out.torque);
            status = out.status;
            farthest = std::max(farthest, deviation());
            largestRobustTorque = largestRobustTorque.cwiseMax(guard.record().robustTorque.cwiseAbs());
        }
    }
    double deviation() const { return (arm.read().q - guard.nominal().q).lpNorm<Eigen::Infinity>(); }
    double speed() const { return arm.read().qd.lpNorm<Eigen::Infinity>(); }

    RobotDescription robot;
    SimulatedRobot arm;
    TorqueGuard guard;
    double amplitude, time = 0.0, farthest = 0.0;
    GuardStatus status = GuardStatus::NotStarted;
    JointVector largestRobustTorque;
};

TEST(TorqueGuard, AnArmThatHasLostItsSensorsIsBrakedAndItsTorqueDoesNotGrow) {
    struct Case {
        const char* robot;
        bool sways;
        double afterTheStop, inTheEnd;  // farthest from the nominal arm [rad]
        double speedInTheEnd;           // [rad/s]
    };
    // The Indy7's friction keeps what is braked near its place; the UR5e is without any, and floats.
    const Case cases[] = {{"indy7", true, 0.1, 0.6, 0.1},
                          {"indy7", false, 0.01, 0.02, 0.01},
                          {"ur5e", false, 0.05, kInfinity, kInfinity}};
    for (const Case& c : cases) {
        SCOPED_TRACE(std::string(c.robot) + (c.sways ? ", in motion" : ", at rest"));
        SwayingArm arm(c.robot, c.sways, 1.0);
        EXPECT_EQ(arm.speed() > 0.3, c.sways);
        const JointVector last = arm.guard.record().robustTorque.cwiseAbs();
        EXPECT_GT(last.maxCoeff(), 1.0);
        arm.largestRobustTorque.setZero();
        arm.farthest = 0.0;
        arm.run(1.0, false);
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::NoReadings);
        EXPECT_CONTAINS(arm.guard.stopMessage(), "engage the brakes");
        EXPECT_EQ(arm.status, GuardStatus::Stopped);
        EXPECT_LT(arm.farthest, c.afterTheStop);
        EXPECT_LT(arm.speed(), 0.05);
        arm.run(9.0, false);
        EXPECT_LT(arm.farthest, c.inTheEnd);
        EXPECT_LT(arm.speed(), c.speedInTheEnd);
        for (int i = 0; i < arm.robot.size(); ++i) EXPECT_LE(arm.largestRobustTorque[i], last[i] * (1.0 + 1e-12)) << i;
    }
}

TEST(TorqueGuard, AnArmStoppedWithReadingsIsHeldAtTheNominalOne) {
    for (const char* name : {"indy7", "ur5e", "panda"}) {
        SCOPED_TRACE(name);
        SwayingArm arm(name, true, 1.0);
        arm.guard.requestStop();
        arm.run(10.0);
        EXPECT_EQ(arm.guard.stopReason(), GuardStop::Requested);
        EXPECT_LT(arm.deviation(), 1e-3);  // the integral is at work
        EXPECT_LT(arm.speed(), 0.02);      // ticks come late now and then
    }
}

TEST(TorqueGuard, TheRobustLoopStandsStillInMissedTicks) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    TorqueGuardOptions options;
    options.robustGains = NricOptions{600.0, 20.0, 100.0};
    options.limitsAuthority = false;  // the reading does not answer what the loop does
    TorqueGuard guard = startAtHome(robot, options);
    const Spring spring{robot.home};
    for (int k = 0; k < 50; ++k) guard.step(followExactly(guard, 1e-4 * k), spring);
    const JointVector before = guard.step(followExactly(guard, 0.005), spring).torque;
    guard.missTicks(900);
    const JointVector after = guard.step(followExactly(guard, 0.005), spring).torque;
    // One tick of the integral: 600 x 100 x 0.005 x 0.001.
    EXPECT_LT((after - before).cwiseAbs().maxCoeff(), 0.3 + 1e-6);
    EXPECT_EQ(guard.stopReason(), GuardStop::None);
}

// Ticks without a reading tell nothing: a stuck encoder is found all the same, and a joint that sticks is no stuck encoder.
TEST(TorqueGuard, MissedTicksNeitherHideAStuckEncoderNorMakeOne) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    for (const bool isStuck : {true, false}) {
        TorqueGuard guard = startAtHome(robot);
        Spring spring{robot.home};
        spring.target[0] += 1.0;
        double lag = 0.0;  // of the reading
        int stands = 0;
        bool wasMissed = false;
        for (int k = 0; k < 200 && guard.stopReason() == GuardStop::None; ++k) {
            // One that is not stuck sticks at the beginning alone, and some ticks are missed just before it breaks loose.
            if (isStuck || (lag < 2e-3 && stands < 80)) {
                lag = guard.nominal().q[0] - robot.home[0];
                ++stands;
            }
            JointState reading = followExactly(guard);
            const bool stood = lag == guard.nominal().q[0] - robot.home[0];
            reading.q[0] = stood ? robot.home[0] : reading.q[0] - lag;
            if (stood) reading.qd[0] = 0.0;
            guard.step(reading, spring);
            const bool misses = isStuck ? k % 5 == 4 : !wasMissed && guard.nominal().qd[0] > 0.052;
            if (misses) guard.missTicks(isStuck ? 1 : 6);
            EXPECT_TRUE(stood || !misses) << "a reading that stands is what hides";
            wasMissed |= misses;
        }
        EXPECT_TRUE(wasMissed);
        EXPECT_GE(stands, 5);
        EXPECT_EQ(guard.stopReason(), isStuck ? GuardStop::TooFar : GuardStop::None) << guard.stopMessage();
        if (isStuck) EXPECT_CONTAINS(guard.stopMessage(), "joint0 does not answer its motor");
        std::printf("  %d readings that stand, %.3f rad/s in the end\n", stands, guard.nominal().qd[0]);
    }
}

TEST(TorqueGuard, WhatIsWithheldIsNotSummedUpHoweverOftenATickIsMissed) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    for (const int every : {0, 2, 3}) {
        TorqueGuardOptions options;
        options.robustGains = NricOptions{600.0, 20.0, 8.0};
        TorqueGuard guard = startAtHome(robot, options);
        const Spring spring{robot.home};
        double largest = 0.0;
        for (int k = 0; k < 4500;
             ++k) {  // joint 1 is pushed 50 mrad away, yields a little all the time, and comes back
            JointState reading = followExactly(guard);
            reading.q[1] -= std::min({0.05, 1e-4 * k, 1e-4 * (4500 - k)}) + (k % 2 ? 1e-5 : 0.0);
            guard.step(reading, spring);
            largest = std::max(largest, std::abs(guard.record().robustTorque[1]));
            if (every > 0 && k % every == 0) guard.missTicks(1);
        }
        ASSERT_EQ(guard.stopReason(), GuardStop::None) << guard.stopMessage();
        EXPECT_GE(largest, 0.25 * robot.actuation.torqueLimit[1]) << "it was cut";
        for (int k = 0; k < 20; ++k) guard.step(followExactly(guard), spring);
        // In full it would be 4 s x 50 mrad x 600 x 8, and cut.
        EXPECT_LT(std::abs(guard.record().robustTorque[1]), 0.3 * largest) << every;
        std::printf("  a tick missed in %d: %.1f of %.0f Nm left\n", every, guard.record().robustTorque[1], largest);
    }
}

TEST(TorqueGuard, WithoutGainsEveryShippedRobotGetsGainsThatItsPosesCarry) {
    for (const char* name : {"indy7", "panda", "ur5e", "planar_two_link", "single_joint"}) {
        SCOPED_TRACE(name);
        const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name);
        TorqueGuard guard(robot, kTick_s);
        ASSERT_TRUE(guard.robustGains());
        std::mt19937 random(11);
        const JointLimits& limits = guard.limits();
        for (int k = 0; k < 200; ++k) {
            JointState pose = atHome(robot);
            for (int i = 0; i < robot.size(); ++i) {
                const double share = 0.01 + 0.98 * static_cast<double>(random()) / 4294967296.0;
                pose.q[i] = limits.position.lower[i] + share * (limits.position.upper[i] - limits.position.lower[i]);
            }
            ASSERT_NO_THROW(guard.start(pose)) << k;
        }
    }
    TorqueGuardOptions none;
    none.hasRobustLoop = false;
    EXPECT_FALSE(TorqueGuard(makeTwoLinkArm(), kTick_s, none).robustGains());
}

// --- Stops ----------------------------------------------------------------------------------------

TEST(TorqueGuard, AStoppedArmIsHeldWhereItIsUntilTheNextStart) {
    MovingArm arm;
    arm.guard.requestStop();
    EXPECT_GT(runUntilStopped(arm.guard, arm.robot, arm.spring), 100);
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::Requested);
    arm.guard.step(followExactly(arm.guard), arm.spring);
    const JointVector held = arm.guard.nominal().q;
    RobotModel model(arm.robot);
    Dynamics dynamics;
    model.calcDynamics(held, JointVector::Zero(2), dynamics);
    for (int k = 0; k < 20000; ++k) {
        const GuardedTorque& out = arm.guard.step(followExactly(arm.guard), arm.spring);
        ASSERT_EQ(out.status, GuardStatus::Stopped);
        ASSERT_EQ(arm.guard.nominal().q, held);
        ASSERT_EQ(arm.guard.nominal().qd, JointVector::Zero(2));
        ASSERT_LT((out.torque - dynamics.gravity).norm(), 1e-9);
    }
    // The robust loop holds it there.
    EXPECT_LT((arm.guard.step(followExactly(arm.guard, 0.001), arm.spring).torque - dynamics.gravity).maxCoeff(), -5.0);

    arm.guard.start(followExactly(arm.guard));
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::None);
    EXPECT_STREQ(arm.guard.stopMessage(), "");
    EXPECT_EQ(arm.guard.step(followExactly(arm.guard), arm.spring).status, GuardStatus::Limited);
}

TEST(TorqueGuard, AStopMayBeRequestedFromAnyThreadAndBeforeTheStart) {
    MovingArm arm;
    std::thread other([&] { arm.guard.requestStop(); });
    runUntilStopped(arm.guard, arm.robot, arm.spring);
    other.join();
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::Requested);
    arm.guard.requestStop();
    arm.guard.start(followExactly(arm.guard));
    EXPECT_EQ(arm.guard.stopReason(), GuardStop::None);
    bool wasCalled = false;
    EXPECT_LT(runUntilStopped(arm.guard, arm.robot,
                              [&](const MotionState&, const Dynamics&, JointVector&) { wasCalled = true; }),
              10);
    EXPECT_FALSE(wasCalled);
}

TEST(TorqueGuard, WithoutAStartThereIsNoTorque) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuard guard(robot, kTick_s);
    guard.missTicks(5);
    bool wasCalled = false;
    const GuardedTorque& out =
        guard.step(atHome(robot), [&](const MotionState&, const Dynamics&, JointVector&) { wasCalled = true; });
    EXPECT_EQ(out.status, GuardStatus::NotStarted);
    EXPECT_EQ(out.torque, JointVector::Zero(2));
    EXPECT_FALSE(wasCalled);
    TorqueGuard moved = std::move(guard);
    moved.start(atHome(robot));
    EXPECT_NE(moved.step(atHome(robot), Spring{robot.home}).status, GuardStatus::NotStarted);
}

/** Without limits on readings and motors nothing holds the robust loop back. */
TEST(TorqueGuard, ARobustTorqueBeyondAllArithmeticStopsTheArm) {
    RobotDescription robot = makeTwoLinkArm();
    robot.actuation.torqueLimit = joints(kInfinity, kInfinity);
    TorqueGuardOptions options;
    options.largestSpeed = kInfinity;
    TorqueGuard guard = startAtHome(robot, options);
    guard.step(atHome(robot), Spring{robot.home});
    EXPECT_EQ(guard.stopReason(), GuardStop::None);
    EXPECT_LE(guard.step({robot.home, joints(1e15, 0.0)}, Spring{robot.home}).torque.lpNorm<Eigen::Infinity>(), 1e9);
    EXPECT_EQ(guard.stopReason(), GuardStop::RobustLoopFailed);
    EXPECT_CONTAINS(guard.stopMessage(), "beyond 1e9");
}

TEST(TorqueGuard, BeyondAllArithmeticTheTorqueGoesToZero) {
    RobotDescription robot = makeTwoLinkArm();
    robot.limits = JointLimits::unlimited(2);
    robot.limits.velocity = {joints(-1e7, -1e7), joints(1e7, 1e7)};
    robot.limits.acceleration = robot.limits.jerk = robot.limits.velocity;
    TorqueGuard guard = startAtHome(robot);
    GuardStatus status = GuardStatus::Passed;
    for (int k = 0; k < 2000 && status != GuardStatus::Failed; ++k) {
        const GuardedTorque& out =
            guard.step(followExactly(guard), [](const MotionState&, const Dynamics& d, JointVector& torque) {
                torque = d.M * JointVector::Constant(2, 1e7) + d.b;
            });
        ASSERT_TRUE(isWithinMotors(out, robot));
        status = out.status;
    }
    EXPECT_EQ(status, GuardStatus::Failed);
    EXPECT_EQ(guard.stopReason(), GuardStop::FilterFailed);
    for (int k = 0; k < 25; ++k) guard.step(followExactly(guard), Spring{robot.home});
    EXPECT_EQ(guard.step(followExactly(guard), Spring{robot.home}).torque, JointVector::Zero(2));
    EXPECT_EQ(guard.step(followExactly(guard), Spring{robot.home}).status, GuardStatus::Failed);
}

// --- Starts ---------------------------------------------------------------------------------------

TEST(TorqueGuard, AStartAtSpeedIsTakenUp) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuard guard(robot, kTick_s);
    guard.start({robot.home, joints(1.5, -2.0)});
    EXPECT_EQ(guard.nominal().qd, joints(1.5, -2.0));
    LimitKeeper keeper(guard);
    BangBang law(2, 300.0, 5);
    for (int k = 0; k < 3000; ++k) {
        ASSERT_LE(guard.step(followExactly(guard), law).status, GuardStatus::Limited);
        keeper.add();
    }
    keeper.expectKept();
}

TEST(TorqueGuard, AStartThatCannotKeepTheLimitsIsRefusedOrLedBack) {
    const RobotDescription robot = makeTwoLinkArm();
    const std::pair<JointState, const char*> starts[] = {
        {{joints(2.6, 0.0), joints(0.0, 0.0)}, "the start of joint0 is outside its limits: position 2.6 rad"},
        {{joints(0.0, 0.0), joints(0.0, 2.6)}, "velocity 2.6 rad/s is beyond velocity_upper"},
        {{joints(0.0, 2.49), joints(0.0, 1.0)}, "the start of joint1 is not viable"},
    };
    for (const auto& [start, words] : starts) {
        SCOPED_TRACE(words);
        TorqueGuard strict = startAtHome(robot);
        expectError({words, "CertifiedBrakingOptions::recovery"}, [&, &s = start] { strict.start(s); });
        EXPECT_EQ(strict.step(start, Spring{robot.home}).status, GuardStatus::NotStarted);
        EXPECT_EQ(strict.step(start, Spring{robot.home}).torque, JointVector::Zero(2));

        TorqueGuardOptions options;
        options.filter.recovery = true;
        TorqueGuard guard(robot, kTick_s, options);
        guard.start(start);
        int recovering = 0;
        GuardStatus status = GuardStatus::NotStarted;
        for (int k = 0; k < 4000; ++k) {
            status = guard.step(followExactly(guard), Spring{joints(3.0, -3.0)}).status;
            ASSERT_LE(status, GuardStatus::Recovering);
            recovering += status == GuardStatus::Recovering;
        }
        EXPECT_GT(recovering, 0);
        EXPECT_LE(status, GuardStatus::Limited);
        EXPECT_LE(guard.nominal().q[0], 2.5 + 1e-9);
    }
}

TEST(TorqueGuard, AMalformedStartIsRefused) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuard guard(robot, kTick_s);
    expectError({"0 positions and 0 velocities for 2 joints"}, [&] { guard.start({}); });
    expectError({"TorqueGuard::start: the start has 2 positions and 3 velocities"}, [&] {
        guard.start({robot.home, JointVector::Zero(3)});
    });
    expectError({"not finite"}, [&] { guard.start({robot.home, joints(0.0, kNan)}); });
    expectError({"beyond 1e7"}, [&] { guard.start({joints(1e8, 0.0), joints(0.0, 0.0)}); });
}

TEST(TorqueGuard, RobustGainsThatTheTickCannotCarryAreRefusedByJoint) {
    TorqueGuardOptions options;
    options.robustGains = NricOptions{joints(600.0, 2000.0)};
    TorqueGuard guard(makeTwoLinkArm(), kTick_s, options);
    const std::string complaint = catchError([&] { guard.start(atHome(makeTwoLinkArm())); });
    expectContains(complaint, {"NricOptions::kr: in this pose kr * tick_s is 2.", "joint `joint1`",
                               "Lower kr of that joint from 2000 to "});
    options.robustGains->kr = joints(600.0, std::strtod(complaint.c_str() + complaint.find("2000 to ") + 8, nullptr));
    TorqueGuard lowered(makeTwoLinkArm(), kTick_s, options);
    lowered.start(atHome(makeTwoLinkArm()));

    RobotDescription weightless = makeTwoLinkArm();
    weightless.joints[1].body = {};
    weightless.actuation.rotorInertia.setZero();
    TorqueGuard none(weightless, kTick_s);
    expectError({"not positive definite"}, [&] { none.start(atHome(weightless)); });
}

// --- Construction ---------------------------------------------------------------------------------

TEST(TorqueGuard, EveryWrongConstructionSaysPlaceCauseAndRemedy) {
    struct Given {
        RobotDescription robot = makeTwoLinkArm();
        double tick_s = kTick_s;
        TorqueGuardOptions options;
    };
    const std::pair<const char*, void (*)(Given&)> cases[] = {
        {"TorqueGuard: the tick is 0 s; allowed is [1e-05, 0.1] s. Give the period", [](Given& g) { g.tick_s = 0.0; }},
        {"the tick is nan s", [](Given& g) { g.tick_s = kNan; }},
        {"the tick is 1 s", [](Given& g) { g.tick_s = 1.0; }},
        {"TorqueGuardOptions::limits: the limits are those of 3 joints; the robot has 2. Give each bound",
         [](Given& g) { g.options.limits = JointLimits::unlimited(3); }},
        {"jerk_lower has 1 numbers; allowed is 2",
         [](Given& g) {
             g.options.limits = g.robot.limits;
             g.options.limits->jerk.lower.resize(1);
         }},
        {"RobotDescription::limits: joint `joint1`: velocity_upper is -1 rad/s; allowed is",
         [](Given& g) { g.robot.limits.velocity.upper[1] = -1.0; }},
        {"position_upper is nan", [](Given& g) { g.robot.limits.position.upper[0] = kNan; }},
        {"finite jerk limit on every joint", [](Given& g) { g.robot.limits.jerk.upper[0] = kInfinity; }},
        {"CertifiedBrakingOptions::kAlpha", [](Given& g) { g.options.filter.kAlpha = kNan; }},
        {"CertifiedBrakingOptions::gamma", [](Given& g) { g.options.filter.gamma = kNan; }},
        {"NricOptions::kr: the gain of joint 0 is nan", [](Given& g) { g.options.robustGains = NricOptions{kNan}; }},
        {"NricOptions::kp: 3 gains; the robot has 2 joints",
         [](Given& g) {
             g.options.robustGains = NricOptions{600.0, JointVector(JointVector::Zero(3))};
         }},
        {"TorqueGuardOptions::largestDeviation: 0 for joint `joint0`; allowed is above 0",
         [](Given& g) { g.options.largestDeviation = 0.0; }},
        {"TorqueGuardOptions::largestDeviation: 3 numbers",
         [](Given& g) { g.options.largestDeviation = JointVector(JointVector::Ones(3)); }},
        {"TorqueConvention::torqueRate: 0 Nm/s for joint `joint0`; allowed is above 0",
         [](Given& g) { g.options.convention.torqueRate = 0.0; }},
        {"TorqueConvention::torqueRate: 3 numbers; the robot has 2 joints",
         [](Given& g) { g.options.convention.torqueRate = JointVector(JointVector::Ones(3)); }},
        {"TorqueConvention::addsFriction: the friction of joint `joint1` takes up to 9 Nm of the 4 Nm",
         [](Given& g) {
             g.robot.actuation.friction = {joints(1.0, 6.0), joints(1.0, 3.0), joints(1.0, 1.0)};
             g.robot.actuation.torqueLimit = joints(4.0, 4.0);
             g.options.convention.addsFriction = true;
         }},
        {"TorqueGuardOptions::largestSpeed: nan for joint `joint0`", [](Given& g) { g.options.largestSpeed = kNan; }},
        {"the robot has 0 joints; allowed is 1 to 16", [](Given& g) { g.robot = {}; }},
        {"the robot has 17 joints", [](Given& g) { g.robot.joints.resize(17); }},
        {"joint `joint0` has joint 1 as its parent", [](Given& g) { g.robot.joints[0].parent = 1; }},
        {"toolParent is 2; allowed is -1 to 1", [](Given& g) { g.robot.toolParent = 2; }},
        {"actuation.torqueLimit has 0 entries; the robot has 2 joints",
         [](Given& g) { g.robot.actuation.torqueLimit.resize(0); }},
        {"actuation.torqueLimit of joint `joint1` is 0; allowed is above 0",
         [](Given& g) { g.robot.actuation.torqueLimit[1] = 0.0; }},
        {"actuation.rotorInertia of joint `joint0` is -1", [](Given& g) { g.robot.actuation.rotorInertia[0] = -1.0; }},
        {"actuation.encoderCounts of joint `joint0` is nan",
         [](Given& g) { g.robot.actuation.encoderCounts[0] = kNan; }},
    };
    for (const auto& [words, spoil] : cases) {
        SCOPED_TRACE(words);
        Given given;
        spoil(given);
        expectError({words}, [&] { TorqueGuard(given.robot, given.tick_s, given.options); });
    }
}

TEST(TorqueGuard, LimitsOnOneSideOrNoneAreEnoughToBegin) {
    RobotDescription robot = makeTwoLinkArm();
    robot.limits.position = {joints(-kInfinity, 20.0), joints(-20.0, kInfinity)};
    robot.allowLargeAngles = true;
    robot.home = joints(-25.0, 25.0);
    TorqueGuard guard = startAtHome(robot);
    EXPECT_LE(guard.step(followExactly(guard), Spring{robot.home}).status, GuardStatus::Limited);
}

// --- Motors, real time ----------------------------------------------------------------------------

TEST(TorqueGuard, MotorsGetNoMoreThanTheyBearWithAndWithoutRobustLoop) {
    for (const bool isRobust : {true, false}) {
        RobotDescription robot = makeTwoLinkArm();
        robot.actuation.torqueLimit = joints(30.0, 10.0);
        TorqueGuardOptions options;
        if (!isRobust) options.hasRobustLoop = false;
        TorqueGuard guard = startAtHome(robot, options);
        BangBang law(2, 300.0, 4);
        int saturated = 0, free = 0;
        for (int k = 0; k < 5000; ++k) {
            const GuardedTorque& out = guard.step(followExactly(guard), law);
            ASSERT_TRUE(isWithinMotors(out, robot));
            const bool isAtLimit = std::abs(out.torque[0]) == 30.0 || std::abs(out.torque[1]) == 10.0;
            ASSERT_EQ(out.motorsSaturated, isAtLimit);
            saturated += isAtLimit;
            free += !isAtLimit;
            if (isRobust || isAtLimit) continue;
            ASSERT_EQ(out.torque, guard.record().filterTorque);
        }
        EXPECT_GT(saturated, 100);
        EXPECT_GT(free, 100);
    }
}

TEST(TorqueGuard, AStepAllocatesNothingWhateverHappens) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    TorqueGuard guard = startAtHome(robot);
    Summary summary(robot.jointNames(), guard.limits(), true);
    const Spring there{robot.home + JointVector::Constant(6, 5.0)}, back{robot.home};
    const JointState none;
    std::vector<GuardStatus> seen;
    seen.reserve(20000);
    std::int64_t allocations = 0;
    for (int k = 0; k < 12000; ++k) {
        const JointState reading = followExactly(guard);
        const Spring& spring = k < 10800 ? there : back;
        const testing::AllocationCounter counter;
        if (k % 100 == 0) guard.missTicks(3);
        if (k == 11000) guard.requestStop();
        const GuardedTorque& out = k % 50 == 1 ? guard.step(none, spring)
                                   : k % 50 == 2
                                       ? guard.step(reading, [](const MotionState&, const Dynamics&, JointVector&) {})
                                       : guard.step(reading, spring);
        summary.add(guard.record());
        seen.push_back(out.status);
        allocations += counter.count();
    }
    EXPECT_EQ(allocations, 0);
    for (GuardStatus status : {GuardStatus::Limited, GuardStatus::Waiting, GuardStatus::Stopping, GuardStatus::Stopped})
        EXPECT_NE(std::find(seen.begin(), seen.end(), status), seen.end()) << getName(status);
}

// --- The example ----------------------------------------------------------------------------------

TEST(TorqueGuard, TheLoopInTheReadmeIsThatOfTheExample) {
    const std::string example = test::readFile(VIABLE_SOURCE_DIR "/framework/examples/own_loop/own_loop.cpp");
    const std::string mark = "    // [the loop]\n";
    const std::size_t begin = example.find(mark) + mark.size(), end = example.rfind(mark);
    ASSERT_LT(begin, end);
    std::istringstream lines(example.substr(begin, end - begin));
    std::string snippet = "```cpp\n";
    for (std::string line; std::getline(lines, line);) snippet += (line.size() > 4 ? line.substr(4) : "") + "\n";
    EXPECT_CONTAINS(test::readFile(VIABLE_SOURCE_DIR "/framework/README.md"), snippet + "```\n");
}

// A push of 30 Nm on an arm that would follow exactly: measured, the nominal arm yields to it and the motors give
// way; the limits hold.
TEST(TorqueGuard, AMeasuredPushMovesTheNominalArmWithinItsLimits) {
    const RobotDescription robot = makeTwoLinkArm();
    TorqueGuard guard(robot, kTick_s);
    TorqueGuard calm(robot, kTick_s);
    Summary summary(robot.jointNames(), guard.limits(), true);
    const JointVector push = joints(30.0, -10.0);
    guard.start(atHome(robot));
    calm.start(atHome(robot));
    double moved = 0.0;
    for (int k = 0; k < 1500; ++k) {
        const bool isPushed = k >= 100 && k < 1100;
        const JointVector external = isPushed ? push : JointVector(joints(0.0, 0.0));
        const GuardedTorque& out = guard.step(followExactly(guard), external, Spring{robot.home});
        calm.step(followExactly(calm), Spring{robot.home});
        ASSERT_NE(out.status, GuardStatus::Stopping);
        const JointVector expected = (guard.record().filterTorque - external)
                                         .cwiseMin(robot.actuation.torqueLimit)
                                         .cwiseMax(-robot.actuation.torqueLimit);
        ASSERT_LT((out.torque - expected).norm(), 1e-9);
        summary.add(guard.record());
        moved = std::max(moved, (guard.nominal().q - calm.nominal().q).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(moved, 1e-2);
    EXPECT_FALSE(summary.anyLimitBroken());
}

TEST(TorqueGuard, AnExternalTorqueOfNoUseMakesTheReadingUseless) {
    const RobotDescription robot = makeTwoLinkArm();
    for (const JointVector& bad : {joints(kNan, 0.0), joints(0.0, 1e300), JointVector(JointVector::Zero(3))}) {
        TorqueGuard guard = startAtHome(robot);
        const Spring law{robot.home};
        guard.step(followExactly(guard), joints(5.0, 0.0), law);
        for (int k = 0; k < 10; ++k) {
            const GuardedTorque& out = guard.step(followExactly(guard), bad, law);
            ASSERT_EQ(out.status, GuardStatus::Waiting);
            ASSERT_EQ(out.readingFault, ReadingFault::Malformed);
            ASSERT_EQ(guard.record().externalTorque[0], 5.0);  // the last one stands
        }
        guard.step(followExactly(guard), bad, law);
        EXPECT_EQ(guard.stopReason(), GuardStop::NoReadings);
        EXPECT_EQ(guard.record().externalTorque[0], 0.0);
    }
}

}  // namespace
}  // namespace viable
