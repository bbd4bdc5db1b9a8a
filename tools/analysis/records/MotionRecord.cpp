#include "analysis/records/MotionRecord.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <system_error>

#include "analysis/records/RecordReaders.h"
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

MotionRecord readKind(const std::filesystem::path& file, const MotionRecordOptions& options) {
    const std::string name = file.string();
    const std::string bytes = readBeginning(file);
    if (bytes.empty()) throw badInput(name, "the file is empty", kKinds);
    if (!beginsWith(bytes, mcap::kMagic)) {
        checkText(name, bytes);
        refuseOption(options.topic, "--topic", "MCAP files with sensor_msgs/JointState", name);
        return detail::readCsvRecord(file, options);
    }
    refuseOption(options.columns, "--columns", "CSV files", name);
    if (!isTickLog(file)) return detail::readJointStateLog(file, options.topic);
    refuseOption(options.topic, "--topic", "MCAP files with sensor_msgs/JointState", name);
    return detail::readTickLog(file, options.arm);
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

}  // namespace viable
