#include "RecordedPoses.h"

#include <fstream>
#include <functional>
#include <random>

#include "CommandBench.h"
#include "core/Text.h"

namespace viable {
namespace {

const char* const kFreiburg = VIABLE_SOURCE_DIR "/../shared/data/freiburg1_xyz-groundtruth.txt";

// Stamps of an epoch like 1.3e9 s are rounded to 0.24 us, which shows in velocities at 1e-5. Where
// a test looks closer, the recording begins here.
constexpr double kPrecise = 100.0;

// Recordings are written to a folder of their own and vanish with the test.
struct RecordedPosesTest : ::testing::Test {
    RecordedPosesTest() {
        const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
        folder_ = std::filesystem::path(::testing::TempDir()) / ("viable_recorded_poses_" + std::string(info->name()));
        std::filesystem::create_directories(folder_);
    }
    ~RecordedPosesTest() override { std::filesystem::remove_all(folder_); }

    std::string write(const std::string& text, const char* name = "poses.txt") {
        const std::filesystem::path path = folder_ / name;
        std::ofstream(path, std::ios::binary) << text;
        return path.string();
    }

    static std::string line(double t, const Pose& pose) {
        char buffer[256];
        std::snprintf(buffer, sizeof buffer, "%.9f %.12f %.12f %.12f %.12f %.12f %.12f %.12f\n", t, pose.position.x(),
                      pose.position.y(), pose.position.z(), pose.orientation.x(), pose.orientation.y(),
                      pose.orientation.z(), pose.orientation.w());
        return buffer;
    }

    // Stamps at about 60 Hz, uneven, from an epoch as cameras have it.
    static std::string record(const std::function<Pose(double)>& motion, double duration, double epoch = 1.3e9,
                              unsigned seed = 1) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> step(0.010, 0.025);
        std::string text = "# time x y z qx qy qz qw\n";
        for (double t = 0.0; t <= duration; t += step(random)) text += line(epoch + t, motion(t));
        return text;
    }

    // What configure() says about a recording.
    std::string findComplaint(const std::string& text, const std::string& more = "") {
        return bench_.findComplaint<RecordedPoses>("file: '" + write(text) + "'" + more);
    }

    void configure(CommandSource& source, const std::string& recording, const std::string& more) {
        bench_.configure(source, "file: '" + recording + "'" + more);
    }

    struct Source : RecordedPoses {
        Source(RecordedPosesTest& test, const std::string& recording, const std::string& more) {
            test.configure(*this, recording, more);
        }
    };

    CommandBench bench_;
    std::filesystem::path folder_;
};

// A hand's motion: 0.2 m, 0.7 rad, below 1 Hz.
Pose hand(double t) {
    Pose pose;
    pose.position = {1.0 + 0.20 * std::sin(1.7 * t), -2.0 + 0.15 * std::cos(2.3 * t),
                     0.5 + 0.1 * std::sin(3.1 * t + 1.0)};
    pose.orientation = calcRotation({0.7 * std::sin(1.9 * t), 0.4 * std::cos(2.9 * t), 0.5 * t}) *
                       Eigen::Quaterniond(0.1, 0.7, -0.7, 0.1).normalized();
    return pose;
}

const char* const kGood =
    "# comment\n"
    "10.00 0.0 0 0 0 0 0 1\n"
    "10.02 0.1 0 0 0 0 0 1\n"
    "10.04 0.2 0 0 0 0 0 1\n"
    "\n"
    "10.06 0.3 0 0 0 0 0 1\n"
    "10.08 0.4 0 0 0 0 0 1\n";
const char* const kShortClutch = ", clutch_s: 0.01";

std::string replaced(std::string text, const std::string& what, const std::string& by) {
    const auto at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return text.replace(at, what.size(), by);
}

TEST_F(RecordedPosesTest, AcceptsWhatRecordersWrite) {
    EXPECT_EQ(findComplaint(kGood, kShortClutch), "");
    std::string crlf;
    for (char c : std::string(kGood)) crlf += c == '\n' ? "\r\n" : std::string(1, c);
    EXPECT_EQ(findComplaint(crlf, kShortClutch), "");
    EXPECT_EQ(findComplaint("\xEF\xBB\xBF" + std::string(kGood), kShortClutch), "");
    EXPECT_EQ(findComplaint(replaced(kGood, "10.02 0.1 0", "  10.02\t+1e-1   0 "), kShortClutch), "");
    std::string noLastNewline = kGood;
    noLastNewline.pop_back();
    EXPECT_EQ(findComplaint(noLastNewline, kShortClutch), "");
}

TEST_F(RecordedPosesTest, ComplainsAboutALineWithItsNumber) {
    auto complaint = [&](const char* what, const char* by) {
        return findComplaint(replaced(kGood, what, by), kShortClutch);
    };
    const char* second = "10.02 0.1 0 0 0 0 0 1";

    expectContains(complaint(second, "10.02 0.1 0 0 0 0 1"),
                   {"poses.txt:3: 7 columns instead of 8", "timestamp tx ty tz qx qy qz qw"});
    EXPECT_CONTAINS(complaint(second, "10.02 0.1 0 0 0 0 0 1 7"), "poses.txt:3: 9 columns instead of 8");
    EXPECT_CONTAINS(complaint(second, "10.02 0.1m 0 0 0 0 0 1"), "poses.txt:3: '0.1m' is not a number (column x_m)");
    EXPECT_CONTAINS(complaint(second, "10.02 0.1 0 nan 0 0 0 1"), "poses.txt:3: 'nan' is not finite (column z_m)");
    EXPECT_CONTAINS(complaint(second, "10.02 0.1 0 0 0 inf 0 1"), "'inf' is not finite (column qy)");
    EXPECT_CONTAINS(complaint(second, "10.02 1e999 0 0 0 0 0 1"), "'1e999' is not a number");
    EXPECT_CONTAINS(complaint(second, "10.02 0,1 0 0 0 0 0 1"), "'0,1' is not a number");
    EXPECT_CONTAINS(complaint(second, "10.02 0.1 0 0 0 0 0 0"),
                    "poses.txt:3: the quaternion has length 0 instead of 1 (+-0.01)");
    EXPECT_CONTAINS(complaint(second, "10.02 0.1 0 0 0.2 0 0 1"), "the quaternion has length 1.0198 instead of 1");
    EXPECT_EQ(complaint(second, "10.02 0.1 0 0 0.1 0 0 1"), "");  // length 1.005
    EXPECT_CONTAINS(complaint(second, std::string(5000, '1').c_str()), "poses.txt:3: the line has 5000 characters");
}

TEST_F(RecordedPosesTest, ComplainsAboutStampsGapsAndSteps) {
    auto complaint = [&](const char* what, const char* by) {
        return findComplaint(replaced(kGood, what, by), kShortClutch);
    };
    expectContains(
        complaint("10.04", "10.02"),
        {"poses.txt:4: time stamp 10.020000000 s is not later than 10.020000000 s on line 3", "Sort the recording"});
    EXPECT_CONTAINS(complaint("10.06", "10.03"),
                    "poses.txt:6: time stamp 10.030000000 s is not later than 10.040000000 s on line 4");
    EXPECT_CONTAINS(complaint("10.08", "10.38"), "poses.txt:7: gap of 0.32 s since line 6, but max_gap_s is 0.2 s");
    EXPECT_EQ(findComplaint(replaced(kGood, "10.08", "10.38"), std::string(kShortClutch) + ", max_gap_s: 0.4"), "");
    for (const double origin : {0.0, 1.7e9, -60.0}) {  // 0.8 - 0.6 is more than 0.2
        std::string text;
        for (int k = 1; k < 400; ++k) text += detail::format("%.1f 0 0 0 0 0 0 1\n", origin + 0.2 * k);
        EXPECT_EQ(findComplaint(text, kShortClutch), "");
    }
    // Stamps in nanoseconds, positions in millimetres, quaternions with w first.
    EXPECT_CONTAINS(findComplaint("10000000000 0 0 0 0 0 0 1\n10020000000 0 0 0 0 0 0 1\n"),
                    "convert the stamps if they are not in seconds");
    expectContains(
        complaint("10.02 0.1", "10.02 100"),
        {"poses.txt:3: moves at 5000 m/s from line 2 to here, faster than 20 m/s", "Positions are in metres"});
    expectContains(complaint("10.02 0.1 0 0 0 0 0 1", "10.02 0.1 0 0 0.8 0 0.6 0"),
                   {"poses.txt:3: turns by 3.142 rad from line 2 to here", "qx qy qz qw"});
}

TEST_F(RecordedPosesTest, ComplainsAboutWholeRecordings) {
    EXPECT_CONTAINS(findComplaint("# nothing\n"), "poses.txt: 0 samples, but at least 4");
    EXPECT_CONTAINS(findComplaint("0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n0.2 0 0 0 0 0 0 1\n"),
                    "poses.txt: 3 samples, but at least 4 are needed");
    EXPECT_CONTAINS(bench_.findComplaint<RecordedPoses>("file: '" + folder_.string() + "'"), folder_.string());
    EXPECT_CONTAINS(bench_.findComplaint<RecordedPoses>("file: '" + folder_.string() + "/none.txt'"), "none.txt");
    EXPECT_NE(bench_.findComplaint<RecordedPoses>("start_s: 1"), "");  // file is required
}

TEST_F(RecordedPosesTest, ComplainsAboutParametersThatDoNotFitTheRecording) {
    expectContains(
        findComplaint(kGood, ", clutch_s: 0.01, start_s: 0.03"),
        {"experiment.yaml:1:", "command.start_s: start_s = 0.03 s leaves 3 samples of a recording of 0.08 s"});
    EXPECT_CONTAINS(findComplaint(kGood, ", start_s: 100"), "leaves 0 samples");
    EXPECT_CONTAINS(findComplaint(kGood, ""),
                    "command: clutch_s = 1 s is longer than the part of the recording in use, 0.08 s");
    EXPECT_CONTAINS(findComplaint(kGood, ", clutch_s: 0"), "clutch_s");

    expectContains(findComplaint(kGood, ", clutch_s: 0.01, axes: [1, 0, 0, 0, 1, 0, 0, 0, -1]"),
                   {"command.axes: axes is not a rotation", "determinant is -1 instead of 1"});
    EXPECT_CONTAINS(findComplaint(kGood, ", clutch_s: 0.01, axes: [1, 0.1, 0, 0, 1, 0, 0, 0, 1]"),
                    "deviate by 0.1 from unit length and right angles");
    EXPECT_CONTAINS(findComplaint(kGood, ", axes: [1, 0, 0, 1]"), "axes");
    EXPECT_EQ(findComplaint(kGood, ", clutch_s: 0.01, axes: [0, 0, 1, -1, 0, 0, 0, -1, 0]"), "");
    EXPECT_EQ(findComplaint(kGood, ", clutch_s: 0.01, axes: [0.7071, -0.7071, 0, 0.7071, 0.7071, 0, 0, 0, 1]"), "");

    const std::string fullTurn = record(
        [](double t) {
            Pose pose;
            pose.orientation = calcRotation({0.0, 0.0, 2.0 * t});
            return pose;
        },
        3.0);
    EXPECT_EQ(findComplaint(fullTurn), "");
    EXPECT_CONTAINS(findComplaint(fullTurn, ", rotation_scale: 0.5"),
                    "command.rotation_scale: rotation_scale cannot be 0.5: at 1.5");
}

TEST_F(RecordedPosesTest, ReadsCsvByColumnNames) {
    const std::string tum = write(kGood);
    std::string csv = "qw,time_s,button,x_m,y_m,z_m,qx,qy,qz\n";
    for (int i = 0; i < 5; ++i) {
        char row[120];
        std::snprintf(row, sizeof row, "1, %.2f, 3 ,%.1f,0,0,0,0,0\n", 10.0 + 0.02 * i, 0.1 * i);
        csv += row;
    }
    Source a(*this, tum, kShortClutch), b(*this, write(csv, "poses.csv"), kShortClutch);
    for (double t = 0.0; t < 0.3; t += 0.001) expectSame(sampleAt(a, t), sampleAt(b, t));
    EXPECT_GT((sampleAt(a, 0.05).tool.position - bench_.tool.position).x(), 0.1);

    EXPECT_CONTAINS(findComplaint(replaced(csv, "x_m", "x_mm")),
                    "poses.txt:1: there is no column 'x_m'; the closest is 'x_mm'");
    EXPECT_CONTAINS(findComplaint(replaced(csv, "button", "qw")), "the column 'qw' stands there twice");
    EXPECT_CONTAINS(findComplaint(replaced(csv, ", 3 ,0.2", ",0.2")), "poses.txt:4: 8 columns instead of 9");
    EXPECT_CONTAINS(findComplaint(replaced(csv, ", 10.04,", ",,")), "poses.txt:4: '' is not a number (column time_s)");
}

TEST_F(RecordedPosesTest, BeginsExactlyAtTheStartPoseAtRest) {
    Source source(*this, write(record(hand, 5.0)), ", start_s: 1.3, scale: 0.7");
    EXPECT_EQ(source.traits().space, MotionCommand::Space::Tool);
    const MotionCommand command = sampleAt(source, 0.0);
    EXPECT_EQ(command.tool.position, bench_.tool.position);
    EXPECT_EQ(command.tool.orientation.coeffs(), bench_.tool.orientation.coeffs());
    EXPECT_EQ(command.toolTwist, Vector6::Zero());
}

TEST_F(RecordedPosesTest, FollowsTheRecordedMotionBetweenItsSamples) {
    Source source(*this, write(record(hand, 10.0, kPrecise)), ", smoothing_s: 0, clutch_s: 0.5");
    const Pose first = hand(0.0);
    for (double t = 0.5; t < 9.4; t += 0.00137) {
        const MotionCommand now = sampleAt(source, t);
        const Pose recorded = hand(t - 0.25);  // half the clutch behind
        const double h = 1e-6;
        const Pose before = hand(t - 0.25 - h), after = hand(t - 0.25 + h);
        EXPECT_LE((now.tool.position - bench_.tool.position - recorded.position + first.position).norm(), 2e-6) << t;
        const Eigen::Quaterniond turn = recorded.orientation * first.orientation.conjugate();
        EXPECT_LE(calcRotationVector(turn * bench_.tool.orientation * now.tool.orientation.conjugate()).norm(), 1e-5)
            << t;
        EXPECT_LE((now.toolTwist.head<3>() - (after.position - before.position) / (2 * h)).norm(), 1e-3) << t;
        EXPECT_LE((now.toolTwist.tail<3>() - calcTurn(before, after) / (2 * h)).norm(), 3e-3) << t;
    }
}

TEST_F(RecordedPosesTest, MapsAxesAndScales) {
    // Camera: z forward, x right, y down; base: x forward, y left, z up.
    const char* axes =
        ", axes: [0, 0, 1, -1, 0, 0, 0, -1, 0], scale: 0.5, rotation_scale: 0.25, clutch_s: 0.1, at_end: hold";
    Source source(*this,
                  write(record(
                      [](double t) {
                          Pose pose;
                          pose.position = {5.0 + 0.1 * t, 6.0 + 0.2 * t, 7.0 + 0.4 * t};
                          pose.orientation = calcRotation({0.0, 0.0, 0.8 * t});
                          return pose;
                      },
                      1.0, kPrecise)),
                  axes);
    const MotionCommand now = sampleAt(source, 0.55);  // 0.5 s into the recording
    EXPECT_LE((now.tool.position - bench_.tool.position - 0.5 * 0.5 * Eigen::Vector3d(0.4, -0.1, -0.2)).norm(), 1e-9);
    EXPECT_LE((calcTurn(bench_.tool, now.tool) - Eigen::Vector3d(0.25 * 0.5 * 0.8, 0, 0)).norm(), 1e-9);
    Vector6 twist;
    twist << 0.2, -0.05, -0.1, 0.2, 0.0, 0.0;
    EXPECT_LE((now.toolTwist - twist).norm(), 1e-7);
}

TEST_F(RecordedPosesTest, IsSmoothFromEndToEnd) {
    for (const char* end : {", at_end: hold", ", at_end: reverse"}) {
        Source source(*this, write(record(hand, 4.0)), std::string(", clutch_s: 0.5") + end);
        const MotionExtremes found = expectSmoothMotion(source, 11.0, 1.0);
        EXPECT_LT(found.speedJump, 0.004) << end;     // the recording's 1.6 m/s^2, and the clutch's
        EXPECT_LT(found.turnRateJump, 0.016) << end;  // 3.7 / 0.5 * speed
        EXPECT_GT(found.speed, 0.3);
        EXPECT_GT(found.turnRate, 1.0);
    }
}

TEST_F(RecordedPosesTest, HoldsOrReversesAtTheEnd) {
    const std::string recording = write(record(hand, 4.0));
    Source holds(*this, recording, ", clutch_s: 0.5, at_end: hold"),
        reverses(*this, recording, ", clutch_s: 0.5, at_end: reverse");
    const MotionCommand last = sampleAt(holds, 5.0);
    EXPECT_EQ(last.toolTwist, Vector6::Zero());
    EXPECT_GT((last.tool.position - bench_.tool.position).norm(), 0.05);
    expectSame(last, sampleAt(holds, 1000.0));

    // The length of one pass, from the moment where it turns.
    double pass = 4.2;
    while (sampleAt(holds, pass).toolTwist != Vector6::Zero()) pass += 1e-4;
    for (double t = 0.0; t < pass - 1e-3; t += 0.01) {
        const MotionCommand forth = sampleAt(reverses, t);
        expectSame(forth, sampleAt(holds, t));
        // The pass's end is known to 0.1 ms, so poses agree to that times the speed.
        const MotionCommand back = sampleAt(reverses, 2.0 * pass - t);
        EXPECT_LE((forth.tool.position - back.tool.position).norm(), 3e-4) << t;
        EXPECT_LE((forth.toolTwist + back.toolTwist).norm(), 4e-3) << t;
    }
}

TEST_F(RecordedPosesTest, TurnsAllTheWayRound) {
    Source source(*this,
                  write(record(
                      [](double t) {
                          Pose pose;
                          pose.orientation = calcRotation(Eigen::Vector3d(0.0, 0.6, 0.8) * t);
                          if (std::fmod(t, 0.7) > 0.35)  // q and -q are the same rotation
                              pose.orientation.coeffs() *= -1.0;
                          return pose;
                      },
                      15.0, kPrecise)),
                  ", clutch_s: 0.5");
    expectSmoothMotion(source, 15.0, 1.0);
    for (double t = 0.6; t < 14.0; t += 0.1)
        EXPECT_LE((sampleAt(source, t).toolTwist.tail<3>() - Eigen::Vector3d(0, 0.6, 0.8)).norm(), 1e-6) << t;
}

TEST_F(RecordedPosesTest, SmoothingTakesNoiseOutWithoutDelay) {
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0.0, 0.001);
    const auto noisy = [&](double t) {
        Pose pose = hand(t);
        for (int axis = 0; axis < 3; ++axis) pose.position[axis] += noise(random);
        pose.orientation = calcRotation({noise(random), noise(random), noise(random)}) * pose.orientation;
        return pose;
    };
    const std::string recording = write(record(noisy, 10.0));
    Source raw(*this, recording, ", smoothing_s: 0, clutch_s: 0.5");
    Source smoothed(*this, recording, ", smoothing_s: 0.03, clutch_s: 0.5");
    Vector6 rawError = Vector6::Zero(), smoothedError = Vector6::Zero();
    int count = 0;
    for (double t = 0.6; t < 9.4; t += 0.003, ++count) {
        const double h = 1e-6;
        const Pose before = hand(t - 0.25 - h), after = hand(t - 0.25 + h);
        Vector6 truth;
        truth.head<3>() = (after.position - before.position) / (2 * h);
        truth.tail<3>() = calcTurn(before, after) / (2 * h);
        rawError += (sampleAt(raw, t).toolTwist - truth).cwiseAbs2();
        smoothedError += (sampleAt(smoothed, t).toolTwist - truth).cwiseAbs2();
    }
    for (int axis = 0; axis < 6; ++axis) {
        EXPECT_GT(std::sqrt(rawError[axis] / count), 0.03) << axis;
        EXPECT_LT(std::sqrt(smoothedError[axis] / count), 0.02) << axis;
    }
}

TEST_F(RecordedPosesTest, FollowsAMotionCaptureRecording) {
    if (!std::filesystem::exists(kFreiburg)) GTEST_SKIP() << "the recording " << kFreiburg << " is not there";
    Source source(*this, kFreiburg, ", axes: [0, 0, 1, -1, 0, 0, 0, -1, 0]");
    // 30 s of recording forth, and the beginning of the way back. Acceleration changes from sample
    // to sample with the noise that is left.
    const MotionExtremes found = expectSmoothMotion(source, 40.0, 6.0);
    EXPECT_GT(found.reach, 0.2);
    EXPECT_LT(found.reach, 1.0);
    EXPECT_GT(found.speed, 0.4);
    EXPECT_LT(found.speed, 0.7);
    EXPECT_LT(found.speedJump, 0.010);     // 10 m/s^2
    EXPECT_LT(found.turnRateJump, 0.030);  // 30 rad/s^2
}

TEST_F(RecordedPosesTest, GivesTheSameAfterAResetAndInAnyOrder) {
    const std::string recording = write(record(hand, 4.0));
    Source source(*this, recording, ""), other(*this, recording, "");
    for (double t = 0.0; t < 12.0; t += 0.01) sampleAt(other, t);
    other.reset(bench_.start);
    for (double t : {0.0, 3.0, 7.5, 0.5, 11.0}) expectSame(sampleAt(source, t), sampleAt(other, t));
}

TEST_F(RecordedPosesTest, RefusesTimesThatAreNone) {
    Source source(*this, write(record(hand, 4.0)), "");
    MotionCommand command;
    for (double t : {-1.0, std::nan(""), HUGE_VAL}) EXPECT_EQ(source.sample(t, command), TickStatus::InvalidInput);
    EXPECT_EQ(command.tool.position, Eigen::Vector3d::Zero());  // not written
}

TEST_F(RecordedPosesTest, DoesNotAllocate) {
    Source source(*this, write(record(hand, 4.0)), "");
    expectNoAllocation(bench_, source, 30000);
}

/** The hand, seen but for `gaps` [s, s]. */
std::string recordWithGaps(const std::vector<std::pair<double, double>>& gaps, double duration) {
    std::string text = "time_s,x_m,y_m,z_m,qx,qy,qz,qw\n";
    for (int k = 0; k * 0.01 <= duration; ++k) {
        const double t = k * 0.01;
        const auto isLost = [t](const auto& gap) { return t > gap.first && t < gap.second; };
        if (std::any_of(gaps.begin(), gaps.end(), isLost)) continue;
        const Pose pose = hand(t);
        char row[256];
        std::snprintf(row, sizeof row, "%.2f,%.12f,%.12f,%.12f,%.12f,%.12f,%.12f,%.12f\n", t, pose.position.x(),
                      pose.position.y(), pose.position.z(), pose.orientation.x(), pose.orientation.y(),
                      pose.orientation.z(), pose.orientation.w());
        text += row;
    }
    return text;
}

TEST_F(RecordedPosesTest, TellsAllGapsAtOnce) {
    expectContains(findComplaint(recordWithGaps({{2.0, 14.0}, {16.0, 16.5}, {20.0, 21.0}}, 25.0)),
                   {"poses.txt: 3 gaps, but max_gap_s is 0.2 s: 12 s before line 203, 0.5 s before line 404, "
                    "1 s before line 755",
                    "Set `gaps: hold`"});
    std::vector<std::pair<double, double>> many;
    for (int k = 0; k < 14; ++k) many.emplace_back(1.0 * k, 1.0 * k + 0.305 + 0.01 * k);
    EXPECT_CONTAINS(findComplaint(recordWithGaps(many, 15.0)), "and 4 more, the longest of all 0.44 s");
}

TEST_F(RecordedPosesTest, RestsInGapsAndGoesOnFromWhereItIs) {
    // Three parts; what is seen for 0.3 s only is shorter than the clutch and part of the gap.
    const std::string recording = write(recordWithGaps({{4.0, 10.0}, {10.3, 16.0}, {20.0, 20.3}}, 24.0), "gaps.csv");
    const std::string more = ", gaps: hold, smoothing_s: 0, clutch_s: 0.5";
    Source source(*this, recording, more + ", at_end: hold"), reverses(*this, recording, more);
    const MotionExtremes found = expectSmoothMotion(reverses, 60.0, 1.0);
    EXPECT_LT(found.speedJump, 0.004);
    EXPECT_LT(found.turnRateJump, 0.016);

    const MotionCommand held = sampleAt(source, 4.5);
    EXPECT_EQ(held.toolTwist, Vector6::Zero());
    for (double t = 4.5; t < 16.0; t += 0.01) {
        const MotionCommand now = sampleAt(source, t);
        EXPECT_LE((now.tool.position - held.tool.position).norm(), 1e-12) << t;
        EXPECT_LE(calcTurn(held.tool, now.tool).norm(), 1e-12) << t;
        EXPECT_LE(now.toolTwist.norm(), 1e-12) << t;
    }
    // Each part at its time, half the clutch behind, from where the tool is; the last gap is shorter than the clutch.
    const auto expectPart = [&](double from, double to, double delay) {
        const MotionCommand begin = sampleAt(source, from + delay);
        const Pose first = hand(from);
        for (double t = from + 0.5; t < to - 0.25; t += 0.037) {
            const MotionCommand now = sampleAt(source, t + delay + 0.25);
            const Pose seen = hand(t);
            EXPECT_LE((now.tool.position - begin.tool.position - seen.position + first.position).norm(), 1e-5) << t;
            const Eigen::Quaterniond turn = seen.orientation * first.orientation.conjugate();
            EXPECT_LE(calcRotationVector(turn * begin.tool.orientation * now.tool.orientation.conjugate()).norm(), 1e-4)
                << t;
        }
    };
    expectPart(0.0, 4.0, 0.0);
    expectPart(16.0, 20.0, 0.0);
    expectPart(20.3, 24.0, 0.2);
}

TEST_F(RecordedPosesTest, HoldsNothingWhereThereIsNoGapAndRefusesWhereThereIsOnlyGap) {
    const std::string recording = write(record(hand, 6.0));
    Source plain(*this, recording, ""), holds(*this, recording, ", gaps: hold");
    for (double t = 0.0; t < 20.0; t += 0.1) expectSame(sampleAt(plain, t), sampleAt(holds, t));
    // The part that begins in a gap is the next one.
    Source late(*this, write(recordWithGaps({{2.0, 8.0}}, 12.0), "late.csv"),
                ", gaps: hold, start_s: 5, smoothing_s: 0");
    const Pose first = hand(8.0), then = hand(10.0);
    EXPECT_LE((sampleAt(late, 2.5).tool.position - bench_.tool.position - then.position + first.position).norm(), 1e-5);

    EXPECT_CONTAINS(findComplaint(recordWithGaps({{0.5, 2.0}, {2.805, 5.0}}, 5.4), ", gaps: hold"),
                    "clutch_s = 1 s is longer than the part of the recording in use, 0.8 s (the longest without a "
                    "gap)");
    EXPECT_CONTAINS(findComplaint("0 0 0 0 0 0 0 1\n1e9 0 0 0 0 0 0 1\n2e9 0 0 0 0 0 0 1\n"
                                  "3e9 0 0 0 0 0 0 1\n",
                                  ", gaps: hold"),
                    "no part of the recording without a gap has 4 samples");
    EXPECT_CONTAINS(findComplaint(kGood, ", gaps: skip"), "gaps");
}

TEST_F(RecordedPosesTest, GivesTheSameThroughTheLoader) {
    const std::string recording = write(record(hand, 4.0));
    expectSameAsLibrary<RecordedPoses>(bench_, "recorded_poses", 11.0,
                                       [&](CommandSource& source) { configure(source, recording, ""); });
}

}  // namespace
}  // namespace viable
