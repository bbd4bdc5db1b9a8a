#include "records/LogReader.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "core/Text.h"
#include "log/LimitKinds.h"
#include "log/LogSeries.h"
#include "records/McapFile.h"

namespace viable {

namespace {

using namespace mcap;

constexpr char kRemedy[] =
    "The log is damaged or was not written by viable; what stands before this byte could be read";

bool isTime(const LogChannel& channel, const LogField& field) {
    return channel.name == "tick" && field.name == "time_s";
}

template <class IsThere>
std::vector<LogColumn> listColumns(const LogLayout& layout, const IsThere& isThere) {
    std::vector<LogColumn> columns;
    for (const LogChannel* one : listLogChannels()) {
        const LogChannel& channel = *one;
        for (const LogField& field : channel.fields)
            if (isTime(channel, field) && isThere(channel, field))
                columns.insert(columns.begin(), LogColumn(field.name, field, 0));
        const int n = static_cast<int>(layout.jointNames.size());
        for (int joint = 0; joint < n; ++joint) {
            for (const LogField& field : channel.fields) {
                if (!field.isPerJoint() || !isThere(channel, field)) continue;
                const std::string& name = layout.jointNames[joint];
                columns.emplace_back(channel.name + "." + name + "." + field.name, field, joint);
            }
        }
        for (const LogField& field : channel.fields) {
            if (field.isPerJoint() || isTime(channel, field) || !isThere(channel, field)) continue;
            if (field.kind == LogKind::Vector) {
                for (std::size_t i = 0; i < field.elements.size(); ++i)
                    columns.emplace_back(channel.name + "." + field.elements[i], field, static_cast<int>(i));
            } else {
                columns.emplace_back(channel.name + "." + field.name, field, 0);
            }
        }
    }
    return columns;
}

/** One field of a message as the file's schema declares it. */
struct Step {
    const LogField* field = nullptr;  // null: not known here, skipped
    std::size_t size = 0;             // of one value; 0: string
    bool isSequence = false;
    std::uint32_t count = 1;  // of a fixed array
};

std::optional<std::size_t> findSize(const std::string& type) {
    static const std::map<std::string, std::size_t> sizes = {
        {"bool", 1},  {"byte", 1},   {"char", 1},  {"int8", 1},   {"uint8", 1},   {"int16", 2},   {"uint16", 2},
        {"int32", 4}, {"uint32", 4}, {"int64", 8}, {"uint64", 8}, {"float32", 4}, {"float64", 8}, {"string", 0}};
    const auto found = sizes.find(type);
    if (found == sizes.end()) return std::nullopt;
    return found->second;
}

/** Reads a ros2msg text of plain types. Throws std::runtime_error. */
std::vector<Step> parseSchema(std::string_view text, const LogChannel& channel) {
    std::vector<Step> steps;
    std::set<std::string> names;
    while (!text.empty()) {
        const std::size_t lineEnd = text.find('\n');
        std::string line(text.substr(0, lineEnd));
        text.remove_prefix(lineEnd == std::string_view::npos ? text.size() : lineEnd + 1);
        line.resize(std::min(line.find('#'), line.size()));
        constexpr char kBlank[] = " \t\r";
        const std::size_t typeBegin = line.find_first_not_of(kBlank);
        if (typeBegin == std::string::npos) continue;
        const std::size_t typeEnd = std::min(line.find_first_of(kBlank, typeBegin), line.size());
        const std::size_t nameBegin = line.find_first_not_of(kBlank, typeEnd);
        if (nameBegin == std::string::npos) throw std::runtime_error("has a line without a name");
        const std::size_t nameEnd = std::min(line.find_first_of(" \t\r=", nameBegin), line.size());
        if (line.find('=', typeEnd) != std::string::npos) continue;  // a constant takes no space
        const std::string type = line.substr(typeBegin, typeEnd - typeBegin);
        const std::string name = line.substr(nameBegin, nameEnd - nameBegin);
        if (!names.insert(name).second) throw std::runtime_error("names `" + name + "` twice");

        Step step;
        const std::size_t bracket = type.find('[');
        const std::optional<std::size_t> size = findSize(type.substr(0, bracket));
        bool isKnown = size.has_value();
        if (isKnown) step.size = *size;
        if (bracket != std::string::npos) {
            const std::string inside = type.substr(bracket + 1);
            if (inside == "]" || inside.substr(0, 2) == "<=") {
                step.isSequence = true;
            } else {
                const std::size_t digits = inside.find_first_not_of("0123456789");
                isKnown = isKnown && digits > 0 && digits <= 6 && inside.substr(digits) == "]";
                if (isKnown) step.count = static_cast<std::uint32_t>(std::stoul(inside));
            }
        }
        if (!isKnown) throw std::runtime_error("has the type `" + type + "`, unknown here");
        for (const LogField& field : channel.fields) {
            if (field.getSchemaName() != name) continue;
            if (field.getSchemaType() != type)
                throw std::runtime_error("gives `" + name + "` the type `" + type + "`; this version reads `" +
                                         field.getSchemaType() + "`");
            step.field = &field;
        }
        steps.push_back(step);
    }
    return steps;
}

}  // namespace

std::vector<LogColumn> listColumns(const LogLayout& layout) {
    return listColumns(layout, [&](const LogChannel& channel, const LogField&) { return channel.isLogged(layout); });
}

struct LogReader::Impl {
    struct Schema {
        std::string name, encoding, text;
    };
    struct Plan {
        const LogChannel* channel = nullptr;  // null: somebody else's, skipped
        std::uint32_t bit = 0;
        std::vector<Step> steps;
        bool isOnChange = false;
        std::string body;         // isOnChange: of its last message
        std::uint64_t chunk = 0;  // where that stands: McapFile::chunkCount()
    };

    explicit Impl(const std::filesystem::path& path) : name(path.string()), file(path, kRemedy) {
        while (file.nextOfOpening()) file.within([&] { readRecord(); });
        if (layout.jointNames.empty())
            file.fail(file.isComplete() ? "the log has no channel of this program"
                                        : "the log ends within its opening and holds no rows");
        columns =
            listColumns(layout, [&](const LogChannel&, const LogField& field) { return fields.count(&field) != 0; });
    }

    /** True: with this record `row` is whole. */
    bool readRecord() {
        const std::string_view content = file.content();
        if (file.opcode() == kMessage) return readMessage(content);
        if (file.opcode() == kSchema) readSchema(content);
        if (file.opcode() == kChannel) readChannel(content);
        if (file.opcode() == kMetadata) readMetadata(content);
        if (file.opcode() == kAttachment) readAttachment(content);
        return false;  // others: indices, and what later versions of the format may bring
    }

    void readMetadata(std::string_view bytes) {
        ByteReader in(bytes);
        if (in.readString() != "viable") return;
        metadata = in.readMap();
        const auto kinds = metadata.find(kLimitKindsKey);
        if (kinds != metadata.end()) readLimitKinds(kinds->second);
    }

    void readSchema(std::string_view bytes) {
        ByteReader in(bytes);
        const std::uint16_t id = in.readU16();
        const auto readText = [&] { return std::string(in.readString()); };
        schemas[id] = Schema{readText(), readText(), readText()};
    }

    void readChannel(std::string_view bytes) {
        ByteReader in(bytes);
        const std::uint16_t id = in.readU16();
        const std::uint16_t schemaId = in.readU16();
        const std::string topic(in.readString());
        const std::string encoding(in.readString());
        const std::map<std::string, std::string> entries = in.readMap();
        if (plans.count(id) != 0) return;  // a repetition
        plans[id] = Plan{};

        const auto schema = schemas.find(schemaId);
        const std::vector<const LogChannel*> all = listLogChannels();
        const auto found = std::find_if(all.begin(), all.end(), [&](const LogChannel* c) {
            return schema != schemas.end() && c->getTopic() == topic && c->getSchema() == schema->second.name;
        });
        if (found == all.end()) return;  // somebody else's
        const LogChannel* const channel = *found;
        if (encoding != "cdr" || schema->second.encoding != "ros2msg")
            throw BadBytes(0, "channel " + quote(topic) + " is encoded as " + quote(encoding) + " with a schema in " +
                                  quote(schema->second.encoding) + "; this version reads `cdr` with `ros2msg`");
        Plan plan;
        plan.bit = std::uint32_t{1} << (found - all.begin());
        plan.channel = channel;
        if ((declared & plan.bit) != 0) throw BadBytes(0, "a second channel " + quote(topic));
        try {
            plan.steps = parseSchema(schema->second.text, *channel);
        } catch (const std::runtime_error& e) {
            throw BadBytes(0, "the schema of channel " + quote(topic) + " " + e.what());
        }
        readJointNames(topic, entries);
        for (const Step& step : plan.steps)
            if (step.field != nullptr) fields.insert(step.field);
        if (channel->name == "command")
            layout.commandSpace =
                channel->message == "ToolCommand" ? MotionCommand::Space::Tool : MotionCommand::Space::Joint;
        if (channel->name == "real") layout.hasRealPlant = true;
        if (channel->name == "external") layout.hasExternalTorque = true;
        if (channel->name == "contact") layout.hasContact = true;
        if (channel->name == "touch") layout.hasTouch = true;
        for (const LimitKind kind : listArmLimits())
            if (channel->name == getName(kind, LimitSide::Neither)) layout.limits.set(kind);
        if (channel->name == "live") layout.isLive = true;
        declared |= plan.bit;
        const auto written = entries.find(kWritten);
        plan.isOnChange = written != entries.end();
        if (plan.isOnChange && written->second != kOnChange)
            throw BadBytes(0, "the messages of channel " + quote(topic) + " are written as " + quote(written->second) +
                                  "; this version reads `" + kOnChange + "`");
        if (!plan.isOnChange) expected |= plan.bit;
        Plan& kept = plans[id] = std::move(plan);
        if (kept.isOnChange) onChange.push_back(&kept);
    }

    void readJointNames(const std::string& topic, const std::map<std::string, std::string>& entries) {
        const auto entry = entries.find("joint_names");
        const nlohmann::json json =
            nlohmann::json::parse(entry == entries.end() ? std::string() : entry->second, nullptr, false);
        const bool isList =
            json.is_array() && !json.empty() && json.size() <= static_cast<std::size_t>(kMaxJoints) &&
            std::all_of(json.begin(), json.end(), [](const nlohmann::json& j) { return j.is_string(); });
        if (!isList)
            throw BadBytes(0,
                           "channel " + quote(topic) + " does not name 1 to " + std::to_string(kMaxJoints) + " joints");
        const auto names = json.get<std::vector<std::string>>();
        if (!layout.jointNames.empty() && names != layout.jointNames)
            throw BadBytes(0, "channel " + quote(topic) + " names other joints than the one before");
        layout.jointNames = names;
    }

    void readAttachment(std::string_view content) {
        ByteReader in(content);
        in.readU64();
        in.readU64();
        LogAttachment attachment{std::string(in.readString()), std::string(in.readString()), ""};
        attachment.data = in.take(in.readU64());
        const std::size_t covered = in.position();
        const std::uint32_t crc = in.readU32();
        if (crc != 0 && crc != calcCrc(content.substr(0, covered)))
            throw BadBytes(0, "the checksum of attachment " + quote(attachment.name) + " differs");
        attachments.push_back(std::move(attachment));
    }

    bool readMessage(std::string_view record) {
        ByteReader in(record);
        const std::uint16_t id = in.readU16();
        const std::uint32_t sequence = in.readU32();
        in.readU64();
        in.readU64();
        const auto found = plans.find(id);
        if (found == plans.end()) throw BadBytes(0, "a message of the undeclared channel " + std::to_string(id));
        Plan& plan = found->second;
        if (plan.channel == nullptr) return false;
        if (seen == 0) {
            row = TickRecord();
            rowSequence = sequence;
        } else if (sequence != rowSequence || (seen & plan.bit) != 0) {
            throw BadBytes(0, "row " + std::to_string(rowSequence) + " lacks a channel");
        }
        if (in.take(kCdrLittleEndian.size()) != kCdrLittleEndian)
            throw BadBytes(0, "a message of channel " + quote(plan.channel->getTopic()) + " is not little-endian CDR");
        const std::string_view body = in.take(in.left());
        decodeAll(plan, body);
        if (plan.isOnChange) {
            plan.body = body;
            plan.chunk = file.chunkCount();
        }
        seen |= plan.bit;
        if ((seen & expected) != expected || expected == 0) return false;
        endRow();
        return true;
    }

    /** Gives the row what was not written again. No chunk relies on another, which may be lost. */
    void endRow() {
        for (const Plan* plan : onChange) {
            if ((seen & plan->bit) != 0) continue;
            if (plan->body.empty() || plan->chunk != file.chunkCount())
                throw BadBytes(0, "row " + std::to_string(rowSequence) + " comes before the first message of channel " +
                                      quote(plan->channel->getTopic()) + " in its chunk");
            decodeAll(*plan, plan->body);
        }
        seen = 0;
    }

    void decodeAll(const Plan& plan, std::string_view body) {
        MessageReader in(body, MessageLayout::LittleEndianCdr);
        for (const Step& step : plan.steps) decode(step, in);
    }

    void decode(const Step& step, MessageReader& in) {
        const std::uint32_t count = step.isSequence ? in.readU32() : step.count;
        if (step.field == nullptr) {
            if (step.size == 0) {
                for (std::uint32_t i = 0; i < count; ++i) in.readText();
            } else if (count > 0) {
                in.align(step.size);
                in.skip(std::uint64_t{count} * step.size);
            }
            return;
        }
        const LogField& field = *step.field;
        if (field.isPerJoint() && count != layout.jointNames.size())
            throw BadBytes(0, "`" + field.name + "` has " + std::to_string(count) + " entries for " +
                                  std::to_string(layout.jointNames.size()) + " joints");
        const int n = static_cast<int>(count);
        if (field.isText()) {
            for (int i = 0; i < n; ++i) {
                const std::string_view word = in.readText();
                if (!field.setText(row, i, word)) throw BadBytes(0, "`" + field.name + "` cannot be " + quote(word));
            }
            return;
        }
        if (field.kind == LogKind::Integer) {
            const auto value = static_cast<std::int64_t>(in.readU64());
            if (!field.setInteger(row, value))
                throw BadBytes(0, "`" + field.name + "` cannot be " + std::to_string(value));
        } else if (field.updJoints != nullptr) {
            JointVector& v = field.updJoints(row);
            v.resize(n);
            for (int i = 0; i < n; ++i) v[i] = in.readDouble();
        } else {
            for (int i = 0; i < n; ++i) field.updNumber(row, i) = in.readDouble();
        }
    }

    /** The next file of the log; false: there is none. One that is gone meanwhile, of a run that goes on, is passed over. */
    bool beginNext() {
        std::error_code failed;
        while (!later.empty() && !std::filesystem::exists(later.front(), failed)) later.pop_front();
        if (later.empty()) return false;
        part = std::make_unique<Impl>(later.front());
        if (part->layout.jointNames != layout.jointNames || part->fields != fields)
            throw badInput(later.front().string(), "this is no later file of " + name + ": its columns differ",
                           "Files of another run do not belong into the folder of this one.");
        later.pop_front();
        return true;
    }

    /** Takes follow one another; what is between two rows of one is in a file that has been deleted, or was lost. */
    bool readOfTake(TickRecord& record) {
        bool isFound = takes.count(wantedTake) != 0;
        for (;;) {
            while ((part ? *part : *this).read(record)) {
                if (record.take == wantedTake) {
                    takes.insert(wantedTake);
                    return true;
                }
                if (isFound) return false;
                if (record.take > 0) takes.insert(record.take);
            }
            if (!beginNext()) break;
        }
        if (isFound) return false;
        std::string there;
        for (const std::int64_t take : takes) detail::addItem(there, std::to_string(take));
        throw badInput(name, "the log has no take " + std::to_string(wantedTake),
                       there.empty()
                           ? "It has none: a take is what an operator records on the page of a live arm, from "
                             "one press of `Record` to the next."
                           : "It has " + there + ".");
    }

    bool read(TickRecord& record) {
        while (file.next()) {
            bool isWhole = false;
            file.within([&] { isWhole = readRecord(); });
            if (!isWhole) continue;
            record = row;
            return true;
        }
        if (file.isComplete() && seen != 0) file.fail("the last row lacks a channel");
        return false;
    }

    const std::string name;
    McapFile file;

    std::int64_t wantedTake = 0;              // 0: all rows
    std::set<std::int64_t> takes;             // of the rows so far, where one is wanted
    std::deque<std::filesystem::path> later;  // files of the log that have not been read yet, where one is wanted
    std::unique_ptr<Impl> part;               // the one that is read; null: the first

    LogLayout layout;
    std::map<std::string, std::string> metadata;
    std::vector<LogAttachment> attachments;
    std::vector<LogColumn> columns;
    std::set<const LogField*> fields;  // those that the file has
    std::map<std::uint16_t, Schema> schemas;
    std::map<std::uint16_t, Plan> plans;
    std::vector<const Plan*> onChange;  // those of `plans` that are written on change

    // A row is whole when every channel with a message in each row has given it.
    TickRecord row;
    std::uint32_t rowSequence = 0, seen = 0, expected = 0, declared = 0;
};

LogReader::LogReader(const std::filesystem::path& file) : impl_(std::make_unique<Impl>(file)) {}
LogReader::~LogReader() = default;

const LogLayout& LogReader::layout() const {
    return impl_->layout;
}
const std::string& LogReader::library() const {
    return impl_->file.library();
}
const std::map<std::string, std::string>& LogReader::metadata() const {
    return impl_->metadata;
}
const std::vector<LogAttachment>& LogReader::attachments() const {
    return impl_->attachments;
}
const std::vector<LogColumn>& LogReader::columns() const {
    return impl_->columns;
}
bool LogReader::isComplete() const {
    return impl_->file.isComplete();
}
bool LogReader::read(TickRecord& record) {
    return impl_->wantedTake == 0 ? impl_->read(record) : impl_->readOfTake(record);
}

void LogReader::keepTake(std::int64_t take) {
    impl_->wantedTake = take;
    if (take == 0) return;
    const std::vector<std::filesystem::path> later = LogSeries::listLater(impl_->name);
    impl_->later.assign(later.begin(), later.end());
}

}  // namespace viable
