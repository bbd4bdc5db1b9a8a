#include <nlohmann/json.hpp>

#include "CaseSupport.h"
#include "records/LogReader.h"

namespace viable::test {
namespace {

/** Somebody who walks to the arm and stays beside it. */
constexpr char kAnn[] =
    "environment={people: {ann: {capsules: [{from_m: [0, 0, -1], to_m: [0, 0, 1], radius_m: 0.2}], latency_s: 0.02, "
    "walk: [{time_s: 0, xyz: [2, 0, 0]}, {time_s: 1, xyz: [0.6, 0, 0]}]}}}";

TEST(PeopleKeys, AreReadAndStandInTheResolvedFile) {
    const Experiment e = readTestExperiment(kOneJoint, {kAnn});
    const CasePlan& plan = e.cases.front();
    ASSERT_TRUE(plan.environment);
    ASSERT_EQ(plan.environment->people.size(), 1u);
    EXPECT_EQ(plan.environment->people[0].latency_s, 0.02);
    EXPECT_TRUE(plan.geometry);
    const std::string text = writeConfig(plan.resolved);
    EXPECT_EQ(writeConfig(readTestExperiment(text).cases.front().resolved), text);
    expectError({"environment.people.ann", "capsules"},
                [] { readTestExperiment(kOneJoint, {"environment={people: {ann: {speed: 1}}}"}); });
}

TEST(PeopleKeys, ABodyPartMayBeTouchedAtWhatTheArmsMassAllows) {
    const std::string touchable =
        std::string(kAnn).replace(std::string(kAnn).find("latency_s"), 0, "body_part: hand, ");
    const Experiment e = readTestExperiment(kOneJoint, {"filter={plugin: whole_arm_braking}", touchable});
    const CasePlan& plan = e.cases.front();
    const double expected = calcContactSpeed(BodyPart::Hand, plan.robot.movingMass());
    EXPECT_EQ(plan.environment->people[0].contactSpeed, expected);
    const CaseResult result = runCase(configureCase(plan), {});
    ASSERT_TRUE(result.summary.account(LimitKind::Separation));
    const LimitAccount& people = *result.summary.account(LimitKind::Separation);
    EXPECT_EQ(people.nominal.brokenTicks, 0);
    EXPECT_LE(people.nominal.largest, expected);
    expectContains(formatDetails(result), {"ann may be touched at up to "});
    const nlohmann::json json = nlohmann::json::parse(writeSummaryJson({}, {}, {result}))["cases"][0];
    EXPECT_EQ(json["people"]["contact_speeds_mps"]["ann"], expected);
    // Who must not be touched by what moves holds the arm up for longer.
    const CaseResult untouched = runFirstCase(kOneJoint, {"filter={plugin: whole_arm_braking}", kAnn});
    EXPECT_LT(people.resting_s, untouched.summary.account(LimitKind::Separation)->resting_s);
}

// A run: with whole_arm_braking nobody is touched too fast, and it is logged and told; with a law that knows nobody it is counted.
TEST(PeopleKeys, ARunJudgesThem) {
    const TemporaryFolder folder;
    const auto run = [&](const char* filter, const char* log) {
        RunOptions options;
        options.log = folder / log;
        return runFirstCase(kOneJoint, {std::string("filter=") + filter, kAnn}, options);
    };
    const CaseResult kept = run("{plugin: whole_arm_braking}", "run.mcap");
    ASSERT_TRUE(kept.summary.account(LimitKind::Separation));
    EXPECT_EQ(kept.exitCode(), 0) << formatDetails(kept);
    EXPECT_TRUE(kept.guarantees.has(LimitKind::Separation));
    const LimitAccount& people = *kept.summary.account(LimitKind::Separation);
    EXPECT_EQ(people.nominal.brokenTicks, 0);
    EXPECT_GT(people.nominal.worst, 0.0);
    EXPECT_GT(people.resting_s, 0.1);
    EXPECT_EQ(people.faults.appeared + people.faults.faster + people.faults.lost + people.faults.refused, 0);
    expectContains(formatDetails(kept), {"nobody touched too fast", "and separation from people", "from ann", "link1"});
    LogReader reader(folder / "run.mcap");
    EXPECT_TRUE(reader.layout().limits.has(LimitKind::Separation));
    TickRecord record;
    bool acts = false;
    while (reader.read(record)) {
        EXPECT_TRUE(record.reports[LimitKind::Separation].isKnown);
        EXPECT_TRUE(record.reports[LimitKind::Separation].isKept);
        EXPECT_GT(record.reports[LimitKind::Separation].margin, 0.0);
        acts |= record.joints[0].limit == LimitKind::Separation;
    }
    EXPECT_TRUE(acts);

    const CaseResult blind = run("{plugin: certified_braking}", "blind.mcap");
    ASSERT_TRUE(blind.summary.account(LimitKind::Separation));
    EXPECT_FALSE(blind.guarantees.has(LimitKind::Separation));
    EXPECT_GT(blind.summary.account(LimitKind::Separation)->nominal.brokenTicks, 50);
    EXPECT_EQ(blind.exitCode(), 0) << "nobody guaranteed it";
    expectContains(formatDetails(blind), {"no separation from people", "touched ann while it was too fast"});
    CaseResult first = blind, second = kept;
    first.name = "blind";
    second.name = "kept";
    expectContains(formatRanking({first, second}), {"\n 1 kept", "\n 2 blind", "(touches somebody too fast in ",
                                                    "First by ticks of the nominal arm that touch somebody too fast"});
    const nlohmann::json json = nlohmann::json::parse(writeSummaryJson({}, {}, {blind}))["cases"][0];
    EXPECT_GT(json["people"]["nominal"]["ticks_too_fast"], 50);
    EXPECT_EQ(json["people"]["nominal"]["person"], "ann");
    EXPECT_EQ(json["guarantees_separation"], false);
}

TEST(PeopleKeys, AFilterInAProcessOfItsOwnDoesNotSeeThemMove) {
    const Experiment e = readTestExperiment(kOneJoint, {"filter={plugin: whole_arm_braking}", kAnn});
    const Isolation isolation;
    expectError({"in a process of its own it does not see how the people", "Run it without --isolate"},
                [&] { configureCase(e.cases.front(), &isolation); });
    const Experiment blind = readTestExperiment(kOneJoint, {"filter={plugin: certified_braking}", kAnn});
    EXPECT_TRUE(configureCase(blind.cases.front(), &isolation)) << "it guarantees nothing of them";
}

// Faults of who is seen are braked for, counted and named.
TEST(PeopleKeys, WhoComesFromNowhereIsNamed) {
    const auto run = [](const std::string& person) {
        return runFirstCase(kOneJoint,
                            {"filter={plugin: whole_arm_braking}", "environment={people: {ann: " + person + "}}"});
    };
    const std::string body = "capsules: [{from_m: [0, 0, -1], to_m: [0, 0, 1], radius_m: 0.2}], ";
    const CaseResult fast = run("{" + body + "walk: [{time_s: 0.5, xyz: [3, 0, 0]}, {time_s: 1, xyz: [0.5, 0, 0]}]}");
    EXPECT_GT(fast.summary.account(LimitKind::Separation)->faults.faster, 0);
    EXPECT_EQ(fast.summary.account(LimitKind::Separation)->nominal.violatedTicks, 0);
    EXPECT_EQ(fast.exitCode(), 0);
    expectContains(formatDetails(fast), {"faster than stated", "last of ann"});
    const CaseResult lost = run("{" + body + "walk: [{time_s: 0, xyz: [3, 0, 0]}], unseen: [{from_s: 0.2, to_s: 9}]}");
    EXPECT_EQ(lost.summary.account(LimitKind::Separation)->faults.lost, 1);
    EXPECT_GT(lost.summary.account(LimitKind::Separation)->resting_s, 0.1) << "she may have come near since";
    const CaseResult came =
        run("{" + body + "walk: [{time_s: 0, xyz: [0.6, 0, 0]}], unseen: [{from_s: 0, to_s: 0.4}]}");
    EXPECT_EQ(came.summary.account(LimitKind::Separation)->faults.appeared, 1);
    EXPECT_EQ(came.exitCode(), 0);
}

}  // namespace
}  // namespace viable::test
