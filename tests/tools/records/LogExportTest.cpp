#include "records/LogExport.h"

#include "FullDisk.h"
#include "LogTestSupport.h"
#include "Paths.h"

namespace viable::test {
namespace {

using Space = MotionCommand::Space;

class LogExportTest : public LogTestBase {};

/** RFC 4180, written for this test. */
std::vector<std::vector<std::string>> parseCsv(const std::string& text) {
    std::vector<std::vector<std::string>> rows;
    std::vector<std::string> row(1);
    bool quoted = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (quoted) {
            if (c != '"') {
                row.back() += c;
            } else if (i + 1 < text.size() && text[i + 1] == '"') {
                row.back() += text[++i];
            } else {
                quoted = false;
            }
        } else if (c == '"') {
            quoted = true;
        } else if (c == ',') {
            row.emplace_back();
        } else if (c == '\n') {
            rows.push_back(row);
            row.assign(1, "");
        } else {
            row.back() += c;
        }
    }
    EXPECT_EQ(row, std::vector<std::string>(1)) << "the last line has no end";
    return rows;
}

void expectNumber(const std::string& text, double expected) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    EXPECT_EQ(*end, '\0') << text;
    if (std::isnan(expected)) {
        EXPECT_TRUE(std::isnan(value)) << text;
        return;
    }
    EXPECT_EQ(std::memcmp(&value, &expected, sizeof(value)), 0) << text;
}

TEST_F(LogExportTest, HasTheDocumentedColumns) {
    const LogLayout layout = makeLayout(1, Space::Joint, true);
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), {}).bytes);
    exportCsv(path("run.mcap"), path("run.csv"));
    EXPECT_EQ(readBytes(path("run.csv")),
              "time_s,nominal.joint0.q_rad,nominal.joint0.qd_radps,nominal.joint0.qdd_radps2,"
              "nominal.joint0.jerk_radps3,nominal.tool.x_m,nominal.tool.y_m,nominal.tool.z_m,"
              "nominal.tool.qx,nominal.tool.qy,nominal.tool.qz,nominal.tool.qw,"
              "real.joint0.q_rad,real.joint0.qd_radps,actual.joint0.q_rad,actual.joint0.qd_radps,"
              "desired.joint0.tau_Nm,filter.joint0.tau_Nm,filter.joint0.active,"
              "filter.joint0.tau_removed_Nm,filter.joint0.margin_rad,filter.joint0.stop_s,"
              "filter.joint0.rest_rad,"
              "limits.joint0.position_lower_rad,limits.joint0.position_upper_rad,"
              "limits.joint0.velocity_lower_radps,limits.joint0.velocity_upper_radps,"
              "limits.joint0.acceleration_lower_radps2,limits.joint0.acceleration_upper_radps2,"
              "limits.joint0.jerk_lower_radps3,limits.joint0.jerk_upper_radps3,"
              "robust.joint0.tau_Nm,motor.joint0.tau_Nm,"
              "command.joint0.q_rad,command.joint0.qd_radps,tick.status,tick.braking,"
              "tick.missed,tick.stop,tick.substituted,tick.compute_us,tick.command_us,tick.dynamics_us,"
              "tick.controller_us,tick.filter_us,tick.robust_us,tick.plant_us,tick.record_us\n");
    const std::vector<LogColumn> columns = listColumns(layout);
    EXPECT_EQ(columns.size(), 48u);
    EXPECT_EQ(columns.front().name(), "time_s");
}

TEST_F(LogExportTest, ToolRunHasToolCommandAndNoRealArm) {
    const LogLayout layout = makeLayout(1, Space::Tool, false);
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), {}).bytes);
    exportCsv(path("run.mcap"), path("run.csv"));
    const std::string header = readBytes(path("run.csv"));
    expectContains(header, {",command.tool.x_m,command.tool.y_m,command.tool.z_m,command.tool.qx,"
                            "command.tool.qy,command.tool.qz,command.tool.qw,command.tool.vx_mps,"
                            "command.tool.vy_mps,command.tool.vz_mps,command.tool.wx_radps,"
                            "command.tool.wy_radps,command.tool.wz_radps,tick.status"});
    for (const char* absent : {"command.joint0", "real.", "actual.", "robust.", "motor."})
        EXPECT_EQ(header.find(absent), std::string::npos) << absent;
}

TEST_F(LogExportTest, EveryNumberReadsBackBitEqual) {
    for (const Space space : {Space::Joint, Space::Tool}) {
        LogLayout layout = makeLayout(3, space, true);
        layout.jointNames[1] = "the \"elbow\", left";
        const std::string name = space == Space::Joint ? "joint" : "tool";
        const std::vector<TickRecord> records = makeRecords(layout, 1500, 0.001, 41);
        writeBytes(path(name + ".mcap"), makeLog(makeOpening(layout), records).bytes);
        exportCsv(path(name + ".mcap"), path(name + ".csv"));
        const auto rows = parseCsv(readBytes(path(name + ".csv")));
        ASSERT_EQ(rows.size(), records.size() + 1);
        std::map<std::string, std::size_t> column;
        for (std::size_t c = 0; c < rows[0].size(); ++c) column[rows[0][c]] = c;
        ASSERT_EQ(column.size(), rows[0].size());
        ASSERT_EQ(rows[0][0], "time_s");
        for (std::size_t i = 0; i < records.size(); ++i) {
            SCOPED_TRACE(name + ", row " + std::to_string(i));
            const TickRecord& r = records[i];
            const std::vector<std::string>& row = rows[i + 1];
            ASSERT_EQ(row.size(), rows[0].size());
            const auto at = [&](const std::string& columnName) {
                const auto found = column.find(columnName);
                EXPECT_NE(found, column.end()) << columnName;
                return found == column.end() ? std::string() : row[found->second];
            };
            expectNumber(at("time_s"), r.time_s);
            for (std::size_t j = 0; j < 3; ++j) {
                const auto e = static_cast<Eigen::Index>(j);
                const std::string& joint = layout.jointNames[j];
                expectNumber(at("nominal." + joint + ".q_rad"), r.nominal.q[e]);
                expectNumber(at("nominal." + joint + ".qd_radps"), r.nominal.qd[e]);
                expectNumber(at("nominal." + joint + ".qdd_radps2"), r.nominal.qdd[e]);
                expectNumber(at("nominal." + joint + ".jerk_radps3"), r.nominal.jerk[e]);
                expectNumber(at("real." + joint + ".q_rad"), r.real.q[e]);
                expectNumber(at("real." + joint + ".qd_radps"), r.real.qd[e]);
                expectNumber(at("actual." + joint + ".q_rad"), r.actual.q[e]);
                expectNumber(at("actual." + joint + ".qd_radps"), r.actual.qd[e]);
                expectNumber(at("desired." + joint + ".tau_Nm"), r.desiredTorque[e]);
                expectNumber(at("filter." + joint + ".tau_Nm"), r.filterTorque[e]);
                expectNumber(at("robust." + joint + ".tau_Nm"), r.robustTorque[e]);
                expectNumber(at("motor." + joint + ".tau_Nm"), r.motorTorque[e]);
                expectNumber(at("filter." + joint + ".margin_rad"), r.stops[j].margin);
                expectNumber(at("filter." + joint + ".stop_s"), r.stops[j].duration_s);
                expectNumber(at("filter." + joint + ".rest_rad"), r.stops[j].rest);
                expectNumber(at("filter." + joint + ".tau_removed_Nm"), r.removedTorque[e]);
                expectNumber(at("limits." + joint + ".acceleration_lower_radps2"), r.limits.acceleration.lower[e]);
                expectNumber(at("limits." + joint + ".jerk_upper_radps3"), r.limits.jerk.upper[e]);
                if (r.stops[j].margin == std::numeric_limits<double>::infinity())
                    EXPECT_EQ(at("filter." + joint + ".margin_rad"), "inf");
                EXPECT_EQ(at("filter." + joint + ".active"), getName(r.joints[j].limit, r.joints[j].side));
                if (space == Space::Joint) {
                    expectNumber(at("command." + joint + ".q_rad"), r.command.q[e]);
                    expectNumber(at("command." + joint + ".qd_radps"), r.command.qd[e]);
                }
            }
            expectNumber(at("nominal.tool.y_m"), r.tool.position.y());
            expectNumber(at("nominal.tool.qw"), r.tool.orientation.w());
            expectNumber(at("nominal.tool.qx"), r.tool.orientation.x());
            if (space == Space::Tool) {
                expectNumber(at("command.tool.z_m"), r.command.tool.position.z());
                expectNumber(at("command.tool.qz"), r.command.tool.orientation.z());
                expectNumber(at("command.tool.vx_mps"), r.command.toolTwist[0]);
                expectNumber(at("command.tool.wz_radps"), r.command.toolTwist[5]);
            }
            EXPECT_EQ(at("tick.status"), getName(r.status));
            EXPECT_EQ(at("tick.braking"), r.braking ? "1" : "0");
            EXPECT_EQ(at("tick.missed"), r.missed ? "1" : "0");
            EXPECT_EQ(at("tick.stop"), getName(r.verdict));
            EXPECT_EQ(at("tick.substituted"), std::to_string(r.substituted));
            expectNumber(at("tick.compute_us"), r.compute_us);
            expectNumber(at("tick.filter_us"), r.stage_us[static_cast<int>(Stage::Filter)]);
            expectNumber(at("tick.record_us"), r.stage_us[static_cast<int>(Stage::Record)]);
        }
    }
}

TEST_F(LogExportTest, ATakeIsItsRowsAndNoOthersFromAllFilesOfTheLog) {
    LogLayout layout = makeLayout(2, Space::Joint, true);
    layout.isLive = true;
    std::vector<TickRecord> records = makeRecords(layout, 4000, 0.001, 43);
    for (std::size_t i = 0; i < records.size(); ++i)
        records[i].take = i / 1000 == 1 ? 0 : std::min<int>(3, 1 + i / 1000);
    const auto write = [&](const char* name, std::size_t from, std::size_t to) {
        const std::vector<TickRecord> part(records.begin() + static_cast<std::ptrdiff_t>(from),
                                           records.begin() + static_cast<std::ptrdiff_t>(to));
        writeBytes(path(name), makeLog(makeOpening(layout), part).bytes);
    };
    // Take 1: rows 0 to 999; take 3: 2000 to 3999, in three files, of which the second has been deleted.
    write("run.mcap", 0, 2500);
    write("run.part3.mcap", 2500, 3500);
    write("run.part10.mcap", 3500, 4000);
    write("run.party.mcap", 0, 10);
    exportCsv(path("run.mcap"), path("take.csv"), false, 3);
    const auto rows = parseCsv(readBytes(path("take.csv")));
    ASSERT_EQ(rows.size(), 2001u);
    for (std::size_t i = 0; i < 2000; ++i) expectNumber(rows[i + 1][0], records[2000 + i].time_s);
    exportMcap(path("run.mcap"), path("take.mcap"), false, 1);
    LogReader reader(path("take.mcap"));
    EXPECT_EQ(reader.metadata().at("take"), "1");
    std::size_t count = 0;
    for (TickRecord row; reader.read(row); ++count) ASSERT_EQ(getBits(row, layout), getBits(records[count], layout));
    EXPECT_EQ(count, 1000u);
    expectError({"the log has no take 2. It has 1, 3."},
                [&] { exportCsv(path("run.mcap"), path("no.csv"), false, 2); });
    expectError({"It has 1."}, [&] { exportMcap(path("run.party.mcap"), path("no.mcap"), false, 4); });
    for (TickRecord& record : records) record.take = 0;
    write("none.mcap", 0, 4000);
    expectError({"It has none"}, [&] { exportMcap(path("none.mcap"), path("no.mcap"), false, 1); });
    for (const std::string& name : listFolder()) EXPECT_NE(name.rfind("no.", 0), 0u) << name;
}

TEST_F(LogExportTest, ALiveLogOfBeforeTakesIsRecovered) {
    LogLayout layout = makeLayout(2, Space::Joint, true);
    layout.isLive = true;
    std::vector<TickRecord> records = makeRecords(layout, 30, 0.001, 44);
    for (TickRecord& record : records) record.take = 0;
    std::string bytes = makeLog(makeOpening(layout), records).bytes;
    std::uint64_t end = 0;  // where the summary begins; what comes before it is the end of the data: cut off
    std::memcpy(&end, bytes.data() + bytes.size() - 28, sizeof end);
    bytes.resize(end - 13);
    const std::string column = "int64 take\n", other = "int64 none\n";
    std::size_t count = 0;
    for (std::size_t at = 0; (at = bytes.find(column, at)) != std::string::npos; ++count)
        bytes.replace(at, column.size(), other);
    ASSERT_GT(count, 0u);
    writeBytes(path("before.mcap"), bytes);
    {
        const LogReader before(path("before.mcap"));
        EXPECT_EQ(before.columns().size() + 1, listColumns(layout).size());
    }
    EXPECT_EQ(recoverLog(path("before.mcap"), path("now.mcap")), 30u);
    LogReader now(path("now.mcap"));
    EXPECT_EQ(now.columns().size(), listColumns(layout).size());
    std::size_t row = 0;
    for (TickRecord record; now.read(record); ++row) ASSERT_EQ(getBits(record, layout), getBits(records[row], layout));
    EXPECT_EQ(row, 30u);
}

// A log of November 2026 and what viable exported from it then: limits in each row, chunks of Zstandard.
TEST_F(LogExportTest, AnOldLogGivesWhatItGave) {
    const std::filesystem::path folder = VIABLE_SOURCE_DIR "/tests/tools/records";
    const std::string then = readBytes(folder / "before_limits_on_change.csv");
    exportCsv(folder / "before_limits_on_change.mcap", path("now.csv"));
    EXPECT_TRUE(readBytes(path("now.csv")) == then);

    // Its copies in the forms of today say the same.
    EXPECT_EQ(recoverLog(folder / "before_limits_on_change.mcap", path("recovered.mcap")), 40u);
    exportCsv(path("recovered.mcap"), path("recovered.csv"));
    EXPECT_TRUE(readBytes(path("recovered.csv")) == then);
    exportMcap(path("recovered.mcap"), path("open.mcap"));
    exportCsv(path("open.mcap"), path("open.csv"));
    EXPECT_TRUE(readBytes(path("open.csv")) == then);
    recoverLog(path("open.mcap"), path("again.mcap"));
    EXPECT_TRUE(readBytes(path("again.mcap")) == readBytes(path("recovered.mcap")));
}

TEST_F(LogExportTest, ALogThatWasCutOffGivesItsRows) {
    const LogLayout layout = makeLayout(2, Space::Joint, false);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 400, 0.001, 42));
    writeBytes(path("cut.mcap"), log.bytes.substr(0, log.writes[4] + 50));
    exportCsv(path("cut.mcap"), path("cut.csv"));
    EXPECT_EQ(parseCsv(readBytes(path("cut.csv"))).size(), 301u);
}

TEST_F(LogExportTest, NothingIsOverwrittenAndNothingIsLeft) {
    const LogLayout layout = makeLayout(2, Space::Joint, false);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 4000, 0.001, 43));
    writeBytes(path("run.mcap"), log.bytes);
    writeBytes(path("run.csv"), "mine");
    EXPECT_EQ(catchError(ErrorKind::BadInput, [&] { exportCsv(path("run.mcap"), path("run.csv")); }),
              path("run.csv").string() +
                  ": the file exists already and is never overwritten. Choose another name or move "
                  "the old file away");
    EXPECT_EQ(readBytes(path("run.csv")), "mine");

    std::string damaged = log.bytes;
    damaged[log.writes[30] + 200] = static_cast<char>(damaged[log.writes[30] + 200] ^ 4);
    writeBytes(path("bad.mcap"), damaged);
    expectError({"bad.mcap: byte "}, [&] { exportCsv(path("bad.mcap"), path("bad.csv")); });
    expectError({"absent/run.csv: the file cannot be written: No such file"}, ErrorKind::LogNotWritten,
                [&] { exportCsv(path("run.mcap"), path("absent/run.csv")); });
    {
        const FullDisk disk(1'500'000);
        expectError({"full.csv: the file cannot be written: File too large"}, ErrorKind::LogNotWritten,
                    [&] { exportCsv(path("run.mcap"), path("full.csv")); });
    }
    EXPECT_EQ(listFolder(), (std::vector<std::string>{"bad.mcap", "run.csv", "run.mcap"}));
}

}  // namespace
}  // namespace viable::test
