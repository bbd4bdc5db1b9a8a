#include "analysis/records/MotionRecord.h"

#include <zlib.h>

#include "LogTestSupport.h"
#include "records/LogExport.h"

namespace viable::test {
namespace {

constexpr double kDegree = kPi / 180.0;

struct MotionRecordTest : LogTestBase {
    MotionRecord read(const std::string& bytes, const MotionRecordOptions& options = {}) const {
        writeBytes(path("record"), bytes);
        return readMotionRecord(path("record"), options);
    }
    std::string refuse(const std::string& bytes, const MotionRecordOptions& options = {}) const {
        return catchError(ErrorKind::BadInput, [&] { read(bytes, options); });
    }
    /** The message without the folder, so that the file is just "record". */
    void expectRefused(const std::string& bytes, const std::string& part,
                       const MotionRecordOptions& options = {}) const {
        std::string text = refuse(bytes, options);
        const std::string folder = folder_.string() + "/";
        for (std::size_t at = 0; (at = text.find(folder)) != std::string::npos;) text.erase(at, folder.size());
        EXPECT_CONTAINS(text, part);
    }
};

using MotionRecordKindTest = MotionRecordTest;
using CsvMotionRecordTest = MotionRecordTest;
using TickLogMotionRecordTest = MotionRecordTest;
using JointStateMotionRecordTest = MotionRecordTest;

void expectSame(const std::vector<double>& a, const std::vector<double>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i)
        EXPECT_TRUE(a[i] == b[i] || (std::isnan(a[i]) && std::isnan(b[i]))) << i << ": " << a[i] << ", " << b[i];
}

// ---- Which kind

TEST_F(MotionRecordKindTest, WhatIsNoRecordIsRefused) {
    expectRefused("", "record: the file is empty");
    expectRefused(std::string("\x7F"
                              "ELF\2\1\1\0",
                              8),
                  "record: neither an MCAP file nor text. Give a log of");
    expectRefused("#ROSBAG V2.0\n", "the file is a bag of ROS 1, which is not read here. Convert it to MCAP");
    expectRefused(std::string("SQLite format 3\0", 16), "`ros2 bag convert`");
    expectRefused("\xFF\xFEt\n", "text in UTF-16, which is not read here. Save it as UTF-8");
    expectRefused("PK\x03\x04", "spreadsheet");
    const auto open = [&](const std::filesystem::path& file) {
        return catchError(ErrorKind::BadInput, [&] { readMotionRecord(file); });
    };
    EXPECT_CONTAINS(open(path("absent")), "cannot be opened: ");
    EXPECT_CONTAINS(open(folder_), "not a file");
}

// ---- CSV

/** `count` lines "k * step_s, q(k)" behind the header; `line` may change them. */
std::string makeCsv(const std::string& header, int count, const std::function<std::string(int)>& line) {
    std::string text = header + "\n";
    for (int k = 0; k < count; ++k) text += line(k) + "\n";
    return text;
}

std::string makeLine(int k) {
    return std::to_string(k) + "," + std::to_string(k) + ".5";
}

TEST_F(CsvMotionRecordTest, UnitsInTheHeaderAreConverted) {
    const MotionRecord record = read(makeCsv(
        "t [ms],a_rad,b (deg),lift_mm,c [deg],rail_m,a_Nm,a_radps,lift [N],lift [m/s],stray_Nm,motor [A],b [deg s^-1]",
        20, [](int k) {
            return std::to_string(100 + 2 * k) + ",0.25,90,1500,-180," + std::to_string(k) + ",7.5,bad,-3,1,1,1,1";
        }));
    EXPECT_EQ(record.source, path("record").string());
    EXPECT_EQ(record.begin, "100");
    EXPECT_EQ(record.robot, "");
    EXPECT_FALSE(record.limits);
    ASSERT_EQ(record.times_s.size(), 20u);
    EXPECT_EQ(record.times_s[0], 0.0);
    EXPECT_DOUBLE_EQ(record.times_s[19], 0.038);
    ASSERT_EQ(record.joints.size(), 5u);
    const std::vector<std::string> names{"a", "b", "lift", "c", "rail"};
    const std::vector<bool> slide{false, false, true, false, true};
    const std::vector<double> last{0.25, 90 * kDegree, 1.5, -180 * kDegree, 19.0};
    for (std::size_t i = 0; i < 5; ++i) {
        EXPECT_EQ(record.joints[i].name, names[i]);
        EXPECT_EQ(record.joints[i].isPrismatic, slide[i]) << names[i];
        ASSERT_EQ(record.joints[i].positions.size(), 20u);
        EXPECT_DOUBLE_EQ(record.joints[i].positions[19], last[i]) << names[i];
        EXPECT_EQ(record.joints[i].torques.size(), i == 0 || i == 2 ? 20u : 0u) << names[i];
    }
    EXPECT_EQ(record.joints[0].torques[4], 7.5);
    EXPECT_EQ(record.joints[2].torques[4], -3.0);
}

TEST_F(CsvMotionRecordTest, EveryUnitOfTimeGivesSeconds) {
    for (const auto& [unit, perSecond] :
         {std::pair("s", 1.0), {"ms", 1e3}, {"us", 1e6}, {"\xC2\xB5s", 1e6}, {"ns", 1e9}}) {
        EXPECT_DOUBLE_EQ(read(makeCsv(std::string("time_") + unit + ",q_rad", 20, makeLine)).times_s[19],
                         19 / perSecond)
            << unit;
    }
}

TEST_F(CsvMotionRecordTest, EverySeparatorAndDialectGivesTheSameRecord) {
    const std::vector<double> times{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20};
    std::vector<double> a = times, b = times;
    for (double& q : a) q += 0.5;
    for (double& q : b) q = -2e-3 * q;
    a[3] = kNan;
    const auto make = [&](const std::string& header, const std::string& separator, const std::string& end,
                          const std::string& missing) {
        std::string text = header + end;
        for (int k = 0; k <= 20; ++k)
            text += std::to_string(k) + separator + (k == 3 ? missing : std::to_string(k) + ".5") + separator +
                    std::to_string(-2 * k) + "e-3" + (k == 20 ? "" : end);
        return text;
    };
    const std::vector<std::string> files{
        make("time_s,a_rad,b_rad", ",", "\n", ""),
        make("time_s,a_rad,b_rad", ",", "\r\n", "nan"),
        make("\xEF\xBB\xBFtime_s;a_rad;b_rad", ";", "\r\n", ""),
        make("time_s\ta_rad\tb_rad", "\t", "\n", ""),
        make("time_s a_rad b_rad", "   ", "\n", "nan"),
        make("t [s] a [rad] b (rad)", " ", "\n", "NaN"),
        make("# time_s a_rad b_rad", " \t", "\n", "-nan"),
        make("# recorded in May, \"by hand\n#\n\n#time_s,a_rad,b_rad", " , ", "\n\n", ""),
        make("# a comment\ntime_s,a_rad,b_rad", ",", "\n# another\n", "\"\""),
        make("\"time_s\",\"a_rad\",\"b_rad\"", ",", "\n", "\"nan\""),
        make("time_s,a_rad,b_rad", ",", ",\n", ""),
        make("time_s,a_rad,b_rad", ",", ",\n,,\n", ""),
    };
    for (const std::string& file : files) {
        SCOPED_TRACE(file.substr(0, 60));
        const MotionRecord record = read(file);
        expectSame(record.times_s, times);
        ASSERT_EQ(record.joints.size(), 2u);
        EXPECT_EQ(record.joints[0].name, "a");
        EXPECT_EQ(record.joints[1].name, "b");
        expectSame(record.joints[0].positions, a);
        for (std::size_t k = 0; k <= 20; ++k) EXPECT_DOUBLE_EQ(record.joints[1].positions[k], b[k]);
    }
}

TEST_F(CsvMotionRecordTest, NamesInQuotesMayHoldAnything) {
    const MotionRecord record =
        read(makeCsv("time_s,\"left, \"\"upper\"\" [deg]\"", 20, [](int k) { return std::to_string(k) + ",\"+90\""; }));
    EXPECT_EQ(record.joints.at(0).name, "left, \"upper\"");
    EXPECT_DOUBLE_EQ(record.joints[0].positions[0], 90 * kDegree);
}

TEST_F(CsvMotionRecordTest, TimesSince1970KeepTheirMicroseconds) {
    const auto check = [&](const MotionRecord& record, double step_s) {
        for (std::size_t k = 0; k < record.times_s.size(); ++k)
            EXPECT_NEAR(record.times_s[k], static_cast<double>(k) * step_s, 1e-9) << k;
    };
    const auto pad = [](int k) { return std::to_string(1000000 + k).substr(1); };  // six digits
    check(read(makeCsv("time_s,q_rad", 50, [&](int k) { return "1305031098." + pad(k) + ",1"; })), 1e-6);
    check(read(makeCsv("time_us,q_rad", 50, [&](int k) { return "1305031098" + pad(k) + ",1"; })), 1e-6);
    check(read(makeCsv("time_ns,q_rad", 50, [&](int k) { return "1305031098600" + pad(k) + ",1"; })), 1e-9);
    EXPECT_EQ(read(makeCsv("time_s,q_rad", 20, [&](int k) { return "1305031098." + pad(k) + ",1"; })).begin,
              "1305031098.000000");
}

TEST_F(CsvMotionRecordTest, ALineAcrossBlocksOfTheFileIsWhole) {
    // Over 2 MiB, so that lines lie across the blocks that are read at once.
    const MotionRecord record = read(
        makeCsv("time_us,q_rad", 150000, [](int k) { return std::to_string(k) + "," + std::to_string(k) + ".25"; }));
    ASSERT_EQ(record.times_s.size(), 150000u);
    for (std::size_t k = 0; k < 150000; ++k) ASSERT_EQ(record.joints[0].positions[k], static_cast<double>(k) + 0.25);
}

TEST_F(CsvMotionRecordTest, BadHeadersAreRefusedWithARemedy) {
    const auto expect = [&](const std::string& header, const std::string& part) {
        SCOPED_TRACE(header);
        expectRefused(makeCsv(header, 20, makeLine), part);
    };
    expect("time_s,joint1",
           "record:1: column 2, `joint1`, does not end in a unit that is known here. Write units such "
           "as `time_s`, `joint1_rad` or `joint1 [deg]`");
    expect("time_s,joint_A", "column 2, `joint_A`, does not end in a unit");  // no current
    expect("time_s,joint_1", "column 2, `joint_1`, does not end in a unit");
    expect("time_s,joint1 [turns]", "column 2, `joint1 [turns]`, does not end in a unit");
    expect("time,q_rad", "Or --columns \"time:s,q_rad:rad\" names the columns to use and their units");
    expect("a_rad,q_rad", "record:1: no column is the time");
    expect("time_s,q_radps", "record:1: no column is the position of a joint");
    expect("time_s,wall_ms", "two columns are times: `time_s` and `wall_ms`. --columns");
    expect("time_s,_rad", "column 2 has a unit and no name");
    expectRefused(makeCsv("time_s,a_rad,a_deg", 20, [](int) { return "1,1,1"; }),
                  "two columns are positions of joint `a`");
    expectRefused(makeCsv("time_s,a_rad,a_Nm,a [Nm]", 20, [](int) { return "1,1,1"; }),
                  "two columns are torques of joint `a`");
    expectRefused(makeCsv("time_s,\"a_rad", 20, makeLine), "record:1:8: a quote is not closed on its line");
    expectRefused("0,1\n1,2\n", "record:1: numbers, and no line before them names their columns. Write a header line");
    expectRefused("# some words\n0,1\n1,2\n", "record:2: numbers, and no line before them");
    expectRefused("# time_s,a_rad\n", "the file has no header and no samples");
    expectRefused("time_s,a_rad\n", "no sample follows the header in line 1");
    expectRefused("\n\ntime_s,a_rad\n# nothing\n", "no sample follows the header in line 3");
    std::string many = "time_s";
    for (int i = 0; i < 300; ++i) many += ",a" + std::to_string(i) + "_rad";
    expect(many, "more than 256 joints");
}

TEST_F(CsvMotionRecordTest, BadLinesAreNamedWithTheirPlace) {
    const auto expect = [&](const std::string& line, const std::string& part) {
        SCOPED_TRACE(line);
        expectRefused(
            makeCsv("time_s,a_rad,b_rad", 30, [&](int k) { return k == 7 ? line : std::to_string(k) + ", 1,2"; }),
            part);
    };
    expect("x,1,2", "record:9:1: `x` is not a number. Correct it, or leave the field empty");
    expect("7,1.5rad,2", "record:9:3: `1.5rad` is not a number");
    expect("7,1, 0x10", "record:9:6: `0x10` is not a number");
    expect("7,1,2 3", "record:9:5: `2 3` is not a number");
    expect("7,1,1e999", "record:9:5: `1e999` is not a number");
    expect("7,+-1,2", "`+-1` is not a number");
    expect(",1,2", "record:9:1: the line has no time");
    expect("nan,1,2", "record:9:1: the time nan is not finite");
    expect("inf,1,2", "record:9:1: the time inf is not finite");
    expect("7,1,-inf", "record:9:5: the reading of joint `b` is infinite. Leave a reading out");
    expect("6,1,2",
           "record:9:1: time 6 comes twice. Times must ascend from sample to sample: sort the samples or correct");
    expect("5.5,1,2", "record:9:1: time 5.5 follows 6. Times must ascend");
    expect("7,1", "record:9: the line has 2 fields, the header in line 1 3");
    expect("7,1,2,3", "record:9: the line has 4 fields");
    expect("7,\"1,2", "record:9:3: a quote is not closed on its line");
    expect("7,\"1\"5,2", "record:9:6: text behind a closed quote");
    expect(std::string(3 << 20, '1'), "record:9: the line is longer than 1048576 bytes");
    // Behind the beginning, which decides on the kind of the file.
    expectRefused(
        makeCsv("time_s,a_rad", 3000, [](int k) { return makeLine(k) + std::string(k == 2500 ? 1 : 0, '\0'); }),
        "record:2502: the line has a zero byte: this is not text");
    expectRefused(makeCsv("time_s;a_rad", 30, [](int k) { return std::to_string(k) + ";1,5"; }),
                  "record:2:3: `1,5` is not a number. Write numbers with a decimal point");
}

TEST_F(CsvMotionRecordTest, TooFewSamplesOrReadingsAreRefused) {
    expectRefused(makeCsv("time_s,a_rad", 19, makeLine),
                  "record: holds 19 samples; at least 20 are needed. Record for longer");
    EXPECT_EQ(read(makeCsv("time_s,a_rad", 20, makeLine)).times_s.size(), 20u);
    expectRefused(makeCsv("time_s,a_rad,b_rad", 40, [](int k) { return makeLine(k) + (k < 19 ? ",1" : ","); }),
                  "record: joint `b` has 19 readings in 40 samples; at least 20 are needed");
}

TEST_F(CsvMotionRecordTest, AJointThatNeverMovesIsRead) {
    expectSame(
        read(makeCsv("time_s,a_rad", 20, [](int k) { return std::to_string(k) + ",1.25"; })).joints.at(0).positions,
        std::vector<double>(20, 1.25));
}

/** As in a public file of a motion capture system, without units. */
std::string makeTrajectory() {
    return makeCsv("# ground truth trajectory\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw", 30, [](int k) {
        return "1305031098." + std::to_string(6000 + 99 * k) + " 1.5 0.25 " + std::to_string(k) + " 0.6 0.6 -0.3 -0.4";
    });
}

TEST_F(CsvMotionRecordTest, ColumnsWithoutUnitsAreReadByAList) {
    expectRefused(makeTrajectory(), "record:3: column 1, `timestamp`, does not end in a unit");
    expectRefused(makeTrajectory(), "Or --columns \"timestamp:s,tx:rad\" names the columns");
    const MotionRecord record = read(makeTrajectory(), {LoggedArm::Real, "timestamp:s, tz:m,tx : mm", ""});
    ASSERT_EQ(record.joints.size(), 2u);
    EXPECT_EQ(record.joints[0].name, "tz");
    EXPECT_TRUE(record.joints[0].isPrismatic);
    EXPECT_EQ(record.joints[0].positions[29], 29.0);
    EXPECT_EQ(record.joints[1].name, "tx");
    EXPECT_EQ(record.joints[1].positions[29], 1.5e-3);
    EXPECT_NEAR(record.times_s[10], 0.099, 1e-9);
}

TEST_F(CsvMotionRecordTest, ItsColumnsAreToldAsTheyAreRead) {
    writeBytes(path("a.csv"), makeCsv("t [ms],b (deg),lift_mm,b_Nm,motor [A]", 20, makeLine));
    std::string told;
    const ColumnTable table = describeColumns(path("a.csv"));
    for (const ColumnTable::Row& row : table.columns) told += row.name + "|" + row.unit + "|" + row.meaning + "\n";
    EXPECT_EQ(table.rows, 20u);
    EXPECT_EQ(told,
              "t [ms]|s|time of the reading\nb (deg)|rad|position of joint b\nlift_mm|m|position of joint lift\n"
              "b_Nm|Nm|torque of joint b\nmotor [A]||not read here\n");
}

TEST_F(CsvMotionRecordTest, TheListReplacesTheUnitsOfTheHeader) {
    const auto line = [](int k) { return std::to_string(k) + ",180,words,4"; };
    const MotionRecord record =
        read(makeCsv("time_s,a_rad,note,a_Nm", 20, line), {LoggedArm::Real, "time_s:ms,a_rad:deg", ""});
    EXPECT_DOUBLE_EQ(record.times_s[19], 0.019);
    EXPECT_EQ(record.joints.at(0).name, "a_rad");  // the name's unit is another: it stays
    EXPECT_DOUBLE_EQ(record.joints[0].positions[0], 180 * kDegree);
    EXPECT_TRUE(record.joints[0].torques.empty());
    // The same unit is no part of the name, so that torques find their joint.
    const MotionRecord same =
        read(makeCsv("time_s,a_rad,note,a_Nm", 20, line), {LoggedArm::Real, "time_s:s,a_rad:rad,a_Nm:Nm", ""});
    EXPECT_EQ(same.joints.at(0).name, "a");
    EXPECT_EQ(same.joints[0].torques.at(0), 4.0);
}

TEST_F(CsvMotionRecordTest, BadListsOfColumnsAreRefused) {
    const auto expect = [&](const std::string& columns, const std::string& part) {
        SCOPED_TRACE(columns);
        expectRefused(makeTrajectory(), part, {LoggedArm::Real, columns, ""});
    };
    expect("timestamp", "--columns: `timestamp` is not a column's name and its unit. Write NAME:UNIT,NAME:UNIT");
    expect("timestamp:s,tx:furlong", "--columns: `tx:furlong` is not");
    expect("timestamp:s,tx:rad/s", "--columns: `tx:rad/s` is not");
    expect("timestamp:s,", "--columns: `` is not");
    expect(":s", "--columns: `:s` is not");
    expect("timestmp:s,tx:m",
           "record:3: --columns names `timestmp`, which is not a column of the header. Did you mean `timestamp`?");
    expect("tx:m", "no column is the time");
    expect("timestamp:s", "no column is the position of a joint");
    expect("timestamp:s,tx:s", "two columns are times");
    expect("timestamp:s,tx:m,tx:m", "two columns are positions of joint `tx`");
    expectRefused(makeCsv("t,a,a", 20, [](int k) { return makeLine(k) + ",1"; }), "two columns have the name `a`",
                  {LoggedArm::Real, "t:s,a:rad", ""});
    expectRefused(makeTrajectory(), "--topic is for MCAP files", {LoggedArm::Real, "timestamp:s,tx:m", "/a"});
}

// ---- Logs of this program

LogOpening makeRunOpening(bool hasRealPlant) {
    LogOpening opening = makeOpening(makeLayout(2, MotionCommand::Space::Joint, hasRealPlant));
    opening.layout.jointNames = {"arm.first", "lift"};
    opening.metadata = {{"robot", "/robots/some"}, {"prismatic_joints", R"(["lift"])"}};
    return opening;
}

std::vector<TickRecord> makeRun(const LogOpening& opening, int count = 60) {
    std::vector<TickRecord> rows = makeRecords(opening.layout, count, 0.01, 5);
    const JointVector ones = JointVector::Ones(2);
    for (int k = 0; k < count; ++k) {
        TickRecord& r = rows[static_cast<std::size_t>(k)];
        r.nominal.q = (JointVector(2) << k, -k).finished();
        r.real.q = r.nominal.q + 0.5 * ones;
        r.motorTorque = 3.0 * r.nominal.q;
        r.limits = {
            {-1.0 * ones, ones}, {-2.0 * ones, 2.0 * ones}, {-3.0 * ones, 3.0 * ones}, {-4.0 * ones, 4.0 * ones}};
        r.limits.jerk.upper[1] = kInfinity;
    }
    rows[5].real.q[1] = kNan;
    return rows;
}

TEST_F(TickLogMotionRecordTest, BothArmsAreRead) {
    const LogOpening opening = makeRunOpening(true);
    const std::vector<TickRecord> rows = makeRun(opening);
    const std::string bytes = makeLog(opening, rows).bytes;
    for (const LoggedArm arm : {LoggedArm::Real, LoggedArm::Nominal}) {
        const bool isReal = arm == LoggedArm::Real;
        const MotionRecord record = read(bytes, {arm, "", ""});
        EXPECT_EQ(record.robot, "/robots/some");
        EXPECT_EQ(record.begin, "0");
        ASSERT_EQ(record.joints.size(), 2u);
        EXPECT_EQ(record.joints[0].name, "arm.first");
        EXPECT_FALSE(record.joints[0].isPrismatic);
        EXPECT_TRUE(record.joints[1].isPrismatic);
        ASSERT_EQ(record.times_s.size(), rows.size());
        for (std::size_t i = 0; i < 2; ++i) {
            std::vector<double> q, tau;
            for (const TickRecord& r : rows) {
                q.push_back((isReal ? r.real.q : r.nominal.q)[static_cast<Eigen::Index>(i)]);
                tau.push_back(r.motorTorque[static_cast<Eigen::Index>(i)]);
            }
            expectSame(record.joints[i].positions, q);
            expectSame(record.joints[i].torques, isReal ? tau : std::vector<double>());
        }
        for (std::size_t k = 0; k < rows.size(); ++k) EXPECT_EQ(record.times_s[k], rows[k].time_s);
        ASSERT_TRUE(record.limits);
        EXPECT_EQ(record.limits->velocity.upper, rows[0].limits.velocity.upper);
        EXPECT_EQ(record.limits->jerk.upper, rows[0].limits.jerk.upper);
    }
}

TEST_F(TickLogMotionRecordTest, LimitsThatChangeOrAreNoNumbersAreLeftOut) {
    const LogOpening opening = makeRunOpening(true);
    std::vector<TickRecord> rows = makeRun(opening);
    rows[40].limits.velocity.lower[1] = -1.0;
    EXPECT_FALSE(read(makeLog(opening, rows).bytes).limits);
    rows = makeRun(opening);
    for (TickRecord& r : rows) r.limits.jerk.lower[0] = kNan;
    EXPECT_FALSE(read(makeLog(opening, rows).bytes).limits);
}

TEST_F(TickLogMotionRecordTest, TheRealArmHasTheLimitsThatTheRunHeldOnIt) {
    LogOpening opening = makeRunOpening(true);
    opening.metadata["real_limits"] = R"({"position_lower":[-5,"-.inf"],"position_upper":[5,".inf"],
        "velocity_lower":[-6,-7],"velocity_upper":[6,7]})";
    const std::string bytes = makeLog(opening, makeRun(opening)).bytes;
    const JointLimits real = *read(bytes).limits;
    EXPECT_EQ(real.position.lower, (JointVector(2) << -5, -kInfinity).finished());
    EXPECT_EQ(real.position.upper, (JointVector(2) << 5, kInfinity).finished());
    EXPECT_EQ(real.velocity.lower, (JointVector(2) << -6, -7).finished());
    EXPECT_EQ(real.velocity.upper, (JointVector(2) << 6, 7).finished());
    EXPECT_EQ(real.acceleration.upper, JointVector::Constant(2, 3.0));
    EXPECT_EQ(read(bytes, {LoggedArm::Nominal, "", ""}).limits->position.upper, JointVector::Constant(2, 1.0));
    for (const char* bad : {"[]", "{", R"({"position_lower":[1]})", R"({"position_lower":[1,"x"]})"}) {
        opening.metadata["real_limits"] = bad;
        expectRefused(makeLog(opening, makeRun(opening)).bytes,
                      "`real_limits` hold no number for each joint at `position_lower`");
    }
}

TEST_F(TickLogMotionRecordTest, WithoutARealArmTheRemedyIsTheNominalOne) {
    const LogOpening opening = makeRunOpening(false);
    const std::string bytes = makeLog(opening, makeRun(opening)).bytes;
    expectRefused(bytes, "record: the log has no real arm. Take the nominal arm: --signal nominal");
    EXPECT_EQ(read(bytes, {LoggedArm::Nominal, "", ""}).joints[1].positions[7], -7.0);
    expectRefused(bytes, "--columns is for CSV files; this file is none. Leave out --columns",
                  {LoggedArm::Nominal, "a:s", ""});
    expectRefused(bytes, "--topic is for MCAP files", {LoggedArm::Nominal, "", "/a"});
}

TEST_F(TickLogMotionRecordTest, ALogThatWasCutOffIsReadAsFarAsItGoes) {
    const LogOpening opening = makeRunOpening(true);
    const WrittenLog log = makeLog(opening, makeRun(opening));
    ASSERT_GT(log.writes.size(), 6u);
    EXPECT_EQ(read(log.bytes.substr(0, log.writes[5] + 20)).times_s.size(), 40u);
    expectRefused(log.bytes.substr(0, log.writes[2] + 20), "holds 10 samples; at least 20");
    expectRefused(log.bytes.substr(0, log.writes[1]), "holds 0 samples");
}

TEST_F(TickLogMotionRecordTest, BadRowsAreNamed) {
    const LogOpening opening = makeRunOpening(true);
    std::vector<TickRecord> rows = makeRun(opening);
    rows[30].time_s = rows[29].time_s;
    expectRefused(makeLog(opening, rows).bytes, "record: row 31: time 0.29 comes twice");
    rows = makeRun(opening);
    rows[30].real.q[1] = kInfinity;
    expectRefused(makeLog(opening, rows).bytes, "record: row 31, time 0.3 s: the reading of joint `lift` is infinite");
    EXPECT_EQ(read(makeLog(opening, rows).bytes, {LoggedArm::Nominal, "", ""}).times_s.size(), 60u);
    rows = makeRun(opening);
    rows[3].time_s = kNan;
    expectRefused(makeLog(opening, rows).bytes, "record: row 4: its time is not a finite number");
}

TEST_F(TickLogMotionRecordTest, TheExportAsCsvHoldsTheSame) {
    const LogOpening opening = makeRunOpening(true);
    const std::string bytes = makeLog(opening, makeRun(opening)).bytes;
    writeBytes(path("run.mcap"), bytes);
    exportCsv(path("run.mcap"), path("run.csv"));
    for (const LoggedArm arm : {LoggedArm::Real, LoggedArm::Nominal}) {
        const MotionRecord log = read(bytes, {arm, "", ""});
        const MotionRecord csv = readMotionRecord(path("run.csv"), {arm, "", ""});
        ASSERT_EQ(csv.joints.size(), 2u);
        expectSame(csv.times_s, log.times_s);
        for (std::size_t i = 0; i < 2; ++i) {
            EXPECT_EQ(csv.joints[i].name, log.joints[i].name);
            EXPECT_EQ(csv.joints[i].isPrismatic, log.joints[i].isPrismatic);
            expectSame(csv.joints[i].positions, log.joints[i].positions);
            expectSame(csv.joints[i].torques, log.joints[i].torques);
        }
    }
    // What the columns mean, of the log and of its CSV.
    const ColumnTable columns = describeColumns(path("run.mcap")), asText = describeColumns(path("run.csv"));
    ASSERT_EQ(asText.columns.size(), columns.columns.size());
    EXPECT_EQ(columns.rows, 60u);
    EXPECT_EQ(asText.rows, 60u);
    std::map<std::string, ColumnTable::Row> rows;
    for (std::size_t i = 0; i < columns.columns.size(); ++i) {
        const ColumnTable::Row& row = columns.columns[i];
        EXPECT_NE(row.meaning, "") << row.name;
        EXPECT_EQ(row.meaning.find("library adds"), std::string::npos) << row.name;
        EXPECT_EQ(asText.columns[i].name, row.name);
        EXPECT_EQ(asText.columns[i].meaning, row.meaning);
        EXPECT_TRUE(asText.columns[i].unit == row.unit || row.unit == "1") << row.name;
        rows[row.name] = row;
    }
    EXPECT_EQ(rows.at("nominal.<joint>.q_m").unit, "m");
    EXPECT_EQ(rows.at("nominal.<joint>.q_rad").unit, "rad");
    EXPECT_EQ(rows.at("tick.status").form, "word");
    expectContains(rows.at("motor.<joint>.tau_N").meaning, {"torque that the motor gave"});
    const LogOpening nominal = makeRunOpening(false);
    writeBytes(path("nominal.mcap"), makeLog(nominal, makeRun(nominal)).bytes);
    exportCsv(path("nominal.mcap"), path("nominal.csv"));
    expectError({"nominal.csv:1: the exported log has no real arm. Take the nominal arm: --signal nominal"},
                [&] { readMotionRecord(path("nominal.csv")); });
}

// ---- Joint states of others

std::string integer(std::uint64_t v, int size) {
    std::string s;
    for (int i = 0; i < size; ++i) s += static_cast<char>(v >> (8 * i));
    return s;
}
std::string text(const std::string& s) {
    return integer(s.size(), 4) + s;
}
std::string makeMcapRecord(int opcode, const std::string& content) {
    return static_cast<char>(opcode) + integer(content.size(), 8) + content;
}

enum class Dialect { Ros1, LittleCdr, BigCdr };

struct State {
    std::uint32_t seconds = 0, nanoseconds = 0;
    std::vector<std::string> names;
    std::vector<double> positions, velocities, efforts;
};

/** The bytes of a sensor_msgs/JointState by the rules of ROS 1 or of CDR. */
std::string encode(const State& state, Dialect dialect) {
    std::string body;
    const auto put = [&](std::uint64_t v, int size) {
        if (dialect != Dialect::Ros1)
            body.resize((body.size() + static_cast<std::size_t>(size) - 1) / static_cast<std::size_t>(size) *
                        static_cast<std::size_t>(size));
        std::string bytes = integer(v, size);
        if (dialect == Dialect::BigCdr) bytes.assign(bytes.rbegin(), bytes.rend());
        body += bytes;
    };
    const auto putText = [&](const std::string& s) {
        put(s.size() + (dialect == Dialect::Ros1 ? 0 : 1), 4);
        body += s;
        if (dialect != Dialect::Ros1) body += '\0';
    };
    if (dialect == Dialect::Ros1) put(77, 4);
    put(state.seconds, 4);
    put(state.nanoseconds, 4);
    putText("base");
    put(state.names.size(), 4);
    for (const std::string& name : state.names) putText(name);
    for (const std::vector<double>* values : {&state.positions, &state.velocities, &state.efforts}) {
        put(values->size(), 4);
        for (const double value : *values) {
            std::uint64_t bits;
            std::memcpy(&bits, &value, sizeof(bits));
            put(bits, 8);
        }
    }
    if (dialect == Dialect::Ros1) return body;
    return std::string("\0", 1) + (dialect == Dialect::BigCdr ? '\0' : '\1') + std::string(2, '\0') + body;
}

/** Frames of stored blocks: what the formats allow, without a compressor. */
std::string packLz4(const std::string& plain) {
    return std::string("\x04\x22\x4D\x18\x60\x70\x73", 7) + integer(plain.size() | 0x80000000u, 4) + plain +
           integer(0, 4);
}
std::string packZstd(const std::string& plain) {
    return std::string("\x28\xB5\x2F\xFD\xA0", 5) + integer(plain.size(), 4) + integer(1 | plain.size() << 3, 3) +
           plain;
}

/** A file as a recorder of joint states makes it. */
class StateFile {
public:
    explicit StateFile(Dialect dialect = Dialect::LittleCdr, const std::string& compression = "")
        : dialect_(dialect), compression_(compression), bytes_("\x89MCAP0\r\n", 8) {
        bytes_ += makeMcapRecord(1, text(dialect == Dialect::Ros1 ? "ros1" : "ros2") + text("a recorder"));
        schema(3, dialect == Dialect::Ros1 ? "sensor_msgs/JointState" : "sensor_msgs/msg/JointState");
        channel(5, 3, "/joint_states");
    }
    void schema(int id, const std::string& name) {
        data_ += makeMcapRecord(3, integer(static_cast<std::uint64_t>(id), 2) + text(name) +
                                       text(dialect_ == Dialect::Ros1 ? "ros1msg" : "ros2msg") + text("..."));
    }
    void channel(int id, int schema, const std::string& topic, std::string encoding = "") {
        if (encoding.empty()) encoding = dialect_ == Dialect::Ros1 ? "ros1" : "cdr";
        data_ += makeMcapRecord(4, integer(static_cast<std::uint64_t>(id), 2) +
                                       integer(static_cast<std::uint64_t>(schema), 2) + text(topic) + text(encoding) +
                                       integer(0, 4));
    }
    void message(int id, std::uint64_t logTime_ns, const std::string& body) {
        data_ += makeMcapRecord(5, integer(static_cast<std::uint64_t>(id), 2) + integer(0, 4) + integer(logTime_ns, 8) +
                                       integer(0, 8) + body);
    }
    void add(const State& state, std::uint64_t logTime_ns = 1, int id = 5) {
        message(id, logTime_ns, encode(state, dialect_));
    }
    void endChunk() {
        if (compression_ == "plain") {
            bytes_ += data_;
        } else {
            const auto crc = static_cast<std::uint64_t>(
                crc32(0, reinterpret_cast<const Bytef*>(data_.data()), static_cast<uInt>(data_.size())));
            const std::string packed = compression_ == "lz4"    ? packLz4(data_)
                                       : compression_ == "zstd" ? packZstd(data_)
                                                                : data_;
            lastChunk = bytes_.size();
            bytes_ += makeMcapRecord(6, integer(0, 8) + integer(0, 8) + integer(data_.size(), 8) + integer(crc, 4) +
                                            text(compression_) + integer(packed.size(), 8) + packed);
        }
        data_.clear();
    }
    std::string finish() {
        endChunk();
        return bytes_ + makeMcapRecord(0x0F, integer(0, 4)) + makeMcapRecord(2, std::string(20, '\0')) +
               std::string("\x89MCAP0\r\n", 8);
    }
    std::size_t lastChunk = 0;  // its offset

private:
    Dialect dialect_;
    std::string compression_, bytes_, data_;
};

State makeState(int k) {
    const double q = 0.25 * k;
    return {1700000000, static_cast<std::uint32_t>(1000 * k + 17), {"a", "b"}, {q, -q}, {1, 2}, {q + 1, q + 2}};
}

struct Encoding {
    Dialect dialect;
    std::string compression;
};
class JointStateEncodings : public MotionRecordTest, public ::testing::WithParamInterface<Encoding> {};

TEST_P(JointStateEncodings, ComeBack) {
    StateFile file(GetParam().dialect, GetParam().compression);
    for (int k = 0; k < 40; ++k) {
        file.add(makeState(k));
        if (k % 15 == 14) file.endChunk();
    }
    const MotionRecord record = read(file.finish());
    EXPECT_EQ(record.begin, "1700000000.000000017");
    EXPECT_EQ(record.robot, "");
    EXPECT_FALSE(record.limits);
    ASSERT_EQ(record.times_s.size(), 40u);
    ASSERT_EQ(record.joints.size(), 2u);
    EXPECT_EQ(record.joints[0].name, "a");
    EXPECT_EQ(record.joints[1].name, "b");
    for (std::size_t k = 0; k < 40; ++k) {
        const double q = 0.25 * static_cast<double>(k);
        EXPECT_NEAR(record.times_s[k], 1e-6 * static_cast<double>(k), 1e-15);
        EXPECT_EQ(record.joints[0].positions[k], q);
        EXPECT_EQ(record.joints[1].positions[k], -q);
        EXPECT_EQ(record.joints[0].torques[k], q + 1);
        EXPECT_EQ(record.joints[1].torques[k], q + 2);
    }
    EXPECT_FALSE(record.joints[0].isPrismatic);
}

INSTANTIATE_TEST_SUITE_P(All, JointStateEncodings,
                         ::testing::Values(Encoding{Dialect::LittleCdr, ""}, Encoding{Dialect::LittleCdr, "plain"},
                                           Encoding{Dialect::LittleCdr, "zstd"}, Encoding{Dialect::LittleCdr, "lz4"},
                                           Encoding{Dialect::BigCdr, ""}, Encoding{Dialect::Ros1, ""},
                                           Encoding{Dialect::Ros1, "lz4"}));

TEST_F(JointStateMotionRecordTest, JointsAreFoundByNameInEveryMessage) {
    StateFile file;
    for (int k = 0; k < 60; ++k) {
        State state = makeState(k);
        if (k % 3 == 1) state.names = {"b", "a"};
        if (k % 3 == 2) state = {state.seconds, state.nanoseconds, {"late"}, {9.0}, {}, {}};
        file.add(state);
    }
    const MotionRecord record = read(file.finish());
    ASSERT_EQ(record.joints.size(), 3u);
    EXPECT_EQ(record.joints[2].name, "late");
    for (std::size_t k = 0; k < 60; ++k) {
        const double q = 0.25 * static_cast<double>(k);
        const std::vector<double> expected = k % 3 == 0   ? std::vector<double>{q, -q, kNan}
                                             : k % 3 == 1 ? std::vector<double>{-q, q, kNan}
                                                          : std::vector<double>{kNan, kNan, 9.0};
        expectSame({record.joints[0].positions[k], record.joints[1].positions[k], record.joints[2].positions[k]},
                   expected);
    }
    EXPECT_EQ(record.joints[0].torques.size(), 60u);
    EXPECT_EQ(record.joints[0].torques[1], 2.25);  // of message 2, which names it second
    EXPECT_TRUE(std::isnan(record.joints[0].torques[2]));
    EXPECT_TRUE(record.joints[2].torques.empty());
}

TEST_F(JointStateMotionRecordTest, AnEffortMissingOnceLeavesTheTorquesOut) {
    StateFile file;
    for (int k = 0; k < 40; ++k) {
        State state = makeState(k);
        if (k == 20) state.efforts.clear();
        file.add(state);
    }
    EXPECT_TRUE(read(file.finish()).joints[0].torques.empty());
}

TEST_F(JointStateMotionRecordTest, WithoutStampsTheLogTimesCount) {
    StateFile file, mixed;
    for (int k = 0; k < 40; ++k) {
        State state = makeState(k);
        state.seconds = state.nanoseconds = 0;
        file.add(state, 1700000000000000000u + 2500u * static_cast<unsigned>(k));
        mixed.add(k == 0 ? state : makeState(k));
    }
    const MotionRecord record = read(file.finish());
    EXPECT_EQ(record.begin, "1700000000.000000000");
    EXPECT_NEAR(record.times_s[39], 39 * 2.5e-6, 1e-15);
    expectRefused(mixed.finish(), "record: message 1 of the topic: its header.stamp is zero, those of others are not");
}

TEST_F(JointStateMotionRecordTest, OneOfSeveralTopicsIsChosenByName) {
    StateFile file;
    file.schema(9, "geometry_msgs/msg/Twist");
    file.channel(1, 9, "/cmd_vel");
    file.channel(6, 3, "/left/joint_states");
    file.channel(7, 3, "/silent/joint_states");  // without messages: no choice
    for (int k = 0; k < 40; ++k) {
        file.message(1, 1, "whatever");
        file.add(makeState(k));
    }
    StateFile both = file;
    for (int k = 0; k < 30; ++k) both.add(makeState(2 * k), 1, 6);
    EXPECT_EQ(read(file.finish()).times_s.size(), 40u);
    const std::string bytes = both.finish();
    expectRefused(bytes,
                  "record: joint states stand on several topics: `/joint_states`, `/left/joint_states`. Choose one "
                  "with --topic, such as --topic /joint_states");
    EXPECT_EQ(read(bytes, {LoggedArm::Real, "", "/joint_states"}).times_s.size(), 40u);
    writeBytes(path("states.mcap"), bytes);
    const ColumnTable columns = describeColumns(path("states.mcap"), {LoggedArm::Real, "", "/joint_states"});
    EXPECT_EQ(columns.rows, 40u);
    EXPECT_EQ(columns.columns[1].unit, "rad");
    EXPECT_EQ(read(bytes, {LoggedArm::Real, "", "/left/joint_states"}).times_s.size(), 30u);
    expectRefused(bytes, "no joint states on the topic `/cmd_vel`; they are on `/joint_states`, `/left/joint_states`",
                  {LoggedArm::Real, "", "/cmd_vel"});
    expectRefused(bytes, "Did you mean `/joint_states`? Name one of these with --topic",
                  {LoggedArm::Real, "", "/joint_sates"});
    expectRefused(bytes, "--columns is for CSV files", {LoggedArm::Real, "a:s", ""});
}

TEST_F(JointStateMotionRecordTest, AFileWithoutJointStatesNamesWhatItHas) {
    StateFile file;
    file.schema(9, "geometry_msgs/msg/Twist");
    file.channel(1, 9, "/cmd_vel");
    file.message(1, 1, "whatever");
    expectRefused(file.finish(),
                  "neither a log of viable nor a file with messages of sensor_msgs/JointState; its "
                  "schemas: `geometry_msgs/msg/Twist`, `sensor_msgs/msg/JointState`");
    StateFile json;
    json.channel(8, 3, "/joint_states", "json");
    expectRefused(json.finish(), "channel `/joint_states` is encoded as `json`; this version reads `cdr` and `ros1`");
    expectRefused(std::string("\x89MCAP0\r\n", 8), "ends within its opening");
}

TEST_F(JointStateMotionRecordTest, BadMessagesAreNamed) {
    const auto expect = [&](const std::function<void(State&)>& spoil, const std::string& part) {
        StateFile file;
        for (int k = 0; k < 40; ++k) {
            State state = makeState(k);
            if (k == 10) spoil(state);
            file.add(state);
        }
        expectRefused(file.finish(), part);
    };
    expect([](State& s) { s.nanoseconds -= 1000; },
           "record: message 11 of the topic: time 1700000000.000009017 comes twice. Times must ascend");
    expect([](State& s) { s.nanoseconds -= 5000; },
           "message 11 of the topic: time 1700000000.000005017 follows 1700000000.000009017");
    expect([](State& s) { s.positions[1] = kInfinity; },
           "message 11 of the topic: the reading of joint `b` is infinite");
    expect([](State& s) { s.efforts[0] = -kInfinity; }, "the reading of joint `a` is infinite");
    expect([](State& s) { s.positions.pop_back(); }, "the message has 1 positions for 2 joints");
    expect([](State& s) { s.efforts.push_back(1); }, "the message has 3 efforts for 2 joints");
    expect([](State& s) { s.names[1] = "a"; }, "the message names joint `a` twice");
    expect([](State& s) { s.names.resize(300); }, "the message names 300 joints; at most 256 are accepted");

    const auto expectBody = [&](const std::string& body, const std::string& part) {
        StateFile file;
        file.message(5, 1, body);
        expectRefused(file.finish(), part);
    };
    const std::string good = encode(makeState(1), Dialect::LittleCdr);
    expectBody(good + std::string(8, '\0'), "the message is longer than a sensor_msgs/JointState");
    expectBody(good.substr(0, good.size() - 1), "needs 16 bytes where only 15 are left");
    std::string long_ = good;
    long_.replace(4 + 8, 4, integer(0xFFFFFFF0u, 4));  // the frame's length
    expectBody(long_, "record: byte 39: in this chunk, record at byte ");
    expectBody(long_, "needs 4294967280 bytes where only");
    expectBody(std::string("\0\7\0\0", 4) + good.substr(4), "the message is CDR of another kind");
    StateFile undeclared;
    undeclared.message(44, 1, good);
    expectRefused(undeclared.finish(), "a message of the undeclared channel 44");
    StateFile late;
    late.message(5, ~std::uint64_t{0}, good);
    expectRefused(late.finish(), "a log time of 18446744073709551615 ns");
    StateFile unnamed;
    for (int k = 0; k < 40; ++k) unnamed.add({1, static_cast<std::uint32_t>(k + 1), {}, {}, {}, {}});
    expectRefused(unnamed.finish(), "the joint states name no joint");
    StateFile few;
    for (int k = 0; k < 19; ++k) few.add(makeState(k));
    expectRefused(few.finish(), "holds 19 samples; at least 20 are needed");
}

TEST_F(JointStateMotionRecordTest, DamageIsNamedWithItsByte) {
    StateFile file(Dialect::LittleCdr, "lz4");
    for (int k = 0; k < 40; ++k) file.add(makeState(k));
    const std::string good = file.finish();
    const std::size_t chunk = file.lastChunk, content = chunk + 9, packed = content + 8 + 8 + 8 + 4 + 4 + 3 + 8;
    const auto spoil = [&](std::size_t at, const std::string& with) {
        std::string bytes = good;
        return bytes.replace(at, with.size(), with);
    };
    const std::string place = "record: byte " + std::to_string(content) + ": ";
    ASSERT_EQ(good.substr(packed, 4), "\x04\x22\x4D\x18");
    expectRefused(spoil(content + 24, "xxxx"),
                  place + "the chunk's checksum differs. The file is damaged; what stands before");
    expectRefused(spoil(packed, "x"), place + "the chunk cannot be decompressed: ");
    expectRefused(spoil(packed + 6, "x"), place + "the chunk cannot be decompressed: ");
    const std::uint64_t plain = good.size() - packed - 15 - 13 - 37;  // frame 7 + 4 + 4, data end, footer and magic
    expectRefused(spoil(packed + 7, integer((plain - 200) | 0x80000000u, 4)),
                  place + "the chunk cannot be decompressed: ");
    expectRefused(spoil(packed + 7, integer((plain + 100) | 0x80000000u, 4)),
                  place + "the chunk cannot be decompressed: ");
    expectRefused(spoil(content + 16, integer(plain - 1, 8)),
                  "the chunk cannot be decompressed: it is longer than it says");
    expectRefused(spoil(content + 16, integer(plain + 1, 8)), "bytes instead of " + std::to_string(plain + 1));
    expectRefused(spoil(content + 32, "lz5"), "compressed by `lz5`; this version reads `zstd`, `lz4` and none");
    // Any bit of the chunk's data.
    for (std::size_t at = packed; at < packed + plain; at += 97) {
        std::string bytes = good;
        bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
        expectRefused(bytes, place);
    }
}

TEST_F(JointStateMotionRecordTest, AFileThatWasCutOffIsReadAsFarAsItGoes) {
    StateFile file(Dialect::LittleCdr, "zstd");
    for (int k = 0; k < 60; ++k) {
        file.add(makeState(k));
        if (k % 25 == 24) file.endChunk();
    }
    const std::string bytes = file.finish();
    EXPECT_EQ(read(bytes.substr(0, bytes.size() - 1)).times_s.size(), 60u);
    EXPECT_EQ(read(bytes.substr(0, file.lastChunk + 50)).times_s.size(), 50u);
}

}  // namespace
}  // namespace viable::test
