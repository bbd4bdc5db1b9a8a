#include <nlohmann/json.hpp>

#include "Program.h"
#include "ProjectExperiment.h"

// The limits of the real joint, on whole runs of the project's experiments.

namespace viable::test {
namespace {

CaseResult runReal(const std::vector<std::string>& overrides, double duration_s = 4.0) {
    std::vector<std::string> all{"duration_s=" + std::to_string(duration_s)};
    all.insert(all.end(), overrides.begin(), overrides.end());
    return ProjectExperiment("indy7_real_limits", all).run("real_joint");
}

double findShare(const CaseResult& result) {
    double share = 0.0;
    for (int i = 0; i < static_cast<int>(result.summary.jointNames().size()); ++i)
        share = std::max(share, result.summary.boundShare(LimitKind::Position, i));
    return share;
}

bool isRealOutside(const CaseResult& result) {
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity})
        for (const LimitRecord& record : result.summary.realLimit(kind))
            if (record.worstExcess > 0.0) return true;
    return false;
}

// Friction three times the figures and 7 kg unknown to the model, at the edge of the stated set, in two engines.
TEST(Fault16, BothEnginesKeepTheRealLimitsAndTheBound) {
    const ProjectExperiment experiment("indy7_two_engines", {"duration_s=5"});
    std::vector<double> shares;
    for (const CasePlan& plan : experiment.experiment().cases) {
        const CaseResult result = experiment.run(plan.name);
        EXPECT_EQ(result.exitCode(), 0) << result.stopMessage;
        EXPECT_FALSE(isRealOutside(result)) << plan.name;
        shares.push_back(findShare(result));
        EXPECT_LT(shares.back(), 1.0);
        EXPECT_GT(shares.back(), 0.2) << "the bound is of little use";
    }
    std::printf("  share of the bound: simbody %.4f, mujoco %.4f\n", shares[0], shares[1]);
    EXPECT_NEAR(shares[0], shares[1], 0.01);
}

struct Beyond {
    const char* name;
    std::vector<std::string> overrides;
};

// Outside the set: the run trips, the nominal arm is braked within its limits, and it is told what became of the real one.
TEST(Fault17, DisturbancesOutsideTheSetTripAndStopTheArm) {
    const Beyond cases[] = {
        {"friction times ten", {"real_plant.friction_scale=10"}},
        {"friction times six that breaks away at twice that",
         {"real_plant.friction_scale=6", "real_plant.breakaway_ratio=2"}},
        {"joint held", {"real_plant.blocked_joint=1", "real_plant.blocked_from_s=1", "real_plant.blocked_until_s=3"}},
        {"motors at a third", {"real_plant.torque_limit_factor=0.3"}},
    };
    for (const Beyond& beyond : cases) {
        const CaseResult result = runReal(beyond.overrides);
        EXPECT_EQ(result.stopReason, StopReason::TrackingLost) << beyond.name;
        EXPECT_EQ(result.exitCode(), 6) << beyond.name;
        EXPECT_FALSE(result.summary.anyLimitBroken()) << beyond.name;
        EXPECT_FALSE(isRealOutside(result)) << beyond.name;
        ASSERT_TRUE(result.summary.trip()) << beyond.name;
        std::printf("  %-52s tripped at %.3f s\n", beyond.name, result.stopTime_s);
    }
}

TEST(Fault22, NoiseWithinTheSetIsBorneAndWrongReadingsStopTheArm) {
    const CaseResult noisy = runReal({"disturbance_set.reading_error_rad=4e-6", "real_plant.encoder_noise_rad=1e-6"});
    EXPECT_EQ(noisy.exitCode(), 0) << noisy.stopMessage;
    EXPECT_LT(findShare(noisy), 1.0);
    for (const char* fault : {"bias", "sign", "spike", "wrap"}) {
        const CaseResult result = runReal({std::string("real_plant.sensor_fault=") + fault,
                                           "real_plant.sensor_fault_from_s=1", "real_plant.sensor_fault_rad=0.05"});
        EXPECT_EQ(result.stopReason, StopReason::SensorFailed) << fault;
        EXPECT_EQ(result.exitCode(), 6) << fault << ": beyond the bound, too";
        EXPECT_NEAR(result.stopTime_s, 1.0, 2e-3) << fault;
        EXPECT_FALSE(result.summary.anyLimitBroken()) << fault;
    }
    const CaseResult stuck = runReal({"real_plant.sensor_fault=stuck", "real_plant.sensor_fault_from_s=1"});
    // It stood still first; the robust loop, which cannot know that, pushed it on until its bound was passed, and no further.
    EXPECT_EQ(stuck.stopReason, StopReason::TrackingLost) << stuck.stopMessage;
    EXPECT_NE(stuck.stopMessage.find("the sensor is stuck or the joint blocked"), std::string::npos)
        << stuck.stopMessage;
    EXPECT_EQ(stuck.exitCode(), 3) << "the real velocity passed its limit before the error showed it";
    EXPECT_LT(stuck.summary.realLimit(LimitKind::Velocity)[0].worstExcess, 1.0) << "it was 14 rad/s";
    EXPECT_LT(stuck.stopTime_s, 1.5);
}

/** The cells of a column of a table with a line of names. */
std::vector<double> readColumn(const std::string& table, const std::string& name) {
    std::istringstream lines(table);
    std::string line, cell;
    std::getline(lines, line);
    std::istringstream names(line);
    int index = 0, wanted = -1;
    for (; std::getline(names, cell, ','); ++index)
        if (cell == name) wanted = index;
    EXPECT_GE(wanted, 0) << "no column " << name << " in " << line;
    std::vector<double> values;
    while (wanted >= 0 && std::getline(lines, line)) {
        std::istringstream cells(line);
        for (int i = 0; i <= wanted; ++i) std::getline(cells, cell, ',');
        values.push_back(std::stod(cell));
    }
    return values;
}

// A part of the ten thousand draws; the whole: viable sweep experiments/indy7_sweep.yaml --runs 10000
TEST(RealLimits, TwoHundredDrawsWithinTheSetKeepTheLimitsOfTheRealArm) {
    const TemporaryFolder folder;
    const auto out = folder.path() / "sweep";
    const Outcome outcome =
        Program({"sweep", "experiments/indy7_sweep.yaml", "--runs", "200", "--seed", "1", "--out", out.string()})
            .wait();
    ASSERT_EQ(outcome.code, 0) << outcome.out << outcome.err;
    const std::string table = readFile(out / "sweep.csv");
    const auto findLargest = [&](const char* column) {
        const std::vector<double> values = readColumn(table, column);
        EXPECT_EQ(values.size(), 200u);
        return *std::max_element(values.begin(), values.end());
    };
    const double position = findLargest("real.worst_use.position");
    const double velocity = findLargest("real.worst_use.velocity"), share = findLargest("bound.share");
    std::printf("  real arm: position %.4f, velocity %.4f of the limits; %.3f of the bound\n", position, velocity,
                share);
    EXPECT_LE(position, 1.0);
    EXPECT_LE(velocity, 1.0);
    EXPECT_LT(share, 1.0);
    EXPECT_GT(share, 0.2) << "the bound is more than five times what is seen";
    EXPECT_EQ(findLargest("motor.saturated_ticks"), 0.0);
}

// Two more arms, and friction that is known, at the edge of their sets, with commands beyond the limits; and beyond the set.
TEST(RealLimits, OtherArmsKeepThemToo) {
    const Beyond beyond[] = {{"two_link_real_limits", {"real_plant.payload_kg=1"}},
                             {"ur5e_real_limits", {"real_plant.payload_kg=2"}},
                             {"indy7_known_friction", {"duration_s=4", "real_plant.friction_scale=8"}}};
    for (const Beyond& arm : beyond) {
        const CaseResult result = ProjectExperiment(arm.name, {}).run("real_joint");
        EXPECT_EQ(result.exitCode(), 0) << arm.name << ": " << result.stopMessage;
        EXPECT_FALSE(isRealOutside(result)) << arm.name;
        std::printf("  %-24s share of the bound %.3f\n", arm.name, findShare(result));
        EXPECT_LT(findShare(result), 1.0) << arm.name;
        EXPECT_GT(findShare(result), 0.2) << arm.name << ": the bound is of little use";
        const CaseResult tripped = ProjectExperiment(arm.name, arm.overrides).run("real_joint");
        EXPECT_EQ(tripped.exitCode(), 6) << arm.name;
        EXPECT_FALSE(isRealOutside(tripped)) << arm.name;
    }
}

TEST(BoundCommand, ShowsTheBoundAndWhatItConsistsOf) {
    const Outcome told = Program({"bound", "experiments/indy7_real_limits.yaml"}).wait();
    ASSERT_EQ(told.code, 0) << told.err;
    for (const char* part : {"position [mrad]", "velocity [rad/s]", "payload", "dry friction", "the motors give",
                             "share of the position range [%]"})
        EXPECT_NE(told.out.find(part), std::string::npos) << part << "\n" << told.out;
    const Outcome json = Program({"bound", "experiments/indy7_real_limits.yaml", "--json"}).wait();
    const nlohmann::json all = nlohmann::json::parse(json.out);
    ASSERT_EQ(all.size(), 1u);
    EXPECT_EQ(all[0]["position_rad"].size(), 6u);
    double sum = 0.0;  // the parts of the larger view are no less than the bound
    for (const auto& part : all[0]["parts"]) sum += part["position_rad"][0].get<double>();
    EXPECT_GE(sum, 0.999 * all[0]["position_rad"][0].get<double>());

    const Outcome none = Program({"bound", "experiments/paper_fig5.yaml"}).wait();
    EXPECT_EQ(none.code, 2);
    EXPECT_NE(none.err.find("no case has a tracking bound"), std::string::npos) << none.err;
}

}  // namespace
}  // namespace viable::test
