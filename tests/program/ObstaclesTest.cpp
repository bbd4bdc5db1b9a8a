#include <octomap/OcTree.h>

#include "Effort.h"
#include "Program.h"
#include "ProjectExperiment.h"
#include "environment/CollisionChecker.h"

// The experiment with obstacles, run by run, judged by somebody else: poses every tenth of a millisecond, each capsule against
// each obstacle and each cell of the octree.

namespace viable::test {
namespace {

constexpr double kTick_s = 1e-3;
constexpr int kPosesPerTick = 10;
/** Accuracy of the judge and rounding [m]. */
constexpr double kAllowed_m = 1e-8;

struct Judged {
    CaseResult result;
    std::int64_t poses, inCollision;
    double least_m;
};

Judged runAndJudge(const ProjectExperiment& experiment, const std::string& name) {
    const CasePlan* plan = nullptr;
    for (const CasePlan& each : experiment.experiment().cases)
        if (each.name == name) plan = &each;
    const CollisionChecker checker(plan->robot, *plan->geometry, *plan->environment);
    std::int64_t poses = 0, inCollision = 0;
    double least_m = kInfinity;
    CaseResult result = experiment.run(name, [&](const TickRecord& r) {
        for (int k = 0; k < kPosesPerTick; ++k) {
            const double s = kTick_s * k / kPosesPerTick;
            JointVector q = r.nominal.q;
            for (Eigen::Index i = 0; i < q.size(); ++i)
                q[i] = advance({r.nominal.q[i], r.nominal.qd[i], r.nominal.qdd[i]}, r.nominal.jerk[i], s).p;
            const double distance = checker.findContact(q, r.time_s + s, 0.05).distance;
            ++poses;
            inCollision += distance < 0.0;
            least_m = std::min(least_m, distance);
        }
    });
    return {std::move(result), poses, inCollision, least_m};
}

TEST(Obstacles, WithoutTheFilterTheArmCollidesAndWithItNever) {
    int collided = 0;
    double least = 1.0;
    const int runs = countOf(20);
    for (int seed = 1; seed <= runs; ++seed) {
        SCOPED_TRACE("command.seed=" + std::to_string(seed));
        const ProjectExperiment experiment("indy7_obstacles", {"command.seed=" + std::to_string(seed)});
        const Judged judged = runAndJudge(experiment, "whole_arm");
        EXPECT_EQ(judged.result.exitCode(), 0) << judged.result.stopMessage;
        EXPECT_EQ(judged.result.summary.ticksWith(FilterStatus::Infeasible), 0);
        EXPECT_EQ(judged.inCollision, 0);
        EXPECT_GE(judged.least_m, 0.02 - kAllowed_m);
        EXPECT_EQ(judged.result.summary.account(LimitKind::Clearance)->nominal.brokenTicks, 0);
        EXPECT_EQ(judged.result.summary.account(LimitKind::Clearance)->nominal.nearTicks, 0);
        least = std::min(least, judged.least_m);
        collided += experiment.run("joints_only").summary.account(LimitKind::Clearance)->nominal.brokenTicks > 0;
    }
    std::printf("  %d runs of 20 s: without the filter %d collided; with it the least clearance is %.2f mm\n", runs,
                collided, 1e3 * least);
    EXPECT_GT(collided, runs / 2);
    EXPECT_LT(least, 0.03) << "nothing was ever near";
}

// A wall of cells that nobody has but this test; alone, behind another filter, and with what the joints alone do.
TEST(Obstacles, AMapOfCellsIsKeptClearOfByTheFilterAloneAndInAChain) {
    const TemporaryFolder folder;
    octomap::OcTree tree(0.05);
    for (double y = -0.975; y < 1.0; y += 0.05)
        for (double z = -0.475; z < 1.5; z += 0.05) tree.updateNode(0.675, y, z, true);
    tree.prune();
    ASSERT_TRUE(tree.writeBinary((folder / "wall.bt").string()));
    const std::string environment =
        "environment={safety_distance_m: 0.02, map: {file: '" + (folder / "wall.bt").string() + "', unknown: free}}";
    const auto calcLeast = [&](const std::string& filter) {
        const ProjectExperiment experiment("indy7_obstacles",
                                           {environment, "duration_s=8", "cases={one: {filter: " + filter + "}}"});
        const Judged judged = runAndJudge(experiment, "one");
        EXPECT_EQ(judged.result.exitCode(), 0) << judged.result.stopMessage;
        return judged.least_m;
    };
    EXPECT_LT(calcLeast("{plugin: certified_braking}"), 0.0);
    const double alone = calcLeast("{plugin: whole_arm_braking}");
    EXPECT_GE(alone, 0.02 - kAllowed_m);
    EXPECT_LT(alone, 0.05);
    EXPECT_GE(calcLeast("[tosbp, {plugin: whole_arm_braking, k_alpha: 20}]"), 0.02 - kAllowed_m);
}

TEST(Obstacles, FilesAreFoundBesideTheExperimentWhereverOneStands) {
    const TemporaryFolder folder;
    octomap::OcTree tree(0.05);
    tree.updateNode(0.975, 0.025, 0.025, true);
    ASSERT_TRUE(tree.writeBinary((folder / "cell.bt").string()));
    std::ofstream(folder / "mine.yaml") << "schema: 1\ntitle: Mine\nrobot: " VIABLE_SOURCE_DIR
                                           "/robots/indy7\nduration_s: 0.01\n"
                                           "command: {plugin: generated_hand_motion}\n"
                                           "controller: {plugin: task_space_pd}\n"
                                           "environment: {map: {file: cell.bt, unknown: free}}\n"
                                           "cases: {a: {filter: {plugin: whole_arm_braking}}}\n";
    const auto inFolder = [&] {
        if (chdir(folder.path().c_str()) != 0) _exit(99);
    };
    for (const std::string& file :
         {std::string("mine.yaml"), std::string("./mine.yaml"), (folder / "mine.yaml").string()}) {
        const Outcome o = Program({"check", file}, inFolder).wait();
        EXPECT_EQ(o.code, 0) << o.err;
    }
    const Outcome o = Program({"check", "mine.yaml", "--set", "environment.map.file=cell.bt"}, inFolder).wait();
    EXPECT_EQ(o.code, 0) << o.err;
}

// A floor of a building, the arm in free space beside occupied cells, at two places of it.
TEST(Obstacles, ARealMapWithUnknownSpaceOccupiedOrFree) {
    const std::string map = VIABLE_SOURCE_DIR "/../shared/data/geb079.bt";
    if (!std::filesystem::exists(map)) GTEST_SKIP() << "no " << map << " here";
    for (const char* base : {"[-4.2, -0.88, -0.16]", "[-12, -0.68, -1.76]"})
        for (const char* unknown : {"free", "occupied"}) {
            SCOPED_TRACE(std::string(base) + " " + unknown);
            const ProjectExperiment experiment("indy7_obstacles",
                                               {"environment={safety_distance_m: 0.02, map: {file: '" + map +
                                                    "', at: {xyz: " + base + "}, unknown: " + unknown + "}}",
                                                "duration_s=10"});
            const Judged judged = runAndJudge(experiment, "whole_arm");
            EXPECT_EQ(judged.result.exitCode(), 0) << judged.result.stopMessage;
            EXPECT_EQ(judged.inCollision, 0);
            EXPECT_GE(judged.least_m, 0.02 - kAllowed_m);
            const std::int64_t collided =
                experiment.run("joints_only").summary.account(LimitKind::Clearance)->nominal.brokenTicks;
            std::printf(
                "  map at %s, unknown %s: least clearance %.1f mm; without the filter %lld ticks in collision\n", base,
                unknown, 1e3 * judged.least_m, static_cast<long long>(collided));
            EXPECT_GT(collided, 0);
        }
}

// A Panda pressed against two bars: whether joint7 alone is asked to move, or all are, it goes where it is asked to.
TEST(Obstacles, AJointThatNothingHoldsIsNotFrozenWithTheOthers) {
    for (const auto& [name, goal] : {std::pair("frozen_free", 0.0279), std::pair("frozen_pressed", 0.2279)}) {
        SCOPED_TRACE(name);
        double place = 0.0, velocity = 0.0;
        const CaseResult result =
            ProjectExperiment(std::string("../tests/program/") + name).run("c", [&](const TickRecord& record) {
                place = record.nominal.q[6];
                velocity = record.nominal.qd[6];
            });
        EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
        EXPECT_NEAR(place, goal, 1e-3);
        EXPECT_LT(std::abs(velocity), 1e-2);
    }
}

// Less torque rate than the motion takes without a limit, and much less: the arm goes where it is asked to, a little later, and
// no motor's torque changes faster. The peak without a limit is one of single ticks and moves with each choice of a jerk
// (1415 Nm/s; 1604 on a motion as long if no clearance or torque is taken over from the path of the tick before), so that the
// limit asks for something is told by a share of all ticks.
TEST(Obstacles, ATorqueRateBelowWhatTheJerkLimitsNeedDoesNotFreezeTheArm) {
    struct Run {
        double way = 0.0, fastest = 0.0;  ///< of all joints [rad], of any motor [Nm/s]
        std::vector<double> rates;        ///< of each tick, the fastest motor's
    };
    const auto run = [](const std::string& name, double rate) {
        const std::string set = "cases.rate.filter.torque_rate_Nmps=" + std::to_string(rate);
        Run done;
        JointVector q, torque;
        const CaseResult result =
            ProjectExperiment("../tests/program/torque_rate", {set}).run(name, [&](const TickRecord& record) {
                if (q.size() != 0) {
                    done.way += (record.nominal.q - q).cwiseAbs().sum();
                    done.rates.push_back((record.filterTorque - torque).cwiseAbs().maxCoeff() / kTick_s);
                    done.fastest = std::max(done.fastest, done.rates.back());
                }
                q = record.nominal.q;
                torque = record.filterTorque;
            });
        EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
        std::printf("  %s: %.1f rad of all joints, torque changes by at most %.2f Nm/s\n", name.c_str(), done.way,
                    done.fastest);
        return done;
    };
    const Run free = run("none", 1000.0);
    for (const double rate : {1000.0, 250.0}) {
        const auto beyond = std::count_if(free.rates.begin(), free.rates.end(), [&](double r) { return r > rate; });
        std::printf("  without a limit faster than %.0f Nm/s in %ld of %zu ticks\n", rate, static_cast<long>(beyond),
                    free.rates.size());
        EXPECT_GT(static_cast<double>(beyond), 0.01 * static_cast<double>(free.rates.size()))
            << "the limit asks for nothing";
        const Run kept = run("rate", rate);
        EXPECT_GT(kept.fastest, 0.99 * rate) << "the limit is not what holds the torque";
        EXPECT_LT(kept.way, free.way) << rate;
        EXPECT_LE(kept.fastest, rate * (1.0 + 1e-9));
        EXPECT_GT(kept.way, (rate < 500.0 ? 0.5 : 0.8) * free.way) << rate;
    }
}

}  // namespace
}  // namespace viable::test
