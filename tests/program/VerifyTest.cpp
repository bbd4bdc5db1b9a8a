#include <sched.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <random>

#include "Program.h"
#include "analysis/smoothing/Smoothing.h"

// `viable verify` and `viable identify` from outside: exit codes, words, files, and what they say against what a
// simulation knows.

namespace viable::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/** The main experiment's real arm, its readings and its truth. */
struct Verify : testing::Test {
    static void SetUpTestSuite() {
        folder_ = std::make_unique<TemporaryFolder>();
        const Outcome o = run({"run", "experiments/indy7_teleoperation.yaml", "--case", "C3", "--set", "duration_s=10",
                               "--out", *folder_ / "run", "--no-report"});
        ASSERT_EQ(o.code, 0) << o.err;
        LogReader reader(log());
        for (TickRecord record; reader.read(record);) truth_.push_back(record);
    }
    static void TearDownTestSuite() {
        folder_.reset();
        truth_.clear();
    }
    static fs::path log() { return *folder_ / "run/C3.mcap"; }

    static inline std::unique_ptr<TemporaryFolder> folder_;
    static inline std::vector<TickRecord> truth_;
};

/** The largest size of the jerk's mean over `ticks` within the rows [first, end): from the true velocity. */
double findMeanJerk(const std::vector<TickRecord>& truth, int joint, std::size_t first, std::size_t end,
                    std::size_t ticks) {
    double largest = 0.0;
    const double tick_s = truth[1].time_s - truth[0].time_s;
    const auto qdd = [&](std::size_t i) {
        return (truth[i + 1].actual.qd[joint] - truth[i].actual.qd[joint]) / tick_s;
    };
    for (std::size_t i = first; i + ticks + 1 < end; ++i)
        largest = std::max(largest, std::abs(qdd(i + ticks) - qdd(i)) / (static_cast<double>(ticks) * tick_s));
    return largest;
}

/** A wave that all of some joints follow, by a fine encoder: its motion is resolved as finely as its readings. */
std::string writeWave(int joints, int samples) {
    std::string text = "time_s";
    for (int joint = 0; joint < joints; ++joint) text += ",joint" + std::to_string(joint) + "_rad";
    std::mt19937_64 random(1);
    std::normal_distribution<double> noise(0.0, 1e-8);
    for (int i = 0; i < samples; ++i) {
        char number[32];
        std::snprintf(number, sizeof number, "\n%.3f", 1e-3 * i);
        text += number;
        std::snprintf(number, sizeof number, ",%.8f", std::sin(5e-3 * i) + noise(random));
        for (int joint = 0; joint < joints; ++joint) text += number;
    }
    return text + "\n";
}

// What the smoothing of one joint takes is given back before the next one: some 900 bytes per sample, where six at once
// take ten times as many. On one core, and of a long record, one joint is judged after the other.
TEST(VerifyMemory, OneJointPerCoreIsJudgedAtATime) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "a sanitizer keeps memory that was given back";
#endif
    constexpr int kSamples = 50000;
    constexpr double kMost_B = 1200.0;  // per sample
    EXPECT_EQ(countSmoothedAtOnce(1'000'001), 1u);
    EXPECT_GE(countSmoothedAtOnce(kSamples), 6u);
    cpu_set_t all, one_core;
    ASSERT_EQ(sched_getaffinity(0, sizeof all, &all), 0);
    CPU_ZERO(&one_core);
    for (int core = 0; CPU_COUNT(&one_core) == 0; ++core)
        if (CPU_ISSET(core, &all)) CPU_SET(core, &one_core);
    ASSERT_EQ(sched_setaffinity(0, sizeof one_core, &one_core), 0);
    TemporaryFolder folder;
    const auto measure = [&](int joints, int samples) {
        const std::string name = std::to_string(joints) + "x" + std::to_string(samples) + ".csv";
        Program program({"verify", folder.write(name, writeWave(joints, samples))});
        rusage used{};
        int status = 0;
        EXPECT_EQ(wait4(program.pid(), &status, 0, &used), program.pid());
        EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
        return 1024.0 * static_cast<double>(used.ru_maxrss);
    };
    const double bare = measure(1, 1000), one = measure(1, kSamples), six = measure(6, kSamples);
    sched_setaffinity(0, sizeof all, &all);
    std::printf("%.0f B per sample of one joint, %.0f of six\n", (one - bare) / kSamples, (six - bare) / kSamples);
    EXPECT_GT(one, bare);
    EXPECT_LT(six - bare, kMost_B * kSamples);
}

TEST_F(Verify, AgreesWithTheTruthOfTheMainExperiment) {
    const std::string file = *folder_ / "verdict.json";
    const Outcome o = run({"verify", log(), "--json", file});
    ASSERT_TRUE(o.code == 3 || o.code == 0 || o.code == 7) << o.err;
    const json verdict = json::parse(readFile(file));
    EXPECT_EQ(o.code, verdict.at("verdict") == "broken" ? 3 : verdict.at("verdict") == "held" ? 0 : 7);
    EXPECT_EQ(verdict.at("signal"), "real");
    int held = 0, broken = 0;
    for (std::size_t i = 0; i < verdict.at("joints").size(); ++i) {
        const int joint = static_cast<int>(i);
        for (const auto& [quantity, one] : verdict.at("joints")[i].at("limits").items()) {
            SCOPED_TRACE("joint " + std::to_string(i) + " " + quantity);
            const double lower = one.at("lower"), upper = one.at("upper");
            const double room = one.at("visible_excess").is_null() ? INFINITY : one.at("visible_excess").get<double>();
            // The truth: the largest excess, and for accelerations and jerk what lasts 50 ms.
            double worst = -INFINITY;
            for (std::size_t row = 1; row + 1 < truth_.size(); ++row) {
                const double tick_s = truth_[1].time_s - truth_[0].time_s;
                double x = truth_[row].actual.q[joint];
                if (quantity == "velocity") x = truth_[row].actual.qd[joint];
                if (quantity == "acceleration")
                    x = (truth_[row + 1].actual.qd[joint] - truth_[row - 1].actual.qd[joint]) / (2.0 * tick_s);
                if (quantity != "jerk") worst = std::max({worst, x - upper, lower - x});
            }
            if (quantity == "jerk") worst = findMeanJerk(truth_, joint, 0, truth_.size(), 50) - upper;
            if (one.at("verdict") == "held") {
                ++held;
                EXPECT_LT(worst, room);
            } else if (one.at("verdict") == "broken") {
                ++broken;
                const double certain = one.at("broken").at("certain_excess"), at_s = one.at("broken").at("worst_s");
                EXPECT_GT(certain, 0.0);
                if (quantity == "jerk") {
                    const auto row = static_cast<std::size_t>(at_s / 1e-3);
                    const std::size_t first = row - std::min<std::size_t>(row, 60);
                    const std::size_t end = std::min(truth_.size(), row + 60);
                    EXPECT_GT(findMeanJerk(truth_, joint, first, end, 2) - upper, certain);
                } else {
                    EXPECT_GT(worst, 0.0);
                }
            }
        }
    }
    std::printf("%d held, %d broken, each as the truth is\n", held, broken);
    EXPECT_GE(held, 12);
    EXPECT_GE(broken, 1);  // friction that reverses jerks the arm
}

TEST_F(Verify, TheNominalArmKeepsItsLimits) {
    const Outcome o = run({"verify", log(), "--signal", "nominal"});
    EXPECT_EQ(o.code, 0) << o.out << o.err;
    EXPECT_NE(o.out.find("24 held, 0 broken, 0 cannot be told at this noise"), std::string::npos) << o.out;
}

TEST_F(Verify, ReportsAndWritesNothingByHalf) {
    const Outcome o = run({"verify", log(), "--report"});
    EXPECT_EQ(o.code, 3) << o.err;
    EXPECT_NE(o.out.find("C3.verify.json"), std::string::npos);
    EXPECT_TRUE(fs::exists(log().parent_path() / "C3.verify.json"));
    EXPECT_NE(readFile(log().parent_path() / "report.html").find("\"verification\""), std::string::npos);
    const Outcome nowhere = run({"verify", log(), "--json", *folder_ / "none/verdict.json"});
    EXPECT_EQ(nowhere.code, 5);
    EXPECT_NE(nowhere.err.find("none/verdict.json"), std::string::npos) << nowhere.err;
}

/** 1000 samples of a wave in the given columns. */
std::string makeCsv(const std::string& header, double scale = 1.0) {
    std::string text = header + "\n";
    for (int i = 0; i < 1000; ++i) {
        char line[80];
        std::snprintf(line, sizeof line, "%.3f,%.9f\n", 0.001 * i, scale * std::sin(0.003 * i));
        text += line;
    }
    return text;
}

TEST_F(Verify, TakesCsvWithTheLimitsOfARobot) {
    const std::string csv = folder_->write("ok.csv", makeCsv("time_s,joint0_deg", 20.0));
    const Outcome o = run({"verify", csv, "--limits", "indy7"});
    EXPECT_EQ(o.code, 0) << o.out << o.err;
    EXPECT_NE(o.out.find("not in the record, so not judged: joint1, joint2"), std::string::npos) << o.out;
    const Outcome fast =
        run({"verify", folder_->write("fast.csv", makeCsv("time_s,joint0_rad", 2.0)), "--limits", "indy7"});
    EXPECT_EQ(fast.code, 3) << fast.out;
    EXPECT_NE(fast.out.find("BROKEN"), std::string::npos);
}

TEST_F(Verify, BadInputIsRefusedWithPlaceAndRemedy) {
    const auto refuse = [&](const std::string& text, const std::string& words, std::vector<std::string> more = {}) {
        more.insert(more.begin(), {"verify", folder_->write("bad.csv", text)});
        const Outcome o = run(more);
        EXPECT_EQ(o.code, 2) << o.out << o.err;
        EXPECT_NE(o.err.find(words), std::string::npos) << o.err;
        EXPECT_EQ(o.out, "");
    };
    std::string back = makeCsv("time_s,joint0_rad");
    back.replace(back.find("0.500,"), 6, "0.400,");
    refuse(back, "bad.csv:502");
    std::string nan = makeCsv("time_s,joint0_rad");
    nan.replace(nan.find("0.500,"), 6, "nan,");
    refuse(nan, "bad.csv:502");
    refuse(makeCsv("time,joint0"), "does not end in a unit");
    refuse("time_s,joint0_rad\n0,1\n0.001,2\n", "holds 2 samples");
    std::string constant = "time_s,joint0_rad\n";
    for (int i = 0; i < 100; ++i) constant += std::to_string(0.001 * i) + ",0.5\n";
    refuse(constant, "all readings are the same");
    refuse(makeCsv("time_s,elbow_rad"), "no joint of this record is one of robot indy7: elbow", {"--limits", "indy7"});
    refuse(makeCsv("time_s,joint0_m"), "its readings are in m", {"--limits", "indy7"});
    refuse(makeCsv("time_s,joint0_rad"), "not a log of a run", {"--report"});
    refuse(makeCsv("time_s,joint0_rad"), "--confidence: it must lie in [0.5, 1)", {"--confidence", "2"});
    refuse(makeCsv("time_s,joint0_rad"), "never overwritten", {"--json", folder_->write("here.json", "mine")});
    EXPECT_EQ(readFile(*folder_ / "here.json"), "mine");
    std::string wrapped = "time_s,joint0_rad\n";
    for (int i = 0; i < 1000; ++i)
        wrapped += std::to_string(0.001 * i) + "," + std::to_string(std::remainder(0.01 * i, 2.0 * M_PI)) + "\n";
    refuse(wrapped, "an angle that wraps");
    refuse(makeCsv("time_s,joint0_rad"), "Did you mean `indy7`", {"--limits", "indy"});
}

TEST_F(Verify, TellsTheJerkOfAHumanHand) {
    const std::string recording = VIABLE_SOURCE_DIR "/../shared/data/freiburg1_xyz-groundtruth.txt";
    if (!fs::exists(recording)) GTEST_SKIP() << "the recorded motion " << recording << " is not here";
    const std::string file = *folder_ / "hand.json";
    expectRun({"verify", recording, "--columns", "timestamp:s,tx:m,ty:m,tz:m", "--json", file}, 0);
    const json verdict = json::parse(readFile(file));
    ASSERT_EQ(verdict.at("joints").size(), 3u);
    for (const json& joint : verdict.at("joints")) {
        const json& jerk = joint.at("limits").at("jerk");
        EXPECT_EQ(jerk.at("unit"), "m/s^3");
        EXPECT_NEAR(joint.at("quantum").get<double>(), 1e-4, 1e-7);
        const double largest = std::max(jerk.at("highest").get<double>(), -jerk.at("lowest").get<double>());
        const double band = jerk.at("deviation").get<double>() * jerk.at("band_deviations").get<double>();
        std::printf("%s: jerk up to %.1f m/s^3, band +- %.1f\n", joint.at("name").get<std::string>().c_str(), largest,
                    band);
        EXPECT_GT(largest, band);  // it is seen
        EXPECT_LT(largest, 300.0);
    }
}

TEST_F(Verify, IdentifiesTheFrictionOfTheMainExperiment) {
    const std::string actuation = *folder_ / "actuation.yaml";
    expectRun({"identify", log(), "--out", actuation, "--json", *folder_ / "figures.json"}, 0);
    EXPECT_NE(readFile(actuation).find("coulomb_Nm"), std::string::npos);
    const json figures = json::parse(readFile(*folder_ / "figures.json"));
    EXPECT_EQ(figures.at("joints").size(), 6u);
    // A folder with the new file is a robot.
    fs::copy(VIABLE_SOURCE_DIR "/robots/indy7", *folder_ / "indy7", fs::copy_options::recursive);
    fs::copy_file(actuation, *folder_ / "indy7/actuation.yaml", fs::copy_options::overwrite_existing);
    EXPECT_EQ(run({"robots", "--describe", *folder_ / "indy7"}).code, 0);
    EXPECT_EQ(run({"identify", log(), log()}).code, 2);
    EXPECT_EQ(run({"identify", log(), "--out", actuation}).code, 2);  // exists
    // What has no torques cannot be identified.
    const Outcome csv =
        run({"identify", folder_->write("q.csv", makeCsv("time_s,joint0_rad")), "--robot", "single_joint"});
    EXPECT_EQ(csv.code, 2) << csv.out;
    EXPECT_NE(csv.err.find("torque"), std::string::npos) << csv.err;
}

}  // namespace
}  // namespace viable::test
