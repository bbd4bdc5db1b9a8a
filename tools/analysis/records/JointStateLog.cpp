#include <algorithm>
#include <cmath>
#include <set>

#include "analysis/records/RecordReaders.h"
#include "core/Text.h"
#include "records/McapFile.h"

namespace viable::detail {

namespace {

using namespace mcap;

MessageReader openMessage(ByteReader in, bool isCdr) {
    MessageLayout layout = MessageLayout::Ros1;
    if (isCdr) {
        const std::string_view kind = in.take(4);  // the last two bytes are options
        if (kind[0] != 0 || (kind[1] != 0 && kind[1] != 1))
            throw BadBytes(0, "the message is CDR of another kind; this version reads plain CDR");
        layout = kind[1] == 0 ? MessageLayout::BigEndianCdr : MessageLayout::LittleEndianCdr;
    }
    return MessageReader(in.take(in.left()), layout);
}

void readDoubles(MessageReader& in, std::vector<double>& to) {
    const std::uint32_t count = in.readU32();
    if (count > 0) in.align(8);
    in.expect(std::uint64_t{count} * 8);
    to.resize(count);
    for (double& v : to) v = in.readDouble();
}

struct JointState {
    std::int64_t stamp_ns = 0;
    std::vector<std::string_view> names;
    std::vector<double> positions, velocities, efforts;

    void take(MessageReader in, bool hasSequence) {
        if (hasSequence) in.readU32();
        const std::uint32_t seconds = in.readU32(), nanoseconds = in.readU32();
        // Unsigned in ROS 1; in ROS 2 signed, but no clock is before 1970.
        stamp_ns = std::int64_t{seconds} * 1'000'000'000 + nanoseconds;
        in.readText();  // frame
        const std::uint32_t count = in.readU32();
        if (count > kMostJoints)
            throw BadBytes(0, "the message names " + std::to_string(count) + " joints; at most " +
                                  std::to_string(kMostJoints) + " are accepted");
        names.clear();
        for (std::uint32_t i = 0; i < count; ++i) names.push_back(in.readText());
        readDoubles(in, positions);
        readDoubles(in, velocities);
        readDoubles(in, efforts);
        if (in.left() >= 8) throw BadBytes(0, "the message is longer than a sensor_msgs/JointState");
        for (const auto& [what, size] : {std::pair("positions", positions.size()), {"efforts", efforts.size()}})
            if (size != 0 && size != names.size())
                throw BadBytes(0, "the message has " + std::to_string(size) + " " + what + " for " +
                                      std::to_string(names.size()) + " joints");
    }
};

std::string formatStamp(std::int64_t ns) {
    std::string fraction = std::to_string(ns % 1'000'000'000);
    fraction.insert(0, 9 - fraction.size(), '0');
    return std::to_string(ns / 1'000'000'000) + "." + fraction;
}

std::string list(const std::set<std::string>& names) {
    std::string text;
    for (const std::string& name : names) detail::addItem(text, quote(name));
    return text.empty() ? "none" : text;
}

class JointStateLog {
public:
    JointStateLog(const std::filesystem::path& path, const std::string& topic)
        : path_(path.string()),
          file_(path, "The file is damaged; what stands before this byte could be read"),
          topic_(topic) {}

    MotionRecord read() {
        while (file_.next()) {
            file_.within([&] {
                if (file_.opcode() == kSchema) readSchema();
                if (file_.opcode() == kChannel) readChannel();
                if (file_.opcode() == kMessage) readMessage();
            });
        }
        if (topics_.empty())
            throw badInput(path_,
                           "neither a log of viable nor a file with messages of sensor_msgs/JointState; its schemas: " +
                               list(schemaNames_),
                           "Record the topic of the joint states");
        if (topic_.empty() && topics_.size() > 1)
            throw badInput(path_, "joint states stand on several topics: " + list(topics_),
                           "Choose one with --topic, such as --topic " + *topics_.begin());
        if (!topic_.empty() && topics_.count(topic_) == 0) {
            const std::string closest = findClosestName(topic_, {topics_.begin(), topics_.end()});
            throw badInput(path_, "no joint states on the topic " + quote(topic_) + "; they are on " + list(topics_),
                           (closest.empty() ? "" : "Did you mean " + quote(closest) + "? ") +
                               std::string("Name one of these with --topic"));
        }
        setTimes();
        if (record_.joints.empty())
            throw badInput(path_, "the joint states name no joint", "Record a topic with positions");
        for (MotionRecord::Joint& joint : record_.joints)
            for (std::size_t k = 0; k < joint.torques.size(); ++k)
                if (std::isnan(joint.torques[k]) && !std::isnan(joint.positions[k])) {
                    joint.torques.clear();
                    break;
                }
        record_.saysUnits = false;
        return std::move(record_);
    }

private:
    struct Channel {
        std::string topic;
        bool isJointState = false, isCdr = false;
    };

    void readSchema() {
        ByteReader in(file_.content());
        const std::uint16_t id = in.readU16();
        schemaNames_.insert(schemas_[id] = in.readString());
    }

    void readChannel() {
        ByteReader in(file_.content());
        const std::uint16_t id = in.readU16();
        const std::string schema = schemas_[in.readU16()];
        Channel channel;
        channel.topic = in.readString();
        const std::string_view encoding = in.readString();
        channel.isJointState = schema == "sensor_msgs/msg/JointState" || schema == "sensor_msgs/JointState";
        channel.isCdr = encoding == "cdr";
        if (channel.isJointState && !channel.isCdr && encoding != "ros1")
            throw BadBytes(0, "channel " + quote(channel.topic) + " is encoded as " + quote(encoding) +
                                  "; this version reads `cdr` and `ros1`");
        channels_[id] = std::move(channel);
    }

    void readMessage() {
        ByteReader in(file_.content());
        const std::uint16_t id = in.readU16();
        in.readU32();
        const std::uint64_t logTime_ns = in.readU64();
        in.readU64();
        const auto channel = channels_.find(id);
        if (channel == channels_.end()) throw BadBytes(0, "a message of the undeclared channel " + std::to_string(id));
        const auto& [topic, isJointState, isCdr] = channel->second;
        if (!isJointState) return;
        topics_.insert(topic);
        if (topic_.empty() ? topics_.size() > 1 : topic != topic_) return;
        message_.take(openMessage(in, isCdr), !isCdr);
        addRow(logTime_ns);
    }

    void addRow(std::uint64_t logTime_ns) {
        if (logTime_ns > static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max()))
            throw BadBytes(0, "a log time of " + std::to_string(logTime_ns) + " ns");
        stamps_ns_.push_back(message_.stamp_ns);
        logTimes_ns_.push_back(static_cast<std::int64_t>(logTime_ns));
        const std::size_t rows = stamps_ns_.size();
        const bool hasEfforts = !message_.efforts.empty();
        for (std::size_t i = 0; i < message_.positions.size(); ++i) {
            MotionRecord::Joint& joint = findJoint(i);
            if (joint.positions.size() == rows)
                throw BadBytes(0, "the message names joint " + quote(joint.name) + " twice");
            joint.positions.resize(rows - 1, kNan);
            joint.torques.resize(rows - 1, kNan);
            joint.positions.push_back(message_.positions[i]);
            joint.torques.push_back(hasEfforts ? message_.efforts[i] : kNan);
            if (std::isinf(joint.positions.back()) || std::isinf(joint.torques.back()))
                throw infiniteReading(path_ + ": message " + std::to_string(rows) + " of the topic", joint.name);
        }
    }

    /** The joint of the message's i-th entry; messages mostly name the same joints in the same order. */
    MotionRecord::Joint& findJoint(std::size_t i) {
        std::vector<MotionRecord::Joint>& joints = record_.joints;
        const std::string_view name = message_.names[i];
        if (i < joints.size() && joints[i].name == name) return joints[i];
        const auto found =
            std::find_if(joints.begin(), joints.end(), [&](const MotionRecord::Joint& j) { return j.name == name; });
        if (found != joints.end()) return *found;
        if (joints.size() == kMostJoints)
            throw BadBytes(0, "the messages name more than " + std::to_string(kMostJoints) + " joints");
        joints.emplace_back();
        joints.back().name = name;
        return joints.back();
    }

    void setTimes() {
        for (MotionRecord::Joint& joint : record_.joints) {
            joint.positions.resize(stamps_ns_.size(), kNan);
            joint.torques.resize(stamps_ns_.size(), kNan);
        }
        const auto isZero = [](std::int64_t stamp) { return stamp == 0; };
        const bool hasNoStamps = std::all_of(stamps_ns_.begin(), stamps_ns_.end(), isZero);
        const std::vector<std::int64_t>& times = hasNoStamps ? logTimes_ns_ : stamps_ns_;
        record_.begin = formatStamp(times.front());
        for (std::size_t k = 0; k < times.size(); ++k) {
            // The first of them is the zero point, so that nanoseconds survive.
            record_.times_s.push_back(static_cast<double>(times[k] - times.front()) * 1e-9);
            const std::string where = path_ + ": message " + std::to_string(k + 1) + " of the topic";
            if (isZero(times[k]) && !hasNoStamps)
                throw badInput(where, "its header.stamp is zero, those of others are not", "Give all messages a stamp");
            if (k > 0 && !(record_.times_s[k] > record_.times_s[k - 1]))
                throw notAscending(where, formatStamp(times[k - 1]), formatStamp(times[k]));
        }
    }

    std::string path_;
    McapFile file_;
    std::string topic_;  // chosen; empty: the only one
    std::map<std::uint16_t, std::string> schemas_;
    std::set<std::string> schemaNames_, topics_;  // topics: those with joint states
    std::map<std::uint16_t, Channel> channels_;
    JointState message_;
    std::vector<std::int64_t> stamps_ns_, logTimes_ns_;
    MotionRecord record_;
};

}  // namespace

MotionRecord readJointStateLog(const std::filesystem::path& file, const std::string& topic) {
    return JointStateLog(file, topic).read();
}

}  // namespace viable::detail
