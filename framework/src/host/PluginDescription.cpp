#include "host/PluginDescription.h"

#include <algorithm>

#include "config/ParameterJson.h"
#include "config/ParameterText.h"
#include "core/Text.h"

namespace viable {

using detail::Json;

/** What may stand there, in a cell of a table. */
static std::string describeValue(const ParameterSpec& spec) {
    const std::string range = spec.range().text();
    const std::string inRange = range != NumberRange().text() ? " in " + range : "";
    std::string orWords;
    for (const std::string& word : detail::getWords(spec)) orWords += ", or `" + word + "`";
    switch (spec.type) {
        case ParameterType::Choice:
            return "`" + detail::join(detail::splitChoices(spec.choices), "`, `") + "`";
        case ParameterType::Integer: {
            const std::int64_t least = detail::getSmallest(spec), most = detail::getLargest(spec);
            std::string text = "whole number";
            if (least != std::numeric_limits<std::int64_t>::min()) text += " from " + std::to_string(least);
            if (most != std::numeric_limits<std::int64_t>::max()) text += " up to " + std::to_string(most);
            return text;
        }
        case ParameterType::Flag:
            return "`true` or `false`";
        case ParameterType::JointNumbers:
            return "number" + inRange + ", or one per joint" + orWords;
        case ParameterType::Numbers:
        case ParameterType::Rows: {
            std::string count = std::to_string(spec.minCount);
            if (spec.maxCount == std::numeric_limits<int>::max())
                count = "at least " + count;
            else if (spec.maxCount != spec.minCount)
                count += " to " + std::to_string(spec.maxCount);
            return (spec.type == ParameterType::Rows ? "list of lists of " : "list of ") + count + " numbers" +
                   inRange + orWords;
        }
        case ParameterType::Number:
            return "number" + inRange;
        default:
            return detail::getTypeName(spec.type);
    }
}

/** Text that cannot end its cell. */
static std::string escapeCell(const char* text) {
    std::string cell;
    for (const char* c = text ? text : ""; *c; ++c) {
        if (*c == '|') cell += '\\';
        cell += *c == '\n' ? ' ' : *c;
    }
    return cell;
}

std::string describePluginsAsJson(const std::vector<PluginInfo>& plugins, const std::vector<RefusedLibrary>& refused,
                                  bool withGuarantees) {
    Json root = {{"plugins", Json::array()}, {"refused", Json::array()}};
    for (const PluginInfo& p : plugins) {
        Json plugin = {
            {"kind", getName(p.kind)}, {"name", p.name}, {"summary", p.summary}, {"library", p.library.string()}};
        if (withGuarantees && p.kind == PluginKind::SafetyFilter)
            plugin["guarantees_limits"] = PluginLoader::create<SafetyFilter>(p)->traits().guarantees.hasJoints();
        plugin["parameters"] = Json::array();
        for (std::uint64_t i = 0; i < p.entry->parameterCount; ++i)
            plugin["parameters"].push_back(detail::describeAsJson(p.entry->parameters[i]));
        root["plugins"].push_back(std::move(plugin));
    }
    for (const RefusedLibrary& r : refused)
        root["refused"].push_back({{"library", r.library.string()}, {"reason", r.reason}});
    return root.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string describeParameters(const ParameterSpec* specs, std::size_t count) {
    if (count == 0) return "  (no parameters)\n";
    std::string text;
    for (std::size_t i = 0; i < count; ++i) {
        const ParameterSpec& spec = specs[i];
        std::string value = describeValue(spec);
        value.erase(std::remove(value.begin(), value.end(), '`'), value.end());
        text += std::string("  ") + spec.name + (*spec.unit ? " [" + std::string(spec.unit) + "]" : "") + ": " + value +
                (!spec.defaultText ? "; required"
                                   : std::string("; default ") + (*spec.defaultText ? spec.defaultText : "\"\"")) +
                "\n      " + spec.help + "\n";
    }
    return text;
}

std::string describeParametersAsMarkdown(const ParameterSpec* specs, std::size_t count) {
    if (count == 0) return "It has no parameters.\n";
    std::string text =
        "| Parameter | Unit | Value | Default | Meaning |\n"
        "|---|---|---|---|---|\n";
    for (std::size_t i = 0; i < count; ++i) {
        const ParameterSpec& spec = specs[i];
        std::string standard = "required";
        if (spec.defaultText) standard = *spec.defaultText ? "`" + escapeCell(spec.defaultText) + "`" : "none";
        text += "| `" + escapeCell(spec.name) + "` | " + escapeCell(spec.unit) + " | " + describeValue(spec) + " | " +
                standard + " | " + escapeCell(spec.help) + " |\n";
    }
    return text;
}

}  // namespace viable
