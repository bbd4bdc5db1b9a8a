
#include <nlohmann/json.hpp>

#include "Program.h"

// The main experiment, run by the program as a user runs it; the claims are those of the paper's
// Figs. 8 and 9.

namespace viable::test {
namespace {

double worstUse(const nlohmann::json& run, const char* quantity) {
    double worst = 0.0;
    for (const auto& joint : run["limits"][quantity]) worst = std::max(worst, joint["worst_use"].get<double>());
    return worst;
}

void checkClaims(const nlohmann::json& summary) {
    const auto &c1 = summary["cases"][0], &c2 = summary["cases"][1], &c3 = summary["cases"][2];
    const auto &c4 = summary["cases"][3], &free = summary["cases"][4];
    ASSERT_EQ(c1["name"], "C1");
    ASSERT_EQ(c2["name"], "C2");
    ASSERT_EQ(c3["name"], "C3");
    ASSERT_EQ(c4["name"], "C4");
    ASSERT_EQ(free["name"], "C3_without_nric");
    // Certified braking: every limit in every tick, and never without a choice.
    EXPECT_EQ(c3["guarantees_limits"], true);
    EXPECT_EQ(c3["limits_kept"], true);
    EXPECT_EQ(c3["infeasible_ticks"], 0);
    EXPECT_EQ(c3["unviable_ticks"], 0);
    for (const char* quantity : {"position", "velocity", "acceleration", "jerk"}) {
        EXPECT_LE(worstUse(c3, quantity), 1.0 + 1e-12) << quantity;
        for (const auto& joint : c3["limits"][quantity]) EXPECT_EQ(joint["ticks_outside"], 0);
    }
    EXPECT_GT(worstUse(c3, "position"), 0.99);
    EXPECT_GT(worstUse(c3, "jerk"), 0.99);
    // The law is derived for continuous time, so sampled it may overshoot a little.
    for (const char* quantity : {"position", "velocity", "acceleration", "jerk"})
        EXPECT_LE(worstUse(c2, quantity), 1.0 + 1e-3) << quantity;
    for (const char* quantity : {"position", "velocity", "acceleration"})
        EXPECT_LE(worstUse(c1, quantity), 1.0 + 1e-3) << quantity;
    EXPECT_GT(worstUse(c1, "jerk"), 10.0);
    // The motion is strong enough to be held back: the limits are met, not just kept.
    EXPECT_GT(worstUse(c2, "position"), 0.99);
    EXPECT_GT(worstUse(c2, "velocity"), 0.9);
    EXPECT_GT(worstUse(c2, "jerk"), 0.99);
    EXPECT_GT(free["tracking"]["rms_rad"].get<double>(), 20.0 * c3["tracking"]["rms_rad"].get<double>());
    EXPECT_GT(free["tracking"]["max_rad"].get<double>(), 20.0 * c3["tracking"]["max_rad"].get<double>());
    // Behind a controller that knows them the same limits cost the hand little.
    EXPECT_EQ(c4["limits_kept"], true);
    EXPECT_LT(c4["tool_error_rms_m"].get<double>(), c1["tool_error_rms_m"].get<double>());
    EXPECT_LT(c4["tool_error_rms_m"].get<double>(), 0.5 * c3["tool_error_rms_m"].get<double>());
    EXPECT_LT(c4["jerk_rms_radps3"].get<double>(), 1.35 * c3["jerk_rms_radps3"].get<double>());
    EXPECT_GT(c4["passed_ticks"].get<double>(), 0.95 * 30000);
    for (const auto& one : summary["cases"]) {
        EXPECT_EQ(one["ticks"], 30000);
        EXPECT_EQ(one["log_rows"], 30000);
        EXPECT_EQ(one["substituted_ticks"], 0);
    }
}

TEST(MainExperiment, GeneratedHandMotion) {
    TemporaryFolder folder;
    const Outcome o = run({"run", "experiments/indy7_teleoperation.yaml", "--out", folder / "run"});
    ASSERT_EQ(o.code, 0) << o.err;
    checkClaims(nlohmann::json::parse(readFile(folder / "run/summary.json")));

    // What `viable identify` finds in that run, fed forward: the real arm follows three times as closely and more.
    const Outcome found = run({"identify", folder / "run/C3.mcap", "--out", folder / "actuation.yaml"});
    ASSERT_EQ(found.code, 0) << found.err;
    const auto follow = [&](const std::string& scale) {
        const std::string block = "cases.C3.robust_loop={plugin: nric, k_r: 600, k_p: 20, k_i: 8, friction_file: " +
                                  (folder / "actuation.yaml").string() + ", friction_scale: " + scale + "}";
        const Outcome run = test::run({"run", "experiments/indy7_teleoperation.yaml", "--case", "C3", "--set", block,
                                       "--out", folder / ("fed" + scale)});
        EXPECT_EQ(run.code, 0) << run.err;
        return nlohmann::json::parse(
                   readFile(folder / ("fed" + scale + "/summary.json")))["cases"][0]["tracking"]["rms_rad"]
            .get<double>();
    };
    const double right = follow("1"), less = follow("0.7"), more = follow("1.3");
    std::printf("  real - nominal with friction fed forward: %.3g mrad RMS; 30 %% less %.3g, more %.3g\n", 1e3 * right,
                1e3 * less, 1e3 * more);
    EXPECT_LT(right, 1.0e-3);
    EXPECT_LT(less, 2.0e-3);
    EXPECT_LT(more, 2.0e-3);
}

TEST(MainExperiment, RecordedHandMotion) {
    const std::string recording = VIABLE_SOURCE_DIR "/../shared/data/freiburg1_xyz-groundtruth.txt";
    if (!std::filesystem::exists(recording))
        GTEST_SKIP() << "the recorded motion ../shared/data/freiburg1_xyz-groundtruth.txt is not here";
    TemporaryFolder folder;
    const Outcome o = run({"run", "experiments/indy7_teleoperation.yaml", "--out", folder / "run", "--set",
                           "command.plugin=recorded_poses", "--set", "command.file=" + recording});
    ASSERT_EQ(o.code, 0) << o.err;
    checkClaims(nlohmann::json::parse(readFile(folder / "run/summary.json")));
}

}  // namespace
}  // namespace viable::test
