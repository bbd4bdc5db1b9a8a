#include "Balls.h"

#include <thread>

#include "WholeArm.h"
#include "environment/CollisionChecker.h"
#include "viable/environment/Surroundings.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;
/** Accuracy of the judge and rounding [m]. */
constexpr double kAllowed_m = 1e-8;

Solid makeBox(const char* name, const Eigen::Vector3d& centre, const Eigen::Vector3d& size) {
    Solid box;
    box.name = name;
    box.kind = Solid::Kind::Box;
    box.pose.translation() = centre;
    box.size = size;
    return box;
}

/** Indy7 among obstacles, under the filter. */
class ArmAmongObstacles : public FilteredWholeArm {
public:
    explicit ArmAmongObstacles(const Environment& surroundings, WholeArmBrakingOptions options = {},
                               RobotDescription description = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"))
        : FilteredWholeArm(std::move(description)),
          environment(surroundings),
          feed(makeSurroundings(surroundings)),
          setup_{robot, robot.limits, kTick_s, 60.0, state, dynamics.tool, &geometry, &feed},
          options_(options) {}

    static std::shared_ptr<const Surroundings> makeSurroundings(const Environment& e) {
        const Eigen::Vector3d far = Eigen::Vector3d::Constant(2.0);
        return std::make_shared<Surroundings>(e, -far, far, 0.5);
    }

    void configure() {
        filter.configure(setup_, options_);
        filter.reset(state);
    }
    double findDistance() const {
        if (!checker_) checker_ = std::make_unique<CollisionChecker>(robot, geometry, environment);
        return checker_->findContact(state.q, t, 0.5).distance;
    }

    Environment environment;
    SurroundingsFeed feed;

private:
    RunSetup setup_;
    WholeArmBrakingOptions options_;
    mutable std::unique_ptr<CollisionChecker> checker_;
};

/** Which way the tool points at home, about the base axis. */
double findHeading() {
    ArmAmongObstacles arm(Environment{});
    const Eigen::Vector3d p = arm.dynamics.tool.position;
    return std::atan2(p.y(), p.x());
}

/** Nothing but a thin plate, in the arm's way when its base joint turns by `angle`. */
Environment makePlate(double angle, double thickness) {
    Solid plate = makeBox("plate", Eigen::Vector3d::Zero(), {2.0, thickness, 3.0});
    plate.pose.linear() = Eigen::AngleAxisd(findHeading() + angle + kPi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    plate.pose.translation() = plate.pose.linear() * Eigen::Vector3d(-1.25, 0.0, 0.0);
    Environment environment;
    environment.solids.push_back(plate);
    return environment;
}

// A plate of a tenth of a millimetre: no look at the stop ever falls into it, and yet it is never passed, at any speed.
TEST(WholeArmBraking, AThinPlateBetweenTwoLooksIsNotMissed) {
    for (const double angle : {0.6, 1.0, 1.5}) {
        Environment environment = makePlate(angle, 1e-4);
        environment.safetyDistance_m = 0.0;
        ArmAmongObstacles arm(environment);
        arm.configure();
        const JointVector goal = turned(arm.robot.home, 0, 3.0);
        double least = kInfinity;
        for (int tick = 0; tick < 3000; ++tick) {
            arm.goTo(goal, 400.0);
            least = std::min(least, arm.findDistance());
        }
        EXPECT_GT(least, -kAllowed_m) << angle;
        EXPECT_LT(least, 0.02) << "it never came near the plate";
        EXPECT_LT(arm.state.q[0], arm.robot.home[0] + angle);
    }
}

// Touching the safety distance, a command that leads away moves the arm in the next ticks.
TEST(WholeArmBraking, MovingAwayIsPossibleAtOnce) {
    for (const double kAlpha : {kInfinity, 20.0}) {
        Environment environment = makePlate(0.8, 0.02);
        environment.safetyDistance_m = 0.03;
        WholeArmBrakingOptions options;
        options.joints.kAlpha = kAlpha;
        ArmAmongObstacles arm(environment, options);
        arm.configure();
        for (int tick = 0; tick < 4000; ++tick) arm.goTo(turned(arm.robot.home, 0, 2.0));
        const double touching = arm.findDistance();
        EXPECT_LT(touching, 0.045);
        EXPECT_GE(touching, 0.03 - kAllowed_m);
        // Until it is a microradian away; and how long full jerk takes from the same state, were there no plate.
        const double at = arm.state.q[0], fullJerk = arm.robot.limits.jerk.lower[0];
        AxisState free{at, arm.state.qd[0], arm.state.qdd[0]};
        int least = 0, delay = 0;
        for (; !(free.p < at - 1e-6); ++least) free = advance(free, fullJerk, kTick_s);
        for (; !(arm.state.q[0] < at - 1e-6) && delay < 200; ++delay) {
            arm.goTo(arm.robot.home);
            if (delay == 0) EXPECT_EQ(arm.decision.value[0], fullJerk);
        }
        std::printf("  k_alpha %g: %.1f mm from the plate, away by a microradian after %d ticks; at full jerk %d\n",
                    kAlpha, 1e3 * touching, delay, least);
        EXPECT_LE(delay, least + 2);
        for (int tick = 0; tick < 4000; ++tick) arm.goTo(arm.robot.home);
        EXPECT_NEAR(arm.state.q[0], arm.robot.home[0], 1e-3);
    }
}

TEST(WholeArmBraking, WithoutAnythingAroundItIsCertifiedBrakingToTheLastBit) {
    Environment nothing;
    WholeArmBrakingOptions options;
    options.joints.kAlpha = 50.0;
    ArmAmongObstacles arm(nothing, options), plain(nothing, options);
    arm.geometry.pairs.clear();
    arm.configure();
    CertifiedBrakingFilter filter;
    const RunSetup setup{plain.robot, plain.robot.limits, kTick_s, 60.0, plain.state, plain.dynamics.tool};
    filter.configure(setup, options.joints);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    JointVector qdd = JointVector::Zero(6);
    FilterDecision decision;
    for (int tick = 0; tick < 1500; ++tick) {
        if (tick % 150 == 0)
            for (double& x : qdd) x = 6.0 * share(random);
        JointVector torque;
        calcInverseDynamics(arm.dynamics, qdd, torque);
        filter.filter({arm.state, torque, arm.dynamics}, decision);
        ASSERT_EQ(arm.push(qdd) == FilterStatus::StoppedByPlan, false) << tick;
        ASSERT_EQ(decision.value, arm.decision.value) << tick;
    }
}

Environment makeRoom() {
    Environment environment;
    environment.solids = {
        makeBox("table", {0.2, 0.0, -0.06}, {1.6, 1.2, 0.04}), makeBox("wall", {0.8, 0.0, 0.6}, {0.1, 2.0, 1.4}),
        makeBox("pillar", {0.35, 0.45, 0.7}, {0.1, 0.1, 1.6}), makeBox("shelf", {0.5, -0.5, 0.55}, {0.5, 0.4, 0.03})};
    return environment;
}

// What stops before an obstacle comes to rest there, whatever the command asks for: it must not use up the rounding of
// distances tick by tick.
TEST(WholeArmBraking, ABrakedArmRestsWithoutChattering) {
    const Environment environment = makeRoom();
    std::mt19937 random(11);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    int stopped = 0;
    for (int k = 0; k < 24; ++k) {
        JointVector goal(6);
        for (int i = 0; i < 6; ++i) goal[i] = (k % 3 == 0 ? 3.2 : 2.0) * share(random);
        WholeArmBrakingOptions options;
        options.joints.kAlpha = 20.0;
        options.steers = false;
        ArmAmongObstacles arm(environment, options);
        arm.configure();
        const double stiffness = k % 2 ? 6.0 : 40.0;
        for (int tick = 0; tick < 8000; ++tick) arm.goTo(goal, stiffness);
        double largest = 0.0;
        for (int tick = 0; tick < 1000; ++tick) {
            arm.goTo(goal, stiffness);
            largest = std::max(largest, arm.decision.value.lpNorm<Eigen::Infinity>());
        }
        EXPECT_LT(largest, 1e-4) << "goal " << k;  // [rad/s^3], of limits of 37.7
        stopped += (arm.state.q - goal).lpNorm<Eigen::Infinity>() > 0.1;
    }
    EXPECT_GT(stopped, 10);
}

// Poses with room around them, drawn at random, each wanted from home by a controller that knows of nothing. How many of them
// are reached, and how near the others come, steering and only stopping.
TEST(WholeArmBraking, SteeringReachesMoreOfTheFreeSpaceThanStopping) {
    const Environment environment = makeRoom();
    constexpr int kGoals = 40, kTicksPerGoal = 6000;
    constexpr double kReached_rad = 0.02;
    constexpr double kStiffness = 6.0;  // stiffer ones overshoot for ever with these jerk limits
    int reached[2] = {0, 0};
    double missing[2] = {0.0, 0.0};
    std::mt19937 random(11);
    ArmAmongObstacles drawn(environment);
    for (int k = 0; k < kGoals;) {
        const JointVector goal = makeRandomVector(6, 2.0, random);
        drawn.state.q = goal;
        if (drawn.findDistance() < 0.04) continue;
        ++k;
        for (const bool steers : {false, true}) {
            WholeArmBrakingOptions options;
            options.joints.kAlpha = 20.0;
            options.steers = steers;
            ArmAmongObstacles arm(environment, options);
            arm.configure();
            for (int tick = 0; tick < kTicksPerGoal; ++tick) arm.goTo(goal, kStiffness);
            const double rest = (arm.state.q - goal).lpNorm<Eigen::Infinity>();
            reached[steers] += rest < kReached_rad;
            missing[steers] += rest / kGoals;
            EXPECT_GE(arm.findDistance(), 0.02 - kAllowed_m);
        }
    }
    std::printf(
        "  of %d free poses (seed 11) %d are reached by stopping only, %d with steering; missing on average %.2f and "
        "%.2f rad\n",
        kGoals, reached[0], reached[1], missing[0], missing[1]);
    EXPECT_GT(reached[1], reached[0]);
    EXPECT_LT(missing[1], missing[0]);
}

// 7 kg and motors at 60 %: what certified braking alone does breaks the motors' limits, along stops and now.
TEST(WholeArmBraking, MotorsBearEveryTickAndEveryStop) {
    const RobotDescription loaded = withPayload(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"), 7.0, {0.0, 0.0, 0.05});
    double use[2] = {0.0, 0.0};
    for (const bool limitsTorque : {false, true}) {
        WholeArmBrakingOptions options;
        if (limitsTorque) options.torqueShare = 0.6;
        ArmAmongObstacles arm(Environment{}, options, loaded);
        arm.configure();
        RobotModel model(loaded);
        std::mt19937 random(5);
        std::uniform_real_distribution<double> share(-1.0, 1.0);
        JointVector goal = arm.robot.home;
        for (int tick = 0; tick < 6000; ++tick) {
            if (tick % 700 == 0)
                for (int i = 0; i < 6; ++i) goal[i] = arm.robot.home[i] + 1.2 * share(random);
            ASSERT_LE(arm.goTo(goal, 900.0), FilterStatus::Recovering) << tick;
            const auto see = [&](const JointVector& torque) {
                const JointVector limit = loaded.actuation.torqueLimit;
                use[limitsTorque] = std::max(use[limitsTorque], torque.cwiseAbs().cwiseQuotient(limit).maxCoeff());
            };
            see(arm.motion.torque);
            if (tick % 40 != 0) continue;
            MotionState s = arm.state;
            std::array<GridStop, kMaxJoints> stops = arm.decision.stops;
            for (int k = 0; k < 600; ++k) {
                Dynamics dynamics;
                model.calcDynamics(s.q, s.qd, dynamics);
                JointVector jerk(6);
                for (std::size_t i = 0; i < 6; ++i) jerk[static_cast<Eigen::Index>(i)] = stops[i].popJerk();
                FilterDecision next;
                next.holdJerk(jerk);
                see(calcTorque({s, dynamics.gravity, dynamics}, FilterStatus::Modified, next));
                advanceNominal(next, kTick_s, s);
            }
        }
    }
    std::printf("  largest use of the motors' torque: %.3f without, %.3f with torque_share 0.6\n", use[0], use[1]);
    EXPECT_GT(use[0], 0.61);
    EXPECT_LE(use[1], 0.6 * (1.0 + 1e-8));
    EXPECT_GT(use[1], 0.55) << "the motors are hardly used";
}

// What a share of the motors' torque is kept for: the torque that is held over a tick, M times its mean acceleration plus b. At a
// tick's ends M qdd + b is up to M jerk dt / 2 away from it, beyond the share where jerk is large, and hardly more.
TEST(WholeArmBraking, TorqueShareIsOfTheTorqueThatATickHolds) {
    const RobotDescription panda = loadRobot(VIABLE_SOURCE_DIR "/robots/panda");
    const int n = panda.size();
    WholeArmBrakingOptions options;
    options.torqueShare = 0.4;
    ArmAmongObstacles arm(Environment{}, options, panda);
    arm.configure();
    const JointVector limit = options.torqueShare * panda.actuation.torqueLimit;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    double held = 0.0, atEnds = 0.0, beyondBound = 0.0;
    JointVector pushed = JointVector::Zero(n);
    for (int tick = 0; tick < 4000; ++tick) {
        if (tick % 5 == 0)
            for (double& x : pushed) x = 15.0 * share(random);
        const Dynamics before = arm.dynamics;
        const JointVector qdd = arm.state.qdd;
        ASSERT_LE(arm.push(pushed), FilterStatus::StoppedByPlan) << tick;
        held = std::max(held, arm.motion.torque.cwiseAbs().cwiseQuotient(limit).maxCoeff());
        const JointVector atBegin = before.M * qdd + before.b, atEnd = arm.dynamics.M * arm.state.qdd + arm.dynamics.b;
        const JointVector change = before.M.cwiseAbs() * arm.motion.jerk.cwiseAbs() * (kTick_s / 2.0);
        for (const JointVector& torque : {atBegin, atEnd}) {
            atEnds = std::max(atEnds, torque.cwiseAbs().cwiseQuotient(limit).maxCoeff());
            beyondBound = std::max(beyondBound, (torque.cwiseAbs() - change).cwiseQuotient(limit).maxCoeff());
        }
    }
    std::printf(
        "  share of the share used: %.4f held over ticks, %.3f at their ends, %.4f there without M jerk dt / 2\n", held,
        atEnds, beyondBound);
    EXPECT_LE(held, 1.0 + 1e-8);
    EXPECT_GT(atEnds, 1.05);
    EXPECT_LE(beyondBound, 1.02);
}

// The clearance that is logged is never more than the distance in its own tick, and not far below it where something is near.
TEST(WholeArmBraking, TheClearanceItTellsIsALowerBoundInItsTick) {
    std::mt19937 random(8);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    double tooMuch = -kInfinity, below = 0.0;
    int near = 0;
    for (int round = 0; round < 6; ++round) {
        Environment environment = makePlate(0.8, 0.02);
        environment.solids.push_back(makeBox("table", {0.0, 0.0, -0.1}, {2.0, 2.0, 0.1}));
        environment.solids.push_back(
            makeBox("shelf", {0.5 * share(random), 0.5 * share(random), 1.0}, {0.3, 0.3, 0.05}));
        ArmAmongObstacles arm(environment);
        try {
            arm.configure();
        } catch (const Error&) {
            continue;  // the shelf is where it starts
        }
        JointVector goal = arm.robot.home;
        for (int tick = 0; tick < 3000; ++tick) {
            if (tick % 400 == 0) goal = makeRandomVector(6, 2.0, random);
            const double before = arm.findDistance();
            arm.goTo(goal);
            const double least = std::min(before, arm.findDistance());
            if (!arm.decision.reports[LimitKind::Clearance].isKnown || least >= 0.4) continue;
            tooMuch = std::max(tooMuch, arm.decision.reports[LimitKind::Clearance].margin - least);
            if (least > 0.05) continue;
            ++near;
            below += least - arm.decision.reports[LimitKind::Clearance].margin;
        }
    }
    std::printf(
        "  told at most %+.2g mm more than there was in the tick; %.2g mm less on average of %d ticks near something\n",
        1e3 * tooMuch, 1e3 * below / near, near);
    EXPECT_LE(tooMuch, 1e-8);
    EXPECT_GT(near, 500);
    EXPECT_LT(below / near, 0.03);
}

// An obstacle appears around the arm while it moves: it brakes, there is always a decision, and it can move out.
TEST(Fault60, AnObstacleThatAppearsInsideTheArmBrakesItAndLetsItOut) {
    ArmAmongObstacles arm(Environment{});
    arm.configure();
    const JointVector there = turned(arm.robot.home, 0, 1.0);
    for (int tick = 0; tick < 250; ++tick) arm.goTo(there);
    ASSERT_GT(arm.state.qd[0], 0.3);
    Environment sudden;
    sudden.solids.push_back(test::makeBall(arm.dynamics.tool.position, 0.08));
    arm.feed.put(ArmAmongObstacles::makeSurroundings(sudden), arm.t);
    arm.environment = sudden;  // for the judge
    double reported = kInfinity, deepest = kInfinity;
    for (int tick = 0; tick < 1500; ++tick) {
        const FilterStatus status = arm.goTo(there);
        ASSERT_TRUE(status == FilterStatus::StoppedByPlan || status == FilterStatus::Modified ||
                    status == FilterStatus::Passed)
            << tick;
        const LimitReport& clearance = arm.decision.reports[LimitKind::Clearance];
        if (clearance.margin < 0.0) EXPECT_EQ(clearance.other, 0) << tick;
        reported = std::min(reported, clearance.margin);
        deepest = std::min(deepest, arm.findDistance());
    }
    EXPECT_LT(reported, 0.0) << "it tells that it is in collision";
    // It stands beyond the middle of the ball: the way out is onward.
    const JointVector out = turned(arm.robot.home, 0, 1.8);
    for (int tick = 0; tick < 3000; ++tick) {
        arm.goTo(out);
        ASSERT_GE(arm.findDistance(), deepest - 0.006) << tick;  // a look's guard, 5 mm, and what the field gives away
    }
    EXPECT_NEAR(arm.state.q[0], out[0], 2e-3) << "it does not get out";
    EXPECT_GE(arm.findDistance(), sudden.safetyDistance_m);
}

// Seen anew in every tick and quicker than the arm: it comes at 6 m/s after the tool, goes through the arm, and leaves.
TEST(Fault60, ABallThatIsQuickerThanTheArmIsBrakedForAndReportedWhileItTouches) {
    for (const bool appears : {false, true}) {  // from afar, or at once at the tool
        WholeArmBrakingOptions options;
        ArmAmongObstacles arm(Environment{}, options);
        arm.configure();
        const JointVector there = turned(arm.robot.home, 0, 2.0);
        for (int tick = 0; tick < 250; ++tick) arm.goTo(there);
        ASSERT_GT(arm.state.qd[0], 0.3);
        Environment sudden;
        sudden.solids.push_back(test::makeBall(arm.dynamics.tool.position, 0.08));
        const Eigen::Vector3d way(0.0, 0.0, -6.0);
        const double first = appears ? 0.0 : -0.2;  // [s], from where it meets the tool's place
        int braked = 0, touched = 0, told = 0, falselyTold = 0;
        for (int tick = 0; tick < 700; ++tick) {
            const double time = first + kTick_s * tick;
            const bool isThere = time < 0.2;
            Environment now;
            if (isThere) {
                now = sudden;
                now.solids[0].pose.translation() = arm.dynamics.tool.position + time * way;
            }
            arm.feed.put(ArmAmongObstacles::makeSurroundings(now), arm.t);
            const JointVector q = arm.state.q;
            const FilterStatus status = arm.goTo(there);
            ASSERT_TRUE(status == FilterStatus::StoppedByPlan || status == FilterStatus::Modified ||
                        status == FilterStatus::Passed)
                << tick;
            ASSERT_TRUE(isFinite(arm.decision.value, 6)) << tick;
            for (int i = 0; i < 6; ++i) {
                const AxisLimits axis = arm.robot.limits.axis(i);
                ASSERT_LE(std::abs(arm.state.qd[i]), axis.velocityUpper * (1.0 + 1e-9)) << tick;
                ASSERT_LE(std::abs(arm.state.qdd[i]), axis.accelerationUpper * (1.0 + 1e-9)) << tick;
                ASSERT_LE(std::abs(arm.decision.value[i]), axis.jerkUpper * (1.0 + 1e-9)) << tick;
            }
            bool acts = status == FilterStatus::StoppedByPlan;
            for (const JointIntervention& joint : arm.decision.joints) acts |= joint.limit == LimitKind::Clearance;
            braked += acts;
            if (!isThere) continue;
            CollisionChecker checker(arm.robot, arm.geometry, now);
            const bool touches = checker.findContact(q, arm.t, 0.5).distance < -1e-6;
            const bool tells = arm.decision.reports[LimitKind::Clearance].isKnown &&
                               arm.decision.reports[LimitKind::Clearance].margin < 0.0;
            touched += touches;
            told += touches && tells;
            falselyTold += tells && checker.findContact(q, arm.t, 0.5).distance > now.safetyDistance_m;
        }
        std::printf("  %s: braked in %d ticks; touched in %d, told in %d of them\n", appears ? "at once" : "from afar",
                    braked, touched, told);
        if (appears)
            EXPECT_LE(braked, 1);  // it leaves at once, and moving away stays possible
        else
            EXPECT_GT(braked, 5);
        EXPECT_GT(touched, 5);
        EXPECT_EQ(told, touched);
        EXPECT_EQ(falselyTold, 0);
        for (int tick = 0; tick < 3000; ++tick) arm.goTo(there);  // it is gone, and the arm goes on
        EXPECT_NEAR(arm.state.q[0], there[0], 2e-3);
    }
}

TEST(Fault61, SurroundingsTooLongAgoStopTheArmUntilNewerOnesCome) {
    WholeArmBrakingOptions options;
    options.maxAge_s = 0.2;
    ArmAmongObstacles arm(Environment{}, options);
    arm.configure();
    const JointVector there = turned(arm.robot.home, 0, 2.0);
    for (int tick = 0; tick < 1000; ++tick) arm.goTo(there);
    EXPECT_EQ(arm.state.qd.lpNorm<Eigen::Infinity>(), 0.0);
    EXPECT_GT(arm.decision.reports[LimitKind::Clearance].age_s, 0.9);
    const double stoppedAt = arm.state.q[0];
    for (int tick = 0; tick < 500; ++tick) {
        if (tick % 100 == 0) arm.feed.put(ArmAmongObstacles::makeSurroundings({}), arm.t);
        arm.goTo(there);
        EXPECT_LE(arm.decision.reports[LimitKind::Clearance].age_s, 0.2);
    }
    EXPECT_GT(arm.state.q[0], stoppedAt + 0.05);
}

// Whole surroundings are exchanged by another thread all the time, always the same: the arm moves as if nothing happened.
TEST(Fault61, SurroundingsExchangedWhileTheArmMoves) {
    const Environment environment = makePlate(0.8, 0.02);
    ArmAmongObstacles quiet(environment), swapped(environment);
    quiet.configure();
    swapped.configure();
    std::atomic<bool> ends{false};
    std::atomic<int> puts{0};
    std::thread maker([&] {
        while (!ends) {
            swapped.feed.put(ArmAmongObstacles::makeSurroundings(environment), 0.0);
            ++puts;
        }
    });
    const JointVector there = turned(quiet.robot.home, 0, 2.0);
    double least = kInfinity;
    for (int tick = 0; tick < 1500; ++tick) {
        quiet.goTo(there);
        swapped.goTo(there);
        least = std::min(least, swapped.findDistance());
    }
    ends = true;
    maker.join();
    EXPECT_GT(puts, 10);
    EXPECT_GE(least, environment.safetyDistance_m - kAllowed_m);
    EXPECT_NEAR(quiet.state.q[0], swapped.state.q[0], 0.02);
}

TEST(WholeArmBraking, AStartTooNearIsRefusedWithLinkObstacleAndDistance) {
    Environment environment;
    ArmAmongObstacles free(environment);
    environment.solids.push_back(makeBox("shelf", free.dynamics.tool.position, {0.05, 0.05, 0.05}));
    ArmAmongObstacles arm(environment);
    expectError({"link6", "shelf", "0.02", "recovery", "lower bounds", "the capsules themselves come to -"},
                [&] { arm.configure(); });
    WholeArmBrakingOptions options;
    options.joints.recovery = true;
    ArmAmongObstacles led(environment, options);
    led.configure();
    for (int tick = 0; tick < 3000; ++tick) led.goTo(turned(led.robot.home, 0, 1.0));
    EXPECT_GE(led.findDistance(), 0.02 - kAllowed_m) << "it is led out";
}

TEST(WholeArmBraking, AllocatesNothingBesideObstacles) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    Environment environment = makePlate(0.8, 0.02);
    environment.solids.push_back(makeBox("table", {0.0, 0.0, -0.1}, {2.0, 2.0, 0.1}));
    WholeArmBrakingOptions options;
    options.torqueShare = 0.6;
    options.joints.kAlpha = 20.0;
    options.joints.recovery = true;
    ArmAmongObstacles arm(environment, options);
    arm.configure();
    std::mt19937 random(1);
    JointVector goal = arm.robot.home;
    // New ones now and then, one of them in the arm's way: made before, put by another thread in a real loop.
    Environment nearer = environment;
    nearer.solids.push_back(
        makeBox("shelf", arm.dynamics.tool.position + Eigen::Vector3d(0.0, 0.1, 0.0), {0.1, 0.1, 0.1}));
    const auto first = ArmAmongObstacles::makeSurroundings(environment),
               second = ArmAmongObstacles::makeSurroundings(nearer);
    std::array<int, 8> with{};
    testing::AllocationCounter counter;
    for (int tick = 0; tick < 20000; ++tick) {
        if (tick % 500 == 0) goal = makeRandomVector(6, 2.0, random);
        if (tick % 250 == 0) arm.feed.put(tick % 500 == 0 ? first : second, arm.t);
        ++with[static_cast<std::size_t>(arm.goTo(goal))];
    }
    EXPECT_EQ(counter.count(), 0);
    EXPECT_GT(with[static_cast<std::size_t>(FilterStatus::Modified)], 5000);
    EXPECT_GT(with[static_cast<std::size_t>(FilterStatus::StoppedByPlan)], 20);
}

TEST(WholeArmBraking, TorqueRatesThatAreNotAboveZeroAreRefused) {
    for (const double rate : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
        WholeArmBrakingOptions options;
        JointVector rates = JointVector::Constant(6, 1000.0);
        rates[2] = rate;
        options.torqueRate = rates;
        ArmAmongObstacles arm(Environment{}, options);
        EXPECT_THROW(arm.configure(), Error) << rate;
    }
}

}  // namespace
}  // namespace viable
