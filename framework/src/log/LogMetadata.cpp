#include "log/LogMetadata.h"

#include <algorithm>

#include "core/JsonNumber.h"

namespace viable {

namespace {

using nlohmann::json;
using Names = std::vector<std::string>;

constexpr char kBound[] = "tracking_bound", kObstacles[] = "obstacles", kLinks[] = "links", kPeople[] = "people";

/** The fields that are texts as they stand. */
constexpr std::pair<const char*, std::string LogMetadata::*> kTexts[] = {{"case", &LogMetadata::caseName},
                                                                         {"robot", &LogMetadata::robot},
                                                                         {"version", &LogMetadata::version},
                                                                         {"map_sha256", &LogMetadata::mapSha256}};

// The numbers of a block, one per joint, under their keys in its JSON object.
using Numbers = std::vector<std::pair<const char*, JointVector*>>;
Numbers listNumbers(JointLimits& limits) {
    return {{"position_lower", &limits.position.lower},
            {"position_upper", &limits.position.upper},
            {"velocity_lower", &limits.velocity.lower},
            {"velocity_upper", &limits.velocity.upper}};
}
Numbers listNumbers(LogMetadata::Bound& bound) {
    return {{"position_rad", &bound.position}, {"velocity_radps", &bound.velocity}, {"measured_rad", &bound.measured}};
}

template <class Block>
std::string writeBlock(Block& block) {
    json all;
    for (const auto& [key, values] : listNumbers(block))
        for (const double x : *values) all[key].push_back(detail::makeNumberOrWord(x, detail::kFileInfinity));
    return all.dump();
}

bool readNumber(const json& from, double& x) {
    if (from.is_number())
        x = from.get<double>();
    else if (from == ".inf" || from == "-.inf")
        x = from == ".inf" ? kInfinity : -kInfinity;
    else
        return false;
    return true;
}

/** Reads `text`, or says what is wrong with it. */
template <class Block>
std::string readBlock(const std::string& text, std::size_t joints, std::optional<Block>& to) {
    const json all = json::parse(text, nullptr, false);
    Block block;
    for (const auto& [key, values] : listNumbers(block)) {
        const json list = all.is_object() ? all.value(key, json()) : json();
        bool isList = list.is_array() && list.size() == joints;
        values->resize(static_cast<Eigen::Index>(joints));
        for (std::size_t i = 0; isList && i < joints; ++i)
            isList = readNumber(list[i], (*values)[static_cast<Eigen::Index>(i)]);
        if (!isList) return std::string("hold no number for each joint at `") + key + "`";
    }
    to = block;
    return "";
}

/** No value: not a JSON list of texts. */
std::optional<Names> readNames(const std::string& text) {
    const json list = json::parse(text, nullptr, false);
    const bool isList =
        list.is_array() && std::all_of(list.begin(), list.end(), [](const json& name) { return name.is_string(); });
    return isList ? std::optional(list.get<Names>()) : std::nullopt;
}

}  // namespace

void LogMetadata::refuseDamaged(const std::string& name, const std::string& log) const {
    if (const auto entry = damaged.find(name); entry != damaged.end())
        throw badInput(log, "its metadata `" + name + "` " + entry->second, "The log was not written by viable");
}

std::map<std::string, std::string> writeLogMetadata(LogMetadata metadata) {
    std::map<std::string, std::string> texts;
    for (const auto& [name, field] : kTexts)
        if (!(metadata.*field).empty()) texts[name] = metadata.*field;
    if (!metadata.prismaticJoints.empty()) texts[LogMetadata::kPrismaticJoints] = json(metadata.prismaticJoints).dump();
    if (metadata.realLimits) texts[LogMetadata::kRealLimits] = writeBlock(*metadata.realLimits);
    if (metadata.bound) texts[kBound] = writeBlock(*metadata.bound);
    if (metadata.obstacles) texts[kObstacles] = json(*metadata.obstacles).dump();
    if (metadata.links) texts[kLinks] = json(*metadata.links).dump();
    if (metadata.people) texts[kPeople] = json(*metadata.people).dump();
    for (const auto& [kind, files] : metadata.libraries)
        texts[kind] = files.size() == 1 ? files.front() : json(files).dump();
    return texts;
}

LogMetadata readLogMetadata(const std::map<std::string, std::string>& texts, const Names& joints) {
    LogMetadata metadata;
    for (const auto& [name, text] : texts) {
        std::string wrong;
        const auto known = std::find_if(std::begin(kTexts), std::end(kTexts),
                                        [&n = name](const auto& entry) { return entry.first == n; });
        if (known != std::end(kTexts)) {
            metadata.*known->second = text;
        } else if (name == LogMetadata::kPrismaticJoints) {
            const auto isJoint = [&](const std::string& joint) {
                return std::find(joints.begin(), joints.end(), joint) != joints.end();
            };
            const std::optional<Names> names = readNames(text);
            if (names && std::all_of(names->begin(), names->end(), isJoint))
                metadata.prismaticJoints = *names;
            else
                wrong = "are no JSON list of joints of this log: " + text;
        } else if (name == LogMetadata::kRealLimits) {
            wrong = readBlock(text, joints.size(), metadata.realLimits);
        } else if (name == kBound) {
            wrong = readBlock(text, joints.size(), metadata.bound);
        } else if (name == kObstacles || name == kLinks) {
            (name == kLinks ? metadata.links : metadata.obstacles) = readNames(text);
        } else if (name == kPeople) {
            metadata.people = readNames(text);
        } else {  // the name of a kind of plugin
            metadata.libraries[name] = readNames(text).value_or(Names{text});
        }
        if (!wrong.empty()) metadata.damaged[name] = wrong;
    }
    return metadata;
}

}  // namespace viable
