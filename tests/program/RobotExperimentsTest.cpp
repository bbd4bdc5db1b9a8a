#include "CaseSupport.h"
#include "ProjectExperiment.h"

// What the experiments of the other arms claim: limits kept and reached, the real arm next to the nominal one.

namespace viable {
namespace {

/** What certified braking guarantees: nothing outside, always a choice, to the end. */
void expectKept(const CaseResult& result, std::int64_t ticks) {
    print(result);
    EXPECT_TRUE(result.guarantees.hasJoints());
    EXPECT_EQ(result.summary.ticks(), ticks);
    EXPECT_EQ(countOutside(result), 0);
    EXPECT_FALSE(result.summary.anyLimitBroken());
    EXPECT_EQ(result.summary.ticksWith(FilterStatus::Infeasible), 0);
    EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
}

void expectReached(const CaseResult& result) {
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
        EXPECT_GT(getUse(result, kind), 0.999) << static_cast<int>(kind);
}

/** The largest distance of the logged states from their limits to the outside, relative to the limit's range: a count of its
own, which knows each side. */
double getWorstExcess(const TickRecord& record, const JointLimits& limits) {
    double worst = -1.0;
    const auto add = [&](const JointVector& value, const auto& range) {
        for (int i = 0; i < value.size(); ++i) {
            const double width = range.upper[i] - range.lower[i];
            worst = std::max({worst, (value[i] - range.upper[i]) / width, (range.lower[i] - value[i]) / width});
        }
    };
    add(record.nominal.q, limits.position);
    add(record.nominal.qd, limits.velocity);
    add(record.nominal.qdd, limits.acceleration);
    add(record.nominal.jerk, limits.jerk);
    return worst;
}

TEST(PandaExperiment, KeepsTheVendorsLimitsAlsoThoseOnOneSideOfZero) {
    const ProjectExperiment experiment("panda_asymmetric_limits");
    const JointLimits& limits = experiment.experiment().cases[0].limits;
    constexpr int kElbow = 3, kWrist = 5;
    ASSERT_LT(limits.position.upper[kElbow], 0.0);
    ASSERT_GT(limits.position.upper[kWrist], 100.0 * -limits.position.lower[kWrist]);
    double excess = -1.0, highestElbow = -10.0, lowestElbow = 10.0, lowestWrist = 10.0, highestWrist = -10.0;
    std::int64_t elbowBeyond = 0, wristBeyond = 0;
    const CaseResult result = experiment.run("certified", [&](const TickRecord& record) {
        excess = std::max(excess, getWorstExcess(record, limits));
        highestElbow = std::max(highestElbow, record.nominal.q[kElbow]);
        lowestElbow = std::min(lowestElbow, record.nominal.q[kElbow]);
        highestWrist = std::max(highestWrist, record.nominal.q[kWrist]);
        lowestWrist = std::min(lowestWrist, record.nominal.q[kWrist]);
        elbowBeyond += record.command.q[kElbow] > limits.position.upper[kElbow];
        wristBeyond += record.command.q[kWrist] < limits.position.lower[kWrist];
    });
    expectKept(result, 60000);
    expectReached(result);
    std::printf(
        "  worst excess %.3g of the range; joint4 from %.6f to %.6f, joint6 from %.6f to %.6f rad; told to pass the "
        "limit near zero in %lld and %lld ticks\n",
        excess, lowestElbow, highestElbow, lowestWrist, highestWrist, static_cast<long long>(elbowBeyond),
        static_cast<long long>(wristBeyond));
    EXPECT_LE(excess, 1e-12);
    EXPECT_GT(elbowBeyond, 1000);
    EXPECT_GT(wristBeyond, 1000);
    // Led up to the side that is near zero, and not beyond; the far side is used as well.
    EXPECT_NEAR(highestElbow, limits.position.upper[kElbow], 1e-3);
    EXPECT_NEAR(lowestWrist, limits.position.lower[kWrist], 1e-3);
    EXPECT_LT(lowestElbow, -2.5);
    EXPECT_GT(highestWrist, 3.0);
}

TEST(PandaExperiment, TosbpKeepsTheJerkLimitAndAtTheCertifiedLawsGainNotTheOthers) {
    const CaseResult slow = ProjectExperiment("panda_asymmetric_limits").run("tosbp");
    const CaseResult fast =
        ProjectExperiment("panda_asymmetric_limits", {"cases.tosbp.filter.k_alpha=20",
                                                      // no motors follow it beyond its limits: to be seen to its end
                                                      "cases.tosbp.robust_loop.accept_unstable=true"})
            .run("tosbp");
    print(slow);
    print(fast);
    EXPECT_EQ(countOutside(slow), 0);
    EXPECT_GT(slow.summary.ticksWith(FilterStatus::Infeasible), 0);
    EXPECT_EQ(fast.summary.ticksOutside(LimitKind::Jerk), 0);
    EXPECT_GT(countOutside(fast), 100000);
}

void printTracking(const CaseResult& result) {
    std::printf("  %-22s real - nominal: %.4g mrad RMS, %.4g mrad at most\n", result.name.c_str(),
                1e3 * result.summary.trackingRms(), 1e3 * result.summary.trackingMax());
}

/** Whatever the real arm does the nominal one keeps its limits; with gains of its own it is held, by the paper's less, without
a robust loop least. @param most  RMS [rad] */
void expectOwnGainsHold(const CaseResult& own, const CaseResult& papers, const CaseResult& without, double most,
                        int ticks) {
    for (const CaseResult* result : {&own, &papers, &without}) {
        printTracking(*result);
        expectKept(*result, ticks);
    }
    EXPECT_TRUE(own.margins && own.margins->isEnough());
    EXPECT_LT(own.summary.trackingRms(), most);
    EXPECT_GT(papers.summary.trackingRms(), 20.0 * own.summary.trackingRms());
    EXPECT_GT(without.summary.trackingRms(), 100.0 * own.summary.trackingRms());
}

/** k_r * tick_s of the paper's is thousands of times what the wrists, which have no rotors here, allow. */
TEST(PandaExperiment, ItsGainsHaveMarginAndHoldTheRealArmAndThePapersAreRefused) {
    const char* const name = "panda_asymmetric_limits";
    const CaseResult own = ProjectExperiment(name).run("certified");
    const std::vector<std::string> indy7 = {"robust_loop.k_r=600", "robust_loop.k_p=20", "robust_loop.k_i=8"};
    test::expectError({"unstable on this arm", "k_r of joint7 is 600"},
                      [&] { ProjectExperiment(name, indy7).run("certified"); });
    const CaseResult normal =
        ProjectExperiment(name, {indy7[0], indy7[1], indy7[2], "robust_loop.accept_unstable=true"}).run("certified");
    const CaseResult without = ProjectExperiment(name).run("without_nric");
    expectOwnGainsHold(own, normal, without, 5e-3, 60000);
}

void expectEveryLimitKeptAndReached(const ProjectExperiment& experiment, int ticks) {
    double excess = -1.0;
    const CaseResult result = experiment.run("certified", [&](const TickRecord& record) {
        excess = std::max(excess, getWorstExcess(record, experiment.experiment().cases[0].limits));
    });
    expectKept(result, ticks);
    expectReached(result);
    EXPECT_LE(excess, 1e-12);
}

TEST(Ur5eExperiment, KeepsAndReachesEveryLimit) {
    expectEveryLimitKeptAndReached(ProjectExperiment("ur5e_unknown_tool"), 32000);
}

TEST(Ur5eExperiment, ItsGainsHaveMarginAndHoldTheRealArmAndThePapersDoNot) {
    const ProjectExperiment experiment("ur5e_unknown_tool");
    const CaseResult own = experiment.run("certified");
    expectOwnGainsHold(own, experiment.run("papers_gains"), experiment.run("without_nric"), 1.5e-3, 32000);
}

TEST(PlanarTwoLinkExperiment, TheFilterKeepsWhatIsPassedWithoutIt) {
    const ProjectExperiment experiment("planar_two_link");
    const CaseResult unfiltered = experiment.run("unfiltered");
    const CaseResult certified = experiment.run("certified");
    const CaseResult without = experiment.run("without_nric");
    print(unfiltered);
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk})
        EXPECT_GT(getUse(unfiltered, kind), 1.1) << static_cast<int>(kind);
    EXPECT_EQ(unfiltered.exitCode(), 0);
    expectKept(certified, 12000);
    expectReached(certified);
    expectKept(without, 12000);
    printTracking(certified);
    printTracking(without);
    EXPECT_LT(certified.summary.trackingRms(), 5e-3);
    EXPECT_GT(without.summary.trackingRms(), 100.0 * certified.summary.trackingRms());
}

/** One minute of set-points that jump many times a second, half of them beyond a limit. */
class DemandingCommands : public ::testing::TestWithParam<const char*> {};

TEST_P(DemandingCommands, CertifiedBrakingKeepsEveryLimit) {
    for (const int seed : {101, 102, 103, 104}) {
        std::printf("  seed %d\n", seed);
        const ProjectExperiment experiment(GetParam(),
                                           {"command={plugin: random_steps, seed: " + std::to_string(seed) +
                                                ", shortest_s: 0.02, longest_s: 1.5, beyond_share: 0.5, beyond_rad: 1}",
                                            "duration_s=60", "controller.stiffness=400", "controller.damping=20",
                                            "robust_loop.accept_unstable=true"});  // beyond the motors
        expectEveryLimitKeptAndReached(experiment, 60000);
    }
}

INSTANTIATE_TEST_SUITE_P(Robots, DemandingCommands, ::testing::Values("panda_asymmetric_limits", "ur5e_unknown_tool"),
                         [](const auto& robot) { return std::string(robot.param); });

}  // namespace
}  // namespace viable
