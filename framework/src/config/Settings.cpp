#include "viable/config/Settings.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <iterator>
#include <system_error>

#include "config/ConfigText.h"
#include "config/ParameterText.h"
#include "core/ErrorList.h"
#include "core/Text.h"

namespace viable {

static std::int64_t toInt64(double bound) {
    // 2^63 is the first double beyond the range.
    if (bound <= -9223372036854775808.0) return std::numeric_limits<std::int64_t>::min();
    if (bound >= 9223372036854775808.0) return std::numeric_limits<std::int64_t>::max();
    return static_cast<std::int64_t>(bound);
}

namespace detail {

std::string writeSetting(double value) {
    if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
    char plain[32];  // 0.0001, where the shortest form is 1e-04
    const char* const end = std::to_chars(plain, plain + sizeof plain, value, std::chars_format::general, 15).ptr;
    double read = 0.0;
    std::from_chars(plain, end, read);
    return read == value ? std::string(plain, static_cast<std::size_t>(end - plain)) : formatNumber(value);
}

std::string writeSetting(const std::vector<double>& value) {
    std::vector<std::string> items;
    for (const double number : value) items.push_back(writeSetting(number));
    return "[" + join(items) + "]";
}

std::string writeSetting(const PerJoint& value) {
    if (value.count() == 1) return writeSetting(value[0]);
    const JointVector all = value.expand(value.count());
    return writeSetting(std::vector<double>(all.begin(), all.end()));
}

std::string writeSetting(const std::vector<std::vector<double>>& value) {
    std::vector<std::string> items;
    for (const std::vector<double>& row : value) items.push_back(writeSetting(row));
    return "[" + join(items) + "]";
}

std::string getWord(const char* words, int index) {
    return splitChoices(words).at(static_cast<std::size_t>(index));
}

bool isEmpty(const SettingValue& value) {
    const auto* joints = std::get_if<JointVector>(&value);
    const auto* numbers = std::get_if<std::vector<double>>(&value);
    return (joints && joints->size() == 0) || (numbers && numbers->empty());
}

int findWord(const char* words, const std::string& word) {
    const std::vector<std::string> all = splitChoices(words);
    return static_cast<int>(std::find(all.begin(), all.end(), word) - all.begin());
}

namespace {

struct TypeNames {
    const char *name, *word;
};
/** In the order of ParameterType. */
constexpr TypeNames kTypes[] = {
    {"number", "number"},
    {"whole number", "integer"},
    {"true or false", "flag"},
    {"choice", "choice"},
    {"text", "text"},
    {"file", "file"},
    {"number or list with one per joint", "joint_numbers"},
    {"list of numbers", "numbers"},
    {"list of lists of numbers", "rows"},
    {"list of texts", "texts"},
    {"number or list with one per joint, or {lower, upper}", "bounds"},
    {"number or list with one per joint, {lower, upper} or {center, half_range}", "positions"},
    {"block", "block"},
    {"list of blocks", "blocks"},
    {"blocks by name", "named"},
};

/** A plugin may have been built with types that are not known here. */
const TypeNames& getNames(ParameterType type) {
    static constexpr TypeNames kUnknown = {"unknown", "unknown"};
    const auto i = static_cast<std::size_t>(type);
    return i < std::size(kTypes) ? kTypes[i] : kUnknown;
}

}  // namespace

const char* getTypeName(ParameterType type) {
    return getNames(type).name;
}
const char* getTypeWord(ParameterType type) {
    return getNames(type).word;
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

using detail::getLargest, detail::getSmallest, detail::getTypeName, detail::getWords, detail::quoteText,
    detail::splitChoices;

bool hasText(const char* text) {
    return text && *text;
}

/** An empty text is one, too. */
bool isFreeText(ParameterType type) {
    return type == ParameterType::Text || type == ParameterType::File;
}

std::string nameWithUnit(const ParameterSpec& spec) {
    return "`" + std::string(spec.name) + "`" + (hasText(spec.unit) ? " [" + std::string(spec.unit) + "]" : "");
}

/** The declared default as a node, as if it stood in the block. */
ConfigNode makeDefault(const ParameterSpec& spec, const ConfigNode& block) {
    const std::string keyPath = detail::joinKeyPath(block.keyPath, spec.name);
    const std::string file = std::string("default of ") + spec.name;
    if (isFreeText(spec.type) && !*spec.defaultText) {
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

/** The block's place for errors about what is not written in it. */
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
    if (!fs::status_known(status))
        throw badInput(node.place(), shown + " cannot be looked at: " + code.message(), "Check its permissions");
    if (!fs::is_regular_file(status))
        throw badInput(node.place(), shown + (fs::is_directory(status) ? " is a folder" : " is no regular file"),
                       "Name a file");
    return path;
}

std::vector<std::vector<double>> toRows(const ConfigNode& node, const ParameterSpec& spec) {
    if (node.kind != ConfigNode::Kind::List)
        throw badInput(node.place(), "must be a list of lists of numbers; it is " + detail::describeNode(node),
                       "Write rows in brackets, such as `[[1, 2], [3, 4]]`");
    std::vector<std::vector<double>> rows;
    rows.reserve(node.items.size());
    detail::ErrorList errors;
    for (const ConfigNode& row : node.items)
        errors.collect([&] { rows.push_back(toNumbers(row, spec.minCount, spec.maxCount, spec.range())); });
    errors.throwIfAny(node.place());
    return rows;
}

JointBounds toBounds(const ConfigNode& node, const ParameterSpec& spec, int n) {
    const NumberRange positive = spec.range();
    NumberRange lowerSide, upperSide;
    lowerSide.mayBeInfinite = upperSide.mayBeInfinite = spec.mayBeInfinite;
    const bool isPosition = spec.type == ParameterType::Positions;
    if (!isPosition) {
        lowerSide.max = upperSide.min = 0.0;
        lowerSide.maxIsOpen = upperSide.minIsOpen = true;
    }
    if (node.kind != ConfigNode::Kind::Map) {
        const JointVector size = toJointVector(node, n, positive);
        return {-size, size};
    }
    ConfigMap map(node);
    const bool isCentered = isPosition && (node.find("center") || node.find("half_range"));
    const char* const first = isCentered ? "center" : "lower";
    const char* const second = isCentered ? "half_range" : "upper";
    if (isPosition && !isCentered)  // they are known, too
        for (const char* key : {"center", "half_range"}) map.find(key);
    map.find(first);
    map.find(second);
    map.finish();  // a misspelt key explains a missing one
    const ConfigNode &one = map.require(first), &other = map.require(second);
    if (!isCentered) return {toJointVector(one, n, lowerSide), toJointVector(other, n, upperSide)};
    const JointVector middle = toJointVector(one, n), half = toJointVector(other, n, positive);
    return {middle - half, middle + half};
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
        for (std::size_t k = 0; k < i; ++k)
            if (name == specs[k].name) failPlugin(where, "the plugin declares the parameter `" + name + "` twice");
    }
}

}  // namespace

const std::string& Parameters::place(const char* name) const {
    const auto entry = places_.find(name);
    if (entry == places_.end())
        failPlugin(resolved_.place(), "the plugin asks for the place of the parameter `" + std::string(name) +
                                          "`, which it does not declare");
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

/** @param node  as written, or the default. @param folderOf  see toFile() */
SettingValue readValue(const ConfigNode& node, const ConfigNode& folderOf, const ParameterSpec& spec, int jointCount,
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
        case ParameterType::Texts: {
            if (node.kind != ConfigNode::Kind::List)
                throw badInput(node.place(), "must be a list of texts; it is " + detail::describeNode(node),
                               "Write `" + std::string(spec.name) + ": [NAME, ...]`");
            std::vector<std::string> texts;
            for (const ConfigNode& item : node.items) texts.push_back(toText(item));
            return texts;
        }
        case ParameterType::Bounds:
        case ParameterType::Positions:
            return toBounds(node, spec, jointCount);
        default:
            break;
    }
    failPlugin(where, "the plugin declares the parameter `" + std::string(spec.name) + "` with an unknown type");
}

/** @param what  is missing */
Error describeMissing(const ConfigNode& block, const ParameterSpec& spec, const std::string& what) {
    std::string help = hasText(spec.help) ? spec.help : "no help";
    if (help.back() == '.') help.pop_back();  // the message sets its own
    const bool isChosen = isChosenByOverride(block);
    const std::string entry = isChosen
                                  ? detail::kOverrideFile + (" " + detail::joinKeyPath(block.keyPath, spec.name)) + "="
                                  : std::string(spec.name) + ": ";
    return badInput(describePlace(block), what + " is missing: " + help,
                    "Add `" + entry + "...` (" + getTypeName(spec.type) + ")" + (isChosen ? "" : " here"));
}

}  // namespace

Parameters readParameters(const ConfigNode& block, const ParameterSpec* specs, std::size_t count, int jointCount) {
    ConfigMap map(block);
    checkSpecs(specs, count, block.place());
    const ConfigNode* plugin = map.find("plugin");
    for (std::size_t i = 0; i < count; ++i) map.find(specs[i].name);
    detail::ErrorList errors;
    const bool isKnown = errors.collect([&] { map.finish(); });

    Parameters parameters;
    parameters.jointCount_ = jointCount;
    ConfigNode& resolved = parameters.resolved_;
    resolved = block;
    resolved.entries.clear();
    if (plugin) resolved.entries.emplace_back("plugin", *plugin);

    for (std::size_t i = 0; i < count; ++i) {
        const ParameterSpec& spec = specs[i];
        const ConfigNode* written = block.find(spec.name);
        const bool isMissing = !written && !spec.defaultText;
        if (isMissing && !isKnown) continue;  // the misspelt key explains it
        const std::string place = written ? written->place() : describePlace(block);
        if (!written && spec.defaultText && !*spec.defaultText && !isFreeText(spec.type)) {  // none
            parameters.places_.emplace(spec.name, place);
            continue;
        }
        errors.collect([&] {
            if (isMissing) throw describeMissing(block, spec, nameWithUnit(spec));
            ConfigNode node = written ? *written : makeDefault(spec, block);
            const SettingValue value = readValue(node, written ? *written : block, spec, jointCount, block.place());
            if (spec.type == ParameterType::File) {  // the resolved block must mean the same from any folder
                node.text = std::get<std::filesystem::path>(value).string();
                node.quoted = true;
            }
            parameters.places_.emplace(spec.name, place);
            resolved.entries.emplace_back(spec.name, node);
        });
    }
    errors.throwIfAny(describePlace(block));
    return parameters;
}

void SettingList::fill(const ConfigNode& block, int jointCount) const {
    for (std::size_t i = 0; i < specs_.size(); ++i) {
        const ParameterSpec& spec = specs_[i];
        const ConfigNode* node = block.find(spec.name);
        if (!node && spec.defaultText && !*spec.defaultText) continue;
        if (!node)
            failPlugin(block.place(),
                       "the plugin asks for the parameter `" + std::string(spec.name) + "`, which it does not declare");
        targets_[i].assign(targets_[i].member, readValue(*node, *node, spec, jointCount, block.place()), spec);
    }
}

void SettingList::readNested(const ParameterSpec& spec, const Target& target, const ConfigNode& node,
                             int jointCount) const {
    detail::ErrorList errors;
    const auto readOne = [&](const ConfigNode& block, const std::string& name) {
        errors.collect([&] { target.readInner(target.member, &block, name, jointCount); });
    };
    std::string keys;
    for (const ParameterSpec& inner : spec.inner()) detail::addItem(keys, inner.name);
    const std::string name = spec.name;
    const auto checkCount = [&](std::size_t count) {
        if (spec.maxCount > 0 && count > static_cast<std::size_t>(spec.maxCount))
            throw badInput(node.place(),
                           "there are " + std::to_string(count) + " " + name + ", possible are up to " +
                               std::to_string(spec.maxCount),
                           "Up to " + std::to_string(spec.maxCount) + ": leave some out, or make one of several.");
    };
    if (spec.type != ParameterType::Block) target.readInner(target.member, nullptr, {}, jointCount);
    if (spec.type == ParameterType::Block) {
        readOne(node, {});
    } else if (spec.type == ParameterType::Named) {
        if (node.kind != ConfigNode::Kind::Map)
            throw badInput(node.place(), "these are no " + name + " by name: " + name + " are entries with a name each",
                           "Write `" + name + ": {NAME: {...}, ...}`, each of " + keys + ".");
        checkCount(node.entries.size());
        for (const auto& [entry, block] : node.entries) readOne(block, entry);
    } else {
        const auto least = static_cast<std::size_t>(spec.minCount);
        if (node.kind != ConfigNode::Kind::List || node.items.size() < least)
            throw badInput(node.place(),
                           name + " must be a list" + (least > 0 ? " with at least one entry" : "") + "; it is " +
                               detail::describeNode(node),
                           "Write a list of {" + keys + "}.");
        checkCount(node.items.size());
        for (const ConfigNode& block : node.items) readOne(block, {});
    }
    errors.throwIfAny(node.place());
}

void SettingList::read(const ConfigNode& block, int jointCount) const {
    ConfigMap map(block);
    for (const ParameterSpec& spec : specs_) map.find(spec.name);
    detail::ErrorList errors;
    const bool isKnown = errors.collect([&] { map.finish(); });
    for (std::size_t i = 0; i < specs_.size(); ++i) {
        const ParameterSpec& spec = specs_[i];
        const ConfigNode* const written = block.find(spec.name);
        errors.collect([&] {
            if (!written && !spec.defaultText && isKnown)
                throw describeMissing(block, spec, "the key " + quoteText(spec.name));
            if (!written) return;  // where a key is not known, it may have been meant
            if (spec.inner)
                readNested(spec, targets_[i], *written, jointCount);
            else
                targets_[i].assign(targets_[i].member, readValue(*written, *written, spec, jointCount, block.place()),
                                   spec);
        });
    }
    errors.throwIfAny(block.place());
}

}  // namespace viable
