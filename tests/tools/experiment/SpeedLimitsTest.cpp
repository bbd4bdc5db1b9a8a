#include <nlohmann/json.hpp>

#include "CaseSupport.h"
#include "records/LogReader.h"

namespace viable::test {
namespace {

TEST(SpeedLimitKeys, AreReadAndStandInTheResolvedFile) {
    const Experiment e = readTestExperiment(
        kOneJoint,
        {"speed_limits={arm_mps: 0.5, regions: {table: {lower_m: [0, -1, -1], upper_m: [2, 0.5, 1], speed_mps: 0.1}}}",
         "cases.A.speed_limits.tool_mps=0.3"});
    const CasePlan& plan = e.cases.front();
    const SpeedLimits& limits = plan.robot.speedLimits;
    EXPECT_EQ(limits.arm, 0.5);
    EXPECT_EQ(limits.tool, 0.3);
    ASSERT_EQ(limits.regions.size(), 1u);
    EXPECT_EQ(limits.regions[0].name, "table");
    EXPECT_EQ(limits.regions[0].upper.y(), 0.5);
    EXPECT_EQ(limits.regions[0].speed, 0.1);
    EXPECT_FALSE(plan.environment);
    EXPECT_EQ(configureCase(plan)->setup.geometry, nullptr) << "the arm is not checked against itself";
    const std::string text = writeConfig(plan.resolved);
    const CasePlan again = readTestExperiment(text).cases.front();
    EXPECT_EQ(writeConfig(again.resolved), text);
    EXPECT_EQ(again.robot.speedLimits.regions[0].lower.y(), -1.0);
    EXPECT_FALSE(readTestExperiment(kOneJoint).cases.front().robot.speedLimits.isAny());
}

TEST(SpeedLimitKeys, WrongOnesAreRefusedWithTheirPlace) {
    const auto complain = [](const char* block) {
        return catchError([&] { readTestExperiment(kOneJoint, {std::string("speed_limits=") + block}); });
    };
    expectContains(complain("{arm: 0.5}"), {"`arm`", "arm_mps"});
    expectContains(complain("{arm_mps: 0}"), {"speed_limits.arm_mps", "0.001"});
    expectContains(complain("{regions: {a: {lower_m: [0, 0, 0], upper_m: [1, 0, 1], speed_mps: 0.1}}}"),
                   {"region `a`", "no room"});
    expectContains(complain("{regions: {a: {lower_m: [0, 0, 0], upper_m: [1, 1, 1]}}}"), {"speed_mps"});
    expectContains(complain("{regions: [1]}"), {"no regions by name"});
}

TEST(SpeedLimitKeys, ARobotHasItsOwnInLimitsYaml) {
    const TemporaryFolder folder;
    const std::filesystem::path robot = folder / "single_joint";
    std::filesystem::copy(VIABLE_SOURCE_DIR "/robots/single_joint", robot);
    std::ofstream(robot / "limits.yaml", std::ios::app) << "\nspeed_limits: {arm_mps: 0.4}\n";
    const std::string choice = "robot=" + robot.string();
    EXPECT_EQ(readTestExperiment(kOneJoint, {choice}).cases[0].robot.speedLimits.arm, 0.4);
    EXPECT_EQ(readTestExperiment(kOneJoint, {choice, "speed_limits={arm_mps: .inf}"}).cases[0].robot.speedLimits.arm,
              kInfinity);
    // What a run was of is what its resolved file says, lifted limits, too.
    for (const char* speeds : {"{arm_mps: .inf}", "{tool_mps: 0.3}", "{regions: {}}"}) {
        const CasePlan plan = readTestExperiment(kOneJoint, {choice, std::string("speed_limits=") + speeds}).cases[0];
        const SpeedLimits again = readTestExperiment(writeConfig(plan.resolved)).cases[0].robot.speedLimits;
        EXPECT_EQ(again.arm, plan.robot.speedLimits.arm) << speeds;
        EXPECT_EQ(again.tool, plan.robot.speedLimits.tool) << speeds;
    }
    // One limit does not lift another.
    EXPECT_EQ(readTestExperiment(kOneJoint, {choice, "speed_limits={tool_mps: 0.3}"}).cases[0].robot.speedLimits.arm,
              0.4);
    std::filesystem::remove(robot / "collision.yaml");
    expectError({"collision.yaml"}, [&] { readTestExperiment(kOneJoint, {choice}); });
    EXPECT_NO_THROW(readTestExperiment(kOneJoint, {choice, "speed_limits={arm_mps: .inf, tool_mps: 0.3}"}));
}

// A run: with whole_arm_braking kept, logged and told; with a law that does not know them counted.
TEST(SpeedLimitKeys, ARunJudgesThem) {
    const TemporaryFolder folder;
    const auto run = [&](const char* filter, const char* log) {
        RunOptions options;
        options.log = folder / log;
        return runFirstCase(kOneJoint, {std::string("filter=") + filter, "speed_limits={arm_mps: 0.5}"}, options);
    };
    const CaseResult kept = run("{plugin: whole_arm_braking}", "run.mcap");
    ASSERT_TRUE(kept.summary.account(LimitKind::Speed));
    EXPECT_EQ(kept.exitCode(), 0);
    EXPECT_TRUE(kept.guarantees.has(LimitKind::Speed));
    EXPECT_EQ(kept.summary.account(LimitKind::Speed)->nominal.brokenTicks, 0);
    EXPECT_LE(kept.summary.account(LimitKind::Speed)->nominal.largest, 0.5 * (1.0 + 1e-9));
    EXPECT_GT(kept.summary.account(LimitKind::Speed)->nominal.nearTicks, 500);
    expectContains(formatDetails(kept), {"speed limits kept", "and speeds of points", "point speeds", "link1"});
    LogReader reader(folder / "run.mcap");
    EXPECT_TRUE(reader.layout().limits.has(LimitKind::Speed));
    TickRecord record;
    double logged = 0.0;
    bool acts = false;
    while (reader.read(record)) {
        EXPECT_TRUE(record.reports[LimitKind::Speed].isKnown);
        EXPECT_EQ(record.reports[LimitKind::Speed].limit, 0.5);
        logged = std::max(logged, record.reports[LimitKind::Speed].value);
        acts |= record.joints[0].limit == LimitKind::Speed;
    }
    EXPECT_TRUE(acts);
    EXPECT_GT(logged, kept.summary.account(LimitKind::Speed)->nominal.largest - 1e-12);
    EXPECT_LE(logged, 0.5 * (1.0 + 1e-9));

    const CaseResult fast = run("{plugin: certified_braking}", "fast.mcap");
    ASSERT_TRUE(fast.summary.account(LimitKind::Speed));
    EXPECT_FALSE(fast.guarantees.has(LimitKind::Speed));
    EXPECT_GT(fast.summary.account(LimitKind::Speed)->nominal.brokenTicks, 500);
    EXPECT_EQ(fast.exitCode(), 0) << "nobody guaranteed it";
    expectContains(formatDetails(fast), {"no speeds of points", "points of the nominal arm were too fast: link1"});
    const nlohmann::json json = nlohmann::json::parse(writeSummaryJson({}, {}, {fast}))["cases"][0];
    EXPECT_GT(json["speeds"]["nominal"]["worst_use"], 1.5);
    EXPECT_EQ(json["speeds"]["nominal"]["part"], "link1");
    EXPECT_EQ(json["guarantees_speed"], false);
}

}  // namespace
}  // namespace viable::test
