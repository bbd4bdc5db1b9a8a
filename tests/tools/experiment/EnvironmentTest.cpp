#include <nlohmann/json.hpp>

#include "CaseSupport.h"
#include "records/LogReader.h"
#include "sweep/SweepRow.h"

namespace viable::test {
namespace {

/** What the robot single_joint swings about the z axis: a rod of this length and radius [m]. */
constexpr double kRod = 1.0, kRadius = 0.02;

/** The rod drives to where its tip would be behind the wall at y = 0.5 m; nothing holds it back. */
const std::vector<std::string> kIntoTheWall = {
    "environment={obstacles: {wall: {half_space: {normal: [0, -1, 0], offset: -0.5}}}}",
    "command.points=[[0, 0], [0.2, 0.9]]", "duration_s=1", "filter={plugin: pass_through}"};
double calcDistanceFromWall(double q) {
    return 0.5 - std::max(0.0, kRod * std::sin(q)) - kRadius;
}

std::vector<std::string> with(std::vector<std::string> overrides, const std::vector<std::string>& more) {
    overrides.insert(overrides.end(), more.begin(), more.end());
    return overrides;
}

std::vector<TickRecord> readLog(const std::filesystem::path& file) {
    LogReader reader(file);
    std::vector<TickRecord> records;
    TickRecord record;
    while (reader.read(record)) records.push_back(record);
    return records;
}

TEST(EnvironmentKeys, AreReadAndStandInTheResolvedFile) {
    const TemporaryFolder folder;
    folder.write("hall.bt", "not read here");
    const std::string file = folder.write("test.yaml", std::string(kOneJoint) + R"(environment:
  safety_distance_m: 0.05
  obstacles:
    table: {box: [1, 2, 0.04], at: {xyz: [0, pi, 0], rpy: [0, 0, pi/2]}}
    visitor: {sphere: 0.1, path: [{time_s: 0, xyz: [3, 0, 0]}, {time_s: 1, xyz: [2, 0, 0]}]}
  map: {file: hall.bt, unknown: free}
)");
    const PluginLoader loader = makeTestLoader();
    const std::vector<std::filesystem::path> robots = {VIABLE_SOURCE_DIR "/robots"};
    const CasePlan plan =
        readExperiment(file, {"environment.obstacles.table.box=[1, 2, 3]"}, loader, robots).cases.front();
    ASSERT_TRUE(plan.environment && plan.geometry);
    EXPECT_EQ(plan.environment->safetyDistance_m, 0.05);
    ASSERT_EQ(plan.environment->solids.size(), 1u);
    EXPECT_EQ(plan.environment->solids[0].size.z(), 3.0);
    EXPECT_EQ(plan.geometry->links, std::vector<std::string>{"link1"});

    const std::string text = writeConfig(plan.resolved);
    expectContains(text, {std::filesystem::canonical(folder / "hall.bt").string(), "field_cell_m: 0.02"});
    const CasePlan again = readTestExperiment(text).cases.front();  // from another folder
    EXPECT_EQ(writeConfig(again.resolved), text);
    ASSERT_TRUE(again.environment && again.environment->map);
    EXPECT_EQ(again.environment->map->unknown, UnknownSpace::Free);
    EXPECT_EQ(again.environment->spheres.at(0).waypoints.at(1).position.x(), 2.0);
    EXPECT_EQ(again.environment->solids[0].pose.translation().y(), plan.environment->solids[0].pose.translation().y());
}

TEST(EnvironmentKeys, ACaseMayHaveItsOwnAndAnEmptyOneIsOne) {
    const Experiment e =
        readTestExperiment(kOneJoint, {"cases.A.environment={safety_distance_m: 0.1}",
                                       "environment={obstacles: {ball: {sphere: 1, at: {xyz: [3, 0, 0]}}}}"});
    EXPECT_EQ(e.cases[0].environment->safetyDistance_m, 0.1);
    EXPECT_EQ(e.cases[0].environment->solids.size(), 1u);
    EXPECT_FALSE(readTestExperiment(kOneJoint).cases[0].environment);
    const CasePlan empty = readTestExperiment(kOneJoint, {"environment={}"}).cases[0];
    ASSERT_TRUE(empty.environment && empty.geometry);
    EXPECT_TRUE(empty.environment->solids.empty() && !empty.environment->map);
    expectError({"environment", "`obstacle`", "obstacles"},
                [&] { readTestExperiment(kOneJoint, {"environment={obstacle: {}}"}); });
}

TEST(EnvironmentKeys, ARobotWithoutAShapeIsRefused) {
    const TemporaryFolder folder;
    const std::filesystem::path robot = folder / "single_joint";
    std::filesystem::copy(VIABLE_SOURCE_DIR "/robots/single_joint", robot);
    std::filesystem::remove(robot / "collision.yaml");
    EXPECT_NO_THROW(readTestExperiment(kOneJoint, {"robot=" + robot.string()}));
    expectError({"single_joint", "collision.yaml"}, [&] {
        readTestExperiment(kOneJoint, {"robot=" + robot.string(), "environment={}"});
    });
}

TEST(EnvironmentKeys, PluginsAreToldOfArmAndSurroundings) {
    const Experiment none = readTestExperiment(kOneJoint);
    const auto without = configureCase(none.cases[0]);
    EXPECT_EQ(without->setup.geometry, nullptr);
    EXPECT_EQ(without->setup.surroundings, nullptr);
    const Experiment e = readTestExperiment(kOneJoint, kIntoTheWall);
    const auto configured = configureCase(e.cases[0]);
    EXPECT_EQ(configured->setup.geometry, &*e.cases[0].geometry);
    ASSERT_NE(configured->setup.surroundings, nullptr);
    const SurroundingsFeed::View view = configured->setup.surroundings->take();
    EXPECT_EQ(view.surroundings, configured->surroundings.get());
    EXPECT_NEAR(view.surroundings->calcDistance({0, 0.3, 0}, 0.0), 0.2, 1e-12);
}

TEST(Payload, IsOneThatTheModelKnows) {
    const Experiment e = readTestExperiment(kOneJoint, {"payload_kg=2", "payload_offset_m=[0.5, 0, 0]"});
    RobotModel model(e.cases[0].robot);
    Dynamics dynamics;
    model.calcDynamics(JointVector::Zero(1), JointVector::Zero(1), dynamics);
    EXPECT_NEAR(dynamics.M(0, 0), 1.0 + 2.0 * 1.5 * 1.5, 1e-12);
    const CasePlan again = readTestExperiment(writeConfig(e.cases[0].resolved)).cases.front();
    EXPECT_EQ(again.robot.joints[0].body.mass, e.cases[0].robot.joints[0].body.mass);
    EXPECT_EQ(writeConfig(again.resolved), writeConfig(e.cases[0].resolved));
}

TEST(Payload, ThePlantsOwnComesOnTop) {
    const auto calcError = [](const std::string& nominal, const std::string& plant) {
        return runFirstCase(kOneJoint, {"payload_kg=" + nominal, "robust_loop={plugin: none}",
                                        "real_plant={plugin: simbody, encoder: exact, payload_kg: " + plant + "}"})
            .summary.trackingMax();
    };
    // The same torque on an arm that is as heavy as its model says, and on one that is not.
    EXPECT_LT(calcError("2", "0"), 1e-3);
    EXPECT_GT(calcError("2", "1"), 0.05);
    EXPECT_GT(calcError("0", "2"), 0.05);
}

TEST(Payload, ChangesTheTrackingBound) {
    const auto findTorque = [](const std::string& mass) {
        const Experiment e = readTestExperiment(
            kOneJoint, {"payload_kg=" + mass, "robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8}",
                        "real_plant={plugin: simbody}", "disturbance_set={}"});
        return configureTracking(e.cases[0])->bound->lastingTorque[0];
    };
    const double light = findTorque("0"), heavy = findTorque("2");  // in one process: one is not the other's
    EXPECT_GT(heavy, 2.0 * light);
}

TEST(Payload, NonsenseIsRefused) {
    const auto errorOf = [](const std::vector<std::string>& payload) {
        return catchError([&] { readTestExperiment(kOneJoint, payload); });
    };
    expectContains(errorOf({"payload_kg=-1"}), {"payload_kg", "[0, 1000]"});
    expectContains(errorOf({"payload_kg=1", "payload_offset_m=[0, 1]"}), {"payload_offset_m", "3"});
    expectContains(errorOf({"payload_offset_m=[0, 0, 1]"}), {"payload_offset_m", "Add `payload_kg: ...` (0: none)"});
    expectContains(errorOf({"payload_mass=2"}), {"payload_mass", "Did you mean `payload_kg`"});
    expectContains(errorOf({"payload_kg=1", "payload_offset_m=[1e200, 0, 0]"}), {"payload_offset_m", "[-10, 10]"});
    expectContains(errorOf({"payload={mass_kg: 1}"}),
                   {"payload", "Did you mean `payload_kg`? A key carries its unit."});
}

TEST(Collisions, AnArmThatDrivesIntoAWallIsCounted) {
    const TemporaryFolder folder;
    const Experiment e = readTestExperiment(kOneJoint, kIntoTheWall);
    RunOptions options;
    options.log = folder / "run.mcap";
    const CaseResult result = runCase(configureCase(e.cases[0]), options);
    const std::vector<TickRecord> rows = readLog(options.log);
    ASSERT_EQ(rows.size(), 1000u);

    // The same from the log, the poses half-way by the acceleration that was held.
    std::int64_t touching = 0, near = 0;
    double least = calcDistanceFromWall(rows[0].nominal.q[0]), first = -1.0;
    const auto see = [&](double q, double t, bool& touches, bool& isNear) {
        const double distance = calcDistanceFromWall(q);
        least = std::min(least, distance);
        touches |= distance < 0.0;
        isNear |= distance < 0.02;
        if (touches && first < 0.0) first = t;
    };
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const double h = 0.001, q = rows[k].nominal.q[0], qd = rows[k].nominal.qd[0];
        const double x = rows[k].nominal.qdd[0] + h * rows[k].nominal.jerk[0];
        bool touches = false, isNear = false;
        see(q + qd * h / 2.0 + x * h * h / 8.0, rows[k].time_s + h / 2.0, touches, isNear);
        see(q + qd * h + x * h * h / 2.0, rows[k].time_s + h, touches, isNear);
        touching += touches;
        near += isNear;
    }
    ASSERT_TRUE(result.summary.account(LimitKind::Clearance));
    const ArmLimitRecord& nominal = result.summary.account(LimitKind::Clearance)->nominal;
    EXPECT_GT(touching, 300);
    EXPECT_EQ(nominal.brokenTicks, touching);
    EXPECT_EQ(nominal.nearTicks, near);
    EXPECT_GT(near, touching);
    EXPECT_NEAR(nominal.worst, least, 1e-8);
    EXPECT_EQ(nominal.depth(), -nominal.worst);
    ASSERT_TRUE(nominal.firstBroken_s);
    EXPECT_NEAR(*nominal.firstBroken_s, first, 1e-9);
    EXPECT_EQ(nominal.part, "link1");
    EXPECT_EQ(nominal.other, "wall");
    EXPECT_EQ(nominal.otherLink, "");
    EXPECT_FALSE(result.summary.account(LimitKind::Clearance)->real);

    EXPECT_EQ(result.exitCode(), 0);  // nothing was guaranteed
    expectContains(formatVerdict(result), {"; the nominal arm collided: link1 ", " mm deep in wall"});
    expectContains(formatDetails(result),
                   {"clearance     nominal: in collision in " + std::to_string(touching) + " ticks (first at "});
    expectContains(formatComparison({result}),
                   {"least clearance[mm]", "nominal / real", "clearance: smallest distance"});
    const nlohmann::json json =
        nlohmann::json::parse(writeSummaryJson(e.title, e.file, {result}))["cases"][0]["collisions"];
    EXPECT_EQ(json["nominal"]["ticks_in_collision"], touching);
    EXPECT_EQ(json["nominal"]["ticks_too_near"], near);
    EXPECT_EQ(json["nominal"]["penetration_m"], nominal.depth());
    EXPECT_EQ(json["nominal"]["obstacle"], "wall");
    EXPECT_TRUE(json["nominal"]["other_link"].is_null() && json["real"].is_null());
    EXPECT_EQ(json["safety_distance_m"], 0.02);
}

TEST(Collisions, WithoutAnEnvironmentNothingIsSaidOfThem) {
    const CaseResult result = runFirstCase(kOneJoint, {"duration_s=0.1"});
    EXPECT_FALSE(result.summary.account(LimitKind::Clearance));
    for (const std::string& text : {formatComparison({result}), formatDetails(result)})
        for (const char* word : {"clearance", "collision"}) EXPECT_EQ(text.find(word), std::string::npos) << text;
    EXPECT_TRUE(nlohmann::json::parse(writeSummaryJson({}, {}, {result}))["cases"][0]["collisions"].is_null());
}

TEST(Collisions, NothingNearIsNoCollision) {
    const CaseResult result = runFirstCase(
        kOneJoint, {"duration_s=0.1", "environment={obstacles: {ball: {sphere: 1, at: {xyz: [9, 0, 0]}}}}"});
    EXPECT_EQ(result.summary.account(LimitKind::Clearance)->nominal.worst, kInfinity);
    expectContains(formatDetails(result), {"; no collision\n", "nominal: in collision in 0 ticks, nothing within 1 m"});
    expectContains(formatComparison({result}), {"> 1000"});
}

/** The rod rests on the x axis. */
std::vector<std::string> atRest(const std::string& obstacles) {
    return {"command.points=[[0, 0]]", "environment={obstacles: " + obstacles + "}"};
}

TEST(Collisions, AMovingSphereIsJudgedWhereItIsThen) {
    const CaseResult result =
        runFirstCase(kOneJoint, atRest("{ball: {sphere: 0.1, path: [{time_s: 0, xyz: [0.5, -1, 0]}, "
                                       "{time_s: 2, xyz: [0.5, 1, 0]}]}}"));
    const ArmLimitRecord& nominal = result.summary.account(LimitKind::Clearance)->nominal;
    // At 1 m/s it touches while its centre is within 0.12 m of the rod's axis, and is near within 0.14 m.
    EXPECT_NEAR(static_cast<double>(nominal.brokenTicks), 240.0, 1.0);
    EXPECT_NEAR(static_cast<double>(nominal.nearTicks), 280.0, 1.0);
    EXPECT_NEAR(*nominal.firstBroken_s, 0.88, 0.001);
    EXPECT_NEAR(nominal.worst, -0.12, 1e-8);
    EXPECT_NEAR(nominal.worst_s, 1.0, 1e-9);
    EXPECT_EQ(nominal.other, "ball");
}

TEST(Collisions, WhatPassesBetweenTwoRowsIsSeen) {
    // 20 m/s, half-way between two rows 0.02 s apart: at the rows 0.2 m away.
    const CaseResult result = runFirstCase(
        kOneJoint, with(atRest("{ball: {sphere: 0.1, path: [{time_s: 0.4, xyz: [0.5, -0.2, 0]}, {time_s: 0.42, "
                               "xyz: [0.5, 0.2, 0]}]}}"),
                        {"tick_s=0.02", "filter={plugin: pass_through}"}));
    const ArmLimitRecord& nominal = result.summary.account(LimitKind::Clearance)->nominal;
    EXPECT_EQ(nominal.brokenTicks, 1);
    EXPECT_NEAR(*nominal.firstBroken_s, 0.41, 1e-9);
    EXPECT_NEAR(nominal.worst, -0.12, 1e-8);
}

TEST(Collisions, TheRealArmIsJudgedWhereItReallyIs) {
    // The nominal arm rests 0.1 m from the wall; the real one, which nothing holds, is pushed into it.
    const CaseResult result =
        runFirstCase(kOneJoint, {"command.points=[[0, 0]]", "duration_s=0.5", "robust_loop={plugin: none}",
                                 "environment={obstacles: {wall: {half_space: {normal: [0, -1, 0], offset: -0.12}}}}",
                                 "real_plant={plugin: simbody, push_Nm: 4, push_from_s: 0, push_until_s: 1}"});
    const LimitAccount& collisions = *result.summary.account(LimitKind::Clearance);
    EXPECT_EQ(collisions.nominal.brokenTicks, 0);
    EXPECT_NEAR(collisions.nominal.worst, 0.1, 1e-8);
    ASSERT_TRUE(collisions.real);
    EXPECT_GT(collisions.real->brokenTicks, 200);
    // q = 4 t^2 / 2, and the wall where sin(q) is 0.1.
    EXPECT_NEAR(*collisions.real->firstBroken_s, std::sqrt(std::asin(0.1) / 2.0), 0.002);
    expectContains(formatVerdict(result), {"; the real arm collided: link1 "});
    EXPECT_EQ(formatVerdict(result).find("the nominal arm collided"), std::string::npos);
    expectContains(formatDetails(result), {"real: in collision in "});

    const std::vector<SweepColumn> columns = makeSweepColumns({}, {"joint0"});
    const SweepRow row = makeSweepRow(columns, 0, "A", {}, {}, &result);
    const CaseResult bareResult = runFirstCase(kOneJoint, {"duration_s=0.1"});
    const SweepRow empty = makeSweepRow(columns, 0, "A", {}, {}, &bareResult);
    const auto find = [&](const SweepRow& of, const std::string& name) {
        for (std::size_t i = 0; i < columns.size(); ++i)
            if (columns[i].name == name) return of.values[i];
        ADD_FAILURE() << name;
        return SweepValue();
    };
    EXPECT_EQ(find(row, "collision.ticks"), SweepValue(std::int64_t{0}));
    EXPECT_EQ(find(row, "collision.least_clearance_m"), SweepValue(collisions.nominal.worst));
    EXPECT_EQ(find(row, "real.collision.ticks"), SweepValue(collisions.real->brokenTicks));
    EXPECT_EQ(find(row, "real.collision.ticks_too_near"), SweepValue(collisions.real->nearTicks));
    for (const char* name : {"collision.ticks", "real.collision.least_clearance_m"})
        EXPECT_TRUE(std::holds_alternative<std::monostate>(find(empty, name))) << name;
}

/** A filter that guarantees all limits and swings the rod a little to and fro, beside a ball. */
std::vector<std::string> swing(const std::string& ball, const std::string& clearanceTicks) {
    return {"environment={obstacles: {ball: {sphere: 0.1, at: {xyz: " + ball + "}}}}",
            "filter={plugin: guaranteeing, clearance_ticks: " + clearanceTicks + "}", "duration_s=1"};
}

TEST(Collisions, UnderAGuaranteeAndAClearanceTheyBreakTheGuarantee) {
    struct {
        const char *ball, *clearanceTicks;
        bool isBroken;
    } const runs[] = {{"[0.8, 0.13, 0]", "1000000", true},
                      {"[0.8, 0.13, 0]", "0", false},  // it keeps no clearance and guarantees none
                      {"[0.8, 0.50, 0]", "1000000", false}};
    for (const auto& run : runs) {
        SCOPED_TRACE(std::string(run.ball) + ", " + run.clearanceTicks);
        const CaseResult result = runFirstCase(kOneJoint, swing(run.ball, run.clearanceTicks));
        const bool collides = result.summary.account(LimitKind::Clearance)->nominal.brokenTicks > 0;
        EXPECT_EQ(collides, std::string(run.ball) == "[0.8, 0.13, 0]");
        EXPECT_TRUE(result.guarantees.hasJoints());
        EXPECT_EQ(result.brokenGuarantees().has(LimitKind::Clearance), run.isBroken);
        EXPECT_EQ(result.exitCode(), run.isBroken ? 3 : 0);
        EXPECT_EQ(getSweepStatus(result), run.isBroken ? SweepStatus::GuaranteeBroken : SweepStatus::Ok);
        EXPECT_EQ(formatBreach(result).empty(), !run.isBroken);
        if (!run.isBroken) continue;
        expectContains(formatBreach(result), {"the nominal arm collided: link1 ", "deep in ball"});
        expectContains(formatVerdict(result), {"guarantee broken, the arm collided; all limits kept"});
    }
}

TEST(ClearanceLog, HoldsWhatTheFilterSaysAndNothingStale) {
    const TemporaryFolder folder;
    RunOptions options;
    options.log = folder / "run.mcap";
    runFirstCase(kOneJoint,
                 with(swing("[0.8, 0.5, 0]", "300"), {"missed_ticks=[{at_s: 0.1, count: 50}]", "duration_s=0.5"}),
                 options);
    const std::vector<TickRecord> rows = readLog(options.log);
    ASSERT_EQ(rows.size(), 500u);
    for (std::size_t k = 0; k < rows.size(); ++k) {
        SCOPED_TRACE(k);
        const LimitReport& c = rows[k].reports[LimitKind::Clearance];
        // The fixture counts missed ticks, too, in which the arm follows the stop and nobody has looked.
        const bool isMissed = k >= 100 && k < 150;
        ASSERT_EQ(rows[k].missed, isMissed);
        ASSERT_EQ(c.isKnown, k < 300 && !isMissed);
        ASSERT_EQ(c.age_s, c.isKnown ? 0.125 : 0.0);
        ASSERT_EQ(c.link, c.isKnown ? 0 : -1);
        ASSERT_EQ(c.other, c.isKnown ? 0 : -1);
        ASSERT_EQ(c.otherLink, -1);
        if (!c.isKnown) continue;
        ASSERT_EQ(c.margin, 0.25);
        ASSERT_EQ(c.onArm, Eigen::Vector3d(1, 2, 3));
        ASSERT_EQ(c.onOther, Eigen::Vector3d(4, 5, 6));
    }
    const LogReader reader(options.log);
    EXPECT_EQ(reader.metadata().at("links"), R"(["link1"])");
    EXPECT_EQ(reader.metadata().at("obstacles"), R"(["ball"])");
    EXPECT_EQ(reader.metadata().count("map_sha256"), 0u);
}

TEST(ClearanceLog, IsNotThereWithoutAnEnvironment) {
    const TemporaryFolder folder;
    RunOptions options;
    options.log = folder / "run.mcap";
    runCase(configureCase(readTestExperiment(kOneJoint, {"duration_s=0.05"}).cases[0]), options);
    const LogReader reader(options.log);
    EXPECT_FALSE(reader.layout().limits.has(LimitKind::Clearance));
    EXPECT_EQ(reader.metadata().count("obstacles"), 0u);
}

TEST(StopRest, IsWhereTheArmComesToRest) {
    for (const char* filter : {"certified_braking", "pass_through"}) {
        SCOPED_TRACE(filter);
        TestLoop t(kOneJoint, {std::string("filter={plugin: ") + filter + "}"});
        t.tick(300);
        const double rest = t.record.stops[0].rest;
        EXPECT_GT(std::abs(rest - t.loop.nominal().q[0]), 1e-3);  // it moves
        t.loop.requestStop(StopReason::Requested, "test");
        runUntilStopped(t.loop, t.record, 5000, [&](const TickRecord& r) { ASSERT_NEAR(r.stops[0].rest, rest, 1e-9); });
        EXPECT_NEAR(t.loop.nominal().q[0], rest, 1e-9);
    }
}

}  // namespace
}  // namespace viable::test
