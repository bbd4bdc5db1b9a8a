#include "Balls.h"
#include "batch/ArmBatch.h"

#include <cfenv>
#include <functional>
#include <random>
#include <set>

#include "Complaint.h"
#include "Effort.h"
#include "Paths.h"
#include "environment/CollisionChecker.h"
#include "tracking/ToolFollower.h"
#include "viable/loop/NominalPlant.h"
#include "viable/loop/ReferenceGuard.h"
#include "viable/loop/TorqueGuard.h"
#include "viable/robot/RobotModel.h"

namespace viable {
namespace {

using test::findComplaint;

using Actions = std::vector<double>;

RobotDescription loadArm(const std::string& name) {
    return loadRobot(std::string(VIABLE_SOURCE_DIR) + "/robots/" + name);
}

Actions drawActions(std::mt19937_64& random, const ArmBatch& batch, double size) {
    std::uniform_real_distribution<double> uniform(-size, size);
    Actions actions(static_cast<std::size_t>(batch.size() * batch.actionSize()));
    for (double& action : actions) action = uniform(random);
    return actions;
}

JointVector getRow(const std::vector<double>& values, const ArmBatch& batch, int arm) {
    return Eigen::Map<const Eigen::VectorXd>(&values[static_cast<std::size_t>(arm * batch.joints())], batch.joints());
}

/** By how much values are beyond their limits, as a share of those; infinite where one is not finite. */
double findExcess(const JointVector& v, const JointBounds& bounds) {
    if (!v.allFinite()) return kInfinity;
    double worst = 0.0;
    for (int i = 0; i < v.size(); ++i) {
        const double scale = calcLimitScale(bounds.lower[i], bounds.upper[i]);
        if (std::isfinite(bounds.upper[i])) worst = std::max(worst, (v[i] - bounds.upper[i]) / scale);
        if (std::isfinite(bounds.lower[i])) worst = std::max(worst, (bounds.lower[i] - v[i]) / scale);
    }
    return worst;
}

/** The largest share of a limit by which an arm is beyond it. */
double findExcess(const ArmBatch& batch) {
    double worst = 0.0;
    const ArmBatchState& s = batch.state();
    for (int arm = 0; arm < batch.size(); ++arm) {
        const JointLimits& limits = batch.limits(arm);
        const auto look = [&](const std::vector<double>& values, const JointBounds& bounds) {
            worst = std::max(worst, findExcess(getRow(values, batch, arm), bounds));
        };
        look(s.q, limits.position);
        look(s.qd, limits.velocity);
        look(s.qdd, limits.acceleration);
        look(s.jerk, limits.jerk);
    }
    return worst;
}

TEST(ArmBatch, TheCheckOfLimitsSeesWhatItShall) {
    JointBounds bounds{JointVector::Constant(2, -1.0), JointVector::Constant(2, 1.0)};
    JointVector v = JointVector::Zero(2);
    EXPECT_EQ(findExcess(v, bounds), 0.0);
    v[1] = -1.5;
    EXPECT_GT(findExcess(v, bounds), 0.1);
    v[1] = kNan;
    EXPECT_EQ(findExcess(v, bounds), kInfinity);
    bounds.lower[1] = -kInfinity;
    bounds.upper[1] = kInfinity;
    EXPECT_EQ(findExcess(v, bounds), kInfinity);
    v[1] = 5.0;
    EXPECT_EQ(findExcess(v, bounds), 0.0);
}

TEST(ArmBatch, TorquesMoveArmsAsTorqueGuardsDo) {
    const RobotDescription robot = loadArm("indy7");
    constexpr int kArms = 5;
    ArmBatch batch(robot, kArms, 0.001);
    TorqueGuardOptions options;
    options.hasRobustLoop = false;
    std::vector<TorqueGuard> guards;
    for (int arm = 0; arm < kArms; ++arm) {
        guards.emplace_back(robot, 0.001, options);
        guards.back().start({robot.home, JointVector::Zero(6)});
    }
    std::mt19937_64 random(1);
    int limited = 0;
    for (int step = 0; step < 100; ++step) {
        const Actions actions = drawActions(random, batch, step % 7 == 0 ? 1000.0 : 100.0);
        batch.step(actions.data(), 10);
        for (int arm = 0; arm < kArms; ++arm) {
            TorqueGuard& guard = guards[static_cast<std::size_t>(arm)];
            const JointVector action = getRow(actions, batch, arm);
            for (int i = 0; i < 10; ++i) {
                const MotionState at = guard.nominal();
                guard.step({at.q, at.qd}, [&](const MotionState&, const Dynamics&, JointVector& tau) { tau = action; });
            }
            limited += batch.state().status[static_cast<std::size_t>(arm)] == GuardStatus::Limited;
            ASSERT_EQ(getRow(batch.state().q, batch, arm), guard.nominal().q) << step;
            ASSERT_EQ(getRow(batch.state().qd, batch, arm), guard.nominal().qd) << step;
            ASSERT_EQ(getRow(batch.state().qdd, batch, arm), guard.nominal().qdd) << step;
            ASSERT_EQ(getRow(batch.state().jerk, batch, arm), guard.record().nominal.jerk) << step;
            ASSERT_EQ(getRow(batch.state().torque, batch, arm), guard.record().filterTorque) << step;
            for (int i = 0; i < 6; ++i) {
                const double monitored = guard.record().stops[static_cast<std::size_t>(i)].margin;
                EXPECT_GT(getRow(batch.state().margin, batch, arm)[i], monitored - 1e-5);
            }
        }
    }
    EXPECT_GT(limited, 250);
}

TEST(ArmBatch, TargetsLeadArmsAsReferenceGuardsDo) {
    const RobotDescription robot = loadArm("panda");
    constexpr int kArms = 4;
    ArmBatchOptions options;
    options.action = BatchAction::Target;
    ArmBatch batch(robot, kArms, 0.001, options);
    ReferenceGuardOptions hold;
    hold.between = BetweenSamples::Hold;
    hold.velocityFilter_s = kInfinity;
    std::vector<ReferenceGuard> guards;
    for (int arm = 0; arm < kArms; ++arm) {
        guards.emplace_back(robot, 0.001, hold);
        guards.back().start({robot.home, JointVector::Zero(7), JointVector::Zero(7)});
    }
    std::mt19937_64 random(2);
    RobotModel model(robot);
    Dynamics dynamics;
    for (int step = 0; step < 100; ++step) {
        const Actions actions = drawActions(random, batch, 3.0);
        batch.step(actions.data(), 33);
        for (int arm = 0; arm < kArms; ++arm) {
            ReferenceGuard& guard = guards[static_cast<std::size_t>(arm)];
            MotionState before, after;
            for (int i = 0; i < 33; ++i) {
                before = after;
                after = guard.step(getRow(actions, batch, arm)).state;
            }
            ASSERT_EQ(getRow(batch.state().q, batch, arm), after.q) << step;
            ASSERT_EQ(getRow(batch.state().qd, batch, arm), after.qd) << step;
            ASSERT_EQ(getRow(batch.state().qdd, batch, arm), after.qdd) << step;
            model.calcDynamics(before.q, before.qd, dynamics);
            JointVector torque;
            calcInverseDynamics(dynamics, 0.5 * (before.qdd + after.qdd), torque);
            EXPECT_LT((getRow(batch.state().torque, batch, arm) - torque).norm(), 1e-9 * (1.0 + torque.norm())) << step;
        }
    }
}

/** The tool of an arm, as an action. */
Actions findTool(const RobotDescription& robot, const JointVector& q, BatchAction action) {
    RobotModel model(robot);
    Dynamics dynamics;
    model.calcDynamics(q, JointVector::Zero(robot.size()), dynamics);
    Actions found;
    for (int k = 0; k < 3; ++k) found.push_back(dynamics.tool.position[k]);
    for (int k = 0; k < 4 && action == BatchAction::ToolPose; ++k)
        found.push_back(dynamics.tool.orientation.coeffs()[k]);
    return found;
}

/** Tools of arms whose joints are up to `most` from home. */
Actions drawTools(const RobotDescription& robot, BatchAction action, int arms, double most, std::mt19937_64& random) {
    std::uniform_real_distribution<double> uniform(-most, most);
    Actions actions;
    for (int arm = 0; arm < arms; ++arm) {
        JointVector q = robot.home;
        for (int i = 0; i < robot.size(); ++i) q[i] += uniform(random);
        const Actions one = findTool(robot, q, action);
        actions.insert(actions.end(), one.begin(), one.end());
    }
    return actions;
}

TEST(ArmBatch, ToolsAreLedByTheLawOfTheirController) {
    const RobotDescription robot = loadArm("panda");
    ArmBatchOptions options;
    options.action = BatchAction::ToolPose;
    ArmBatch batch(robot, 3, 0.001, options);
    EXPECT_EQ(batch.actionSize(), 7);
    // The same by hand, of the last arm.
    RobotModel model(robot);
    Dynamics dynamics;
    MotionState at{robot.home, JointVector::Zero(7), JointVector::Zero(7)};
    model.calcDynamics(at.q, at.qd, dynamics);
    ToolFollower follower;
    ToolFollowerOptions tool;
    tool.reference = {calcLeverArm(dynamics.J), 0.5, 0.1};
    follower.configure(robot, robot.limits, 0.001, at, tool);
    const RunSetup setup{robot, robot.limits, 0.001, 0.0, at, dynamics.tool};
    CertifiedBrakingFilter filter;
    filter.configure(setup, CertifiedBrakingOptions());
    FilterDecision decision;
    JointVector rate, torque;
    std::mt19937_64 random(11);
    int passed = 0, ticks = 0;
    for (int step = 0; step < 40; ++step) {
        Actions actions = drawTools(robot, BatchAction::ToolPose, 3, 0.4, random);
        const double length = 0.6 + 0.03 * step;  // of the quaternion
        for (int k = 3; k < 7; ++k) actions[static_cast<std::size_t>(14 + k)] *= length;
        batch.step(actions.data(), 25);
        Pose command;
        command.position = Eigen::Map<const Eigen::Vector3d>(&actions[14]);
        command.orientation.coeffs() = Eigen::Map<const Eigen::Vector4d>(&actions[17]);
        ASSERT_TRUE(normalise(command));
        for (int i = 0; i < 25; ++i, ++ticks) {
            model.calcDynamics(at.q, at.qd, dynamics);
            follower.calc(at, command, nullptr, 0.0, rate);
            calcInverseDynamics(dynamics, at.qdd, torque);
            passed += filter.filter({at, torque, dynamics, &rate}, decision) == FilterStatus::Passed;
            advanceNominal(decision, 0.001, at);
        }
        ASSERT_EQ(getRow(batch.state().q, batch, 2), at.q) << step;
        ASSERT_EQ(getRow(batch.state().qdd, batch, 2), at.qdd) << step;
    }
    EXPECT_GT(passed, ticks * 9 / 10);
}

TEST(ArmBatch, ToolsReachTheirTargetsWithAndWithoutAnOrientation) {
    const RobotDescription robot = loadArm("panda");
    for (const BatchAction action : {BatchAction::ToolPose, BatchAction::ToolPosition}) {
        ArmBatchOptions options;
        options.action = action;
        ArmBatch batch(robot, 10, 0.001, options);
        std::mt19937_64 random(12);
        const Actions actions = drawTools(robot, action, 10, 0.3, random);
        batch.step(actions.data(), 4000);
        for (int arm = 0; arm < 10; ++arm) {
            const Actions reached = findTool(robot, getRow(batch.state().q, batch, arm), action);
            double sign = 1.0;  // q and -q are one rotation
            for (std::size_t k = 0; k < reached.size(); ++k) {
                const double wanted = actions[static_cast<std::size_t>(arm) * reached.size() + k];
                if (k == 3) sign = wanted * reached[k] < 0.0 ? -1.0 : 1.0;
                EXPECT_NEAR(k < 3 ? reached[k] : sign * reached[k], wanted, 1e-4) << arm;
            }
        }
    }
}

TEST(ArmBatch, AQuaternionThatIsNoneBrakesItsArmAlone) {
    const RobotDescription robot = loadArm("panda");
    ArmBatchOptions options;
    options.action = BatchAction::ToolPose;
    for (const double length : {0.0, 0.4, 2.1, kNan}) {
        ArmBatch batch(robot, 2, 0.001, options), same(robot, 2, 0.001, options);
        Actions actions = findTool(robot, robot.home, BatchAction::ToolPose);
        actions[0] -= 0.2;
        actions.insert(actions.end(), actions.begin(), actions.begin() + 7);
        batch.step(actions.data(), 150);
        same.step(actions.data(), 150);
        EXPECT_GT(getRow(batch.state().qd, batch, 0).norm(), 0.1);
        Actions broken = actions;
        for (std::size_t k = 3; k < 7; ++k) broken[k] *= length;
        for (int step = 0; step < 10; ++step) {
            batch.step(broken.data(), 100);
            same.step(actions.data(), 100);
            EXPECT_EQ(batch.state().status[0], GuardStatus::Waiting) << length;
            EXPECT_NE(batch.state().status[1], GuardStatus::Waiting) << length;
        }
        EXPECT_LT(getRow(batch.state().qd, batch, 0).norm(), 1e-9);
        EXPECT_EQ(getRow(batch.state().q, batch, 1), getRow(same.state().q, same, 1));
    }
}

/** A ball, a floor and a ball that passes by. */
Environment makeEnvironment() {
    Environment environment;
    const Solid ball = test::makeBall({0.45, 0.2, 0.5}, 0.1);
    Solid floor;
    floor.name = "floor";
    floor.kind = Solid::Kind::HalfSpace;
    floor.pose.translation() << 0.0, 0.0, -0.3;
    environment.solids = {ball, floor};
    MovingSphere passer;
    passer.name = "passer";
    passer.radius = 0.05;
    passer.waypoints = {{0.0, {0.9, -0.9, 0.9}}, {0.5, {-0.9, -0.9, 0.9}}};
    environment.spheres = {passer};
    return environment;
}

/** Random torques beside obstacles. @return the last state; `least`: of exact distances */
ArmBatchState runAmongObstacles(int threads, BatchAction action, int steps, double* least = nullptr,
                                std::set<int>* acting = nullptr) {
    const RobotDescription robot = loadArm("panda");
    ArmBatchOptions options;
    options.action = action;
    options.threads = threads;
    options.environment = makeEnvironment();
    ArmBatch batch(robot, 5, 0.001, options);
    for (const double clearance : batch.state().clearance) EXPECT_TRUE(std::isnan(clearance));
    const CollisionChecker checker(robot, loadArmGeometry(robot), *options.environment);
    std::mt19937_64 random(13);
    Actions actions;
    std::int64_t ticks = 0;
    for (int step = 0; step < steps; ++step) {
        if (step % 4 == 0) actions = drawActions(random, batch, action == BatchAction::Torque ? 80.0 : 1.0);
        if (step % 25 == 20) actions[0] = kNan;
        batch.step(actions.data(), 10);
        ticks += 10;
        EXPECT_LT(findExcess(batch), kOutsideShare);
        if (step % 25 == 20) EXPECT_EQ(batch.state().status[0], GuardStatus::Waiting);
        for (int arm = 0; arm < 5 && least; ++arm) {
            const double exact =
                checker.findContact(getRow(batch.state().q, batch, arm), 1e-3 * static_cast<double>(ticks), 1.0)
                    .distance;
            const double told = batch.state().clearance[static_cast<std::size_t>(arm)];
            EXPECT_LE(told, exact + 1e-6) << step;
            EXPECT_GE(told, options.environment->safetyDistance_m - 1e-6) << step;
            *least = std::min(*least, exact);
        }
        if (acting) acting->insert(batch.state().acting.begin(), batch.state().acting.end());
    }
    return batch.state();
}

TEST(ArmBatch, ArmsKeepClearOfWhatIsAroundWhateverTheActionsAre) {
    for (const BatchAction action : {BatchAction::Torque, BatchAction::Target, BatchAction::ToolPosition}) {
        double least = kInfinity;
        std::set<int> acting;
        runAmongObstacles(1, action, 60, &least, &acting);
        EXPECT_GE(least, 0.02 - 1e-9);
        EXPECT_LT(least, 0.1) << "nothing was near";
        if (action != BatchAction::Torque) {  // those push the arms into their joint limits first
            EXPECT_EQ(acting.count(-static_cast<int>(LimitKind::Clearance)), 1u);
        }
    }
}

TEST(ArmBatch, ClearancesDependOnNoThreads) {
    const ArmBatchState one = runAmongObstacles(1, BatchAction::ToolPosition, 30);
    const ArmBatchState more = runAmongObstacles(3, BatchAction::ToolPosition, 30);
    EXPECT_EQ(one.qdd, more.qdd);
    EXPECT_EQ(one.clearance, more.clearance);
    EXPECT_EQ(one.acting, more.acting);
}

TEST(ArmBatch, APlaceThatIsTooNearIsRefusedAndFound) {
    const RobotDescription robot = loadArm("panda");
    ArmBatchOptions options;
    options.environment = makeEnvironment();
    ArmBatch batch(robot, 3, 0.001, options);
    const JointVector zero = JointVector::Zero(7);
    const MotionState good{robot.home, zero, zero};
    MotionState near = good;
    RobotModel model(robot);
    Dynamics dynamics;
    model.calcDynamics(robot.home, zero, dynamics);
    options.environment->solids[0].pose.translation() = dynamics.tool.position;
    test::expectError({"arm 0: ArmBatchOptions::filter: the start", "from ball; at least 0.02 m is to be kept"},
                      [&] { ArmBatch(robot, 1, 0.001, options); });
    near.q[1] += 1.6, near.q[3] += 1.0;  // onto the floor
    EXPECT_EQ(batch.findUnusable({0, 1, 2}, {good, near, good}), std::vector<int>{1});
    test::expectError({"arm 1: "}, [&] { batch.reset({2, 1}, {good, near}); });
    EXPECT_EQ(getRow(batch.state().q, batch, 1), robot.home);
    options.environment->safetyDistance_m = -1.0;
    test::expectError({"safety"}, [&] { ArmBatch(robot, 1, 0.001, options); });
}

TEST(ArmBatch, AccelerationsAreWhatTheirTorqueCauses) {
    const RobotDescription robot = loadArm("ur5e");
    ArmBatchOptions options;
    options.action = BatchAction::Acceleration;
    ArmBatch batch(robot, 1, 0.001, options), other(robot, 1, 0.001);
    RobotModel model(robot);
    Dynamics dynamics;
    std::mt19937_64 random(3);
    for (int step = 0; step < 300; ++step) {
        const Actions wanted = drawActions(random, batch, 2.0);
        model.calcDynamics(getRow(batch.state().q, batch, 0), getRow(batch.state().qd, batch, 0), dynamics);
        JointVector torque;
        calcInverseDynamics(dynamics, Eigen::Map<const Eigen::VectorXd>(wanted.data(), 6), torque);
        batch.step(wanted.data(), 1);
        other.step(torque.data(), 1);
        ASSERT_EQ(batch.state().q, other.state().q);
    }
}

/** Random actions, limits and starts, and what became of them.
@param rounding  of the caller's arithmetic when it steps */
ArmBatchState runRandom(int threads, BatchAction action, int arms, int steps, double* excess = nullptr,
                        int rounding = FE_TONEAREST) {
    const RobotDescription robot = loadArm("indy7");
    ArmBatchOptions options;
    options.action = action;
    options.threads = threads;
    ArmBatch batch(robot, arms, 0.001, options);
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> share(0.3, 1.0);
    for (int arm = 0; arm < arms; arm += 3) {  // limits of their own, still at rest
        JointLimits limits = robot.limits;
        for (JointBounds* bounds : {&limits.velocity, &limits.acceleration, &limits.jerk})
            for (int i = 0; i < 6; ++i) {
                bounds->lower[i] *= share(random);
                bounds->upper[i] *= share(random);
            }
        batch.changeLimits(arm, limits);
    }
    const double size = action == BatchAction::Torque         ? 300.0
                        : action == BatchAction::Acceleration ? 50.0
                        : action == BatchAction::Target       ? 4.0
                                                              : 1.0;
    for (int step = 0; step < steps; ++step) {
        Actions actions = drawActions(random, batch, size);
        if (step % 3 == 1) actions[static_cast<std::size_t>(step) % actions.size()] = kNan;
        std::fesetround(rounding);
        batch.step(actions.data(), step % 9 + 1);
        EXPECT_EQ(std::fegetround(), rounding);
        std::fesetround(FE_TONEAREST);
        if (excess) *excess = std::max(*excess, findExcess(batch));
        if (step % 50 == 49) {
            std::uniform_real_distribution<double> amid(0.1, 0.9);
            MotionState start{robot.home, JointVector::Zero(6), JointVector::Zero(6)};
            for (int i = 0; i < 6; ++i)
                start.q[i] = robot.limits.position.lower[i] +
                             amid(random) * (robot.limits.position.upper[i] - robot.limits.position.lower[i]);
            batch.reset({step % arms}, {start});
            EXPECT_EQ(getRow(batch.state().q, batch, step % arms), start.q);
        }
    }
    return batch.state();
}

TEST(ArmBatch, LimitsHoldWhateverTheActionsAre) {
    for (const BatchAction action : {BatchAction::Torque, BatchAction::Acceleration, BatchAction::Target,
                                     BatchAction::ToolPose, BatchAction::ToolPosition}) {
        double excess = 0.0;
        runRandom(1, action, 100, test::countOf(400), &excess);
        EXPECT_LT(excess, kOutsideShare);
    }
}

TEST(ArmBatch, ResultsDependOnNeitherThreadsNorNeighboursNorTheCallersModes) {
    const int steps = test::countOf(100);
    const ArmBatchState one = runRandom(1, BatchAction::Torque, 90, steps);
    for (const int threads : {2, 3, 7}) {
        const ArmBatchState more = runRandom(threads, BatchAction::Torque, 90, steps);
        EXPECT_EQ(one.q, more.q);
        EXPECT_EQ(one.qdd, more.qdd);
        EXPECT_EQ(one.margin, more.margin);
        EXPECT_EQ(one.acting, more.acting);
        EXPECT_EQ(one.status, more.status);
    }
    EXPECT_EQ(one.qdd, runRandom(2, BatchAction::Torque, 90, steps, nullptr, FE_DOWNWARD).qdd);
    for (const BatchAction action : {BatchAction::ToolPose, BatchAction::ToolPosition}) {
        const ArmBatchState tools = runRandom(1, action, 60, steps / 2);
        for (const int threads : {2, 5}) EXPECT_EQ(tools.qdd, runRandom(threads, action, 60, steps / 2).qdd);
    }

    const RobotDescription robot = loadArm("indy7");
    ArmBatch many(robot, 40, 0.001), alone(robot, 1, 0.001);
    std::mt19937_64 random(5);
    for (int step = 0; step < 100; ++step) {
        const Actions actions = drawActions(random, many, 200.0);
        many.step(actions.data(), 10);
        alone.step(&actions[6 * 17], 10);
    }
    EXPECT_EQ(getRow(many.state().q, many, 17), getRow(alone.state().q, alone, 0));
}

TEST(ArmBatch, AnActionThatIsNoNumberBrakesItsArmAlone) {
    const RobotDescription robot = loadArm("indy7");
    for (const BatchAction action : {BatchAction::Torque, BatchAction::Acceleration, BatchAction::Target}) {
        ArmBatchOptions options;
        options.action = action;
        ArmBatch batch(robot, 2, 0.001, options), same(robot, 2, 0.001, options);
        std::mt19937_64 random(6);
        const Actions actions = drawActions(random, batch, 100.0);
        batch.step(actions.data(), 100);
        same.step(actions.data(), 100);
        EXPECT_GT(getRow(batch.state().qd, batch, 0).norm(), 0.1);
        Actions broken = actions;
        broken[3] = kNan;
        for (int step = 0; step < 10; ++step) {
            batch.step(broken.data(), 100);
            same.step(actions.data(), 100);
            EXPECT_EQ(batch.state().status[0], GuardStatus::Waiting);
            EXPECT_LT(findExcess(batch), kOutsideShare);
        }
        EXPECT_LT(getRow(batch.state().qd, batch, 0).norm(), 1e-9);
        EXPECT_EQ(getRow(batch.state().q, batch, 1), getRow(same.state().q, same, 1));
        broken[3] = 1e300;
        batch.step(broken.data(), 1);
        EXPECT_EQ(batch.state().status[0], GuardStatus::Waiting);
        batch.step(actions.data(), 100);
        EXPECT_NE(batch.state().status[0], GuardStatus::Waiting);
        EXPECT_GT(getRow(batch.state().qd, batch, 0).norm(), 0.1);
    }
}

TEST(ArmBatch, MarginIsThatOfTheStopAndActingNamesTheLimit) {
    const RobotDescription robot = loadArm("single_joint");
    ArmBatchOptions options;
    options.action = BatchAction::Target;
    ArmBatch batch(robot, 1, 0.001, options);
    const double upper = robot.limits.position.upper[0], far = upper + 10.0;
    EXPECT_NEAR(batch.state().margin[0],
                std::min(upper - robot.home[0], robot.home[0] - robot.limits.position.lower[0]), 1e-5);
    double least = kInfinity;
    for (int step = 0; step < 5000; ++step) {
        batch.step(&far, 1);
        least = std::min(least, batch.state().margin[0]);
    }
    EXPECT_NEAR(batch.state().q[0], upper, 1e-6);
    EXPECT_NEAR(least, 0.0, 1e-5);

    ArmBatch pushed(robot, 1, 0.001);
    const double push = 1e6;
    for (int step = 0; step < 5000; ++step) pushed.step(&push, 1);
    EXPECT_EQ(pushed.state().acting[0], static_cast<int>(LimitKind::Position));
    EXPECT_EQ(pushed.state().status[0], GuardStatus::Limited);
    const double pull = -1e6;
    pushed.step(&pull, 1);
    EXPECT_LT(pushed.state().acting[0], 0);
}

TEST(ArmBatch, LimitsThatShrinkAreApproachedAndHeld) {
    const RobotDescription robot = loadArm("indy7");
    ArmBatch batch(robot, 1, 0.001);
    const Actions push(6, 500.0);
    batch.step(push.data(), 300);
    JointLimits slow = robot.limits;
    slow.velocity.lower *= 0.2;
    slow.velocity.upper *= 0.2;
    ASSERT_GT((getRow(batch.state().qd, batch, 0) - slow.velocity.upper).maxCoeff(), 0.0);
    batch.changeLimits(0, slow);
    batch.step(push.data(), 1);
    EXPECT_EQ(batch.state().status[0], GuardStatus::Recovering);
    batch.step(push.data(), 1500);
    batch.step(push.data(), 1);
    EXPECT_LT(findExcess(batch), kOutsideShare);
}

TEST(ArmBatch, WhatDoesNotFitIsRefusedAndNothingMoves) {
    const RobotDescription robot = loadArm("indy7");
    const auto make = [&](int arms, double tick_s, const ArmBatchOptions& options) {
        return findComplaint([&] { ArmBatch(robot, arms, tick_s, options); });
    };
    EXPECT_EQ(make(0, 0.001, {}), "ArmBatch: 0 arms; allowed is 1 to 1000000. Give the number of arms.");
    EXPECT_CONTAINS(make(1, 1.0, {}), "the tick is 1 s");
    const auto expectRefused = [&](const char* words, const std::function<void(ArmBatchOptions&)>& change) {
        ArmBatchOptions options;
        change(options);
        EXPECT_CONTAINS(make(1, 0.001, options), words);
    };
    expectRefused("jerk", [](auto& options) { options.limits = JointLimits::unlimited(6); });
    expectRefused("gamma", [](auto& options) { options.filter.gamma = 3000.0; });
    expectRefused("threads", [](auto& options) { options.threads = -1; });
    expectRefused("no_such_plant", [](auto& options) { options.plant = "{plugin: no_such_plant}"; });

    ArmBatch batch(robot, 3, 0.001);
    const JointVector zero = JointVector::Zero(6);
    const MotionState good{robot.home + JointVector::Constant(6, 0.01), zero, zero};
    const MotionState outside{robot.limits.position.upper + JointVector::Ones(6), zero, zero};
    const MotionState malformed{robot.home, JointVector::Zero(5), zero};
    const std::vector<double> before = batch.state().q;
    test::expectError({"arm 2: ArmBatchOptions::filter::recovery: "}, [&] { batch.reset({0, 2}, {good, outside}); });
    test::expectError({"arm 1: its start is of the wrong size"}, [&] { batch.reset({0, 1}, {good, malformed}); });
    test::expectError({"there is no arm 3"}, [&] { batch.reset({3}, {good}); });
    test::expectError({"0 starts for 1 arms"}, [&] { batch.reset({1}, {}); });
    test::expectError({"arm 1"}, [&] { batch.changeLimits(1, JointLimits::unlimited(6)); });
    test::expectError({"0 ticks"}, [&] { batch.step(before.data(), 0); });
    EXPECT_EQ(batch.state().q, before);
    batch.reset({0, 2}, {good, good});
    EXPECT_EQ(getRow(batch.state().q, batch, 2), good.q);
    EXPECT_EQ(getRow(batch.state().q, batch, 1), robot.home);
}

TEST(ArmBatch, ARobotWithSpeedLimitsThatItDoesNotKeepIsRefused) {
    RobotDescription robot = loadArm("indy7");
    robot.speedLimits.tool = 0.3;
    test::expectError({"speed limits"}, [&] { ArmBatch(robot, 4, 1e-3, {}); });
}

TEST(ArmBatch, RealArmsFollowAndAreDrawn) {
    const RobotDescription robot = loadArm("indy7");
    ArmBatchOptions options;
    options.plant =
        "{plugin: simbody, dynamics: recursion, payload_kg: '~uniform(0, 2)', friction_scale: '~uniform(0.5, 1.5)'}";
    options.pluginPath = {VIABLE_PLUGIN_DIR};
    options.seed = 7;
    options.threads = 1;
    ArmBatch batch(robot, 20, 0.001, options);
    options.threads = 3;
    ArmBatch threaded(robot, 20, 0.001, options);
    EXPECT_EQ(batch.draws(), threaded.draws());
    const std::vector<std::string>& payloads = batch.draws().at("real_plant.payload_kg");
    ASSERT_EQ(payloads.size(), 20u);
    EXPECT_EQ(std::set<std::string>(payloads.begin(), payloads.end()).size(), 20u);
    std::mt19937_64 random(8);
    double farthest = 0.0;
    for (int step = 0; step < 100; ++step) {
        const Actions actions = drawActions(random, batch, 200.0);
        batch.step(actions.data(), 10);
        threaded.step(actions.data(), 10);
        for (std::size_t i = 0; i < actions.size(); ++i)
            farthest = std::max(farthest, std::abs(batch.state().q[i] - batch.state().realQ[i]));
    }
    EXPECT_GT(farthest, 1e-5);
    EXPECT_LT(farthest, 0.05);
    EXPECT_EQ(batch.state().realQ, threaded.state().realQ);
    EXPECT_EQ(batch.state().motorTorque, threaded.state().motorTorque);
    EXPECT_NE(getRow(batch.state().realQ, batch, 0), getRow(batch.state().q, batch, 0));
    EXPECT_LT(findExcess(batch), kOutsideShare);
    batch.reset({4}, {{robot.home, JointVector::Zero(6), JointVector::Zero(6)}});
    EXPECT_LT((getRow(batch.state().realQ, batch, 4) - robot.home).norm(), 1e-3);
}

// Beside the nominal demand a held joint gets a quarter of its motor, and what lasts.
TEST(ArmBatch, ARealJointThatIsHeldGetsNoMoreThanItsAuthority) {
    for (const char* name : {"indy7", "panda"}) {
        const RobotDescription robot = loadArm(name);
        const int n = robot.size(), held = 1;
        ArmBatchOptions options;
        options.plant =
            "{plugin: simbody, dynamics: recursion, blocked_joint: 1, blocked_from_s: 0.2, "
            "blocked_until_s: '~uniform(0.6, 1.0)'}";
        options.pluginPath = {VIABLE_PLUGIN_DIR};
        options.action = BatchAction::Target;
        ArmBatch batch(robot, 10, 0.001, options);
        std::mt19937_64 random(11);
        Actions targets;
        for (int arm = 0; arm < batch.size(); ++arm)
            for (int i = 0; i < n; ++i)
                targets.push_back(robot.home[i] + std::uniform_real_distribution<double>(0.4, 0.8)(random));
        double most = 0.0;
        for (int step = 0; step < 2000; ++step) {
            batch.step(targets.data(), 1);
            for (int arm = 0; arm < batch.size(); ++arm) {
                const ArmBatchState& state = batch.state();
                const auto at = static_cast<std::size_t>(arm * n + held);
                const double added = std::abs(state.motorTorque[at] - state.torque[at]);
                if (step > 250 && std::abs(state.realQd[at]) < 1e-6)
                    most = std::max(most, added / robot.actuation.torqueLimit[held]);
            }
        }
        std::printf("  %s: %.3f of the motor added at most\n", name, most);
        EXPECT_GT(most, 0.2) << name;
        EXPECT_LT(most, 0.5) << name;  // calcMost()
    }
}

// The plant stands still, so its loop is cut while the nominal torque changes faster than the motors can.
TEST(ArmBatch, NoCutMakesTheMotorsFasterThanTheyAre) {
    const RobotDescription robot = loadArm("indy7");
    const double rate = 30.0, step_Nm = 1e-3 * rate * (1.0 + 1e-9);
    ArmBatchOptions options;
    options.plant = "{plugin: failing_plant, after_ticks: 1000000, rates: 6, rate_Nmps: 30}";
    options.pluginPath = {VIABLE_BROKEN_PLUGIN_DIR};
    ArmBatch batch(robot, 1, 0.001, options);
    for (int round = 0; round < 2; ++round) {
        std::vector<double> before;
        int atTheRate = 0;
        for (int step = 0; step < 1500; ++step) {
            const Actions actions(6, step / 250 % 2 ? 100.0 : -100.0);
            batch.step(actions.data(), 1);
            const std::vector<double>& now = batch.state().motorTorque;
            for (std::size_t i = 0; i < before.size(); ++i) {
                ASSERT_LE(std::abs(now[i] - before[i]), step_Nm) << step << " " << i;
                atTheRate += std::abs(now[i] - before[i]) > 0.999 * step_Nm;
            }
            before = now;
        }
        EXPECT_GT(atTheRate, 100);
        batch.reset({0}, {{robot.home, JointVector::Zero(6), JointVector::Zero(6)}});
    }
}

TEST(ArmBatch, APlantThatFailsStopsItsArmAloneUntilItsReset) {
    const RobotDescription robot = loadArm("indy7");
    for (const char* mode : {"faulted", "nan_state", "wrong_size", "throw_measured", "throw_advance"}) {
        ArmBatchOptions options;
        options.plant = std::string("{plugin: failing_plant, after_ticks: '~integer(5, 60)', mode: ") + mode + "}";
        options.pluginPath = {VIABLE_BROKEN_PLUGIN_DIR};
        options.threads = 3;  // so that most fail in a thread of a step's own
        ArmBatch batch(robot, 100, 0.001, options);
        const Actions actions(600, 0.0);
        std::vector<int> failed;
        for (int step = 0; step < 4; ++step) {
            batch.step(actions.data(), 8);
            failed.clear();
            for (int arm = 0; arm < 100; ++arm)
                if (batch.state().status[static_cast<std::size_t>(arm)] == GuardStatus::Failed) failed.push_back(arm);
        }
        EXPECT_GT(failed.size(), 10u) << mode;
        EXPECT_LT(failed.size(), 90u) << mode;
        EXPECT_LT(findExcess(batch), kOutsideShare);
        const JointVector before = getRow(batch.state().q, batch, failed[0]);
        batch.step(actions.data(), 1);
        EXPECT_EQ(getRow(batch.state().q, batch, failed[0]), before) << mode;
        const MotionState home{robot.home, JointVector::Zero(6), JointVector::Zero(6)};
        batch.reset(failed, std::vector<MotionState>(failed.size(), home));
        batch.step(actions.data(), 1);
        for (const int arm : failed)
            EXPECT_NE(batch.state().status[static_cast<std::size_t>(arm)], GuardStatus::Failed) << mode;
    }
}

TEST(ArmBatch, WhatAPlantTellsIsChecked) {
    const RobotDescription robot = loadArm("indy7");
    for (const auto& [told, cause] : {std::pair{"delay_ticks: -1", "gave a delay of -1 ticks"},
                                      std::pair{"delay_ticks: 21", "gave a delay of 21 ticks"},
                                      std::pair{"rates: 5", "gave a fastest change of the torque"},
                                      std::pair{"rates: 6, rate_Nmps: 0", "gave a fastest change of the torque"}}) {
        ArmBatchOptions options;
        options.plant = std::string("{plugin: failing_plant, ") + told + "}";
        options.pluginPath = {VIABLE_BROKEN_PLUGIN_DIR};
        SCOPED_TRACE(told);
        const auto make = [&] { ArmBatch(robot, 1, 0.001, options); };
        test::expectContains(findComplaint(make, ErrorKind::PluginFailed), {cause});
    }
}

}  // namespace
}  // namespace viable
