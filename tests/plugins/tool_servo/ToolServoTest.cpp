#include "Balls.h"
#include "ToolServo.h"

#include "CaseSupport.h"
#include "Effort.h"
#include "TestArm.h"
#include "core/RotationVector.h"
#include "environment/ArmClearances.h"
#include "environment/ArmSurroundings.h"
#include "tracking/ToolReference.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

/** The nominal arm alone. */
Summary run(std::vector<std::string> overrides) {
    overrides.insert(overrides.begin(), {"controller={plugin: tool_servo}", "filter={plugin: certified_braking}"});
    return runNominalArm(overrides);
}

TEST(ToolFreedom, IsWhatTheJointsLeaveAndPutsThePositionFirstWhereSomeOfItIsGivenUp) {
    for (const char* name : {"panda", "ur5e", "indy7", "planar_two_link"}) {
        const RobotDescription robot = loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name);
        const ToolFreedom freedom(robot, robot.limits);
        Dynamics dynamics;
        RobotModel(robot).calcDynamics(robot.home, JointVector::Zero(robot.size()), dynamics);
        const bool isWhole = robot.size() >= 6;
        EXPECT_EQ(freedom.all, isWhole ? 6 : 2) << name;
        EXPECT_EQ(freedom.ways, isWhole ? 3 : 2) << name;
        EXPECT_EQ(freedom.describe().empty(), isWhole) << name;
        const double length = freedom.calcRotationLength(dynamics.J), lever = calcLeverArm(dynamics.J);
        if (isWhole)
            EXPECT_EQ(length, lever) << name;
        else
            EXPECT_LT(length, 0.05 * lever) << name;
    }
}

// Whoever has no jerk limit can be nearer to a hand than whoever keeps one; a controller that knows the limits makes up
// for it.
TEST(ToolServo, FollowsAHandBetterThanASpringAndDamperWithoutAJerkLimit) {
    for (const int seed : {1, 2}) {
        const std::vector<std::string> hand = {"duration_s=30", "command.seed=" + std::to_string(seed)};
        const Summary servo = run(hand);
        EXPECT_FALSE(servo.anyLimitBroken());
        EXPECT_GE(passedShare(servo), 0.95);
        for (const char* filter : {"acceleration_viability", "certified_braking"}) {
            std::vector<std::string> spring = hand;
            spring.push_back("controller={plugin: task_space_pd}");
            spring.push_back(std::string("filter={plugin: ") + filter + ", k_alpha: 5}");
            EXPECT_LT(servo.toolErrorRms(), run(spring).toolErrorRms()) << filter << ", seed " << seed;
        }
    }
}

// A hand within reach, no position limits but the robot's: the error is the lag.
TEST(ToolServo, FollowsOnOtherArmsWithoutBeingTold) {
    for (const char* robot : {"panda", "ur5e", "indy7"}) {
        const std::string limits = "{velocity_radps: 1.5, acceleration_radps2: 8, jerk_radps3: 200}";
        const Summary s = run({std::string("robot=") + robot, "limits=" + limits, "duration_s=10",
                               "command={plugin: generated_hand_motion, seed: 2, reach_m: [0.1, 0.1, 0.1], "
                               "rotation_rad: 0.3, top_speed_mps: 0.3}"});
        EXPECT_FALSE(s.anyLimitBroken()) << robot;
        EXPECT_GE(passedShare(s), 0.95) << robot;
        EXPECT_LE(s.toolErrorRms(), 0.02) << robot;
    }
}

/** A tool reference and a controller on an arm, without a loop. */
class ToolServoTest : public ::testing::Test {
protected:
    /** Where the reference ends when it goes towards `command` for so long. */
    Pose follow(ToolReference& reference, const Pose& command, double duration_s) {
        for (int tick = 0; tick < std::lround(duration_s / arm_.tick_s); ++tick) {
            const JointVector before = reference.q();
            reference.advance(command);
            for (int i = 0; i < arm_.size(); ++i) {
                EXPECT_LE(reference.q()[i], arm_.limits.position.upper[i]);
                EXPECT_GE(reference.q()[i], arm_.limits.position.lower[i]);
                EXPECT_LE(std::abs(reference.q()[i] - before[i]),
                          arm_.limits.velocity.upper[i] * arm_.tick_s * (1.0 + 1e-9));
            }
        }
        return arm_.calcDynamics(reference.q(), JointVector::Zero(arm_.size())).tool;
    }
    void configure(ToolReference& reference, double restRate = 0.0) {
        reference.configure(arm_.robot, arm_.limits, arm_.tick_s, arm_.robot.home, {0.2, restRate, 0.0});
    }
    Pose homeTool() { return arm_.calcDynamics(arm_.robot.home, JointVector::Zero(arm_.size())).tool; }

    TestArm arm_{"panda"};
    std::mt19937 random_{7};
};

TEST_F(ToolServoTest, ReferenceReachesReachablePosesExactly) {
    for (int k = 0; k < 50; ++k) {
        const Pose command = arm_.calcDynamics(arm_.robot.home + makeRandomVector(arm_.size(), 0.3, random_),
                                               JointVector::Zero(arm_.size()))
                                 .tool;
        ToolReference reference;
        configure(reference);
        const Pose end = follow(reference, command, 3.0);
        EXPECT_LE((end.position - command.position).norm(), 1e-6);
        EXPECT_LE(calcRotationVector(end.orientation * command.orientation.conjugate()).norm(), 1e-6);
    }
}

TEST_F(ToolServoTest, ReferenceGoesAsNearAsItCanAndRestsThere) {
    Pose command = homeTool();
    command.position += Eigen::Vector3d(5.0, 0.0, 0.0);
    ToolReference reference;
    configure(reference);
    EXPECT_GT(follow(reference, command, 20.0).position.x(), homeTool().position.x() + 0.1);
    const JointVector before = reference.q();
    follow(reference, command, 1.0);
    EXPECT_LE((reference.q() - before).cwiseAbs().maxCoeff(), 0.02) << "it creeps or swings in the stretched pose";
}

// A step that leaves out how the error bends swings about a pose that is out of reach, by a millimetre and for ever.
TEST_F(ToolServoTest, ReferenceDoesNotSwingWhereItCanGoNoFurther) {
    for (const char* robot : {"indy7", "ur5e", "panda"}) {
        TestArm arm(robot);
        arm.limits.position.lower.setConstant(-3.0);
        arm.limits.position.upper.setConstant(3.0);
        for (int k = 0; k < 20; ++k) {
            const JointVector start = makeRandomVector(arm.size(), 2.0, random_);
            Pose command = arm.calcDynamics(start, JointVector::Zero(arm.size())).tool;
            command.position *= 1.3 / command.position.norm();
            ToolReference reference;
            reference.configure(arm.robot, arm.limits, arm.tick_s, start, {0.2, 0.0, 0.0});
            reference.reset(start);
            for (int tick = 0; tick < 10000; ++tick) reference.advance(command);
            double way = 0.0;
            const JointVector before = reference.q();
            for (int tick = 0; tick < 200; ++tick) {
                const JointVector last = reference.q();
                reference.advance(command);
                way += (reference.q() - last).norm();
            }
            const double gone = (reference.q() - before).norm();
            EXPECT_LE(way, 1.01 * gone + 1e-6) << robot << " " << k << ": there and back";
        }
    }
}

TEST_F(ToolServoTest, SpareJointsGoToTheirRestAndLeaveTheToolAlone) {
    ToolReference reference;
    configure(reference, 1.0);
    JointVector q = arm_.robot.home;
    q[0] += 0.5, q[2] -= 0.4, q[4] += 0.3;
    const Pose command = arm_.calcDynamics(q, JointVector::Zero(arm_.size())).tool;
    reference.reset(q);
    const double far = (q - arm_.robot.home).norm();
    const Pose end = follow(reference, command, 10.0);
    EXPECT_LT((reference.q() - arm_.robot.home).norm(), 0.95 * far);
    EXPECT_LE((end.position - command.position).norm(), 1e-4);
}

/** A ball beside the elbow of the arm at home. */
Environment makeBall() {
    Environment environment;
    environment.solids.push_back(test::makeBall(Eigen::Vector3d(0.08, 0.2, 0.68), 0.05));
    return environment;
}

/** How near the arm is to what stands around it; at most 1 m. */
double calcNearest(ArmClearances& clearances, const Surroundings& around, const JointVector& q) {
    double least = 1.0;
    for (const auto& item : clearances.find(q, &around, 0.0, 1.0))
        if (item.otherCapsule < 0) least = std::min(least, item.distance);
    return least;
}

TEST_F(ToolServoTest, ReferenceRestsBeforeWhatBarsItsWay) {
    const ArmGeometry geometry = loadArmGeometry(arm_.robot);
    Environment environment = makeBall();
    environment.solids[0].pose.translation() = homeTool().position + Eigen::Vector3d(0.25, 0.0, 0.0);
    const auto surroundings = makeSurroundings(environment, arm_.robot, geometry, arm_.limits);
    ArmClearances clearances(arm_.robot, geometry);
    for (const bool knows : {false, true}) {
        ToolReference reference;
        reference.configure(arm_.robot, arm_.limits, arm_.tick_s, arm_.robot.home, {0.2, 0.0, 0.0},
                            knows ? &geometry : nullptr);
        Pose command = homeTool();
        command.position.x() += 0.25;
        double least = 1.0, way = 0.0;
        for (int tick = 0; tick < 6000; ++tick) {
            const JointVector before = reference.q();
            reference.advance(command, surroundings.get(), 0.0);
            if (tick >= 5000) way += (reference.q() - before).norm();
            for (const auto& item : clearances.find(reference.q(), surroundings.get(), 0.0, 0.5))
                least = std::min(least, item.distance);
        }
        if (!knows) {
            EXPECT_LT(least, 0.0) << "the ball does not bar the way";
            continue;
        }
        EXPECT_GE(least, environment.safetyDistance_m + 0.005);
        EXPECT_LE(least, environment.safetyDistance_m + 0.01) << "it does not come as near as it may";
        EXPECT_LE(way, 0.01) << "it does not come to rest";
    }
}

// A start nearer than the reference goes: it stays there as long as it is to rest, and on its way comes away from what it passes.
TEST_F(ToolServoTest, ReferenceThatIsTooNearRestsAndLeadsAwayByTheWay) {
    const ArmGeometry geometry = loadArmGeometry(arm_.robot);
    Environment environment = makeBall();
    ArmClearances clearances(arm_.robot, geometry);
    // The ball is 24 mm from the arm at home.
    const auto small = makeSurroundings(environment, arm_.robot, geometry, arm_.limits);
    environment.solids[0].radius += calcNearest(clearances, *small, arm_.robot.home) - 0.024;
    const auto surroundings = makeSurroundings(environment, arm_.robot, geometry, arm_.limits);
    EXPECT_NEAR(calcNearest(clearances, *surroundings, arm_.robot.home), 0.024, 1e-3);
    ToolReference reference;
    reference.configure(arm_.robot, arm_.limits, arm_.tick_s, arm_.robot.home, {0.2, 0.0, 0.0}, &geometry);
    Pose command = homeTool();
    for (int tick = 0; tick < 1000; ++tick) reference.advance(command, surroundings.get(), 0.0);
    EXPECT_LE((reference.q() - arm_.robot.home).cwiseAbs().maxCoeff(), 1e-9);
    command.position.y() += 0.4;  // past the ball
    double least = 1.0;
    for (int tick = 0; tick < 5000; ++tick) {
        reference.advance(command, surroundings.get(), 0.0);
        least = std::min(least, calcNearest(clearances, *surroundings, reference.q()));
    }
    EXPECT_GE(least, 0.0235);
    EXPECT_GE(calcNearest(clearances, *surroundings, reference.q()), 0.0265);
}

TEST_F(ToolServoTest, ReferenceStaysWithinTheBoundsOfATick) {
    ToolReference reference;
    configure(reference);
    Pose command = homeTool();
    command.position.y() += 0.3;
    JointBounds around{arm_.robot.home.array() - 0.02, arm_.robot.home.array() + 0.02};
    for (int tick = 0; tick < 500; ++tick) reference.advance(command, nullptr, 0.0, &around);
    EXPECT_TRUE(reference.isHeldBack());
    EXPECT_LE((reference.q() - arm_.robot.home).cwiseAbs().maxCoeff(), 0.02 + 1e-12);
    EXPECT_GT((reference.q() - arm_.robot.home).cwiseAbs().maxCoeff(), 0.0199);
    around.lower.array() += 0.1;  // the arm was led elsewhere: it follows, no faster than it may
    around.upper.array() += 0.1;
    const JointVector before = reference.q();
    reference.advance(command, nullptr, 0.0, &around);
    EXPECT_TRUE(((reference.q() - before).array() <= arm_.limits.velocity.upper.array() * arm_.tick_s + 1e-12).all());
    for (int tick = 0; tick < 500; ++tick) reference.advance(command, nullptr, 0.0, &around);
    EXPECT_GE((reference.q() - around.lower).minCoeff(), -1e-12);
}

TEST_F(ToolServoTest, SpareJointsLeadTheArmAwayFromWhatIsNear) {
    const ArmGeometry geometry = loadArmGeometry(arm_.robot);
    const auto surroundings = makeSurroundings(makeBall(), arm_.robot, geometry, arm_.limits);
    ArmClearances clearances(arm_.robot, geometry);
    const Pose command = homeTool();
    double nearest[2];
    for (const bool leads : {false, true}) {
        ToolReference reference;
        ToolReferenceOptions options{0.2, 0.5, leads ? 0.1 : 0.0};
        reference.configure(arm_.robot, arm_.limits, arm_.tick_s, arm_.robot.home, options, &geometry);
        double worst = 0.0;
        for (int tick = 0; tick < 5000; ++tick) {
            reference.advance(command, surroundings.get(), 0.0);
            worst = std::max(worst, (arm_.calcDynamics(reference.q(), JointVector::Zero(arm_.size())).tool.position -
                                     command.position)
                                        .norm());
        }
        nearest[leads] = calcNearest(clearances, *surroundings, reference.q());
        EXPECT_LE(worst, 1e-4) << "the tool was moved";
    }
    std::printf("elbow to ball: %.4f m, led apart %.4f m\n", nearest[0], nearest[1]);
    EXPECT_LT(nearest[0], 0.06);
    EXPECT_GT(nearest[1], nearest[0] + 0.025);
}

// A hand past a post, over twelve seeds as they come. The reference keeps clear of the post, so that the check of the whole arm
// seldom holds the arm back (in 6 % of the ticks where it did not know of it); led apart by spare joints it is as near to the hand.
TEST(ToolServo, TheReferenceSparesAWholeArmStops) {
    constexpr int kSeeds = 12;
    std::int64_t stops[2] = {0, 0}, ticks = 0;
    double squares[2] = {0.0, 0.0};
    for (const bool leads : {false, true})
        for (int seed = 1; seed <= kSeeds; ++seed) {
            const Summary s =
                run({"robot=panda", "limits={velocity_radps: 1.5, acceleration_radps2: 8, jerk_radps3: 200}",
                     "duration_s=30", "filter={plugin: whole_arm_braking}",
                     std::string("controller={plugin: tool_servo, apart_m: ") + (leads ? "0.1}" : "0}"),
                     "command={plugin: generated_hand_motion, reach_m: [0.15, 0.3, 0.2], rotation_rad: 0.4, "
                     "fastest_s: 0.8, slowest_s: 2, seed: " +
                         std::to_string(seed) + "}",
                     "environment={safety_distance_m: 0.02, obstacles: {post: {cylinder: {radius: 0.05, length: 1.6}, "
                     "at: {xyz: [0.2, 0.35, 0.7]}}}}"});
            EXPECT_FALSE(s.anyLimitBroken());
            ticks += s.ticks();
            stops[leads] += s.ticks() - s.ticksWith(FilterStatus::Passed);
            squares[leads] += s.toolErrorRms() * s.toolErrorRms();
        }
    std::printf("ticks held back %lld, led apart %lld; tool error %.1f and %.1f mm RMS\n",
                static_cast<long long>(stops[0]), static_cast<long long>(stops[1]),
                1e3 * std::sqrt(squares[0] / kSeeds), 1e3 * std::sqrt(squares[1] / kSeeds));
    EXPECT_LT(stops[0] + stops[1], 0.008 * static_cast<double>(ticks));
    EXPECT_LT(squares[1], 1.01 * squares[0]);
}

TEST_F(ToolServoTest, ReferenceTurnsOnWithACommandThatTurnsRoundTwice) {
    ToolReference reference;
    TestArm& arm = arm_;
    arm.limits.position = JointBounds{JointVector::Constant(7, -20.0), JointVector::Constant(7, 20.0)};
    configure(reference);
    const Pose home = homeTool();
    Pose command = home;
    const Eigen::Vector3d axis = home.orientation * Eigen::Vector3d::UnitZ();
    double worst = 0.0;
    for (int tick = 0; tick < 12600; ++tick) {
        command.orientation = calcRotation(axis * (1e-3 * tick)) * home.orientation;
        if (tick % 2 == 1) command.orientation.coeffs() *= -1.0;  // the same rotation
        reference.advance(command);
        worst =
            std::max(worst, calcRotationVector(arm.calcDynamics(reference.q(), JointVector::Zero(7)).tool.orientation *
                                               command.orientation.conjugate())
                                .norm());
    }
    EXPECT_LE(worst, 0.01);
    EXPECT_GT(std::abs(reference.q()[6] - arm.robot.home[6]), 2.0 * kPi) << "it did not turn on";
}

/** The joints of an arm under a controller alone: `ticks` ticks towards one command. */
class ServedArm {
public:
    ServedArm(TestArm& arm, const std::string& parameters) : arm_(arm), setup_(arm.setup()), state(arm.start) {
        servo_.configure(setup_, arm.read(PluginKind::NominalController, "tool_servo", parameters));
        servo_.reset(arm.start);
        command.space = MotionCommand::Space::Tool;
        command.tool = tool();
    }
    Pose tool() { return arm_.calcDynamics(state).tool; }
    template <class Check>
    void follow(int ticks, Check check) {
        ControllerOutput output;
        for (int tick = 0; tick < ticks; ++tick) {
            const Dynamics dynamics = arm_.calcDynamics(state);
            ASSERT_EQ(servo_.compute({command, state, dynamics}, output), TickStatus::Ok);
            advanceArm(state, output.accelerationRate, 1e-3);
            check();
        }
    }

private:
    TestArm& arm_;
    RunSetup setup_;
    ToolServo servo_;

public:
    MotionCommand command;
    MotionState state;
};

// The reference's own path to a far pose is curved, and joints turn back on it; with a reference that counts as resting a
// joint does no more than that.
TEST_F(ToolServoTest, ACommandThatJumpsIsNotPassedForTheVelocityThatWasFollowed) {
    for (const Eigen::Vector3d& way : {Eigen::Vector3d(0.0, 0.3, 0.0), Eigen::Vector3d(-0.1, 0.0, 0.2)}) {
        const auto calcBeyond = [&](const char* filter) {
            ServedArm served(arm_, std::string("rest_rate: 0, velocity_filter_s: ") + filter);
            served.command.tool.position += way;
            const JointVector begin = served.state.q;
            JointVector least = begin, largest = begin;
            served.follow(4000, [&] {
                least = least.cwiseMin(served.state.q);
                largest = largest.cwiseMax(served.state.q);
            });
            EXPECT_LE((served.tool().position - served.command.tool.position).norm(), 1e-6);
            EXPECT_LE(served.state.qd.cwiseAbs().maxCoeff(), 1e-9);
            const JointVector& end = served.state.q;
            return std::max((largest - begin.cwiseMax(end)).maxCoeff(), (begin.cwiseMin(end) - least).maxCoeff());
        };
        const double resting = calcBeyond(".inf"), followed = calcBeyond("0");
        std::printf("beyond its end: %.4f rad, resting reference %.4f rad\n", followed, resting);
        EXPECT_LE(followed, resting + 0.02);
    }
}

TEST_F(ToolServoTest, ARelativeCommandBeginsWhereTheToolIs) {
    ServedArm served(arm_, "relative: true, rest_rate: 0");
    const Pose home = homeTool();
    const Eigen::Quaterniond turn = calcRotation({0.3, -0.2, 0.5});
    served.command.tool = {home.position + Eigen::Vector3d(0.5, 0.2, -0.4), turn * home.orientation};
    served.follow(200, [] {});
    EXPECT_LE((served.state.q - arm_.start.q).cwiseAbs().maxCoeff(), 1e-6) << "the offset counts as a command";
    served.command.tool.position.y() += 0.1;
    served.follow(3000, [] {});
    EXPECT_LE((served.tool().position - home.position - Eigen::Vector3d(0.0, 0.1, 0.0)).norm(), 1e-4);
}

TEST(ToolServo, NeedsAJerkLimit) {
    expectError({"tool_servo", "jerk limit", "limits.jerk_radps3"}, [] {
        run({"limits.jerk_radps3=.inf", "filter={plugin: pass_through}"});
    });
}

// A tool that is where it should be, and spare joints that would go faster than they may.
TEST(ToolFollower, SpareJointsOfAnArmAtItsCommandGoTheirWay) {
    TestArm arm("panda", 0.001);
    arm.limits.velocity.lower.setConstant(-0.3);
    arm.limits.velocity.upper.setConstant(0.3);
    arm.start.q[2] = -1.5;
    const Pose command = arm.calcDynamics(arm.start.q, JointVector::Zero(arm.size())).tool;
    ToolFollower follower;
    follower.configure(arm.robot, arm.limits, arm.tick_s, arm.start, {{0.2, 5.0, 0.0}});
    MotionState state = arm.start;
    JointVector jerk;
    double worst = 0.0;
    for (int k = 0; k < 5000; ++k) {
        follower.calc(state, command, nullptr, k * arm.tick_s, jerk);
        advanceArm(state, jerk, arm.tick_s);
        worst = std::max(
            worst, (arm.calcDynamics(state.q, JointVector::Zero(arm.size())).tool.position - command.position).norm());
    }
    EXPECT_GT((state.q - arm.start.q).cwiseAbs().maxCoeff(), 0.2);
    EXPECT_LT(worst, 0.005);
}

// A lead that the servo cannot stop within would hold it back: with part of the acceleration, or where a tick is long.
TEST(ToolFollower, TheLeadCostsNoSpeed) {
    for (const char* robot : {"indy7", "panda"})
        for (const double tick_s : {0.001, 0.02})
            for (const double share : {1.0, 0.5, 0.25}) {
                TestArm arm(robot, tick_s);
                arm.limits.position.lower.setConstant(-100.0);
                arm.limits.position.upper.setConstant(100.0);
                ToolFollower follower;
                follower.configure(arm.robot, arm.limits, tick_s, arm.start, {{0.2, 0.0, 0.0}, share});
                MotionState state = arm.start;
                JointVector jerk;
                double fastest = 0.0;
                for (int k = 0; k < std::lround(4.0 / tick_s); ++k) {
                    // Always a quarter of a turn ahead about the base's vertical: the first joint is to go as fast as it may.
                    Pose command = arm.calcDynamics(state.q, JointVector::Zero(arm.size())).tool;
                    const Eigen::AngleAxisd turn(1.5, Eigen::Vector3d::UnitZ());
                    command.position = turn * command.position;
                    command.orientation = turn * command.orientation;
                    follower.calc(state, command, nullptr, k * tick_s, jerk);
                    advanceArm(state, jerk, tick_s);
                    fastest = std::max(fastest, state.qd[0]);
                }
                EXPECT_GE(fastest, 0.95 * arm.limits.velocity.upper[0]) << robot << ", " << tick_s << ", " << share;
            }
}

// Somebody shakes the arm for many of its stops, in free space or near a ball that is beside the way: once let go, it goes to
// the command that stands. The same where the arm rested before the ball, and was carried back.
TEST(ToolFollower, AnArmThatWasShakenOrCarriedOffGoesOn) {
    constexpr double kScenes[][3] = {
        {9.0, 0.06, 0.25}, {0.25, 0.06, 0.45}, {0.35, 0.12, 0.35}};  // ball at, radius, hand at
    for (const char* robot : {"panda", "indy7", "ur5e"})
        for (const auto& [ball_m, radius_m, hand_m] : kScenes) {
            const bool isCarried = ball_m == hand_m;
            TestArm arm(robot, 0.001);
            const ArmGeometry geometry = loadArmGeometry(arm.robot);
            const JointVector still = JointVector::Zero(arm.size());
            Pose command = arm.calcDynamics(arm.start.q, still).tool;
            Environment environment;
            environment.safetyDistance_m = 0.02;
            environment.solids.push_back(
                test::makeBall(command.position + ball_m * Eigen::Vector3d::UnitY(), radius_m));
            command.position.y() += hand_m;
            const auto surroundings = makeSurroundings(environment, arm.robot, geometry, arm.limits);
            ToolFollower follower;
            follower.configure(arm.robot, arm.limits, arm.tick_s, arm.start, {}, &geometry);
            MotionState state = arm.start;
            JointVector jerk, at;
            const auto findOff = [&] {
                return (arm.calcDynamics(state.q, still).tool.position - command.position).norm();
            };
            double off_m = 0.0;
            for (int k = 0; k < 30000; ++k) {
                follower.calc(state, command, surroundings.get(), k * arm.tick_s, jerk);
                advanceArm(state, jerk, arm.tick_s);
                if (k == (isCarried ? 9999 : 300)) at = state.q;
                if (k == 9999 && isCarried) off_m = findOff();
                const double x = std::min(1.0, (k - 10000) / 3000.0), way = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
                if (isCarried && k >= 10000 && k < 14000) state = {at + way * (arm.start.q - at), still, still};
                if (!isCarried && k > 300 && k < 10000)
                    state = {(at.array() + 0.02 * std::sin(0.006 * (k - 300))).matrix(), still, still};
            }
            EXPECT_NEAR(findOff(), off_m, isCarried ? 1e-3 : 1e-5) << robot << ", ball " << radius_m;
        }
}

// Each joint in turn with a tenth of the acceleration and jerk: the others would be there long before it.
TEST(ToolFollower, AWeakJointDoesNotLeadTheToolPastACommandThatJumps) {
    std::mt19937 random(static_cast<std::mt19937::result_type>(getSeed(3)));
    for (const char* robot : {"indy7", "ur5e", "panda"}) {
        double mean_m = 0.0;
        int count = 0;
        for (const int weak : {0, 1, 2, 3, 4, 5})
            for (int k = 0; k < countOf(2); ++k, ++count) {
                TestArm arm(robot);
                const auto set = [&](JointBounds& bounds, double limit) {
                    bounds.upper.setConstant(limit);
                    if (&bounds != &arm.limits.velocity) bounds.upper[weak] /= 10.0;
                    bounds.lower = -bounds.upper;
                };
                set(arm.limits.velocity, 2.0);
                set(arm.limits.acceleration, 12.0);
                set(arm.limits.jerk, 120.0);
                const JointVector zero = JointVector::Zero(arm.size());
                const auto placeTool = [&](const JointVector& q) { return arm.calcDynamics(q, zero).tool; };
                const Pose command = placeTool(arm.start.q + makeRandomVector(arm.size(), 0.5, random));
                const Eigen::Vector3d way = command.position - placeTool(arm.start.q).position;
                ToolFollower follower;
                follower.configure(arm.robot, arm.limits, arm.tick_s, arm.start, {{0.2, 0.0, 0.0}});
                MotionState state = arm.start;
                JointVector jerk;
                double beyond_m = 0.0;
                for (int tick = 0; tick < 5000; ++tick) {
                    follower.calc(state, command, nullptr, tick * arm.tick_s, jerk);
                    advanceArm(state, jerk, arm.tick_s);
                    beyond_m =
                        std::max(beyond_m, (placeTool(state.q).position - command.position).dot(way.normalized()));
                }
                EXPECT_LE((placeTool(state.q).position - command.position).norm(), 1e-3) << robot << ", " << weak;
                mean_m += beyond_m;
            }
        mean_m /= count;
        std::printf("%s: %.1f mm beyond the command in the mean\n", robot, 1e3 * mean_m);
        EXPECT_LE(mean_m, 0.005) << robot;
    }
}

TEST_F(ToolServoTest, ABarredReferenceTakesNoMemory) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const ArmGeometry geometry = loadArmGeometry(arm_.robot);
    const auto surroundings = makeSurroundings(makeBall(), arm_.robot, geometry, arm_.limits);
    ToolReference reference;
    reference.configure(arm_.robot, arm_.limits, arm_.tick_s, arm_.robot.home, {0.2, 0.5, 0.1}, &geometry);
    Pose command = homeTool();
    command.position -= Eigen::Vector3d(0.5, 0.0, 0.3);  // into itself
    reference.advance(command, surroundings.get(), 0.0);
    const testing::AllocationCounter counter;
    int barred = 0;
    for (int k = 0; k < 4000; ++k) {
        const JointVector before = reference.q();
        reference.advance(command, surroundings.get(), 0.0);
        // Held back, and not by its speed.
        barred += reference.isHeldBack() && (reference.q() - before).cwiseAbs().maxCoeff() < 1e-4;
    }
    EXPECT_GT(barred, 1000);
    EXPECT_EQ(counter.count(), 0);
}

// 1e6 ticks: VIABLE_EFFORT=50
TEST_F(ToolServoTest, TakesNoMemoryInItsTicks) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    ServedArm served(arm_, "");
    const Pose home = homeTool();
    served.follow(1, [] {});
    const testing::AllocationCounter counter;
    for (int jump = 0; jump < countOf(40); ++jump) {  // near, turned, and out of reach
        const double size = jump % 3 == 2 ? 3.0 : 0.2;
        served.command.tool.position =
            home.position + size * Eigen::Vector3d(std::sin(jump), std::cos(2.0 * jump), 0.3);
        served.command.tool.orientation = calcRotation({0.5 * std::sin(jump), 0.0, 0.1 * jump}) * home.orientation;
        served.follow(500, [] {});
    }
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace viable::test
