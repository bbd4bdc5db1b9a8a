// A kind of limit that a plugin brings along, by one class and one row: the program knows it wherever it knows its own.

#include <nlohmann/json.hpp>

#include "Program.h"
#include "records/LogExportColumns.h"

namespace viable::test {
namespace {

const char* const kTipping = R"(schema: 1
title: a tool that tips
robot: single_joint
duration_s: 1
command: {plugin: waypoints, points: [[0, 1], [1, -1]], repeat_s: 2}
controller: {plugin: joint_pd}
cases: {A: {filter: {plugin: upright}}, B: {filter: {plugin: pass_through}}}
)";

TEST(LimitKind, OfAPluginIsInLogTableVerdictReportAndExitCode) {
    const TemporaryFolder folder;
    const std::string file = folder.write("e.yaml", kTipping);
    const Outcome run = test::run({"run", file, "--details", "--out", folder / "run"});
    EXPECT_EQ(run.code, 3) << run.err;
    expectContains(run.out, {"upright[deg]", "guarantee broken, the arm broke its limit of upright", "no upright",
                             "the nominal arm broke its limit of upright: worst ", "limit 20, beyond it in"});

    const nlohmann::json summary =
        nlohmann::json::parse(readFile(std::filesystem::path(folder / "run") / "summary.json"));
    const nlohmann::json &liar = summary["cases"][0], &passing = summary["cases"][1];
    EXPECT_EQ(liar["exit_code"], 3);
    EXPECT_EQ(passing["exit_code"], 0);
    EXPECT_EQ(liar["guarantees_upright"], true);
    EXPECT_EQ(passing["guarantees_upright"], false);
    for (const nlohmann::json* one : {&liar, &passing}) {
        const nlohmann::json& nominal = (*one)["upright"]["nominal"];
        EXPECT_GT(nominal["worst_deg"], 20.0);
        EXPECT_GT(nominal["ticks_broken"], 100);
        EXPECT_EQ(nominal["ticks_at_fault"], nominal["ticks_broken"]);
        EXPECT_EQ(nominal["part"], "tool");
        EXPECT_EQ((*one)["upright"]["limit_deg"], 20.0);
    }

    // This process has not loaded the plugin: the log tells its reader.
    LogReader reader(std::filesystem::path(folder / "run") / "A.mcap");
    const LimitKind kind = addLimitKind("upright", "deg");
    EXPECT_TRUE(reader.layout().limits.has(kind));
    std::vector<std::string> columns;
    for (const LogColumn& column : reader.columns()) columns.push_back(column.name());
    for (const char* name : {"upright.known", "upright.tilt_deg", "upright.limit_deg", "upright.link"})
        EXPECT_EQ(std::count(columns.begin(), columns.end(), name), 1) << name;
    for (const detail::ExportColumn& column : detail::nameExportColumns(reader, "A.mcap"))
        if (column.name == "upright.tilt_deg") EXPECT_EQ(column.unit, "deg");
    TickRecord row;
    double worst = 0.0;
    bool acts = false;
    while (reader.read(row)) {
        ASSERT_TRUE(row.reports[kind].isKnown);
        EXPECT_EQ(row.reports[kind].limit, 20.0);
        worst = std::max(worst, row.reports[kind].value);
        acts |= row.joints[0].limit == kind;
    }
    EXPECT_TRUE(acts);
    EXPECT_NEAR(worst, liar["upright"]["nominal"]["worst_deg"], 0.1);

    expectContains(readFile(std::filesystem::path(folder / "run") / "report.html"),
                   {"upright, ticks beyond", "the nominal arm broke its limit of upright", "\"upright_upper\""});
    const Outcome again = test::run({"report", folder / "run"});
    EXPECT_EQ(again.code, 0) << again.err;
    expectContains(readFile(std::filesystem::path(folder / "run") / "report.html"), {"upright, ticks beyond"});
}

TEST(LimitKind, JudgeThatMisbehavesIsContainedAndTheLibraryNamed) {
    const TemporaryFolder folder;
    const auto write = [&](const std::string& judge, const std::string& more = "") {
        std::string text = kTipping + more;
        text.replace(text.find("upright}"), 7, "upright, judge: " + judge);
        return folder.write(judge + ".yaml", text);
    };
    const auto run = [&](const std::string& judge) {
        return test::run({"run", write(judge), "--details", "--out", folder / judge, "--jobs", "1"});
    };
    expectContains(run("throws").out, {"the nominal arm broke its limit of upright: worst ", "(its check failed)"});
    expectContains(run("loses_words").out, {"upright: (its words failed)(its words failed)"});
    expectContains(test::run({"check", write("loses_words", "start: {position_rad: [0.5]}\n")}).out,
                   {"at the start the arm broke its limit of upright: (its words failed)"});
    expectContains(run("rounds").out, {"(its check changed the arithmetic)"});
    expectOutcome(run("cannot_say"), 4,
                  {"the limit 'upright' (", "viable_filter_upright.so): could not say whether a case has it"});
    expectOutcome(run("is_null"), 4,
                  {"the limit 'upright' (", "viable_filter_upright.so): could not be made: it gave none"});
    if (kSanitized) return;  // there the sanitizer tells of crashes
    expectOutcome(run("crashes"), 4, {"the limit 'upright' (", "while it judged an arm"});
}

TEST(LimitKind, OfAPluginIsCheckedBeforeARun) {
    const TemporaryFolder folder;
    expectRun({"check", folder.write("e.yaml", kTipping)}, 0,
              {"limits   upright guaranteed", "limits   upright not guaranteed", "e.yaml: ok"});
    expectRun({"check", folder.write("t.yaml", std::string(kTipping) + "start: {position_rad: [0.5]}\n")}, 0,
              {"WARNING  at the start the arm broke its limit of upright: worst 28.6 (tool)"});
}

}  // namespace
}  // namespace viable::test
