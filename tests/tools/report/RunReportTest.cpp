#include "report/RunReport.h"

#include "CaseSupport.h"
#include "ReportSupport.h"
#include "records/LogExport.h"
#include "records/LogReader.h"

namespace viable::test {
namespace {

using nlohmann::json;

/** A folder as a run leaves it. */
struct RunFolder {
    explicit RunFolder(const std::string& yaml, const std::vector<std::string>& overrides = {})
        : experiment(readTestExperiment(yaml, overrides)) {
        page = folder.write("page.html", kPage);
        std::filesystem::create_directory(path());
        for (const CasePlan& plan : experiment.cases) {
            RunOptions options;
            options.log = path() / (plan.name + ".mcap");
            results.push_back(runCase(configureCase(plan), options));
        }
        std::ofstream(path() / "summary.json") << writeSummaryJson(experiment.title, experiment.file, results);
    }
    std::filesystem::path path() const { return folder / "run"; }
    ReadReport report() const { return ReadReport(writeReport(path(), page).at(0)); }

    TemporaryFolder folder;
    Experiment experiment;
    std::filesystem::path page;
    std::vector<CaseResult> results;
};

const char* const kTwoCases = R"(schema: 1
title: "</script><script>alert(1)</script> & <!-- ]]>"
robot: single_joint
duration_s: 20
tick_s: 0.001
limits: {position_rad: pi, velocity_radps: 2*pi, acceleration_radps2: 3*pi, jerk_radps3: 4*pi}
command: {plugin: waypoints, points: [[0, 2*pi], [2, -2*pi]], interpolation: hold, repeat_s: 4}
controller: {plugin: joint_pd, stiffness: 5, damping: 1}
cases:
  free: {filter: {plugin: pass_through}}
  ends: {filter: {plugin: exponential_cbf, k_alpha: 5, gamma: 100, on_infeasible: stop}}
)";

TEST(RunReport, ShowsWhatIsInTheLogAndLosesNoPeak) {
    const RunFolder run(kTwoCases);
    const ReadReport report = run.report();
    ASSERT_EQ(report.data["cases"].size(), 2u);
    for (const json& one : report.data["cases"]) {
        std::vector<double> largest(4, -INFINITY), least(4, INFINITY);
        double lastTime = 0.0, largestMargin = -INFINITY;
        std::int64_t rows = 0, late = 0;
        LogReader reader(run.path() / (one["name"].get<std::string>() + ".mcap"));
        for (TickRecord r; reader.read(r); ++rows) {
            const double values[] = {r.nominal.q[0], r.nominal.qd[0], r.nominal.qdd[0], r.nominal.jerk[0]};
            for (std::size_t k = 0; k < 4; ++k) {
                largest[k] = std::max(largest[k], values[k]);
                least[k] = std::min(least[k], values[k]);
            }
            largestMargin = std::max(largestMargin, r.stops[0].margin);
            lastTime = r.time_s;
            late += r.compute_us >= 1e6 * one["tick_s"].get<double>();
        }
        EXPECT_EQ(one["rows"], rows);
        const std::size_t buckets = one["buckets"];
        EXPECT_LE(buckets, 4000u);
        const double step = one["step_s"];
        EXPECT_NEAR(step * static_cast<double>(buckets), lastTime, step + 1e-3);
        const json& series = one["joints"][0]["series"];
        const char* const names[] = {"nominal_q", "nominal_qd", "nominal_qdd", "nominal_jerk"};
        const bool arePairs = step > 1.5 * one["tick_s"].get<double>();
        for (std::size_t k = 0; k < 4; ++k) {
            const std::vector<float> values = report.numbers(series[names[k]]);
            ASSERT_EQ(values.size(), (arePairs ? 2 : 1) * buckets) << names[k];
            EXPECT_EQ(*std::max_element(values.begin(), values.end()), static_cast<float>(largest[k]));
            EXPECT_EQ(*std::min_element(values.begin(), values.end()), static_cast<float>(least[k]));
        }
        const std::vector<float> margin = report.numbers(series["margin"]);
        EXPECT_EQ(*std::max_element(margin.begin(), margin.end()), static_cast<float>(largestMargin));
        EXPECT_FLOAT_EQ(series["position_upper"], M_PI);
        EXPECT_FLOAT_EQ(series["jerk_lower"], -4 * M_PI);
        EXPECT_TRUE(series["real_q"].is_null());
        EXPECT_EQ(report.codes(one["joints"][0]["active"]).size(), buckets);
        EXPECT_EQ(report.codes(one["status"]).size(), buckets);
        std::int64_t counted = 0;
        for (const json& count : one["tick_time"]["counts"]) counted += count.get<std::int64_t>();
        EXPECT_EQ(counted, rows);
        EXPECT_EQ(one["tick_time"]["edges_us"].size(), one["tick_time"]["counts"].size() + 1);
        EXPECT_EQ(one["tick_time"]["late"], late);
        EXPECT_TRUE(one["jitter"]["counts"].empty());  // not in real time
    }
    EXPECT_EQ(report.data["cases"][0]["step_s"], 0.008);  // 20 s: eight ticks a bucket
    EXPECT_EQ(report.data["cases"][0]["filter"], "pass_through");
    EXPECT_TRUE(report.data["cases"][0]["stop"].is_null());
}

/** Writes a log again, with another opening and other rows, which it returns. */
template <class ChangeOpening, class ChangeRow>
std::vector<TickRecord> rewrite(const std::filesystem::path& log, ChangeOpening changeOpening, ChangeRow changeRow) {
    LogReader reader(log);
    LogOpening opening{reader.layout(), reader.metadata(), reader.attachments()};
    changeOpening(opening);
    std::vector<TickRecord> rows;
    for (TickRecord row; reader.read(row);) rows.push_back(row);
    std::filesystem::remove(log);
    LogWriter writer(log, opening);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        changeRow(rows[i], i);
        writer.append(rows[i]);
    }
    writer.finish();
    return rows;
}

TEST(RunReport, TakesOfALiveRunAreListed) {
    const RunFolder run(kTwoCases, {"duration_s=3", "cases={free: {filter: {plugin: pass_through}}}"});
    const auto rows = rewrite(
        run.path() / "free.mcap", [](LogOpening& opening) { opening.layout.isLive = true; },
        [](TickRecord& row, std::size_t i) {
            row.take = i < 10 ? 0 : i < 1000 ? 1 : i < 1500 ? 0 : i < 2000 ? 2 : 3;  // the third right after the second
        });
    ASSERT_EQ(rows.size(), 3000u);
    const ReadReport report = run.report();
    const json& takes = report.data["cases"][0]["takes"];
    const auto take = [&](int number, std::size_t from, std::size_t to) {
        return json{{"number", number}, {"from_s", rows[from].time_s}, {"to_s", rows[to].time_s}};
    };
    EXPECT_EQ(takes, (json{take(1, 10, 999), take(2, 1500, 1999), take(3, 2000, 2999)})) << takes;
}

TEST(RunReport, ATouchOfOneTickIsInPlotReplayAndTable) {
    const RunFolder run(kTwoCases);
    const json before = run.report().data;
    EXPECT_FALSE(before["cases"][0].contains("contact"));
    EXPECT_FALSE(before["cases"][0]["replay"].contains("contact"));
    EXPECT_EQ(before.dump().find("touched"), std::string::npos);

    // Of the rows in a frame of the replay the hardest is shown, wherever it is among them.
    const std::map<std::size_t, double> strikes = {{12001, 906.0}, {12006, 500.0}, {14000, 3.0}, {14005, 70.0}};
    const auto rows = rewrite(
        run.path() / "free.mcap",
        [](LogOpening& opening) {
            opening.layout.hasContact = true;
            opening.metadata["obstacles"] = R"(["table", "wall"])";
        },
        [&](TickRecord& row, std::size_t i) {
            const auto strike = strikes.find(i);
            const double force = strike != strikes.end() ? strike->second : i > 19990 ? 5.0 : 0.0;
            if (force > 0.0) row.contact = {1, {0.6 * force, 0, 0.8 * force}, force, 1e-3, {0.1, 0.2, 0.3}, 0, 1};
        });
    json summary = json::parse(readFile(run.path() / "summary.json"));
    summary["cases"][0]["contact"] = {{"ticks", 13}, {"obstacle", "wall"}, {"peak_N", 906.0}, {"last_N", 5.0}};
    std::ofstream(run.path() / "summary.json") << summary;
    const ReadReport report = run.report();
    const json &one = report.data["cases"][0], &contact = one["contact"], &table = report.data["summary"];
    EXPECT_EQ(contact["obstacles"], json({"table", "wall"}));
    EXPECT_EQ(contact["peak_N"], 906.0);
    EXPECT_EQ(contact["peak_s"], rows[12001].time_s);
    EXPECT_EQ(contact["peak_obstacle"], 1);
    EXPECT_EQ(contact["last_N"], 5.0);
    const std::vector<float> plot = report.numbers(contact["pressing"]),
                             frames = report.numbers(one["replay"]["contact"]);
    EXPECT_EQ(*std::max_element(plot.begin(), plot.end()), 906.0f);
    const std::size_t perFrame = rows.size() / one["replay"]["n"].get<std::size_t>();
    ASSERT_EQ(perFrame, 8u);
    for (const auto& [row, force] : {std::pair<std::size_t, float>{12001, 906.0f}, {14005, 70.0f}, {14010, 0.0f}}) {
        const float* frame = &frames[8 * (row / perFrame)];
        EXPECT_EQ(frame[0], force) << row;
        EXPECT_FLOAT_EQ(frame[1], 0.6f * force);
        EXPECT_FLOAT_EQ(frame[3], 0.8f * force);
        EXPECT_EQ(frame[5], force > 0.0f ? 0.2f : 0.0f);
        EXPECT_EQ(frame[7], force > 0.0f ? 1.0f : -1.0f);
    }
    EXPECT_FALSE(report.data["cases"][1].contains("contact"));
    const auto endOf = [&](std::size_t row) { return json(table["rows"][row].end() - 3, table["rows"][row].end()); };
    EXPECT_EQ(json(table["columns"].end() - 3, table["columns"].end()),
              json({"touched", "largest force", "force at the end"}));
    EXPECT_EQ(endOf(0), json({"wall", "906 N", "5 N"}));
    EXPECT_EQ(endOf(1), json({"-", "-", "-"}));
}

TEST(RunReport, TheDistanceOfTheToolFromItsCommandIsPlottedAndFirstInTheTable) {
    const RunFolder run(R"(schema: 1
title: a hand
robot: indy7
duration_s: 0.5
command: {plugin: generated_hand_motion, seed: 1}
controller: {plugin: tool_servo}
filter: {plugin: certified_braking}
robust_loop: {plugin: nric}
real_plant: {plugin: simbody}
cases: {A: {}}
)");
    const ReadReport report = run.report();
    const json &one = report.data["cases"][0], &table = report.data["summary"];
    const Summary& summary = run.results[0].summary;
    const auto largest = [&](const char* arm) {
        const std::vector<float> plot = report.numbers(one["tool"][arm]);
        return double(*std::max_element(plot.begin(), plot.end()));
    };
    EXPECT_NEAR(largest("nominal"), summary.tool().largestError(), 1e-6);
    EXPECT_NEAR(largest("real"), summary.realTool().largestError(), 1e-6);
    EXPECT_EQ(one["sentence"], tellCase(run.results[0]).text);
    EXPECT_EQ(table["columns"][2], "command error");
    EXPECT_EQ(table["columns"][3], "command error, real");
    EXPECT_NEAR(std::stod(table["rows"][0][2].get<std::string>()), 1e3 * summary.toolErrorRms(), 0.1);
    expectContains(table["rows"][0][3].get<std::string>(), {" mm, ", "\u00b0"});
}

TEST(RunReport, CollisionsAreCountedInTheTable) {
    const RunFolder run(R"(schema: 1
title: through a ball
robot: single_joint
duration_s: 1
limits: {position_rad: pi, velocity_radps: 2*pi, acceleration_radps2: 3*pi, jerk_radps3: 40*pi}
command: {plugin: waypoints, points: [[0, 1.5]], interpolation: hold}
controller: {plugin: joint_pd, stiffness: 25, damping: 8}
filter: {plugin: pass_through}
cases:
  free: {}
  hits: {environment: {obstacles: {ball: {sphere: 0.1, at: {xyz: [0.6, 0.6, 0]}}}}}
)");
    const json data = run.report().data;
    const json& table = data["summary"];
    const auto at = [&](std::size_t row, const char* column) {
        const auto found = std::find(table["columns"].begin(), table["columns"].end(), json(column));
        return table["rows"][row].at(static_cast<std::size_t>(found - table["columns"].begin()));
    };
    const ArmLimitRecord& counted = run.results[1].summary.account(LimitKind::Clearance)->nominal;
    ASSERT_GT(counted.brokenTicks, 0);
    EXPECT_EQ(at(0, "collisions"), "-");
    EXPECT_EQ(at(0, "least clearance"), "-");
    EXPECT_EQ(at(1, "collisions"), std::to_string(counted.brokenTicks));
    EXPECT_NEAR(std::stod(at(1, "least clearance").get<std::string>()), 1e3 * counted.worst,
                1e-2 * std::abs(1e3 * counted.worst));
    EXPECT_EQ(at(1, "collisions, real"), "-");
    EXPECT_EQ(data["cases"][1]["grade"], "broken");
    EXPECT_CONTAINS(table["note"].get<std::string>(), "collisions: ticks in which");
    // No filter looked at clearances: there is nothing to plot, but the ball is drawn.
    EXPECT_TRUE(data["cases"][1]["clearance"]["distance"].is_null());
    EXPECT_EQ(data["environments"][0]["obstacles"][0]["name"], "ball");
}

TEST(RunReport, TellsThatACaseWasEndedAndWhen) {
    const RunFolder run(kTwoCases);
    const json one = run.report().data["cases"][1];
    EXPECT_NEAR(one["stop"]["time_s"], 0.671, 1e-9);
    EXPECT_CONTAINS(one["stop"]["message"].get<std::string>(), "no admissible choice");
    EXPECT_CONTAINS(one["verdict"].get<std::string>(), "limits broken: position");
    EXPECT_CONTAINS(one["details"].get<std::string>(), "infeasible 1 (first at 0.670 s)");
}

TEST(RunReport, AHostileTitleStaysText) {
    const RunFolder run(kTwoCases);
    const ReadReport report = run.report();
    EXPECT_EQ(report.data["title"], "</script><script>alert(1)</script> & <!-- ]]>");
    // Nothing in the data can end the script element that holds it.
    EXPECT_EQ(cutOut(report.text, "<data>", "</data>").find('<'), std::string::npos);
    EXPECT_CONTAINS(report.data["yaml"].get<std::string>(), "<script>alert");
}

TEST(RunReport, TheRealArmIsThereWithItsDerivatives) {
    const RunFolder run(kTeleoperation);
    const ReadReport report = run.report();
    const json& one = report.data["cases"][0];
    EXPECT_EQ(one["robust_loop"], "nric");
    EXPECT_EQ(one["plant"], "simbody");
    EXPECT_EQ(report.data["robot"]["name"], "indy7");
    ASSERT_EQ(one["joints"].size(), 6u);
    std::vector<TickRecord> rows;
    LogReader reader(run.path() / "A.mcap");
    for (TickRecord r; reader.read(r);) rows.push_back(r);
    ASSERT_EQ(rows.size(), 2000u);
    for (std::size_t i = 0; i < 6; ++i) {
        const json& series = one["joints"][i]["series"];
        const auto q = report.numbers(series["real_q"]);
        const auto qdd = report.numbers(series["real_qdd"]);
        const auto jerk = report.numbers(series["real_jerk"]);
        ASSERT_EQ(q.size(), rows.size());
        EXPECT_TRUE(std::isnan(qdd[0]) && std::isnan(jerk[0]) && std::isnan(jerk[1]));
        const auto v = [&](std::size_t k) { return rows[k].real.qd[static_cast<int>(i)]; };
        for (std::size_t k = 2; k < rows.size(); ++k) {
            EXPECT_EQ(q[k], static_cast<float>(rows[k].real.q[static_cast<int>(i)]));
            const double a = (v(k) - v(k - 1)) / 1e-3;
            EXPECT_NEAR(qdd[k], a, 1e-5 * std::abs(a) + 1e-9);
            const double j = (v(k) - 2 * v(k - 1) + v(k - 2)) / 1e-6;
            EXPECT_NEAR(jerk[k], j, 1e-5 * std::abs(j) + 1e-4);
        }
    }
    const auto poses = report.numbers(one["replay"]["real"]);
    EXPECT_EQ(poses.size(), 6 * one["replay"]["n"].get<std::size_t>());
    EXPECT_EQ(poses[5], static_cast<float>(rows[0].real.q[5]));
}

/** A log of one joint with this metadata: nominal at rest, the true joint at 0.01 rad, 0.02 rad/s, read elsewhere. */
json reportOf(const std::map<std::string, std::string>& metadata) {
    const TemporaryFolder folder;
    LogOpening opening;
    opening.layout.jointNames = {"joint"};
    opening.layout.hasRealPlant = true;
    opening.metadata = metadata;
    LogWriter log(folder / "A.mcap", opening);
    TickRecord row;
    row.nominal.q = row.nominal.qd = JointVector::Zero(1);
    row.actual.q = JointVector::Constant(1, 0.01);
    row.actual.qd = JointVector::Constant(1, 0.02);
    row.real.q = row.real.qd = JointVector::Constant(1, 0.5);
    for (int i = 0; i < 10; ++i) {
        row.time_s = 1e-3 * i;
        log.append(row);
    }
    log.finish();
    const ReadReport report(writeReport(folder.path(), folder.write("page.html", kPage)).at(0));
    json series = report.data["cases"][0]["joints"][0]["series"];
    for (const char* name : {"error", "error_true", "error_velocity"})
        if (series[name].is_object()) series[name] = report.numbers(series[name]);
    return series;
}

TEST(RunReport, TheRealJointsLimitsAndTheBoundAreShownWhereTheLogHasThem) {
    const json series =
        reportOf({{"real_limits", R"({"position_lower": [-1.5], "position_upper": [1.25], "velocity_lower": ["-.inf"],
                             "velocity_upper": [".inf"]})"},
                  {"tracking_bound", R"({"position_rad": [0.03], "velocity_radps": [0.4], "measured_rad": [0.04]})"}});
    EXPECT_EQ(series["real_position_lower"], -1.5);
    EXPECT_EQ(series["real_position_upper"], 1.25);
    EXPECT_FALSE(series.contains("real_velocity_lower"));  // endless: there is no limit to draw
    EXPECT_FALSE(series.contains("real_velocity_upper"));
    EXPECT_EQ(series["bound_position"], 0.03);
    EXPECT_EQ(series["bound_velocity"], 0.4);
    EXPECT_EQ(series["bound_measured"], 0.04);
    ASSERT_EQ(series["error_velocity"].size(), 10u);
    EXPECT_FLOAT_EQ(series["error_true"].at(9), 0.01f);  // the bound is one of the true arm
    EXPECT_FLOAT_EQ(series["error"].at(9), 0.5f);
    EXPECT_FLOAT_EQ(series["error_velocity"][9], 0.02f);

    const json plain = reportOf({});
    for (const char* name : {"real_position_lower", "bound_position", "bound_velocity", "tau_external"})
        EXPECT_FALSE(plain.contains(name)) << name;
    EXPECT_TRUE(plain["error_velocity"].is_null());
    EXPECT_TRUE(plain["error_true"].is_null());
}

TEST(RunReport, TheArmIsDrawnFromTheRobotsFolder) {
    const RunFolder run(kTeleoperation);
    const json scene = run.report().data["scene"];
    ASSERT_TRUE(scene.is_object());
    int moving = 0, capsules = 0;
    for (const json& link : scene["links"]) {
        moving += link["joint"].get<int>() >= 0;
        EXPECT_LT(link["parent"].get<int>(), static_cast<int>(scene["links"].size()));
        for (const json& shape : link["shapes"]) capsules += shape["type"] == "capsule";
    }
    EXPECT_EQ(moving, 6);
    EXPECT_EQ(capsules, 9);
}

TEST(RunReport, ARunWithoutASummaryOrEndIsShownAsFarAsItGoes) {
    const RunFolder run(kOneJoint);
    std::filesystem::remove(run.path() / "summary.json");
    const auto log = run.path() / "A.mcap";
    std::filesystem::resize_file(log, std::filesystem::file_size(log) * 2 / 3);
    const ReadReport report = run.report();
    const json& one = report.data["cases"][0];
    EXPECT_GT(one["rows"], 500);
    EXPECT_LT(one["rows"], 2000);
    EXPECT_CONTAINS(one["verdict"].get<std::string>(), "the log has no end");
    EXPECT_EQ(report.data["title"], "one joint");  // from the log
    EXPECT_EQ(one["grade"], "doubtful");
}

TEST(RunReport, ALogCutOffIsNotShownAsWholeBySummary) {
    const RunFolder run(kOneJoint);
    json summary = json::parse(std::ifstream(run.path() / "summary.json"));
    summary["cases"][0].erase("grade");  // as older ones
    EXPECT_EQ(run.report().data["cases"][0]["grade"], "good");
    const auto grade = [&](const char* key, const json& value) {
        summary["cases"][0][key] = value;
        std::ofstream(run.path() / "summary.json") << summary;
        return run.report().data["cases"][0]["grade"];
    };
    EXPECT_EQ(grade("limits_kept", false), "broken");
    EXPECT_EQ(grade("limits_kept", true), "doubtful");
    grade("stop_time_s", 1.0);
    EXPECT_EQ(grade("stop", "stopped at 1 s: the filter plugin 'x' ended the case: y"), "failed");
    EXPECT_EQ(grade("grade", "good"), "good");
    const auto log = run.path() / "A.mcap";
    std::filesystem::resize_file(log, std::filesystem::file_size(log) * 2 / 3);
    const json one = run.report().data["cases"][0];
    EXPECT_EQ(one["grade"], "doubtful");
    EXPECT_EQ(one["verdict"].get<std::string>().rfind("the log has no end", 0), 0u);
}

TEST(RunReport, ARecoveredLogStandsForTheOneThatWasCutOff) {
    const RunFolder run(kOneJoint);
    const auto log = run.path() / "A.mcap";
    std::filesystem::resize_file(log, std::filesystem::file_size(log) * 2 / 3);
    const std::uint64_t rows = recoverLog(log, run.path() / "A.recovered.mcap");
    for (bool hasSummary : {true, false}) {
        if (!hasSummary) std::filesystem::remove(run.path() / "summary.json");
        const json data = run.report().data;
        ASSERT_EQ(data["cases"].size(), 1u);
        EXPECT_EQ(data["cases"][0]["name"], "A");
        EXPECT_EQ(data["cases"][0]["rows"], rows);
    }
}

TEST(RunReport, CasesWithDifferentArmsGetAPageEach) {
    const RunFolder run(R"(schema: 1
title: two arms
robot: single_joint
duration_s: 0.1
command: {plugin: random_steps}
controller: {plugin: joint_pd}
filter: {plugin: pass_through}
cases: {one: {}, six: {robot: indy7}, again: {}}
)");
    const auto files = writeReport(run.path(), run.page);
    ASSERT_EQ(files.size(), 2u);
    EXPECT_EQ(files[1].filename(), "report_2.html");
    const json first = ReadReport(files[0]).data, second = ReadReport(files[1]).data;
    ASSERT_EQ(first["cases"].size(), 2u);
    EXPECT_EQ(first["cases"][1]["name"], "again");
    ASSERT_EQ(second["cases"].size(), 1u);
    EXPECT_EQ(second["cases"][0]["joints"].size(), 6u);
    EXPECT_EQ(second["robot"]["name"], "indy7");
}

TEST(RunReport, ABucketShowsEveryLimitThatActedInIt) {
    const RunFolder run(kTwoCases, {"cases.free.filter.plugin=tosbp"});
    const ReadReport report = run.report();
    const json& one = report.data["cases"][0];
    const auto shown = report.codes(one["joints"][0]["active"]);
    std::vector<std::uint16_t> expected(shown.size(), 0);
    LogReader reader(run.path() / "free.mcap");
    const double step = one["step_s"];
    for (TickRecord r; reader.read(r);) {
        const JointIntervention& acted = r.joints[0];
        if (acted.limit == LimitKind::None) continue;
        const int bit = 2 * (static_cast<int>(acted.limit) - 1) + (acted.side == LimitSide::Upper);
        expected.at(static_cast<std::size_t>(r.time_s / step + 1e-6)) |= static_cast<std::uint16_t>(1u << bit);
    }
    EXPECT_EQ(shown, expected);
    EXPECT_GT(std::count_if(shown.begin(), shown.end(), [](std::uint16_t x) { return x & (x - 1); }), 0)
        << "no bucket with two limits: nothing was tested";
}

TEST(RunReport, SaysWhatIsWrongWithTheFolderOrThePage) {
    const TemporaryFolder folder;
    const auto page = folder.write("page.html", kPage);
    expectError({"no such folder"}, [&] { writeReport(folder / "absent", page); });
    expectError({"no log (.mcap)"}, [&] { writeReport(folder.path(), page); });
    folder.write("A.mcap", "this is no log");
    expectError({"A.mcap"}, [&] { writeReport(folder.path(), page); });
    folder.write("summary.json", "[1, 2");
    expectError({"this is not a summary of a run"}, [&] { writeReport(folder.path(), page); });
    expectError({"the page of reports is missing"}, [&] { writeReport(folder.path(), folder / "absent.html"); });
    const RunFolder run(kOneJoint);
    const auto empty = folder.write("empty.html", "<html></html>");
    expectError({"has no placeholder for the data"}, [&] { writeReport(run.path(), empty); });
    EXPECT_FALSE(std::filesystem::exists(run.path() / "report.html"));
}

TEST(RunReport, SummaryOfAnotherShapeIsRefusedNotAMisreading) {
    const RunFolder run(kOneJoint);
    for (const char* text : {R"({"cases": 3})", R"({"cases": [5]})", R"({"cases": [{"name": 7}]})",
                             R"({"cases": [{"name": "A"}]})", R"({"title": 1, "cases": []})"}) {
        std::ofstream(run.path() / "summary.json") << text;
        EXPECT_CONTAINS(catchError([&] { run.report(); }), "this is not a summary of a run") << text;
    }
}

}  // namespace
}  // namespace viable::test
