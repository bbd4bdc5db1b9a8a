#include "viable/plugin/Parameters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <system_error>

#include "config/ConfigText.h"
#include "core/Complaints.h"
#include "core/Text.h"
#include "plugin/ParameterText.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

std::int64_t toInt64(double bound) {
    // 2^63 is the first double beyond the range.
    if (bound <= -9223372036854775808.0) return std::numeric_limits<std::int64_t>::min();
    if (bound >= 9223372036854775808.0) return std::numeric_limits<std::int64_t>::max();
    return static_cast<std::int64_t>(bound);
}

}  // namespace

namespace detail {

const char* getTypeName(ParameterType type) {
    switch (type) {
        case ParameterType::Number:
            return "number";
        case ParameterType::Integer:
            return "whole number";
        case ParameterType::Flag:
            return "true or false";
        case ParameterType::Choice:
            return "choice";
        case ParameterType::Text:
            return "text";
        case ParameterType::File:
            return "file";
        case ParameterType::JointNumbers:
            return "number or list with one per joint";
        case ParameterType::Numbers:
            return "list of numbers";
        case ParameterType::Rows:
            return "list of lists of numbers";
    }
    return "unknown";
}

std::vector<std::string> splitChoices(const char* choices) {
    std::vector<std::string> names;
    const std::string text = choices ? choices : "";
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find('|', begin), text.size());
        names.push_back(text.substr(begin, end - begin));
        begin = end + 1;
    }
    return names;
}

std::vector<std::string> getWords(const ParameterSpec& spec) {
    const bool mayHave = spec.type == ParameterType::JointNumbers || spec.type == ParameterType::Numbers;
    return mayHave && spec.choices ? splitChoices(spec.choices) : std::vector<std::string>();
}

std::int64_t getSmallest(const ParameterSpec& spec) {
    const double bound = std::ceil(spec.min);
    return toInt64(spec.minIsOpen && bound == spec.min ? bound + 1.0 : bound);
}

std::int64_t getLargest(const ParameterSpec& spec) {
    const double bound = std::floor(spec.max);
    return toInt64(spec.maxIsOpen && bound == spec.max ? bound - 1.0 : bound);
}

}  // namespace detail

namespace {

using detail::getLargest;
using detail::getSmallest;
using detail::getTypeName;
using detail::getWords;
using detail::quoteText;
using detail::splitChoices;

bool hasText(const char* text) {
    return text && *text;
}

bool isTextual(ParameterType type) {
    return type == ParameterType::Text || type == ParameterType::Choice || type == ParameterType::File;
}

std::string nameWithUnit(const ParameterSpec& spec) {
    return "`" + std::string(spec.name) + "`" + (hasText(spec.unit) ? " [" + std::string(spec.unit) + "]" : "");
}

/** The declared default as a node, as if it stood in the block. */
ConfigNode makeDefault(const ParameterSpec& spec, const ConfigNode& block) {
    const std::string keyPath = detail::joinKeyPath(block.keyPath, spec.name);
    const std::string file = std::string("default of ") + spec.name;
    if (isTextual(spec.type) && !*spec.defaultText) {
        ConfigNode node;
        node.kind = ConfigNode::Kind::Scalar;
        node.quoted = true;
        node.file = file;
        node.keyPath = keyPath;
        return node;
    }
    ConfigNode node = detail::parseYaml(spec.defaultText, file, keyPath, 0, false);
    detail::clearLines(node);
    return node;
}

/** True when the command line chose the plugin, and so emptied the block that the file has. */
bool isChosenByOverride(const ConfigNode& block) {
    const ConfigNode* plugin = block.find("plugin");
    return plugin && plugin->file == detail::kOverrideFile;
}

/** The block's place for complaints about what is not written in it. */
std::string describePlace(const ConfigNode& block) {
    if (!isChosenByOverride(block)) return block.place();
    const ConfigNode& plugin = *block.find("plugin");
    return plugin.place() + "=" + plugin.text;
}

/** @param folderOf  node whose file's folder a relative path starts in */
std::filesystem::path toFile(const ConfigNode& node, const ConfigNode& folderOf, const ParameterSpec& spec) {
    namespace fs = std::filesystem;
    const std::string text = toText(node);
    if (text.empty()) {
        if (spec.defaultText && !*spec.defaultText) return {};
        throw badInput(node.place(), "the name of a file is empty", "Name an existing file");
    }
    const fs::path folder = folderOf.file == detail::kOverrideFile ? fs::path() : fs::path(folderOf.file).parent_path();
    std::error_code code;
    const fs::path path = fs::absolute(folder / text, code);
    const std::string shown = "the file " + quoteText(text) + " (" + path.string() + ")";
    const fs::file_status status = fs::status(path, code);
    if (status.type() == fs::file_type::not_found) {
        const bool isLink = fs::is_symlink(fs::symlink_status(path, code));
        throw badInput(node.place(), shown + (isLink ? " is a symbolic link to a missing file" : " does not exist"),
                       folderOf.file == detail::kOverrideFile
                           ? "Relative paths of --set start in the current folder"
                           : "Relative paths start in the folder of the file that names them");
    }
    if (!fs::status_known(status)) {
        throw badInput(node.place(), shown + " cannot be looked at: " + code.message(), "Check its permissions");
    }
    if (!fs::is_regular_file(status)) {
        throw badInput(node.place(), shown + (fs::is_directory(status) ? " is a folder" : " is no regular file"),
                       "Name a file");
    }
    return path;
}

std::vector<std::vector<double>> toRows(const ConfigNode& node, const ParameterSpec& spec) {
    if (node.kind != ConfigNode::Kind::List) {
        throw badInput(node.place(), "must be a list of lists of numbers; it is " + detail::describeNode(node),
                       "Write rows in brackets, such as `[[1, 2], [3, 4]]`");
    }
    std::vector<std::vector<double>> rows;
    rows.reserve(node.items.size());
    detail::Complaints complaints;
    for (const ConfigNode& row : node.items)
        complaints.gather([&] { rows.push_back(toNumbers(row, spec.minCount, spec.maxCount, spec.range())); });
    complaints.throwIfAny(node.place());
    return rows;
}

[[noreturn]] void failPlugin(const std::string& where, const std::string& what) {
    throw Error(ErrorKind::PluginFailed, where, what,
                "This is a mistake in the plugin's code: correct its parameter table");
}

void checkSpecs(const ParameterSpec* specs, std::size_t count, const std::string& where) {
    for (std::size_t i = 0; i < count; ++i) {
        if (!hasText(specs[i].name)) failPlugin(where, "the plugin declares a nameless parameter");
        const std::string name = specs[i].name;
        if (name == "plugin") failPlugin(where, "the plugin declares a parameter named `plugin`");
        for (std::size_t k = 0; k < i; ++k) {
            if (name == specs[k].name) {
                failPlugin(where, "the plugin declares the parameter `" + name + "` twice");
            }
        }
    }
}

template <class T>
const char* getValueName();
template <>
const char* getValueName<double>() {
    return "Number";
}
template <>
const char* getValueName<std::int64_t>() {
    return "Integer";
}
template <>
const char* getValueName<bool>() {
    return "Flag";
}
template <>
const char* getValueName<std::string>() {
    return "Text or Choice";
}
template <>
const char* getValueName<std::filesystem::path>() {
    return "File";
}
template <>
const char* getValueName<JointVector>() {
    return "JointNumbers";
}
template <>
const char* getValueName<std::vector<double>>() {
    return "Numbers";
}
template <>
const char* getValueName<std::vector<std::vector<double>>>() {
    return "Rows";
}

}  // namespace

template <class T>
const T& Parameters::get(const char* name) const {
    const auto entry = values_.find(name);
    if (entry == values_.end()) {
        failPlugin(resolved_.place(),
                   "the plugin asks for the parameter `" + std::string(name) + "`, which it does not declare");
    }
    if (const T* value = std::get_if<T>(&entry->second)) return *value;
    const char* declared =
        std::visit([](const auto& v) { return getValueName<std::decay_t<decltype(v)>>(); }, entry->second);
    failPlugin(resolved_.place(), "the plugin asks for the parameter `" + std::string(name) + "` as " +
                                      getValueName<T>() + ", but declares it as " + declared);
}

double Parameters::number(const char* name) const {
    return get<double>(name);
}
std::int64_t Parameters::integer(const char* name) const {
    return get<std::int64_t>(name);
}
bool Parameters::flag(const char* name) const {
    return get<bool>(name);
}
const std::string& Parameters::text(const char* name) const {
    return get<std::string>(name);
}
const std::filesystem::path& Parameters::file(const char* name) const {
    return get<std::filesystem::path>(name);
}
const JointVector& Parameters::jointNumbers(const char* name) const {
    return get<JointVector>(name);
}
const std::vector<double>& Parameters::numbers(const char* name) const {
    return get<std::vector<double>>(name);
}
const std::vector<std::vector<double>>& Parameters::rows(const char* name) const {
    return get<std::vector<std::vector<double>>>(name);
}

const std::string& Parameters::place(const char* name) const {
    const auto entry = places_.find(name);
    if (entry == places_.end()) {
        failPlugin(resolved_.place(), "the plugin asks for the place of the parameter `" + std::string(name) +
                                          "`, which it does not declare");
    }
    return entry->second;
}

namespace {

/** A word stands in place of numbers. */
bool isWord(const ConfigNode& node, const ParameterSpec& spec) {
    const std::vector<std::string> words = detail::getWords(spec);
    return node.kind == ConfigNode::Kind::Scalar && std::find(words.begin(), words.end(), node.text) != words.end();
}

/** Throws Error (BadInput) for a word that is none of those that may stand there. */
void checkWord(const ConfigNode& node, const ParameterSpec& spec) {
    const std::vector<std::string> words = detail::getWords(spec);
    if (words.empty() || isWord(node, spec) || node.kind != ConfigNode::Kind::Scalar || node.text.empty()) return;
    const bool isLetters =
        std::all_of(node.text.begin(), node.text.end(), [](unsigned char c) { return std::isalpha(c) || c == '_'; });
    if (!isLetters || node.text == "pi") return;
    const std::string closest = findClosestName(node.text, words);
    throw badInput(node.place(), "`" + node.text + "` is neither a number nor `" + detail::join(words, "`, `") + "`",
                   (closest.empty() ? "" : "Did you mean `" + closest + "`? ") + std::string("Write `") +
                       words.front() + "`, or " +
                       (spec.type == ParameterType::JointNumbers ? "a number for all joints or a list with one each."
                                                                 : "a list of numbers."));
}

/** @tparam Value  that of Parameters. @param node  as written, or the default. @param folderOf  see toFile() */
template <class Value>
Value readValue(const ConfigNode& node, const ConfigNode& folderOf, const ParameterSpec& spec, int jointCount,
                const std::string& where) {
    switch (spec.type) {
        case ParameterType::Number:
            return toNumber(node, spec.range());
        case ParameterType::Integer:
            return toInteger(node, getSmallest(spec), getLargest(spec));
        case ParameterType::Flag:
            return toFlag(node);
        case ParameterType::Choice:
            return toChoice(node, splitChoices(spec.choices));
        case ParameterType::Text:
            return toText(node);
        case ParameterType::File:
            return toFile(node, folderOf, spec);
        case ParameterType::JointNumbers:
            checkWord(node, spec);
            return isWord(node, spec) ? JointVector() : toJointVector(node, jointCount, spec.range());
        case ParameterType::Numbers:
            checkWord(node, spec);
            return isWord(node, spec) ? std::vector<double>()
                                      : toNumbers(node, spec.minCount, spec.maxCount, spec.range());
        case ParameterType::Rows:
            return toRows(node, spec);
    }
    failPlugin(where, "the plugin declares the parameter `" + std::string(spec.name) + "` with an unknown type");
}

Error describeMissing(const ConfigNode& block, const ParameterSpec& spec) {
    std::string help = hasText(spec.help) ? spec.help : "no help";
    if (help.back() == '.') help.pop_back();  // the message sets its own
    const bool isChosen = isChosenByOverride(block);
    const std::string entry = isChosen
                                  ? detail::kOverrideFile + (" " + detail::joinKeyPath(block.keyPath, spec.name)) + "="
                                  : std::string(spec.name) + ": ";
    return badInput(describePlace(block), nameWithUnit(spec) + " is missing: " + help,
                    "Add `" + entry + "...` (" + getTypeName(spec.type) + ")" + (isChosen ? "" : " here"));
}

}  // namespace

Parameters readParameters(const ConfigNode& block, const ParameterSpec* specs, std::size_t count, int jointCount) {
    ConfigMap map(block);
    checkSpecs(specs, count, block.place());
    const ConfigNode* plugin = map.find("plugin");
    for (std::size_t i = 0; i < count; ++i) map.find(specs[i].name);
    detail::Complaints complaints;
    const bool isKnown = complaints.gather([&] { map.finish(); });

    Parameters parameters;
    ConfigNode& resolved = parameters.resolved_;
    resolved.kind = ConfigNode::Kind::Map;
    resolved.file = block.file;
    resolved.line = block.line;
    resolved.column = block.column;
    resolved.keyPath = block.keyPath;
    if (plugin) resolved.entries.emplace_back("plugin", *plugin);

    for (std::size_t i = 0; i < count; ++i) {
        const ParameterSpec& spec = specs[i];
        const ConfigNode* written = block.find(spec.name);
        const bool isMissing = !written && !spec.defaultText;
        if (isMissing && !isKnown) continue;  // the misspelt key explains it
        complaints.gather([&] {
            if (isMissing) throw describeMissing(block, spec);
            ConfigNode node = written ? *written : makeDefault(spec, block);
            auto value =
                readValue<Parameters::Value>(node, written ? *written : block, spec, jointCount, block.place());
            if (spec.type == ParameterType::File) {  // the resolved block must mean the same from any folder
                node.text = std::get<std::filesystem::path>(value).string();
                node.quoted = true;
            }
            parameters.values_.emplace(spec.name, std::move(value));
            parameters.places_.emplace(spec.name, written ? written->place() : describePlace(block));
            resolved.entries.emplace_back(spec.name, node);
        });
    }
    complaints.throwIfAny(describePlace(block));
    return parameters;
}

std::string describeParameters(const ParameterSpec* specs, std::size_t count) {
    if (count == 0) return "  (no parameters)\n";
    std::string text;
    for (std::size_t i = 0; i < count; ++i) {
        const ParameterSpec& spec = specs[i];
        text += "  " + std::string(hasText(spec.name) ? spec.name : "(no name)");
        if (hasText(spec.unit)) text += " [" + std::string(spec.unit) + "]";
        text += std::string(": ") + getTypeName(spec.type);
        switch (spec.type) {
            case ParameterType::Choice: {
                std::string names;
                for (const std::string& name : splitChoices(spec.choices)) {
                    names += (names.empty() ? " of " : ", ") + name;
                }
                text += names;
                break;
            }
            case ParameterType::Integer:
                text += " in [" + std::to_string(getSmallest(spec)) + ", " + std::to_string(getLargest(spec)) + "]";
                break;
            case ParameterType::Numbers:
            case ParameterType::Rows:
                text += " (" + std::to_string(spec.minCount);
                if (spec.maxCount != spec.minCount) text += " to " + std::to_string(spec.maxCount);
                text += spec.type == ParameterType::Rows ? " per row)" : ")";
                [[fallthrough]];
            case ParameterType::Number:
            case ParameterType::JointNumbers:
                text += " in " + spec.range().text();
                for (const std::string& word : getWords(spec)) text += ", or " + word;
                break;
            default:
                break;
        }
        if (!spec.defaultText) {
            text += "; required";
        } else {
            text += "; default " + (*spec.defaultText ? std::string(spec.defaultText) : "\"\"");
        }
        text += "\n      " + std::string(spec.help ? spec.help : "") + "\n";
    }
    return text;
}

}  // namespace viable
