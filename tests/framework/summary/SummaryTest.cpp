#include "ExpectContains.h"
#include "viable/core/Numbers.h"
#include "viable/summary/Summary.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "CaseSupport.h"

namespace viable {
namespace {

using test::expectContains;
using test::kOneJoint;
using test::readTestExperiment;

/** One joint within +-1 rad, 2 rad/s, 3 rad/s^2 and 4 rad/s^3. */
JointLimits makeLimits() {
    const auto both = [](double x) { return JointBounds{JointVector::Constant(1, -x), JointVector::Constant(1, x)}; };
    return {both(1.0), both(2.0), both(3.0), both(4.0)};
}

/** A run whose records are written by hand. */
struct HandMadeRun {
    CaseResult result = makeResult(*configureCase(readTestExperiment(kOneJoint).cases.front()));
    JointLimits limits = makeLimits();
    std::int64_t ticks = 0;

    void add(double q, FilterStatus status, StopVerdict verdict, double jerk = 0.0, double command = 0.0) {
        TickRecord r;
        r.time_s = 0.001 * static_cast<double>(ticks++);
        r.limits = limits;
        r.nominal = {JointVector::Constant(1, q), JointVector::Zero(1), JointVector::Zero(1),
                     JointVector::Constant(1, jerk)};
        r.command.q.setConstant(1, command);
        r.removedTorque.setZero(1);
        r.status = status;
        r.verdict = verdict;
        r.stops[0] = {1.0 - std::abs(q), 0.0};
        result.summary.add(r);
    }
    void end(double q) {
        result.summary.addEnd({JointVector::Constant(1, q), JointVector::Zero(1), JointVector::Zero(1)},
                              0.001 * static_cast<double>(ticks));
    }
    nlohmann::json json() const { return nlohmann::json::parse(writeSummaryJson({}, {}, {result}))["cases"][0]; }
};

TEST(Summary, AnArmThatNeverComesBackHasNotKeptItsLimits) {
    HandMadeRun run;
    for (int k = 0; k < 10; ++k) run.add(1.5 + 0.1 * k, FilterStatus::Recovering, StopVerdict::Recovering);
    run.end(2.5);
    EXPECT_FALSE(run.result.summary.anyLimitBroken());
    EXPECT_TRUE(run.result.summary.endsOutside());
    expectContains(formatDetails(run.result),
                   {"not back within its limits at the end, position by 1.5 rad; 10 of 10 ticks recovering, "
                    "position by 1.5 rad",
                    "worst use    250.00 % (joint0 at 0.010 s), outside in 0 joint-ticks, worst "
                    "excess 0 rad; while recovering outside in 11, worst excess 1.5 rad",
                    "recovering 10 of 10 ticks"});
    expectContains(formatComparison({run.result}), {"100.0 %"});  // changed
    EXPECT_EQ(run.json()["limits_kept"], false);
    EXPECT_EQ(run.json()["ends_outside"], true);
}

TEST(Summary, AnArmThatComesBackHas) {
    HandMadeRun run;
    for (int k = 0; k < 10; ++k)
        run.add(k < 4 ? 1.25 : 0.5, k < 4 ? FilterStatus::Recovering : FilterStatus::Passed,
                k < 4 ? StopVerdict::Recovering : StopVerdict::Safe);
    run.end(0.5);
    EXPECT_FALSE(run.result.summary.endsOutside());
    expectContains(formatDetails(run.result),
                   {"all limits kept but for 4 of 10 ticks recovering, position by 0.25 rad (nominal"});
    expectContains(formatComparison({run.result}), {" 40.0 %"});
    EXPECT_EQ(run.json()["limits_kept"], true);
}

TEST(Summary, ALimitPassedOnTheWayOutIsBroken) {
    HandMadeRun run;
    run.add(0.9, FilterStatus::Passed, StopVerdict::Safe);
    run.add(1.2, FilterStatus::Passed, StopVerdict::NoStop);
    run.end(1.3);
    EXPECT_TRUE(run.result.summary.anyLimitBroken());
    expectContains(formatDetails(run.result), {"limits broken: position by 0.3 rad (nominal"});
    EXPECT_EQ(run.json()["limits_kept"], false);
}

TEST(Summary, WhereThereIsNoLimitItSaysSo) {
    HandMadeRun run;
    run.limits = JointLimits::unlimited(1);
    run.limits.jerk = makeLimits().jerk;
    run.add(5.0, FilterStatus::Passed, StopVerdict::Safe);
    run.end(5.0);
    expectContains(formatDetails(run.result), {"position      no limit\n", "velocity      no limit\n",
                                               "acceleration  no limit\n", "jerk          worst use      0.00 %"});
    expectContains(formatComparison({run.result}), {"no limit no limit no limit     0.00 |"});
    EXPECT_TRUE(run.json()["limits"]["position"]["joint0"]["worst_use"].is_null());
    EXPECT_EQ(run.json()["limits"]["jerk"]["joint0"]["worst_use"], 0.0);
}

TEST(Summary, ALimitOnOneSideIsALimit) {
    HandMadeRun run;
    run.limits.position.lower[0] = -kInfinity;
    run.add(0.5, FilterStatus::Passed, StopVerdict::Safe);
    EXPECT_TRUE(run.result.summary.limit(LimitKind::Position)[0].exists);
}

TEST(Summary, AMarginOfRoundingIsZero) {
    for (const double beyond : {4e-16, -4e-16, 9e-13}) {
        HandMadeRun run;
        run.add(1.0 + beyond, FilterStatus::Passed, StopVerdict::Safe);
        run.end(1.0);
        expectContains(formatDetails(run.result), {"least margin 0 rad", "worst excess 0 rad"});
    }
}

TEST(Summary, OneWordForOneThing) {
    HandMadeRun run;
    run.add(0.0, FilterStatus::Infeasible, StopVerdict::Safe);
    run.add(0.0, FilterStatus::StoppedByPlan, StopVerdict::Safe);
    for (const FilterStatus status : {FilterStatus::Infeasible, FilterStatus::StoppedByPlan})
        expectContains(formatDetails(run.result), {std::string(getName(status)) + " 1"});
    expectContains(formatComparison({run.result}), {"infeasible", "acted N times", "joint-s"});
    EXPECT_EQ(run.json()["infeasible_ticks"], 1);
}

TEST(Summary, TooManyMissedTicksComeWithARemedy) {
    const Experiment e = readTestExperiment(kOneJoint, {"missed_ticks=[{at_s: 0.3, count: 1001}]"});
    const CaseResult result = runCase(configureCase(e.cases[0]), {});
    EXPECT_EQ(result.exitCode(), 4);
    expectContains(formatDetails(result), {"more than 1000 ticks in a row were missed. Lower"});
}

TEST(Summary, TheFirstTickWithoutAChoiceIsTold) {
    HandMadeRun run;
    EXPECT_TRUE(run.json()["first_infeasible_s"].is_null());
    run.add(0.0, FilterStatus::Modified, StopVerdict::Safe);
    run.add(0.0, FilterStatus::Infeasible, StopVerdict::Safe);
    run.add(0.0, FilterStatus::Infeasible, StopVerdict::Safe);
    EXPECT_DOUBLE_EQ(run.json()["first_infeasible_s"], 0.001);
    expectContains(formatDetails(run.result), {"infeasible 2 (first at 0.001 s)"});
}

TEST(Summary, CommandErrorIsMeasuredToTheNearestPlaceWithinTheLimits) {
    HandMadeRun run;
    EXPECT_TRUE(std::isnan(run.result.summary.commandErrorRms()));
    run.add(0.5, FilterStatus::Modified, StopVerdict::Safe, 0.0, 0.1);   // 0.4 away
    run.add(0.7, FilterStatus::Modified, StopVerdict::Safe, 0.0, 50.0);  // 0.3 from the limit
    EXPECT_DOUBLE_EQ(run.result.summary.commandErrorRms(), std::sqrt((0.16 + 0.09) / 2.0));
    EXPECT_DOUBLE_EQ(run.json()["command_error_rms_rad"], std::sqrt((0.16 + 0.09) / 2.0));
}

TEST(Summary, ChatterIsTheJerkOfAJointThatItsCommandPressesAgainstALimitAtRest) {
    // 0.4 s too short; then at rest by a limit: half of the ticks with full jerk, half with none.
    HandMadeRun run;
    for (int k = 0; k < 400; ++k) run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, 4.0, 2.0);
    EXPECT_TRUE(std::isnan(run.result.summary.chatter()));
    EXPECT_TRUE(run.json()["chatter"].is_null());
    for (int k = 0; k < 100; ++k) run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, 4.0, 2.0);
    for (int k = 0; k < 900; ++k) run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, k % 2 ? 4.0 : 0.0, 2.0);
    EXPECT_TRUE(std::isnan(run.result.summary.chatter()));  // less than a second
    for (int k = 0; k < 100; ++k) run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, k % 2 ? 4.0 : 0.0, 2.0);
    EXPECT_NEAR(run.result.summary.chatter(), std::sqrt(0.5), 1e-3);
    // Another command, not pressed any more, far from the limit, or moving: nothing is added.
    for (int k = 0; k < 600; ++k) run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, 4.0, 2.0 + 0.01 * k);
    for (int k = 0; k < 600; ++k) run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, 4.0, 0.99);
    for (int k = 0; k < 600; ++k) run.add(0.8, FilterStatus::Modified, StopVerdict::Safe, 4.0, 2.0);
    for (int k = 0; k < 600; ++k) run.add(0.95 + 1e-5 * k, FilterStatus::Modified, StopVerdict::Safe, 4.0, 2.0);
    EXPECT_NEAR(run.result.summary.chatter(), std::sqrt(0.5), 1e-3);
}

TEST(Summary, TheRankingPutsTicksOutsideBeforeTicksWithoutAChoiceBeforeTheCommand) {
    std::vector<CaseResult> results;
    const auto add = [&](const char* name, double q, FilterStatus status, StopReason reason = StopReason::None) {
        HandMadeRun run;
        run.add(q, status, StopVerdict::Safe);
        run.result.name = name;
        run.result.stopReason = reason;
        results.push_back(run.result);
    };
    add("gave up", 0.0, FilterStatus::Modified, StopReason::FilterEnded);
    add("outside", 1.5, FilterStatus::Modified);
    add("empty", 0.0, FilterStatus::Infeasible);
    add("far", 0.9, FilterStatus::Modified);
    add("near", 0.1, FilterStatus::Modified);
    const std::string text = formatRanking(results);
    std::size_t last = 0;
    for (const char* line : {" 1 near", " 2 far", " 3 empty", " 4 outside", " 5 gave up"}) {
        const std::size_t place = text.find(line);
        ASSERT_NE(place, std::string::npos) << line << " is missing in:\n" << text;
        EXPECT_GT(place, last);
        last = place;
    }
    expectContains(text, {"      1      0.5 |", "       - |"});
}

}  // namespace
}  // namespace viable
