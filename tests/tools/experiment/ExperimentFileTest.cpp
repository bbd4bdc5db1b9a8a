
#include <sstream>

#include "CaseSupport.h"
#include "viable/filter/BrakingPolicyFilter.h"

namespace viable::test {
namespace {

std::string errorOf(const std::string& yaml, const std::vector<std::string>& overrides = {}) {
    return catchError([&] { readTestExperiment(yaml, overrides); });
}

TEST(ExperimentFile, AListOfFiltersIsAChainInThatOrder) {
    const Experiment e = readTestExperiment(
        kOneJoint, {"filter=[{plugin: tosbp, k_alpha: 3}, certified_braking, pass_through]", "filter[0].gamma=40"});
    const CasePlan& plan = e.cases[0];
    EXPECT_EQ(plan.filterName(), "tosbp + certified_braking + pass_through");
    ASSERT_EQ(plan.filters.size(), 3u);
    EXPECT_EQ(plan.filters[0].parameters.get<BrakingPolicyOptions>().following.gamma, 40.0);
    EXPECT_EQ(plan.filters[0].parameters.get<BrakingPolicyOptions>().kAlpha, 3.0);
    const Experiment again = readTestExperiment(writeConfig(plan.resolved));
    EXPECT_EQ(again.cases[0].filterName(), plan.filterName());
    EXPECT_EQ(again.cases[0].filters[0].parameters.get<BrakingPolicyOptions>().following.gamma, 40.0);
}

TEST(ExperimentFile, AWrongListOfFiltersIsRefused) {
    const auto errorOf = [](const std::string& filter) {
        return catchError([&] { readTestExperiment(kOneJoint, {"filter=" + filter}); });
    };
    EXPECT_CONTAINS(errorOf("[]"), "1 to 16 entries, this one has 0. Write for example");
    EXPECT_CONTAINS(errorOf("[tosbp, tosbq]"), "filter[1]: there is no filter plugin called 'tosbq'");
    EXPECT_CONTAINS(errorOf("[tosbp, {gamma: 3}]"), "filter[1]: the block must name a plugin");
    EXPECT_CONTAINS(errorOf("[tosbp, {plugin: tosbp, gama: 3}]"), "filter[1].gama");
    EXPECT_CONTAINS(errorOf("[[tosbp]]"), "filter[0]: the block must name a plugin. Write");
    EXPECT_CONTAINS(errorOf("{plugn: tosbp}"), "Did you mean `plugin` by `plugn`?");
}

TEST(ExperimentFile, ACaseOverridesTheTopAndKeepsTheRest) {
    std::string withCaseB = kTeleoperation;
    withCaseB.replace(withCaseB.find("{A: {}}"), 7, "{A: {}, B: {}}");
    const Experiment e = readTestExperiment(
        withCaseB,
        {"cases.B.filter.plugin=pass_through", "cases.B.limits.jerk_radps3=20", "cases.B.robust_loop.k_r=500"});
    ASSERT_EQ(e.cases.size(), 2u);
    EXPECT_EQ(e.cases[0].filterName(), "tosbp");
    EXPECT_EQ(e.cases[1].filterName(), "pass_through");
    EXPECT_EQ(e.cases[1].limits.jerk.upper[3], 20.0);
    EXPECT_EQ(e.cases[1].limits.velocity.upper[3], e.cases[0].limits.velocity.upper[3]);
    const auto loop = e.cases[1].robustLoop->parameters.get<NricSettings>();
    EXPECT_EQ((*loop.kr)[0], 500.0);
    EXPECT_EQ((*loop.kp)[0], 20.0);
}

TEST(ExperimentFile, TheResolvedFileReadsBackToTheSameCase) {
    for (const char* yaml : {kOneJoint, kTeleoperation}) {
        const Experiment e = readTestExperiment(yaml);
        const std::string text = writeConfig(e.cases[0].resolved);
        const Experiment again = readTestExperiment(text);
        ASSERT_EQ(again.cases.size(), 1u);
        const CasePlan &a = e.cases[0], &b = again.cases[0];
        EXPECT_EQ(writeConfig(b.resolved), text);
        EXPECT_EQ(a.limits.position.lower, b.limits.position.lower);
        EXPECT_EQ(a.limits.jerk.upper, b.limits.jerk.upper);
        EXPECT_EQ(a.start.q, b.start.q);
        EXPECT_EQ(a.tick_s, b.tick_s);
    }
}

TEST(Fault02, EveryMisspeltKeyIsRefusedWithThePlaceAndTheClosestKey) {
    expectContains(errorOf(std::string(kOneJoint) + "tick_ss: 0.1\n"), {"test.yaml:10:", "tick_ss", "tick_s"});
    expectContains(errorOf(kOneJoint, {"filter.gama=3"}), {"--set", "filter.gama", "gamma"});
    expectContains(errorOf(kTeleoperation, {"limits.q_lmi=3"}), {"limits.q_lmi"});
    expectContains(errorOf(kOneJoint, {"cases.A.fliter.plugin=tosbp"}), {"cases.A.fliter", "filter"});
    expectContains(errorOf(kOneJoint, {"filter.plugin=tosbq"}), {"tosbq", "tosbp", "filter.plugin"});
    expectContains(errorOf(kOneJoint, {"robot=indy8"}), {"indy8", "indy7"});
}

TEST(Fault02, AKeyWithoutItsUnitIsToldWhichWasMeant) {
    expectContains(errorOf(kOneJoint, {"start.velocity=1"}),
                   {"--set start.velocity:", "Did you mean `velocity_radps`"});
    expectContains(errorOf(kOneJoint, {"start.acceleration=1"}), {"`acceleration_radps2`"});
    expectContains(errorOf(kTeleoperation, {"limits.jerk=1"}), {"Did you mean `jerk_radps3`"});
    expectContains(errorOf(kOneJoint, {"start.speed=1"}), {"Known keys", "velocity_radps"});
}

TEST(ExperimentFile, WhatTheCommandLineSaysIsNotBlamedOnTheFile) {
    expectContains(errorOf(kTeleoperation, {"limits.jerk_radps3=1e9"}),
                   {"--set limits.jerk_radps3=1e9 (over ", "test.yaml:6:3: limits): "});
    expectContains(errorOf(kTeleoperation, {"cases.A.limits.jerk_radps3=1e9"}),
                   {"--set cases.A.limits.jerk_radps3=1e9 (over "});
    EXPECT_EQ(errorOf(kTeleoperation, {"filter.gamma=3", "limits.jerk_radps3=1e9"}).find("gamma"), std::string::npos);
    // The plugin's own entries are gone with the plugin that they belonged to.
    expectContains(errorOf(kTeleoperation, {"command.plugin=recorded_poses"}),
                   {"--set command.plugin=recorded_poses: `file` is missing", "--set command.file=..."});
}

TEST(ExperimentFile, WhatNoCaseWouldSeeIsRefused) {
    const char* const allOwn = R"(schema: 1
title: t
robot: single_joint
duration_s: 1
command: {plugin: waypoints, points: [[0, 1]]}
controller: {plugin: joint_pd}
cases:
  A: {filter: {plugin: tosbp}}
  B: {filter: {plugin: pass_through}}
)";
    EXPECT_EQ(readTestExperiment(allOwn).cases.size(), 2u);
    expectContains(errorOf(allOwn, {"filter.plugin=acceleration_viability"}),
                   {"--set filter", "no case uses this", "cases.A.filter"});
    EXPECT_NO_THROW(readTestExperiment(allOwn, {"filter={plugin: tosbp, gamma: 50}"}));  // case A does
    expectContains(errorOf(allOwn, {"cases.a.filter.gamma=3"}), {"no case 'a'", "Did you mean 'A'", "A, B"});
}

TEST(ExperimentFile, MissingKeysAreNamed) {
    for (const char* key : {"schema", "title", "robot", "duration_s", "command", "controller", "filter", "cases"}) {
        std::string yaml;
        std::istringstream lines(kOneJoint);
        for (std::string line; std::getline(lines, line);)
            if (line.rfind(std::string(key) + ":", 0) != 0) yaml += line + "\n";
        expectContains(errorOf(yaml), {key});
    }
}

TEST(ExperimentFile, AllThatIsWrongIsToldAtOnceAndOnce) {
    const std::string error = errorOf(R"(schema: 1
title: much is wrong
robot: single_joint
durations_s: 2
limits: {velocity_radps: [x], jerk_radps3: -1}
start: {position: 0, velocity_radps: [1, 2]}
environment: {obstacles: {a: {box: [1, 2]}, b: {spher: 1}}, people: {ann: {max_speed_mps: -1}}}
command: {plugin: waypoint}
controller: {plugin: joint_pd, stifness: 3, damping: abc}
cases:
  A: {filter: {plugin: tosbp, gamma: -3, k_alpha: x}}
  B: {filter: [{plugin: tosbq}, certified_braking, pas_through]}
  C: a
)");
    for (const char* part :
         {"test.yaml: 18 things are wrong:\n", "durations_s: the key", "limits.velocity_radps[0]:",
          "limits.jerk_radps3:", "start.position:", "start.velocity_radps:", "obstacles.a.box:", "obstacles.b.spher:",
          "people.ann.max_speed_mps:", "people.ann: the key `capsules` is missing",
          "people.ann: the key `walk` is missing", "command.plugin:", "controller.stifness:", "controller.damping:",
          "cases.A.filter.gamma:", "cases.A.filter.k_alpha:", "cases.B.filter[0].plugin:", "cases.B.filter[2]:",
          "cases.C: a case must be a map"}) {
        const std::size_t at = error.find(part);
        EXPECT_NE(at, std::string::npos) << part << " in " << error;
        EXPECT_EQ(error.find(part, at + 1), std::string::npos) << part << " twice in " << error;
    }
    EXPECT_EQ(error.find("duration_s` is missing"), std::string::npos) << error;     // durations_s explains it
    EXPECT_EQ(errorOf(kOneJoint, {"filter.gama=3"}).find('\n'), std::string::npos);  // one needs no list
}

TEST(ExperimentFile, WhatIsToldFollowsFromNothingElseThatIsWrong) {
    const auto count = [](const std::string& error) {  // of errors
        std::size_t number = 0;
        return std::sscanf(error.c_str(), "%*[^:]: %zu things", &number) == 1 ? number : 1;
    };
    // The robot's own limits do not fit such a tick: these would.
    const std::string misspelt = errorOf(kOneJoint, {"tick_s=0.1", "limts={jerk_radps3: 20, acceleration_radps2: 2}"});
    expectContains(misspelt, {"limts", "Did you mean `limits`"});
    EXPECT_EQ(count(misspelt), 1u) << misspelt;
    const std::string others =
        errorOf(kOneJoint, {"tick_s=x", "payload_kg=-1", "start.foo=1", "start.velocity=1", "filter.plugin=nix"});
    expectContains(others, {"tick_s:", "payload_kg:", "start.foo:", "start.velocity:", "`velocity_radps`", "'nix'"});
    EXPECT_EQ(count(others), 5u) << others;
    // A key that no case has is not the fault of one of them.
    std::string yaml = kOneJoint;
    yaml.replace(yaml.find("{A: {}}"), 7, "{A: {}, B: {}, C: {}}");
    yaml.erase(yaml.find("duration_s: 2\n"), 14);
    EXPECT_CONTAINS(errorOf(yaml), "test.yaml: the key `duration_s` is missing");
    EXPECT_EQ(count(errorOf(yaml)), 1u);
    // By a tick that is perhaps not what was meant, nothing is judged.
    const std::string tick = errorOf(kOneJoint, {"tik_s=0.0002", "stream={rate_hz: 4000}", "duration_s=0.0005",
                                                 "missed_ticks=[{at_s: 3, count: 1}]"});
    EXPECT_EQ(count(tick), 1u) << tick;
    expectContains(errorOf(yaml, {"cases.A.duration_s=1"}), {"cases.C: the key `duration_s` is missing"});
}

TEST(ExperimentFile, BlocksThatDoNotFitTogetherAreRefused) {
    expectContains(errorOf(kOneJoint, {"robust_loop.plugin=nric"}), {"no real_plant"});
    expectContains(errorOf(kOneJoint, {"real_plant.plugin=simbody"}), {"no robust_loop", "none"});
    expectContains(errorOf(kOneJoint, {"cases.A.title=x"}), {"title", "top of the file"});
    expectContains(errorOf(kOneJoint, {"cases.a/b.duration_s=1"}), {"a/b", "name of a case"});
    expectContains(errorOf(kOneJoint, {"schema=2"}), {"schema is 2", "reads 1"});
    const Experiment e = readTestExperiment(kOneJoint, {"controller.plugin=task_space_pd"});
    expectError({"task_space_pd", "cannot follow", "waypoints", "joint_pd"}, [&] { configureCase(e.cases[0]); });
}

TEST(Fault05, WrongSizesAreRefused) {
    expectContains(errorOf(kTeleoperation, {"limits.velocity_radps=[1, 2, 3]"}), {"limits.velocity_radps", "6"});
    expectContains(errorOf(kTeleoperation, {"controller.stiffness=[1, 2]"}), {"controller.stiffness", "6"});
    expectContains(errorOf(kOneJoint, {"start.position_rad=[0, 0]"}), {"start.position_rad"});
}

TEST(Fault06, BadLimitsAreRefusedByJointAndSide) {
    for (const char* bad : {"0", "-1", "1e12", "1e-320"})
        for (const char* key : {"velocity_radps", "acceleration_radps2", "jerk_radps3"})
            expectContains(errorOf(kOneJoint, {std::string("limits.") + key + "=" + bad}), {"limits"});
    expectContains(errorOf(kOneJoint, {"limits.position_rad={lower: 1, upper: -1}"}), {"joint"});
}

TEST(Fault07, LimitsThatDoNotFitTheTickAreRefused) {
    expectContains(errorOf(kOneJoint, {"limits.acceleration_radps2=0.01"}), {"limits"});
    expectContains(errorOf(kOneJoint, {"limits.position_rad=1e-9"}), {"limits"});
}

TEST(Fault08, TicksAndGainsOutsideTheirRangeAreRefused) {
    for (const char* bad : {"0", "-0.001", "1", ".nan"})
        expectContains(errorOf(kOneJoint, {std::string("tick_s=") + bad}), {"tick_s"});
    const auto configureError = [](const std::string& override) {
        const Experiment e = readTestExperiment(kOneJoint, {override});
        return catchError([&] { configureCase(e.cases[0]); });
    };
    expectContains(configureError("filter.k_alpha=1001"), {"k_alpha * tick_s", "(0, 1]", "--set filter.k_alpha"});
    expectContains(configureError("filter.gamma=2000"), {"gamma * tick_s", "(0, 2)"});
}

TEST(Fault11, MissingAndEscapingFilesAreRefused) {
    expectContains(errorOf(kTeleoperation, {"command={plugin: recorded_poses, file: ../nowhere.txt}"}),
                   {"command.file", "nowhere.txt"});
    expectContains(errorOf(kTeleoperation, {"command={plugin: recorded_poses, file: /}"}), {"command.file"});
    expectContains(errorOf(kOneJoint, {"robot=../../etc"}), {"robot"});
}

std::string configureErrorOf(const std::string& yaml, const std::vector<std::string>& overrides) {
    const Experiment e = readTestExperiment(yaml, overrides);
    return catchError([&] { configureCase(e.cases.front()); });
}
void configureTest(const std::string& yaml, const std::vector<std::string>& overrides) {
    configureCase(readTestExperiment(yaml, overrides).cases.front());
}

TEST(Fault12, AStartOutsideAnyLimitIsRefusedWithJointSideAndDistance) {
    expectContains(configureErrorOf(kOneJoint, {"start.position_rad=[3.2]"}),
                   {"--set start", "position of joint0", "upper limit", "by 0.05", "rad", "recovery: true"});
    expectContains(configureErrorOf(kOneJoint, {"start.position_rad=[-3.2]"}), {"lower limit"});
    expectContains(configureErrorOf(kOneJoint, {"start.velocity_radps=[7]"}),
                   {"velocity", "rad/s", "start: {velocity_radps: [...]}"});
    expectContains(configureErrorOf(kOneJoint, {"start.acceleration_radps2=[-10]"}),
                   {"acceleration", "lower", "start: {acceleration_radps2: [...]}"});
    expectContains(configureErrorOf(kTeleoperation, {"start.position_rad=[0, 0, -pi/2, 0, 0, 0]"}), {"joint4"});
    EXPECT_NO_THROW(configureTest(kOneJoint, {"start.position_rad=[pi]"}));
}

TEST(Fault12, CertifiedBrakingTellsAStartOutsideFromAStopThatWouldLeave) {
    const std::string filter = "filter={plugin: certified_braking}";
    expectContains(configureErrorOf(kOneJoint, {filter, "start.position_rad=[4]"}),
                   {"joint0 is outside its limits: position 4 rad is beyond position_upper by "
                    "0.858 rad (limit 3.14159 rad)",
                    "Change `start.position_rad`", "recovery: true"});
    expectContains(configureErrorOf(kOneJoint, {filter, "start.velocity_radps=[7]"}),
                   {"velocity 7 rad/s is beyond velocity_upper by", "`start.velocity_radps`"});
    const std::string leaves = configureErrorOf(kOneJoint, {filter, "start={position_rad: [3], velocity_radps: [2]}"});
    expectContains(leaves, {"joint0 is not viable: its stop would pass the limit position_upper", "Change `start`",
                            "recovery: true"});
    EXPECT_EQ(leaves.find("outside"), std::string::npos) << leaves;
}

TEST(Fault12, EveryPositionFaceOfEveryJointIsGuarded) {
    const Experiment e = readTestExperiment(kTeleoperation);
    const CasePlan& plan = e.cases.front();
    for (int i = 0; i < plan.robot.size(); ++i)
        for (const double side : {-1.0, 1.0}) {
            const std::string name = side > 0.0 ? "upper" : "lower";
            const double face = (side > 0.0 ? plan.limits.position.upper : plan.limits.position.lower)[i];
            CasePlan moved = plan;
            for (const double inside : {0.0, 1e-6}) {
                moved.start.q[i] = face - side * inside;
                EXPECT_NO_THROW(configureCase(moved)) << i;
            }
            moved.start.q[i] = face + side * 0.0078125;
            expectError({"position", plan.robot.joints[i].name, name + " limit", "by 0.0078"},
                        [&] { configureCase(moved); });
            moved.start.q[i] = face - side * 1e-3;  // inside, and too fast for what room is left
            moved.start.qd[i] = side * 0.3;
            expectError({"not viable", plan.robot.joints[i].name, name + " position limit by"},
                        [&] { configureCase(moved); });
            moved.start.qd[i] = -side * 0.3;
            EXPECT_NO_THROW(configureCase(moved)) << i;
        }
}

TEST(Fault12, EveryVelocityAndAccelerationFaceOfEveryJointIsGuarded) {
    CasePlan plan = readTestExperiment(kTeleoperation).cases.front();
    plan.limits.position = JointLimits::unlimited(plan.robot.size()).position;
    for (int i = 0; i < plan.robot.size(); ++i)
        for (const double side : {-1.0, 1.0}) {
            const std::string name = side > 0.0 ? "upper" : "lower";
            CasePlan moved = plan;
            moved.start.qd[i] = side * plan.limits.velocity.upper[i];
            EXPECT_NO_THROW(configureCase(moved)) << i;
            moved.start.qdd[i] = side;  // on the face, and going on
            expectError({"not viable", plan.robot.joints[i].name, name + " velocity limit by"},
                        [&] { configureCase(moved); });
            moved.start.qd[i] += side * 0.0078125;
            expectError({"start velocity of " + plan.robot.joints[i].name, name + " limit", "by 0.0078"},
                        [&] { configureCase(moved); });
            moved.start.qd[i] = 0.0;
            moved.start.qdd[i] = side * plan.limits.acceleration.upper[i];
            EXPECT_NO_THROW(configureCase(moved)) << i;
            moved.start.qdd[i] += side * 0.0078125;
            expectError({"start acceleration of " + plan.robot.joints[i].name, name + " limit", "by 0.0078"},
                        [&] { configureCase(moved); });
        }
}

TEST(Fault13, AStartWithoutAStopInsideIsRefusedByItsDistance) {
    // v > 0 and a so low that the fastest stop is of type II: every printed row of the paper holds.
    const std::string error =
        configureErrorOf(kTeleoperation, {"start.position_rad=[pi/6-1e-3, -pi/12, -pi/2, 0, -5*pi/12, 0]",
                                          "start.velocity_radps=[0.3, 0, 0, 0, 0, 0]",
                                          "start.acceleration_radps2=[-11, 0, 0, 0, 0, 0]"});
    expectContains(error, {"--set start", "joint0 is not viable", "upper position limit by 0.003", "rad",
                           "certified_braking", "recovery: true"});
    EXPECT_NO_THROW(configureTest(kTeleoperation, {"start.position_rad=[pi/6-6e-3, -pi/12, -pi/2, 0, -5*pi/12, 0]",
                                                   "start.velocity_radps=[0.3, 0, 0, 0, 0, 0]",
                                                   "start.acceleration_radps2=[-11, 0, 0, 0, 0, 0]"}));
}

TEST(Fault13, AFilterThatRecoversTakesAnyStart) {
    EXPECT_NO_THROW(
        configureTest(kOneJoint, {"filter={plugin: guaranteeing, recovers: true}", "start.position_rad=[3.2]"}));
    expectContains(configureErrorOf(kOneJoint, {"filter={plugin: guaranteeing}", "start.position_rad=[3.2]"}),
                   {"upper limit"});
}

TEST(ExperimentFile, MissedTicksAreReadStrictlyAndReadBack) {
    const Experiment e = readTestExperiment(kOneJoint, {"missed_ticks=[{at_s: 0.5, count: 20}, {at_s: 1, count: 1}]"});
    const std::vector<TickGap>& gaps = e.cases[0].missedTicks;
    ASSERT_EQ(gaps.size(), 2u);
    EXPECT_EQ(gaps[0].begin, 500);
    EXPECT_EQ(gaps[0].count, 20);
    const std::string text = writeConfig(e.cases[0].resolved);
    const Experiment again = readTestExperiment(text);
    ASSERT_EQ(again.cases[0].missedTicks.size(), 2u);
    EXPECT_EQ(again.cases[0].missedTicks[1].begin, 1000);
    EXPECT_EQ(writeConfig(again.cases[0].resolved), text);
    // Neither order nor overlap matters.
    const CaseResult merged = runCase(
        configureCase(
            readTestExperiment(kOneJoint, {"missed_ticks=[{at_s: 1, count: 30}, {at_s: 0.9, count: 110}]"}).cases[0]),
        {});
    EXPECT_EQ(merged.summary.missedTicks(), 130);
    expectContains(errorOf(kOneJoint, {"missed_ticks={at_s: 1, count: 2}"}), {"missed_ticks must be a list"});
    expectContains(errorOf(kOneJoint, {"missed_ticks=[{at_s: 1, cout: 2}]"}), {"cout", "count"});
    expectContains(errorOf(kOneJoint, {"missed_ticks=[{at_s: 1}]"}), {"count"});
    expectContains(errorOf(kOneJoint, {"missed_ticks=[{at_s: 3, count: 2}]"}), {"missed_ticks[0].at_s", "[0, 2]"});
    expectContains(errorOf(kOneJoint, {"missed_ticks=[{at_s: 1, count: 0}]"}), {"missed_ticks[0].count"});
}

}  // namespace
}  // namespace viable::test
