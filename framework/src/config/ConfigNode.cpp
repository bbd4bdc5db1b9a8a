#include "viable/config/ConfigNode.h"

#include <algorithm>

#include "config/ConfigText.h"
#include "core/ErrorList.h"
#include "core/Text.h"

namespace viable {

namespace {

using detail::describeNode;
using detail::quoteText;

/** The key path of a node that moves to another place, and of all below it. */
void setKeyPath(ConfigNode& node, const std::string& keyPath) {
    node.keyPath = keyPath;
    for (std::size_t i = 0; i < node.items.size(); ++i)
        setKeyPath(node.items[i], keyPath + "[" + std::to_string(i) + "]");
    for (auto& [key, value] : node.entries) setKeyPath(value, detail::joinKeyPath(keyPath, key));
}

/** A step of a path: a key of a map, or an index into a list. */
struct Step {
    std::string key;
    int index = -1;  // >= 0: an index
};

std::vector<Step> splitPath(const std::string& path, const std::string& where) {
    const std::string remedy = "Write it as `key.path=value`, such as `cases.C2.filter.gamma=3`";
    std::vector<Step> steps;
    std::size_t begin = 0;
    while (true) {
        const std::size_t end = std::min(path.find('.', begin), path.size());
        std::string key = path.substr(begin, end - begin);
        std::vector<int> indices;
        while (!key.empty() && key.back() == ']') {
            const std::size_t open = key.rfind('[');
            const std::string digits = open == std::string::npos ? "" : key.substr(open + 1, key.size() - open - 2);
            if (digits.empty() || digits.size() > 6 || digits.find_first_not_of("0123456789") != std::string::npos)
                throw badInput(where, "the key path has a wrong index in " + quoteText(key),
                               "Write `[0]` for the first entry of a list");
            indices.insert(indices.begin(), std::stoi(digits));
            key.resize(open);
        }
        if (key.empty() || key.find_first_of(" \t\r\n[]{},:\"'#&*!|>%@`<") != std::string::npos)
            throw badInput(where, "the key path " + quoteText(path) + " is not one", remedy);
        steps.push_back({key, -1});
        for (const int index : indices) steps.push_back({{}, index});
        if (end == path.size()) return steps;
        begin = end + 1;
    }
}

}  // namespace

std::string detail::quoteText(const std::string& text) {
    constexpr std::size_t kLongest = 60;
    std::string shown;
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        // Cut between characters of UTF-8 only.
        if (shown.size() >= kLongest && (byte & 0xC0) != 0x80) {
            shown += "...";
            break;
        }
        shown += byte < 0x20 || byte == 0x7F ? '?' : c;
    }
    return "`" + shown + "`";
}

std::string detail::describeNode(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::Scalar)
        return (node.quoted ? "the text " : "the single value ") + quoteText(node.text);
    if (node.kind == ConfigNode::Kind::List) return "a list of " + std::to_string(node.items.size());
    return node.kind == ConfigNode::Kind::Map ? "a map" : "empty";
}

std::string detail::joinKeyPath(const std::string& parent, const std::string& key) {
    return parent.empty() ? key : parent + "." + key;
}

std::string ConfigNode::place() const {
    if (file == detail::kOverrideFile) return keyPath.empty() ? file : file + " " + keyPath;
    std::string where = file;
    if (line > 0) where += ":" + std::to_string(line) + ":" + std::to_string(column);
    if (!keyPath.empty()) where += (where.empty() ? "" : ": ") + keyPath;
    return where;
}

void detail::clearLines(ConfigNode& node) {
    node.line = 0;
    node.column = 0;
    for (ConfigNode& item : node.items) clearLines(item);
    for (auto& entry : node.entries) clearLines(entry.second);
}

const ConfigNode* ConfigNode::find(const std::string& key) const {
    for (const auto& entry : entries)
        if (entry.first == key) return &entry.second;
    return nullptr;
}

ConfigNode* ConfigNode::find(const std::string& key) {
    return const_cast<ConfigNode*>(static_cast<const ConfigNode*>(this)->find(key));
}

void applyOverride(ConfigNode& root, const std::string& assignment) {
    const std::string argument = std::string(detail::kOverrideFile) + " " + quoteText(assignment);
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos)
        throw badInput(argument, "the assignment has no `=`",
                       "Write it as `key.path=value`, such as `cases.C2.filter.gamma=3`");
    const std::string path = assignment.substr(0, equals);
    const std::string valueText = assignment.substr(equals + 1);
    if (path.size() > detail::kMaxKeyPathBytes)
        throw badInput(argument, "the key path is longer than " + std::to_string(detail::kMaxKeyPathBytes) + " bytes",
                       "Check the argument");
    const std::vector<Step> steps = splitPath(path, argument);
    if (valueText.find_first_not_of(" \t\r\n") == std::string::npos)
        throw badInput(argument, "the assignment has no value", "Write a value behind the `=`; empty text is `\"\"`");
    if (steps.size() > static_cast<std::size_t>(kMaxConfigDepth))
        throw badInput(argument, "the key path is deeper than " + std::to_string(kMaxConfigDepth) + " levels",
                       "Check the argument");
    ConfigNode value;
    try {
        value = detail::parseYaml(valueText, detail::kOverrideFile, path, static_cast<int>(steps.size()), false);
    } catch (const Error& error) {
        throw badInput(argument, std::string("the value cannot be read: ") + error.what());
    }
    detail::clearLines(value);

    // First walk without changing anything, so that a wrong path leaves the tree as it was.
    ConfigNode *node = &root, *block = nullptr;  // which has the node in it
    std::size_t existing = 0;
    for (; existing < steps.size(); ++existing) {
        const Step& step = steps[existing];
        ConfigNode* next = nullptr;
        if (step.index >= 0) {
            if (node->kind != ConfigNode::Kind::List || step.index >= static_cast<int>(node->items.size()))
                throw badInput(argument,
                               node->place() + " is " + describeNode(*node) + ", so there is no entry [" +
                                   std::to_string(step.index) + "]",
                               "Name an entry that exists, or set the whole list");
            next = &node->items[step.index];
        } else {
            if (node->kind != ConfigNode::Kind::Map && node->kind != ConfigNode::Kind::Empty)
                throw badInput(argument,
                               node->place() + " is " + describeNode(*node) + ", so there is no entry " +
                                   quoteText(step.key) + " in it",
                               "Check the key path");
            next = node->find(step.key);
        }
        if (!next) break;
        block = node;
        node = next;
    }
    for (std::size_t i = existing; i < steps.size(); ++i)
        if (steps[i].index >= 0)
            throw badInput(argument, "there is no list in the file at this key path",
                           "Set the whole list, such as `key.path=[1, 2]`");

    if (existing == steps.size()) {
        const bool isPlugin = steps.back().key == "plugin" && (value.kind != node->kind || value.text != node->text);
        if (isPlugin) {
            block->entries.clear();
            block->entries.emplace_back("plugin", std::move(value));
        } else {
            *node = std::move(value);
        }
        return;
    }
    std::string keyPath = node->keyPath;
    for (std::size_t i = existing; i < steps.size(); ++i) {
        keyPath = detail::joinKeyPath(keyPath, steps[i].key);
        node->kind = ConfigNode::Kind::Map;
        ConfigNode next;
        next.file = detail::kOverrideFile;
        next.keyPath = keyPath;
        node->entries.emplace_back(steps[i].key, std::move(next));
        node = &node->entries.back().second;
    }
    setKeyPath(value, keyPath);
    *node = std::move(value);
}

ConfigNode overlay(const ConfigNode& base, const ConfigNode& top) {
    if (base.kind != ConfigNode::Kind::Map || top.kind != ConfigNode::Kind::Map) return top;
    const ConfigNode* basePlugin = base.find("plugin");
    const ConfigNode* topPlugin = top.find("plugin");
    if (basePlugin && topPlugin && (basePlugin->kind != topPlugin->kind || basePlugin->text != topPlugin->text))
        return top;
    ConfigNode merged = base;
    if (top.line > 0) {  // a map that an override had to make has no place worth telling
        merged.file = top.file;
        merged.line = top.line;
        merged.column = top.column;
        merged.keyPath = top.keyPath;
    }
    for (const auto& [key, value] : top.entries) {
        if (ConfigNode* old = merged.find(key)) {
            *old = overlay(*old, value);
        } else {
            merged.entries.emplace_back(key, value);
        }
    }
    return merged;
}

ConfigMap::ConfigMap(const ConfigNode& node) : node_(node) {
    if (node.kind != ConfigNode::Kind::Map)
        throw badInput(node.place(), "must be a map of entries; it is " + describeNode(node),
                       "Write entries as `key: value`, indented below the key, or `{key: value}`");
}

const ConfigNode* ConfigMap::find(const std::string& key) {
    if (std::find(known_.begin(), known_.end(), key) == known_.end()) known_.push_back(key);
    return node_.find(key);
}

const ConfigNode& ConfigMap::require(const std::string& key) {
    const ConfigNode* value = find(key);
    if (!value)
        throw badInput(node_.place(), "the key " + quoteText(key) + " is missing", "Add `" + key + ": ...` here");
    return *value;
}

void ConfigMap::finish() const {
    detail::ErrorList errors;
    for (const auto& [key, value] : node_.entries) {
        if (std::find(known_.begin(), known_.end(), key) != known_.end()) continue;
        std::string remedy = known_.empty() ? "No key is allowed here" : "";
        const auto withUnit = std::find_if(known_.begin(), known_.end(), [&key = key](const std::string& known) {
            return known.compare(0, key.size() + 1, key + "_") == 0;  // too many letters for a slip
        });
        std::string meant = findClosestName(key, known_);
        if (meant.empty() && withUnit != known_.end()) meant = *withUnit;
        if (!meant.empty()) remedy = "Did you mean `" + meant + "`?";
        if (withUnit != known_.end() && meant == *withUnit) remedy += " A key carries its unit.";
        if (errors.isEmpty() && !known_.empty())  // once is enough
            remedy += (remedy.empty() ? "" : " ") + ("Known keys: `" + detail::join(known_, "`, `") + "`");
        errors.add(value.place(), "the key " + quoteText(key) + " is unknown", remedy);
    }
    errors.throwIfAny(node_.place());
}

}  // namespace viable
