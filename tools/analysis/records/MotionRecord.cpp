#include "analysis/records/MotionRecord.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <system_error>

#include "analysis/records/CsvColumns.h"
#include "analysis/records/RecordReaders.h"
#include "records/ColumnMeaning.h"
#include "records/LogExportColumns.h"
#include "records/McapFile.h"

namespace viable {

namespace {

constexpr char kKinds[] = "Give a log of `viable run`, an MCAP file with sensor_msgs/JointState, or a CSV file";

std::string readBeginning(const std::filesystem::path& file) {
    std::error_code problem;
    const std::filesystem::file_status status = std::filesystem::status(file, problem);
    if (!std::filesystem::exists(status))
        throw badInput(file.string(), "cannot be opened: " + (problem ? problem.message() : "no such file"),
                       "Check the path");
    if (!std::filesystem::is_regular_file(status)) throw badInput(file.string(), "not a file", kKinds);
    std::ifstream in(file, std::ios::binary);
    if (!in)
        throw badInput(file.string(), "cannot be opened: " + std::generic_category().message(errno),
                       "Check its permissions");
    std::string bytes(4096, '\0');
    in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (in.bad()) throw badInput(file.string(), "cannot be read: " + std::generic_category().message(errno), "");
    bytes.resize(static_cast<std::size_t>(in.gcount()));
    return bytes;
}

bool beginsWith(std::string_view bytes, std::string_view beginning) {
    return bytes.substr(0, beginning.size()) == beginning;
}

/** Throws for files that are no text, with what helps for the kinds that are often met. */
void checkText(const std::string& file, std::string_view bytes) {
    struct Known {
        std::string_view beginning;
        const char *kind, *remedy;
    };
    static constexpr Known kKnown[] = {
        {"#ROSBAG V", "a bag of ROS 1", "Convert it to MCAP, for example with `mcap convert`"},
        {"SQLite format 3", "an SQLite file", "Convert a bag of ROS 2 to MCAP with `ros2 bag convert`"},
        {"\xFF\xFE", "text in UTF-16", "Save it as UTF-8"},
        {"\xFE\xFF", "text in UTF-16", "Save it as UTF-8"},
        {"PK\x03\x04", "a ZIP file or a spreadsheet", "Unpack it, or save the sheet as CSV"},
        {"\x1F\x8B", "compressed by gzip", "Unpack it first"},
    };
    for (const Known& known : kKnown)
        if (beginsWith(bytes, known.beginning))
            throw badInput(file, std::string("the file is ") + known.kind + ", which is not read here", known.remedy);
    const bool isText = std::all_of(bytes.begin(), bytes.end(), [](char c) {
        return static_cast<unsigned char>(c) >= ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\f';
    });
    if (!isText) throw badInput(file, "neither an MCAP file nor text", kKinds);
}

/** Is it this program's? Its logs declare their channels before the first row. */
bool isTickLog(const std::filesystem::path& file) {
    mcap::McapFile log(file, "The file is damaged");
    bool isOurs = false;
    while (!isOurs && log.nextOfOpening()) {
        if (log.opcode() != mcap::kSchema) continue;
        log.within([&] {
            mcap::ByteReader in(log.content());
            in.readU16();
            isOurs = beginsWith(in.readString(), "viable/msg/");
        });
    }
    return isOurs;
}

void refuseOption(const std::string& given, const char* option, const char* purpose, const std::string& file) {
    if (!given.empty())
        throw badInput(file, std::string(option) + " is for " + purpose + "; this file is none",
                       std::string("Leave out ") + option);
}

enum class FileKind { TickLog, JointStates, Csv };

FileKind findKind(const std::filesystem::path& file, const MotionRecordOptions& options) {
    const std::string name = file.string();
    const std::string bytes = readBeginning(file);
    if (bytes.empty()) throw badInput(name, "the file is empty", kKinds);
    FileKind kind = FileKind::Csv;
    if (beginsWith(bytes, mcap::kMagic))
        kind = isTickLog(file) ? FileKind::TickLog : FileKind::JointStates;
    else
        checkText(name, bytes);
    if (kind != FileKind::JointStates)
        refuseOption(options.topic, "--topic", "MCAP files with sensor_msgs/JointState", name);
    if (kind != FileKind::Csv) refuseOption(options.columns, "--columns", "CSV files", name);
    return kind;
}

MotionRecord readKind(const std::filesystem::path& file, const MotionRecordOptions& options) {
    const FileKind kind = findKind(file, options);
    return kind == FileKind::Csv       ? detail::readCsvRecord(file, options)
           : kind == FileKind::TickLog ? detail::readTickLog(file, options.arm)
                                       : detail::readJointStateLog(file, options.topic);
}

/** A row for each column; those of joints have one together, with <joint> for the name. */
void addColumn(ColumnTable& table, ColumnTable::Row row, const std::vector<std::string>& joints) {
    const std::size_t first = row.name.find('.') + 1, last = row.name.rfind('.');
    const bool isOfJoint =
        first < last && std::find(joints.begin(), joints.end(), row.name.substr(first, last - first)) != joints.end();
    if (isOfJoint) row.name.replace(first, last - first, "<joint>");
    const auto known = std::find_if(table.columns.begin(), table.columns.end(),
                                    [&](const ColumnTable::Row& other) { return other.name == row.name; });
    if (known != table.columns.end())
        ++known->count;
    else
        table.columns.push_back(std::move(row));
}

void addTickLog(const std::filesystem::path& file, ColumnTable& table) {
    LogReader reader(file);
    for (const detail::ExportColumn& column : detail::nameExportColumns(reader, file.string()))
        addColumn(
            table,
            {column.name, column.unit, column.column->isText() ? "word" : "number", detail::explainColumn(column.name)},
            reader.layout().jointNames);
    for (TickRecord record; reader.read(record);) ++table.rows;
}

void addCsv(const std::filesystem::path& file, MotionRecordOptions options, ColumnTable& table) {
    options.arm = LoggedArm::Nominal;  // every log has it
    const std::vector<std::string> header = detail::readCsvHeader(file, table.rows);
    const detail::CsvPlan plan = detail::planCsvColumns(header, options, file.string());
    std::vector<std::string> joints;
    for (const MotionRecord::Joint& joint : plan.joints) joints.push_back(joint.name);
    for (std::size_t i = 0; i < header.size(); ++i) {
        if (options.columns.empty() && detail::isExportedCsv(header)) {
            const detail::ColumnUnit* const unit = detail::findColumnUnit(header[i]);
            addColumn(table, {header[i], unit ? unit->text : "", "text", detail::explainColumn(header[i])}, joints);
            continue;
        }
        static constexpr const char* kUses[] = {"not read here", "time of the reading", "position of joint ",
                                                "torque of joint "};
        static constexpr const char* kUnits[][2] = {{"", ""}, {"s", "s"}, {"rad", "m"}, {"Nm", "N"}};
        const auto use = static_cast<std::size_t>(plan.columns[i].use);
        const MotionRecord::Joint joint = use < 2 ? MotionRecord::Joint() : plan.joints[plan.columns[i].joint];
        table.columns.push_back({header[i], kUnits[use][joint.isPrismatic], "text", kUses[use] + joint.name});
    }
}

}  // namespace

MotionRecord readMotionRecord(const std::filesystem::path& file, const MotionRecordOptions& options) {
    MotionRecord record = readKind(file, options);
    record.source = file.string();
    record.arm = options.arm;
    const std::string least = "; at least " + std::to_string(kLeastSamples) + " are needed";
    if (record.times_s.size() < kLeastSamples)
        throw badInput(record.source, "holds " + std::to_string(record.times_s.size()) + " samples" + least,
                       "Record for longer");
    for (const MotionRecord::Joint& joint : record.joints) {
        const auto readings = static_cast<std::size_t>(
            std::count_if(joint.positions.begin(), joint.positions.end(), [](double q) { return !std::isnan(q); }));
        if (readings < kLeastSamples)
            throw badInput(record.source,
                           "joint `" + joint.name + "` has " + std::to_string(readings) + " readings in " +
                               std::to_string(record.times_s.size()) + " samples" + least,
                           "Record for longer, or leave the joint out");
    }
    return record;
}

ColumnTable describeColumns(const std::filesystem::path& file, const MotionRecordOptions& options) {
    ColumnTable table;
    const FileKind kind = findKind(file, options);
    if (kind == FileKind::TickLog) addTickLog(file, table);
    if (kind == FileKind::Csv) addCsv(file, options, table);
    if (kind != FileKind::JointStates) return table;
    const MotionRecord record = detail::readJointStateLog(file, options.topic);
    table.rows = record.times_s.size();
    table.columns.push_back({"header.stamp", "s", "number", "time of the reading"});
    for (const MotionRecord::Joint& joint : record.joints)
        for (const bool isEffort : {false, true})
            table.columns.push_back(
                {(isEffort ? "effort." : "position.") + joint.name, isEffort ? "Nm" : "rad", "number",
                 std::string(isEffort ? "torque" : "position") +
                     " of the joint; where it slides, which the file does not tell, in " + (isEffort ? "N" : "m")});
    return table;
}

}  // namespace viable
