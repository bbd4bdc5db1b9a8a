#include "WholeArm.h"
#include "limits/PointSpeedLimit.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

/** An arm with speed limits and nothing around it, under the filter. */
class LimitedArm : public FilteredWholeArm {
public:
    explicit LimitedArm(const SpeedLimits& limits, WholeArmBrakingOptions options = {}, const char* name = "indy7")
        : FilteredWholeArm(loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name)), options_(options) {
        robot.speedLimits = limits;
        checker.emplace(robot, &geometry);
    }
    void configure() {
        calcDynamics();
        setup_.emplace(RunSetup{robot, robot.limits, kTick_s, 60.0, state, dynamics.tool});
        filter.configure(*setup_, options_);
    }
    double use() const { return checker->find(state.q, state.qd).use; }
    bool acts(LimitKind kind) const {
        for (const JointIntervention& joint : decision.joints)
            if (joint.limit == kind) return true;
        return false;
    }
    JointVector drawGoal(std::mt19937& random) const {
        std::uniform_real_distribution<double> share(-1.0, 1.0);
        JointVector goal = robot.home;
        for (Eigen::Index i = 0; i < goal.size(); ++i)
            goal[i] = std::clamp(goal[i] + 1.5 * share(random), robot.limits.position.lower[i],
                                 robot.limits.position.upper[i]);
        return goal;
    }

    std::optional<detail::PointSpeedLimit> checker;

private:
    WholeArmBrakingOptions options_;
    std::optional<RunSetup> setup_;
};

/** For every point of the arm [m/s]. */
SpeedLimits limitArm(double speed) {
    SpeedLimits limits;
    limits.arm = speed;
    return limits;
}

// To random poses as fast as a stiff law wants, with 0.25 m/s for every point: never more, and near it whenever more is asked for.
TEST(SpeedLimits, TheArmRunsAtTheLimitInsteadOfStopping) {
    for (const char* robot : {"indy7", "panda", "ur5e"}) {
        LimitedArm arm(limitArm(0.25), {}, robot);
        arm.configure();
        EXPECT_TRUE(arm.filter.traits().guarantees.has(LimitKind::Speed));
        std::mt19937 random(3);
        JointVector goal;
        double most = 0.0;
        int asked = 0, atLimit = 0, stopped = 0, acting = 0;
        constexpr int kTicks = 12000, kTicksPerGoal = 3000;
        for (int tick = 0; tick < kTicks; ++tick) {
            if (tick % kTicksPerGoal == 0) goal = arm.drawGoal(random);
            const FilterStatus status = arm.goTo(goal, 100.0);
            ASSERT_LE(status, FilterStatus::StoppedByPlan);
            const double use = arm.use();
            most = std::max(most, use);
            EXPECT_TRUE(arm.decision.reports[LimitKind::Speed].isKnown);
            stopped += status == FilterStatus::StoppedByPlan;
            acting += arm.acts(LimitKind::Speed);
            // The law's own speed: a spring far from its goal asks for far more than 0.25 m/s.
            if ((goal - arm.state.q).lpNorm<Eigen::Infinity>() < 0.2) continue;
            ++asked;
            atLimit += use > kAtSpeedLimit;
        }
        std::printf(
            "  %s: largest speed 1 %+.2g of the limit; above %.0f %% of it in %.1f %% of %d ticks far from the goal; "
            "the "
            "limit acts in %d ticks, %d on a backup stop\n",
            robot, most - 1.0, 100.0 * kAtSpeedLimit, 100.0 * atLimit / asked, asked, acting, stopped);
        EXPECT_LE(most, 1.0 + 1e-9);
        EXPECT_GT(asked, kTicks / 8);
        EXPECT_GT(atLimit, 0.6 * asked);
    }
}

// A start just below a limit is one within it: what is proven of it is as sharp as that.
TEST(SpeedLimits, AStartJustBelowALimitIsNotRefused) {
    for (const double share : {0.9, 0.97, 0.99, 0.995, 0.999}) {
        LimitedArm arm(limitArm(0.25));
        arm.state.qd[0] = 0.1;
        arm.state.qd *= share / arm.use();
        EXPECT_NO_THROW(arm.configure()) << share;
        arm.state.qd *= 1.001 / share;
        EXPECT_THROW(arm.configure(), Error) << share;
    }
}

// With regions alone, an arm outside of them: every tick has been looked at, and says so.
TEST(SpeedLimits, OutsideOfItsRegionsAnArmIsKnownToBeFree) {
    SpeedLimits limits;
    limits.regions.push_back({"far", Eigen::Vector3d::Constant(5.0), Eigen::Vector3d::Constant(6.0), 0.05});
    LimitedArm arm(limits);
    arm.configure();
    const JointVector goal = turned(arm.robot.home, 0, 1.0);
    for (int tick = 0; tick < 300; ++tick) {
        arm.goTo(goal, 100.0);
        ASSERT_TRUE(arm.decision.reports[LimitKind::Speed].isKnown) << tick;
        ASSERT_FALSE(arm.acts(LimitKind::Speed)) << tick;
    }
    EXPECT_GT(arm.decision.reports[LimitKind::Speed].value, 0.1);
    EXPECT_TRUE(std::isinf(arm.decision.reports[LimitKind::Speed].limit));
}

// Without the filter's steering it is kept just as well.
TEST(SpeedLimits, WithoutSteeringTheyAreKept) {
    WholeArmBrakingOptions options;
    options.steers = false;
    LimitedArm arm(limitArm(0.1), options);
    arm.configure();
    std::mt19937 random(4);
    JointVector goal;
    double most = 0.0, way = 0.0;
    for (int tick = 0; tick < 6000; ++tick) {
        if (tick % 1500 == 0) goal = arm.drawGoal(random);
        arm.goTo(goal, 400.0);
        most = std::max(most, arm.use());
        way += arm.state.qd.norm() * FilteredWholeArm::kTick_s;
    }
    EXPECT_LE(most, 1.0 + 1e-9);
    EXPECT_GT(way, 0.1) << "it moves";
}

// A box in which 0.05 m/s counts: outside the arm is faster, and in it the arm goes on.
TEST(SpeedLimits, ARegionIsEnteredSlowly) {
    LimitedArm free({});
    free.configure();
    const Eigen::Vector3d tool = free.dynamics.tool.position;
    const double angle = std::atan2(tool.y(), tool.x()) + 0.6, radius = tool.head<2>().norm();
    const Eigen::Vector3d centre(radius * std::cos(angle), radius * std::sin(angle), tool.z());
    SpeedLimits limits = limitArm(0.5);
    limits.regions.push_back(
        {"box", centre - Eigen::Vector3d::Constant(0.05), centre + Eigen::Vector3d::Constant(0.05), 0.05});
    LimitedArm arm(limits);
    arm.configure();
    const JointVector goal = turned(arm.robot.home, 0, 1.4);
    double most = 0.0, fastest = 0.0;
    int inside = 0, insideAtLimit = 0, tick = 0;
    for (; tick < 30000 && arm.state.q[0] < goal[0] - 0.05; ++tick) {
        arm.goTo(goal, 100.0);
        const detail::PointSpeedLimit::Fastest found = arm.checker->find(arm.state.q, arm.state.qd);
        most = std::max(most, found.use);
        fastest = std::max(fastest, found.speed);
        const bool isInside = found.use > 0.0 && found.speed / found.use < 0.1;
        inside += isInside;
        insideAtLimit += isInside && found.use > 0.9;
    }
    std::printf(
        "  through the box in %.1f s, %.1f s of them inside; fastest %.3f m/s, largest share of a limit 1 %+.2g\n",
        FilteredWholeArm::kTick_s * tick, FilteredWholeArm::kTick_s * inside, fastest, most - 1.0);
    EXPECT_LE(most, 1.0 + 1e-9);
    EXPECT_GT(fastest, 0.4);
    EXPECT_GT(inside, 1000);
    EXPECT_GT(insideAtLimit, 0.6 * inside);
    EXPECT_LT(tick, 30000) << "it gets through";
}

TEST(SpeedLimits, TheToolAloneIsLimited) {
    SpeedLimits limits;
    limits.tool = 0.1;
    LimitedArm arm(limits);
    arm.configure();
    std::mt19937 random(6);
    JointVector goal, before;
    double most = 0.0;
    for (int tick = 0; tick < 6000; ++tick) {
        if (tick % 1500 == 0) goal = arm.drawGoal(random);
        const Eigen::Vector3d tool = arm.dynamics.tool.position;
        arm.goTo(goal, 100.0);
        most = std::max(most, (arm.dynamics.tool.position - tool).norm() / FilteredWholeArm::kTick_s);
    }
    EXPECT_LE(most, 0.1 * (1.0 + 1e-9));  // a mean over a tick is not above the largest
    EXPECT_GT(most, 0.095);
    EXPECT_EQ(arm.decision.reports[LimitKind::Speed].link, -1);
}

TEST(SpeedLimits, AStartThatIsTooFastIsRefusedOrSlowedDown) {
    LimitedArm arm(limitArm(0.1));
    arm.state.qd[0] = 1.0;
    expectError({"link", "m/s", "0.1", "recovery"}, [&] { arm.configure(); });
    WholeArmBrakingOptions options;
    options.joints.recovery = true;
    LimitedArm slowed(limitArm(0.1), options);
    slowed.state.qd[0] = 1.0;
    slowed.configure();
    EXPECT_FALSE(slowed.filter.traits().guarantees.has(LimitKind::Speed));
    const JointVector goal = turned(slowed.robot.home, 0, 1.0);
    double first = slowed.use(), most = first;
    for (int tick = 0; tick < 3000; ++tick) {
        slowed.goTo(goal, 100.0);
        if (tick > 1000) EXPECT_LE(slowed.use(), 1.0 + 1e-9) << tick;
        most = std::max(most, slowed.use());
    }
    EXPECT_GT(first, 5.0);
    EXPECT_LT(most, 1.1 * first);
}

TEST(SpeedLimits, AllocateNothing) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    SpeedLimits limits = limitArm(0.25);
    limits.tool = 0.2;
    limits.regions.push_back({"box", {-1.0, -1.0, 0.3}, {1.0, 1.0, 0.6}, 0.1});
    LimitedArm arm(limits);
    arm.configure();
    std::mt19937 random(7);
    JointVector goal = arm.drawGoal(random);
    testing::AllocationCounter counter;
    for (int tick = 0; tick < 2000; ++tick) arm.goTo(goal, 100.0);
    EXPECT_EQ(counter.count(), 0);
}

TEST(SpeedLimits, NumbersThatAreNoneAreRefused) {
    for (const double speed : {0.0, -1.0, 1e-6, std::numeric_limits<double>::quiet_NaN()}) {
        LimitedArm arm(limitArm(speed));
        EXPECT_THROW(arm.configure(), Error) << speed;
        SpeedLimits region;
        region.regions.push_back({"box", {0.0, 0.0, 0.0}, {1.0, 1.0, 1.0}, speed});
        LimitedArm other(region);
        EXPECT_THROW(other.configure(), Error) << speed;
    }
    SpeedLimits flat;
    flat.regions.push_back({"flat", {0.0, 0.0, 0.0}, {1.0, 0.0, 1.0}, 0.1});
    LimitedArm arm(flat);
    EXPECT_THROW(arm.configure(), Error);
}

}  // namespace
}  // namespace viable
