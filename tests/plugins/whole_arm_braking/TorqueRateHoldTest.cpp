#include "Effort.h"
#include "WholeArm.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

/** What a motion of an arm came to. */
struct Motion {
    double left = 0.0;  ///< of the ways of the other joints to their goals, over time [rad s]
    double rate = 0.0;  ///< largest of the motor's torque [Nm/s]
    int held = 0;       ///< ticks in which all joints follow their stops
};

/** Draws an arm, a motor and a motion by `seed`. @param peak  [Nm/s], of which the motor's rate may be a share; infinite: it is free */
Motion move(const std::vector<RobotDescription>& robots, std::uint64_t seed, double peak, int ticks, double& rate) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> share(0.0, 1.0);
    RobotDescription robot = robots[random() % robots.size()];
    const int n = robot.size();
    const JointBounds& range = robot.limits.position;
    const auto draw = [&](const JointVector& around, double most) {
        JointVector q = around;
        for (int i = 0; i < n; ++i)
            q[i] = std::clamp(q[i] + most * (2.0 * share(random) - 1.0), range.lower[i] + 0.1, range.upper[i] - 0.1);
        return q;
    };
    robot.home = draw(robot.home, 0.6);
    const auto slow = static_cast<int>(random() % static_cast<std::uint64_t>(n));
    JointVector rates = JointVector::Constant(n, kInfinity);
    rate = rates[slow] = peak * (0.2 + 0.5 * share(random));
    WholeArmBrakingOptions options;
    options.torqueRate = PerJoint(rates);
    if (share(random) < 0.5) options.joints.objective = Objective::Joint;
    const double stiffness = 50.0 * std::pow(20.0, share(random));
    FilteredWholeArm arm(robot);
    arm.filter.configure({arm.robot, arm.robot.limits, arm.kTick_s, 60.0, arm.state, arm.dynamics.tool}, options);
    arm.filter.reset(arm.state);
    Motion motion;
    JointVector goal, last;
    const testing::AllocationCounter counter;
    for (int tick = 0; tick < ticks; ++tick) {
        if (tick % 300 == 0) goal = draw(robot.home, 1.0);
        const FilterStatus status = arm.goTo(goal, stiffness);
        EXPECT_LE(status, FilterStatus::StoppedByPlan) << seed << ": " << tick;
        motion.held += status == FilterStatus::StoppedByPlan;
        if (tick > 0) motion.rate = std::max(motion.rate, std::abs(arm.motion.torque[slow] - last[slow]) / arm.kTick_s);
        last = arm.motion.torque;
        const JointVector missing = (goal - arm.state.q).cwiseAbs();
        motion.left += arm.kTick_s * (missing.sum() - missing[slow]);
    }
    EXPECT_EQ(counter.count(), 0);
    return motion;
}

// One motor's torque may change at 20 to 70 % of the rate that the motion takes without a limit, and no other motor's is limited. The
// rate is kept, and the others go on: all joints stood on their stops in 2.3 % of these ticks, up to 245 in a row, while a rate that was
// not kept told no joint from the others.
TEST(WholeArmBraking, OneMotorsTorqueRateDoesNotHoldTheOthers) {
    const std::vector<RobotDescription> robots = {loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"),
                                                  loadRobot(VIABLE_SOURCE_DIR "/robots/panda"),
                                                  loadRobot(VIABLE_SOURCE_DIR "/robots/ur5e")};
    const int arms = test::countOf(300), ticks = 500;
    const auto seed = static_cast<std::uint64_t>(test::getSeed(541));
    double left[2] = {}, fastest = 0.0;
    int held = 0, mostHeld = 0;
    for (int k = 0; k < arms; ++k) {
        const std::uint64_t own = 1000 * seed + static_cast<std::uint64_t>(k);
        double rate = 0.0;
        const Motion free = move(robots, own, kInfinity, ticks, rate);
        const Motion limited = move(robots, own, free.rate, ticks, rate);
        ASSERT_EQ(free.held, 0) << k;
        left[0] += free.left;
        left[1] += limited.left;
        fastest = std::max(fastest, limited.rate / rate);
        held += limited.held;
        mostHeld = std::max(mostHeld, limited.held);
    }
    std::printf(
        "  %d arms of seed %lu, at most %.9f of the rate: all joints held in %d of %d ticks, of one arm in %d; of the "
        "others' way is left %.2f rad s, %.2f without a limit\n",
        arms, static_cast<unsigned long>(seed), fastest, held, arms * ticks, mostHeld, left[1], left[0]);
    EXPECT_LE(fastest, 1.0 + 1e-9);
    EXPECT_LT(held, 0.01 * arms * ticks);
    EXPECT_LT(left[1], 1.05 * left[0]);
}

}  // namespace
}  // namespace viable
