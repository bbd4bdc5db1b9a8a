#include "summary/SummaryFigures.h"

#include "CaseSupport.h"
#include "tracking/ToolReference.h"

namespace viable::test {
namespace {

/** Each joint within +-1 rad, 2 rad/s, 3 rad/s^2 and 4 rad/s^3. */
JointLimits makeLimits(int n = 1) {
    const auto both = [n](double x) { return JointBounds{JointVector::Constant(n, -x), JointVector::Constant(n, x)}; };
    return {both(1.0), both(2.0), both(3.0), both(4.0)};
}

/** A run whose records are written by hand. */
struct HandMadeRun {
    CaseResult result = makeResult(*configureCase(readTestExperiment(kOneJoint).cases.front()));
    JointLimits limits = makeLimits();
    std::int64_t ticks = 0;
    JointIntervention acting{};

    void add(double q, FilterStatus status, StopVerdict verdict, double jerk = 0.0, double command = 0.0) {
        TickRecord r;
        r.time_s = 0.001 * static_cast<double>(ticks++);
        r.limits = limits;
        r.nominal = {JointVector::Constant(1, q), JointVector::Zero(1), JointVector::Zero(1),
                     JointVector::Constant(1, jerk)};
        r.command.q.setConstant(1, command);
        r.removedTorque.setZero(1);
        r.status = status;
        r.joints[0] = acting;
        r.verdict = verdict;
        r.stops[0] = {1.0 - std::abs(q), 0.0};
        result.summary.add(r);
    }
    /** A tick of a tool at `place`, turned about z, whose command waves along x, or is at `asked`, and turned, too. */
    void addTool(const Eigen::Vector3d& place, double turn = 0.0, double asked = kNan, double askedTurn = 0.0) {
        TickRecord r;
        r.time_s = 0.001 * static_cast<double>(ticks++);
        r.limits = limits;
        r.nominal = {JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1), JointVector::Zero(1)};
        r.command.space = MotionCommand::Space::Tool;
        r.command.tool.position.x() = std::isnan(asked) ? 0.1 * std::sin(r.time_s) : asked;
        r.command.tool.orientation = Eigen::AngleAxisd(askedTurn, Eigen::Vector3d::UnitZ());
        r.tool.position = place;
        r.tool.orientation = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ());
        r.removedTorque.setZero(1);
        r.joints[0] = acting;
        result.summary.add(r);
    }
    void end(double q) {
        result.summary.addEnd({JointVector::Constant(1, q), JointVector::Zero(1), JointVector::Zero(1)},
                              0.001 * static_cast<double>(ticks));
    }
    nlohmann::json json() const { return nlohmann::json::parse(writeSummaryJson({}, {}, {result}))["cases"][0]; }
};

TEST(Summary, NoKindOfLimitCanHaveANameThatStandsThereAlready) {
    const int before = countLimitKinds();
    const nlohmann::json one = HandMadeRun().json();
    for (const char* key : {"motors", "tracking", "limits", "ticks", "trip"}) EXPECT_TRUE(one.contains(key)) << key;
    std::set<std::string> keys;
    for (const auto& [key, value] : one.items()) keys.insert(key);
    for (const SummaryFigure& figure : listSummaryFigures())  // those of other cases, too
        keys.insert(figure.key.substr(0, figure.key.find('.')));
    for (const std::string& key : keys) EXPECT_THROW(addLimit(key, "", {}), Error) << key;
    EXPECT_EQ(countLimitKinds(), before);
}

TEST(Summary, AGuaranteeThatNobodyCountsIsNotJudged) {
    HandMadeRun run;
    run.add(0.0, FilterStatus::Passed, StopVerdict::Safe);
    run.result.guarantees.set(LimitKind::Speed);
    expectContains(formatVerdict(run.result), {"; speeds of points guaranteed, but not judged"});
    expectContains(formatDetails(run.result), {"not judged: the filter guarantees it, but nobody counts it"});
}

TEST(Summary, ATouchThatIsNoFaultOfTheArmIsSaidToBeNone) {
    HandMadeRun run;
    run.add(0.0, FilterStatus::Passed, StopVerdict::Safe);
    LimitAccount account;
    account.kind = LimitKind::Speed;
    account.nominal.brokenTicks = 2;
    CaseResult guilty = run.result;
    run.result.summary.addAccount(account);
    expectContains(formatVerdict(run.result), {"points of the nominal arm were too fast: ", ", no fault of the arm"});
    account.nominal.violatedTicks = 1;
    guilty.summary.addAccount(account);
    EXPECT_EQ(formatVerdict(guilty).find("no fault of the arm"), std::string::npos);
}

// On its backup stop, at rest and with a limit that acts: asked to move.
TEST(Summary, AnArmThatStandsOnItsBackupStopIsNamed) {
    HandMadeRun run;
    run.acting = {LimitKind::Clearance, LimitSide::Lower};
    const auto add = [&](int ticks, FilterStatus status) {
        for (int k = 0; k < ticks; ++k) run.add(0.1, status, StopVerdict::Safe, 0.0, 0.1);
    };
    add(1900, FilterStatus::StoppedByPlan);
    add(100, FilterStatus::Modified);
    EXPECT_EQ(run.result.summary.standstill().longest_s, 0.0) << "not for seconds";
    add(2500, FilterStatus::StoppedByPlan);
    add(10, FilterStatus::Modified);
    add(3500, FilterStatus::StoppedByPlan);
    EXPECT_NEAR(run.result.summary.standstill().longest_s, 3.5, 0.0015);
    EXPECT_NEAR(run.result.summary.standstill().begin_s, 4.51, 0.0015);
    EXPECT_NEAR(run.result.summary.standstill().total_s, 6.0, 0.003);
    expectContains(formatVerdict(run.result), {"stood on its backup stop for 3.5 s from 4.510 s on, 6.0 s in all",
                                               "what held it: clearance", "steering is local"});
    EXPECT_NEAR(run.json()["longest_standstill_s"].get<double>(), 3.5, 0.0015);

    HandMadeRun content;  // nothing acts: it does what is asked
    for (int k = 0; k < 4000; ++k) content.add(0.1, FilterStatus::StoppedByPlan, StopVerdict::Safe, 0.0, 0.1);
    EXPECT_EQ(content.result.summary.standstill().total_s, 0.0);
}

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
    expectContains(tellCase(run.result).text, {"nominal arm: all limits kept but for 4 of 10 ticks recovering"});
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

TEST(Summary, AJointThatSlidesIsInMetresAndNewtons) {
    HandMadeRun run;
    run.result.summary.setSliding({true});
    run.add(0.9, FilterStatus::Modified, StopVerdict::Safe);
    run.add(1.2, FilterStatus::Passed, StopVerdict::NoStop);
    run.end(1.3);
    const std::string text = formatDetails(run.result);
    expectContains(text, {"limits broken: position by 0.3 m (nominal", "worst excess 0.3 m\n", "worst excess 0 m/s^3\n",
                          "least margin -0.2 m (joint0", " mm RMS"});
    EXPECT_EQ(text.find(" rad"), std::string::npos) << text;
    expectContains(formatComparison({run.result}), {" mm  "});
    expectContains(formatRanking({run.result, run.result}), {"m/s^3", "[mm]"});
}

TEST(Summary, AnArmWithBothKindsOfJointsHasBothUnits) {
    const JointLimits limits = makeLimits(2);
    CaseResult result(Summary({"turns", "slides"}, limits, false));
    result.summary.setSliding({false, true});
    TickRecord r;
    r.limits = limits;
    r.nominal = {JointVector::Zero(2), JointVector::Zero(2), JointVector::Zero(2), JointVector::Zero(2)};
    r.nominal.q << 1.5, 1.25;
    r.nominal.jerk << 0.0, 6.0;
    r.command.q.setZero(2);
    r.removedTorque = JointVector::Constant(2, 7.0);
    r.joints[0] = r.joints[1] = {LimitKind::Jerk, LimitSide::Upper};
    r.status = FilterStatus::Modified;
    r.stops[0] = {-0.5, 0.0};
    r.stops[1] = {0.75, 0.0};
    result.summary.add(r);
    expectContains(formatDetails(result), {"limits broken: position by 0.5 rad and 0.25 m, jerk by 2 m/s^3 (nominal",
                                           "worst excess 0.5 rad and 0.25 m\n", "worst excess 0 rad/s^3 and 2 m/s^3\n",
                                           "torque removed max 7, RMS 7 Nm\n", "force removed max 7, RMS 7 N\n",
                                           "least margin -0.5 rad (turns", "mrad and mm RMS"});
    expectContains(formatComparison({result}), {" mrad, mm  "});
    expectContains(formatRanking({result, result}), {"SI: rad, rad/s, ..., and m, m/s, ... of joints that slide"});
}

TEST(Summary, StopsByPlanSayHowManyTicksWereMissed) {
    HandMadeRun run;
    run.add(0.1, FilterStatus::StoppedByPlan, StopVerdict::Safe);
    run.add(0.1, FilterStatus::StoppedByPlan, StopVerdict::Safe);
    expectContains(formatDetails(run.result), {"stopped_by_plan 2 (0 of them missed ticks), recovering"});
}

TEST(Summary, WhereThereIsNoLimitItSaysSo) {
    HandMadeRun run;
    run.limits = JointLimits::unlimited(1);
    run.limits.jerk = makeLimits().jerk;
    run.add(5.0, FilterStatus::Passed, StopVerdict::Safe);
    run.end(5.0);
    expectContains(formatDetails(run.result), {"position      no limit\n", "velocity      no limit\n",
                                               "acceleration  no limit\n", "jerk          worst use      0.00 %"});
    expectContains(formatComparison({run.result}), {"jerk 0.00 %"});
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
    expectContains(kAccountLegend, {"infeasible", "acted N times", "joint-s"});
    EXPECT_EQ(run.json()["infeasible_ticks"], 1);
}

TEST(Summary, TooManyMissedTicksComeWithARemedy) {
    const CaseResult result = runFirstCase(kOneJoint, {"missed_ticks=[{at_s: 0.3, count: 1001}]"});
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

/** Ten seconds of a joint and its command. */
template <class Joint, class Command>
CaseResult follow(const Joint& q, const Command& command) {
    HandMadeRun run;
    for (int k = 0; k < 10000; ++k)
        run.add(q(0.001 * k), FilterStatus::Modified, StopVerdict::Safe, 0.0, command(0.001 * k));
    run.end(q(10.0));
    return run.result;
}

TEST(Verdict, AJointThatSwingsAboutACommandAtRestIsTold) {
    const auto rest = [](double) { return 0.3; };
    const CaseResult swings = follow([](double t) { return 0.3 + 0.1 * std::cos(5.0 * t); }, rest);
    expectContains(formatVerdict(swings), {"joint0 swings about a command at rest, by 5.73 degrees to each side",
                                           "the limits keep it going", "joint_servo, which knows them"});
    EXPECT_NEAR(swings.summary.following(0).swing(), 0.1, 1e-5);
    // What dies out, even slowly, does not swing; nor does what is too small to be seen, nor a command that moves.
    for (const double damping : {0.15, 0.3, 0.7}) {
        const CaseResult decays =
            follow([&](double t) { return 0.3 + 0.5 * std::exp(-5.0 * damping * t) * std::cos(5.0 * t); }, rest);
        EXPECT_EQ(decays.summary.following(0).swing(), 0.0) << damping;
        EXPECT_TRUE(findProblems(decays).empty()) << formatVerdict(decays);
    }
    const CaseResult small = follow([](double t) { return 0.3 + 0.004 * std::cos(5.0 * t); }, rest);
    EXPECT_TRUE(findProblems(small).empty()) << formatVerdict(small);
    const auto wave = [](double t) { return 0.5 * std::cos(2.0 * t); };
    EXPECT_TRUE(findProblems(follow(wave, wave)).empty());
}

TEST(Verdict, JointCommandsThatMoveAreJudgedAsThoseOfATool) {
    const auto wave = [](double t) { return 0.5 * std::sin(t); };
    const CaseResult lags = follow([](double t) { return t < 1.0 ? 0.0 : 0.45 * std::sin(t - 1.0); }, wave);
    expectContains(formatVerdict(lags), {"joint0 misses its command: ", " degrees from it, RMS, where the command",
                                         "joint_servo, which knows the limits, comes nearer"});
    expectContains(formatDetails(lags), {"nominal joints 1", " degrees RMS, at most 2", "(joint0)"});
    const CaseResult swings = follow([](double t) { return 0.5 * std::sin(t) + 0.4 * std::sin(3.0 * t); }, wave);
    expectContains(formatVerdict(swings), {"joint0 swings about its command: "});
    EXPECT_TRUE(findProblems(follow([](double t) { return 0.5 * std::sin(t - 0.09); }, wave)).empty());
    // A command beyond the position limits counts at them.
    EXPECT_TRUE(findProblems(follow([](double) { return 1.0; }, [](double t) { return 2.0 + std::cos(t); })).empty());
    // Set-points that jump are followed by no joint at once.
    const auto steps = [](double t) { return static_cast<int>(t) % 2 ? 0.5 : -0.5; };
    const CaseResult late = follow([&](double t) { return steps(t - 0.4); }, steps);
    EXPECT_TRUE(late.summary.following(0).jumps());
    EXPECT_TRUE(findProblems(late).empty()) << formatVerdict(late);
    expectContains(tellCase(late).text,
                   {"the ways to its set-points included; whether joint0 follows cannot be told, as it had less"});
    EXPECT_EQ(tellCase(late).gravity, Gravity::Doubtful);
    // A joint that slides is told in millimetres.
    CaseResult slides = lags;
    slides.summary.setSliding({true});
    expectContains(formatVerdict(slides), {" mm from it, RMS"});
    expectContains(formatDetails(slides), {"311.5 mm RMS"});
}

// One rule for every command: what is asked for is reached, in the time that the limits need (here 2.6 s for 1 rad).
TEST(Verdict, SetPointsAreJudgedOnceThereWasTimeToBeThere) {
    const auto steps = [](double t) { return t < 5.0 ? -0.5 : 0.5; };
    const CaseResult arrives = follow([&](double t) { return steps(t - 2.5); }, steps);
    EXPECT_TRUE(findProblems(arrives).empty()) << formatVerdict(arrives);
    expectContains(tellCase(arrives).text,
                   {"the ways to its set-points included; after them joint0 was farthest from it: "
                    "< 0.001 mrad, RMS, where the command itself moves by 500 mrad"});
    const std::string late = "joint0 is not at its command in the time that its limits need: ";
    expectContains(formatVerdict(follow([&](double t) { return steps(t - 4.5); }, steps)), {late});
    expectContains(formatVerdict(follow([&](double t) { return 0.8 * steps(t - 1.0); }, steps)),
                   {late, "5.73 degrees"});
    expectContains(formatVerdict(follow([](double) { return 0.0; }, [](double) { return 0.8; })),
                   {late});  // a planned goal
    // A motion that comes to rest, with an arm that comes to rest beside it.
    const auto way = [](double t) { return t < 5.0 ? 0.16 * t : 0.8; };
    expectContains(formatVerdict(follow([&](double t) { return 0.9 * way(t); }, way)),
                   {"joint0 is not at its command"});
    EXPECT_TRUE(findProblems(follow([&](double t) { return way(t - 0.1); }, way)).empty());
}

TEST(Verdict, SamplesOfAStreamAreJudgedAsTheMotionThatTheyAre) {
    for (const double rate_Hz : {10.0, 30.0, 200.0}) {
        const auto sampled = [=](double t) { return 0.5 * std::sin(std::floor(t * rate_Hz) / rate_Hz); };
        const auto follows = [&](double lag_s) {
            return follow([=](double t) { return 0.5 * std::sin(t - lag_s); }, sampled);
        };
        EXPECT_FALSE(follows(0.1).summary.following(0).jumps()) << rate_Hz;
        EXPECT_TRUE(findProblems(follows(0.1)).empty()) << rate_Hz;
        expectContains(formatVerdict(follows(1.0)), {"joint0 misses its command: "});
    }
    // Slower ones may be set-points: one that is not followed is told, and not blamed.
    for (const double rate_Hz : {2.0, 5.0}) {
        const auto sampled = [=](double t) { return 0.5 * std::sin(std::floor(t * rate_Hz) / rate_Hz); };
        for (const double lag_s : {0.1, 1.0}) {
            const CaseResult r = follow([=](double t) { return 0.5 * std::sin(t - lag_s); }, sampled);
            EXPECT_EQ(tellCase(r).gravity, lag_s < 0.5 ? Gravity::Good : Gravity::Doubtful) << rate_Hz;
            EXPECT_TRUE(findProblems(r).empty()) << rate_Hz;
        }
    }
}

// It stops with 1 rad/s^2 first, and comes back as fast as it goes: more it cannot.
TEST(Verdict, AnArmThatMovesAwayFromANewSetPointHasTheTimeToTurnRound) {
    const double half_s = std::sqrt(0.55);
    const auto go = [=](double t) {
        const double rest = t - 2.0 - half_s;  // of the way back
        if (t < 1.0) return t - 0.9;
        if (t < 2.0 + half_s) return 0.6 - (t - 2.0) * (t - 2.0) / 2.0;
        return 0.05 + std::pow(std::max(0.0, half_s - rest), 2) / 2.0;
    };
    const CaseResult r = follow(go, [](double t) { return t < 1.0 ? 0.15 : 0.05; });
    EXPECT_TRUE(findProblems(r).empty()) << formatVerdict(r);
    EXPECT_LT(r.summary.following(0).atRest().rms(0.001), 1e-3);
}

// As fast as the limits allow: no set-point is missed, at whatever time the first one comes.
TEST(Verdict, AFirstStepIsASetPointWheneverItComes) {
    for (const double from : {0.0, 0.1})
        for (const double at_s : {0.02, 0.3, 0.7}) {
            const CaseResult r = follow([=](double t) { return t - 2.0 < at_s ? from : 0.8; },
                                        [=](double t) { return t < at_s ? 0.0 : 0.8; });
            EXPECT_EQ(tellCase(r).gravity, Gravity::Good) << at_s << ": " << formatVerdict(r);
        }
}

TEST(Verdict, ASetPointThatIsCorrectedOrTakenBackGivesTimeAndAnArmThatNeverMovesIsTold) {
    const auto steps = [](double t) { return t < 1.0 ? 0.0 : t < 4.0 ? 0.5 : t < 4.1 ? 0.45 : -0.5; };
    const CaseResult r = follow([&](double t) { return steps(t - 2.0); }, steps);
    EXPECT_EQ(tellCase(r).gravity, Gravity::Good) << formatVerdict(r);
    const CaseResult stands =
        follow([](double) { return 0.0; }, [](double t) { return std::fmod(t, 5.0) < 4.0 ? 0.0 : 0.9; });
    expectContains(tellCase(stands).text, {"whether joint0 follows cannot be told, as it hardly moved"});
    // One with a delay sets out though it is called back.
    const CaseResult late =
        follow([](double t) { return 0.15 * std::pow(std::sin(kPi * std::fmin(std::fmod(t, 4.0) / 2.2, 1.0)), 2); },
               [](double t) { return std::fmod(t, 4.0) < 0.2 ? 0.9 : 0.0; });
    EXPECT_TRUE(findProblems(late).empty()) << formatVerdict(late);
}

// Half a turn on, its quaternion has another sign: that is no motion.
TEST(Verdict, AToolThatStandsDoesNotSwingAndOneWithoutTimeIsNotJudged) {
    HandMadeRun turns, jumps;
    for (int k = 0; k < 4000; ++k) {
        turns.addTool(Eigen::Vector3d::Zero(), 0.0, 0.0, kPi * k / 1000);
        jumps.addTool(Eigen::Vector3d::Zero(), 0.0, k / 300 % 2 ? 0.2 : 0.0);
    }
    expectContains(formatVerdict(turns.result), {"the tool's orientation misses its command"});
    expectContains(tellCase(jumps.result).text, {"whether the tool follows cannot be told"});
}

/** Ten seconds of a tool that waves along x as commanded, with what else it does. */
CaseResult wave(const ToolTask& task, const Eigen::Vector3d& place, double lag_s, double turn = 0.0,
                bool stands = false) {
    HandMadeRun hand;
    hand.result.summary.setTask(task);
    for (int k = 0; k < 10000; ++k) {
        const double x = stands ? 0.0 : 0.1 * std::sin(std::max(0.0, 0.001 * k - lag_s));
        hand.addTool(place + Eigen::Vector3d(x, 0.0, 0.0), turn);
    }
    return hand.result;
}

TEST(Verdict, ARelativeCommandCountsFromWhereTheToolIs) {
    ToolTask task;
    task.isRelative = true;
    const CaseResult follows = wave(task, {0.5, 0.2, 0.0}, 0.05, 0.3);
    EXPECT_TRUE(findProblems(follows).empty()) << formatVerdict(follows);
    EXPECT_LT(follows.summary.toolErrorRms(), 0.01);
    expectContains(tellCase(follows).text, {"where the command itself moves by 66"});
    expectContains(formatVerdict(wave(task, {0.5, 0.2, 0.0}, 0.0, 0.3, true)), {"the tool misses its command: "});
    expectContains(formatVerdict(wave({}, {0.5, 0.2, 0.0}, 0.05)), {"the tool misses its command: "});
}

TEST(Verdict, AnArmWithFewJointsIsJudgedByTheDirectionsThatItHas) {
    ToolTask plane;
    plane.ways(2, 2) = 0.0;
    plane.hasTurns = false;
    const CaseResult beside = wave(plane, {0.0, 0.0, 0.3}, 0.05, 0.5);  // 0.3 m above the plane, turned
    EXPECT_TRUE(findProblems(beside).empty()) << formatVerdict(beside);
    expectContains(tellCase(beside).text, {"the arm cannot turn its tool as it likes: its place counts"});
    expectContains(formatVerdict(wave(plane, {0.0, 0.3, 0.0}, 0.05)), {"the tool misses its command: "});
    expectContains(formatVerdict(wave({}, {0.0, 0.0, 0.0}, 0.05, 0.5)), {"the tool's orientation ", "28.6 degrees"});
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/planar_two_link");
    const Eigen::Matrix3d ways = ToolFreedom(robot, robot.limits).place;
    EXPECT_NEAR(ways.trace(), 2.0, 1e-9);
    EXPECT_TRUE((ways * ways).isApprox(ways, 1e-9));
}

TEST(Verdict, AssumedLimitsAreNamedWhereItRestsOnThem) {
    const auto run = [](double factor) {  // of the robot's own jerk limit to the experiment's
        Experiment e = readTestExperiment(kOneJoint, {"duration_s=1"});
        CasePlan& plan = e.cases[0];
        plan.robot.assumed = {"jerk_radps3", "friction", "torque_limit_Nm"};
        plan.robot.limits.jerk = {factor * plan.limits.jerk.lower, factor * plan.limits.jerk.upper};
        return runCase(configureCase(plan), {});
    };
    const CaseResult own = run(1.0);
    expectContains(tellCase(own).text, {", of which those of jerk are assumed"});
    expectContains(formatVerdict(own), {"those of jerk are assumed)"});
    const CaseResult given = run(0.5);
    EXPECT_EQ(tellCase(given).text.find("those of jerk"), std::string::npos);
    EXPECT_FALSE(given.assumedLimits.has(LimitKind::Jerk));
    EXPECT_TRUE(given.assumedLimits.has(LimitKind::Torque));
}

// A tool that an obstacle holds off, sliding to and fro before it faster than its command goes: what keeps it away is told.
TEST(Verdict, AToolThatIsHeldOffByAnObstacleDoesNotSwing) {
    const auto run = [](LimitKind kind, double actsUntil_s, double sway_m = 0.1) {
        HandMadeRun hand;
        for (int k = 0; k < 10000; ++k) {
            const double t = 0.001 * k;
            hand.acting = t < actsUntil_s ? JointIntervention{kind, LimitSide::Lower} : JointIntervention{};
            hand.addTool({0.1 * std::sin(t), 0.3, sway_m * std::sin(5.0 * t)});
        }
        return formatVerdict(hand.result);
    };
    const std::string heldOff = run(LimitKind::Clearance, 10.0);
    expectContains(heldOff, {"the tool misses its command: ",
                             "held off by the safety distance to obstacles or to itself, in "
                             "100 % of that error"});
    EXPECT_EQ(heldOff.find("swings"), std::string::npos) << heldOff;
    EXPECT_EQ(heldOff.find("tool_servo"), std::string::npos) << heldOff;
    expectContains(run(LimitKind::Position, 10.0, 0.0),
                   {"the tool misses its command", "held by position limits, in 100 %"});
    // An arm that swings is at its position limits again and again, which is not why.
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Jerk, LimitKind::None})
        expectContains(run(kind, 10.0), {"the tool swings about its command", "limits, obstacles or the arm's reach"});
    expectContains(run(LimitKind::Clearance, 2.0), {"the tool swings about its command"});  // not what keeps it away
}

// The same of joints.
TEST(Verdict, AJointThatIsHeldOffByAnObstacleDoesNotSwing) {
    for (const LimitKind kind : {LimitKind::Clearance, LimitKind::Jerk}) {
        HandMadeRun run;
        for (int k = 0; k < 10000; ++k) {
            const double t = 0.001 * k;
            run.acting = {kind, LimitSide::Lower};
            run.add(0.5 * std::sin(t) + 0.4 * std::sin(3.0 * t), FilterStatus::Modified, StopVerdict::Safe, 0.0,
                    0.5 * std::sin(t));
        }
        const std::string verdict = formatVerdict(run.result);
        const bool isHeldOff = kind == LimitKind::Clearance;
        expectContains(verdict, {isHeldOff ? "joint0 misses its command: " : "joint0 swings about its command: "});
        EXPECT_EQ(verdict.find("held off by the safety distance") != std::string::npos, isHeldOff) << verdict;
    }
}

TEST(Verdict, JointsThatChatterAtALimitAreTold) {
    const auto press = [](double share) {
        HandMadeRun run;
        for (int k = 0; k < 3000; ++k)
            run.add(0.99, FilterStatus::Modified, StopVerdict::Safe, k % 2 ? 4.0 * share : -4.0 * share, 2.0);
        return formatVerdict(run.result);
    };
    expectContains(press(0.5), {"press", "chatter: RMS jerk 50 % of the jerk limit"});
    EXPECT_EQ(press(0.05).find("chatter"), std::string::npos);
}

// The same spring, with limits that keep a swing going, and a servo that knows them.
TEST(Verdict, ASpringThatTheJerkLimitKeepsSwingingIsTold) {
    const std::vector<std::string> stiff = {"controller={plugin: joint_pd, stiffness: 400, damping: 20}",
                                            "filter={plugin: certified_braking}", "duration_s=20",
                                            "limits={velocity_radps: 3, acceleration_radps2: 8, jerk_radps3: 20}",
                                            "command={plugin: waypoints, points: [[0, 1]]}"};
    expectContains(formatVerdict(runFirstCase(kOneJoint, stiff)),
                   {"all limits kept", "joint0 swings about a command at rest"});
    std::vector<std::string> servo = stiff;
    servo[0] = "controller={plugin: joint_servo}";
    const CaseResult quiet = runFirstCase(kOneJoint, servo);
    EXPECT_TRUE(findProblems(quiet).empty()) << formatVerdict(quiet);
}

TEST(Summary, OnlyCasesThatDifferInTheirFilterAloneAreRanked) {
    const Experiment e =
        readTestExperiment(kOneJoint, {"duration_s=0.1",
                                       "cases={a: {}, b: {filter: {plugin: tosbp, gamma: 50}}, "
                                       "c: {filter: {plugin: certified_braking}, controller: {plugin: joint_servo}}, "
                                       "d: {filter: {plugin: certified_braking}}}"});
    std::vector<CaseResult> results;
    for (const CasePlan& plan : e.cases) results.push_back(runCase(configureCase(plan), {}));
    const std::string text = formatRanking(results);
    expectContains(text, {"\n 1 ", "\n 2 ", "\n 3 ", "\n - c ", "(other controller)", "-: differs in more than"});
    EXPECT_EQ(text.find("\n 4 "), std::string::npos) << text;
    EXPECT_GT(text.find("\n - c "), text.find("\n 3 ")) << text;
    EXPECT_EQ(formatRanking({results[0], results[2]}), "");
}

TEST(Summary, ACaseThatStoppedEarlyIsMarkedInTheFirstTable) {
    HandMadeRun run;
    run.add(0.0, FilterStatus::Passed, StopVerdict::Safe);
    EXPECT_EQ(formatComparison({run.result}).find("STOPPED"), std::string::npos);
    run.result.stopReason = StopReason::ControllerFailed;
    run.result.stopTime_s = 0.25;
    expectContains(formatComparison({run.result}), {"STOPPED", "  0.250 s"});
}

TEST(Summary, ACaseIsOneSentenceThatBeginsWithItsWorstAndATableOfHundredColumns) {
    HandMadeRun good, bad;
    good.result.name = "good";
    bad.result.name = std::string(40, 'b');
    for (HandMadeRun* run : {&good, &bad}) run->add(run == &good ? 0.5 : 1.5, FilterStatus::Passed, StopVerdict::Safe);
    EXPECT_EQ(tellCase(good.result).text,
              "the arm was 500 mrad from its command, RMS, the ways to its set-points included; whether joint0 "
              "follows cannot be told, as it hardly moved; the nominal arm kept its joints' limits, without a "
              "guarantee.");
    EXPECT_EQ(tellCase(bad.result).gravity, Gravity::Broken);
    EXPECT_EQ(tellCase(bad.result).text.find("nominal arm: limits broken: position by 0.5 rad; the arm was"), 0u);
    bad.result.stopReason = StopReason::ControllerFailed;
    bad.result.stopMessage = "stopped at 1 s because a (b (c)) d";
    EXPECT_EQ(tellCase(bad.result).text.find("stopped at 1 s because a d; nominal arm: limits broken"), 0u);
    EXPECT_EQ(bad.json()["sentence"], tellCase(bad.result).text);
    EXPECT_EQ(bad.json()["grade"], "failed");
    EXPECT_EQ(good.json()["grade"], "doubtful");  // nothing can be told of the set-point
    std::istringstream table(formatComparison({good.result, bad.result}));
    for (std::string line; std::getline(table, line);) EXPECT_LE(line.size(), 100u) << line;
    expectContains(table.str(), {" kept", " BROKEN", "500 mrad", "position 150.00 %",
                                 std::string(12, 'b') + "~" + std::string(10, 'b')});
    good.result.others = bad.result.others = {{"command", "c"}, {"robot", "r"}};
    expectContains(formatOrder({bad.result, good.result}), {"then nearest to it): good, bbb"});
    std::swap(good.result.stopReason, bad.result.stopReason);  // whatever it kept until then
    expectContains(formatOrder({good.result, bad.result}), {"b, good"});
    bad.result.others["command"] = "another";
    EXPECT_EQ(formatOrder({bad.result, good.result}), "");
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
}  // namespace viable::test
