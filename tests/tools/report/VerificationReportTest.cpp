#include <cmath>

#include "ReportSupport.h"
#include "log/LogWriter.h"
#include "report/RunReport.h"

namespace viable::test {
namespace {

using nlohmann::json;

/** A run of one joint with the logs A.mcap and B.mcap, which begin at 2 s. */
class VerifiedRun {
public:
    VerifiedRun() {
        page_ = folder_.write("page.html", kPage);
        for (const char* name : {"A.mcap", "B.mcap"}) {
            LogOpening opening;
            opening.layout.jointNames = {"joint"};
            opening.layout.hasRealPlant = true;
            LogWriter log(folder_ / name, opening);
            TickRecord row;
            row.nominal.q = row.real.q = row.actual.q = JointVector::Zero(1);
            row.nominal.qd = row.real.qd = row.actual.qd = JointVector::Zero(1);
            for (int i = 0; i < 10; ++i) {
                row.time_s = 2.0 + 1e-3 * i;
                log.append(row);
            }
            log.finish();
        }
    }
    void write(const std::string& name, const std::string& text) const { folder_.write(name, text); }
    void rename(const std::string& from, const std::string& to) const {
        std::filesystem::rename(folder_ / from, folder_ / to);
    }
    ReadReport report() const { return ReadReport(writeReport(folder_.path(), page_).at(0)); }

private:
    TemporaryFolder folder_;
    std::filesystem::path page_;
};

/** A file as `viable verify` writes it: the position held, the velocity broken, no limit of acceleration, jerk unclear. */
json makeVerification() {
    const auto limit = [](const char* verdict, const char* unit, json size, json visible) {
        return json{{"verdict", verdict},
                    {"unit", unit},
                    {"lower", size.is_null() ? json(nullptr) : json(-size.get<double>())},
                    {"upper", size},
                    {"lowest", -0.25},
                    {"highest", 0.5},
                    {"deviation", 1e-6},
                    {"band_deviations", 5.5},
                    {"judged", 0.98},
                    {"visible_excess", visible},
                    {"broken", nullptr}};
    };
    const json curve = {{"raw_least", {-1, nullptr, 1}}, {"raw_largest", {0, nullptr, 2}},
                        {"mean_least", {-0.5, 0, 1}},    {"mean_largest", {-0.25, 0.5, 1.25}},
                        {"low", {nullptr, -0.5, 0.5}},   {"high", {nullptr, 1, 1e300}}};
    json joint = {{"name", "joint"},
                  {"unit", "rad"},
                  {"trouble", nullptr},
                  {"noise", 2.1e-7},
                  {"quantum", nullptr},
                  {"window_s", 0.012},
                  {"left_out", 3},
                  {"limits",
                   {{"position", limit("held", "rad", 0.5, 1e-5)},
                    {"velocity", limit("broken", "rad/s", 2.0, 1e-3)},
                    {"acceleration", limit("no_limit", "rad/s^2", nullptr, nullptr)},
                    {"jerk", limit("cannot_tell", "rad/s^3", 30.0, nullptr)}}},
                  {"curves",
                   {{"t0", 0.0},
                    {"step_s", 0.004},
                    {"n", 3},
                    {"position", curve},
                    {"velocity", curve},
                    {"acceleration", curve},
                    {"jerk", curve}}}};
    joint["limits"]["velocity"]["broken"] = {{"side", "upper"}, {"first_s", 0.001},       {"worst_s", 0.003},
                                             {"excess", 0.5},   {"certain_excess", 0.25}, {"duration_s", 0.002}};
    return {{"schema", 1},         {"log", "A.mcap"},  {"signal", "real"},
            {"confidence", 0.99},  {"excess", 0.1},    {"excess_duration_s", 0.05},
            {"verdict", "broken"}, {"begin_s", 0},     {"end_s", 0.009},
            {"samples", 10},       {"joints", {joint}}};
}

TEST(VerificationReport, WhatVerifyFoundIsShownWithTheCaseThatItIsAbout) {
    const VerifiedRun run;
    json file = makeVerification();
    file["log"] = "/somewhere/else/A.mcap";
    file["foreign"] = "</script>";
    run.write("A.verify.json", file.dump(1));
    const ReadReport report = run.report();
    const json& one = report.data["cases"][0]["verification"];
    EXPECT_FALSE(report.data["cases"][0].contains("verification_note"));
    EXPECT_FALSE(report.data["cases"][1].contains("verification"));
    EXPECT_FALSE(report.data["cases"][1].contains("verification_note"));
    EXPECT_FALSE(one.contains("foreign"));
    EXPECT_EQ(one["verdict"], "broken");
    EXPECT_EQ(one["signal"], "real");
    EXPECT_EQ(one["confidence"], 0.99);
    EXPECT_EQ(one["samples"], 10);
    ASSERT_EQ(one["joints"].size(), 1u);
    const json& joint = one["joints"][0];
    EXPECT_EQ(joint["noise"], 2.1e-7);
    EXPECT_TRUE(joint["quantum"].is_null());
    EXPECT_EQ(joint["limits"]["position"]["visible_excess"], 1e-5);
    EXPECT_TRUE(joint["limits"]["position"]["broken"].is_null());
    EXPECT_TRUE(joint["limits"]["acceleration"]["upper"].is_null());
    const json& broken = joint["limits"]["velocity"]["broken"];
    EXPECT_EQ(broken["side"], "upper");
    EXPECT_EQ(broken["certain_excess"], 0.25);
    // Its times count from the log's first row, the page's are the log's.
    EXPECT_DOUBLE_EQ(broken["first_s"], 2.001);
    EXPECT_DOUBLE_EQ(one["end_s"], 2.009);
    EXPECT_DOUBLE_EQ(joint["curves"]["t0"], 2.0);

    EXPECT_EQ(joint["curves"]["n"], 3);
    EXPECT_EQ(report.numbers(joint["curves"]["jerk"]["mean"]),
              (std::vector<float>{-0.5f, -0.25f, 0.0f, 0.5f, 1.0f, 1.25f}));
    const std::vector<float> raw = report.numbers(joint["curves"]["position"]["raw"]);
    ASSERT_EQ(raw.size(), 6u);
    EXPECT_EQ(raw[0], -1.0f);
    EXPECT_TRUE(std::isnan(raw[2]) && std::isnan(raw[3]));
    const std::vector<float> band = report.numbers(joint["curves"]["position"]["band"]);
    EXPECT_TRUE(std::isnan(band[0]) && std::isnan(band[1]));
    EXPECT_EQ(band[3], 1.0f);
    EXPECT_TRUE(std::isnan(band[5])) << "more than a float holds";
}

TEST(VerificationReport, AJointOfWhichNothingCanBeSaidHasNoCurves) {
    const VerifiedRun run;
    json file = makeVerification();
    file.erase("signal");
    json& joint = file["joints"][0];
    joint["trouble"] = "it hardly moves";
    for (const char* name : {"noise", "quantum", "window_s", "left_out", "curves"}) joint[name] = nullptr;
    run.write("A.verify.json", file.dump());
    const json one = run.report().data["cases"][0]["verification"];
    EXPECT_EQ(one["signal"], "real");
    EXPECT_EQ(one["joints"][0]["trouble"], "it hardly moves");
    EXPECT_TRUE(one["joints"][0]["curves"].is_null());
    EXPECT_TRUE(one["joints"][0]["noise"].is_null());
}

TEST(VerificationReport, TheFileOfACaseIsFoundBesideItsRecoveredLog) {
    const VerifiedRun run;
    run.rename("A.mcap", "A.recovered.mcap");
    json file = makeVerification();
    for (const char* log : {"A.mcap", "A.recovered.mcap"}) {
        file["log"] = log;
        run.write("A.verify.json", file.dump());
        EXPECT_TRUE(run.report().data["cases"][0].contains("verification")) << log;
    }
}

TEST(VerificationReport, ADamagedOrForeignFileIsLeftOutAndTheNoteSaysWhy) {
    const VerifiedRun run;
    const json good = makeVerification();
    const auto changed = [&](const char* pointer, const json& value) {
        json file = good;
        file[json::json_pointer(pointer)] = value;
        return file.dump();
    };
    const auto without = [&](const char* pointer, const char* key) {
        json file = good;
        file[json::json_pointer(pointer)].erase(key);
        return file.dump();
    };
    const std::string whole = good.dump(1);
    const std::pair<std::string, const char*> files[] = {
        {"", "it is not a JSON object, or cut off"},
        {whole.substr(0, whole.size() / 2), "it is not a JSON object, or cut off"},
        {"[1, 2]", "it is not a JSON object, or cut off"},
        {"{}", "it is damaged: key 'schema' not found"},
        {changed("/schema", 2), "it has schema 2, this version knows 1"},
        {changed("/schema", "1"), "it has schema \"1\", this version knows 1"},
        {changed("/log", "B.mcap"), "it is about B.mcap"},
        {changed("/log", 3), "it is damaged: type must be string"},
        {changed("/verdict", "fine"), "it has an unknown verdict"},
        {changed("/confidence", "high"), "it is damaged: type must be number"},
        {changed("/confidence", nullptr), "it is damaged: type must be number"},
        {changed("/joints", 5), "it is damaged"},
        {changed("/joints", json::array()), "its joints are not those of the log"},
        {changed("/joints/0/name", "elbow"), "its joints are not those of the log"},
        {changed("/joints/0/noise", "low"), "it is damaged: type must be number"},
        {changed("/joints/0/limits/jerk/verdict", "maybe"), "it has an unknown verdict"},
        {without("/joints/0/limits", "jerk"), "it is damaged: key 'jerk' not found"},
        {changed("/joints/0/limits/velocity/broken", nullptr), "it is damaged"},
        {changed("/joints/0/curves/step_s", 0), "it has curves without times"},
        {changed("/joints/0/curves/n", 4), "it has curves that do not fit together"},
        {changed("/joints/0/curves/n", -1), "it has curves that do not fit together"},
        {changed("/joints/0/curves/jerk/low", {1, 2}), "it has curves that do not fit together"},
        {changed("/joints/0/curves/jerk/low/1", "x"), "it is damaged: type must be number"},
        {without("/joints/0/curves", "position"), "it is damaged: key 'position' not found"},
    };
    for (const auto& [text, why] : files) {
        run.write("A.verify.json", text);
        const json data = run.report().data;
        ASSERT_EQ(data["cases"].size(), 2u) << why;
        const json& one = data["cases"][0];
        EXPECT_EQ(one["rows"], 10);
        EXPECT_FALSE(one.contains("verification")) << text.substr(0, 200);
        ASSERT_TRUE(one.contains("verification_note")) << why;
        EXPECT_EQ(
            one["verification_note"].get<std::string>().rfind("A.verify.json is not shown: " + std::string(why), 0), 0u)
            << one["verification_note"] << " instead of " << why;
    }
}

}  // namespace
}  // namespace viable::test
