#include <algorithm>

#include "config/ConfigText.h"
#include "core/Text.h"

namespace viable {

namespace {

bool isNull(const std::string& text) {
    return text.empty() || text == "~" || text == "null" || text == "Null" || text == "NULL";
}

std::string quote(const std::string& text) {
    std::string quoted = "\"";
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        if (c == '"' || c == '\\') {
            quoted += '\\';
            quoted += c;
        } else if (c == '\n') {
            quoted += "\\n";
        } else if (c == '\t') {
            quoted += "\\t";
        } else if (byte < 0x20 || byte == 0x7F) {
            quoted += detail::format("\\x%02x", byte);
        } else {
            quoted += c;
        }
    }
    return quoted + '"';
}

bool isLetterOrDigit(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

std::string writeKey(const std::string& key) {
    const bool isPlain = !isNull(key) && isLetterOrDigit(key[0]) && std::all_of(key.begin(), key.end(), [](char c) {
        return isLetterOrDigit(c) || c == '-' || c == '.';
    });
    return isPlain ? key : quote(key);
}

std::string writeScalar(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::Empty) return "~";
    return node.quoted || !detail::isPlainText(node.text) ? quote(node.text) : node.text;
}

bool isContainer(const ConfigNode& node) {
    return node.kind == ConfigNode::Kind::List || node.kind == ConfigNode::Kind::Map;
}

/** Whether the node fits on one line: anything but a filled map, a list of such, and a list with
text that could not stand unquoted between brackets. */
bool isInline(const ConfigNode& node) {
    if (!isContainer(node)) return true;
    if (node.kind == ConfigNode::Kind::Map) return node.entries.empty();
    return std::none_of(node.items.begin(), node.items.end(), [](const ConfigNode& item) {
        const bool needsBlock = item.kind == ConfigNode::Kind::Scalar && !item.quoted &&
                                item.text.find_first_of(",[]{}?:") != std::string::npos;
        return isContainer(item) || needsBlock;
    });
}

std::string writeInline(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::Map) return "{}";
    if (node.kind != ConfigNode::Kind::List) return writeScalar(node);
    std::string text = "[";
    for (std::size_t i = 0; i < node.items.size(); ++i) text += (i == 0 ? "" : ", ") + writeScalar(node.items[i]);
    return text + "]";
}

void writeBlock(const ConfigNode& node, std::size_t indent, std::string& text) {
    if (isInline(node)) {
        text.append(indent, ' ').append(writeInline(node)).append("\n");
        return;
    }
    if (node.kind == ConfigNode::Kind::List) {
        for (const ConfigNode& item : node.items) {
            // The dash takes the place of the last two blanks before the item's first line.
            const std::size_t begin = text.size();
            writeBlock(item, indent + 2, text);
            text[begin + indent] = '-';
        }
        return;
    }
    for (const auto& [key, value] : node.entries) {
        text.append(indent, ' ').append(writeKey(key)).append(":");
        if (isInline(value)) {
            text.append(" ").append(writeInline(value)).append("\n");
        } else {
            text.append("\n");
            writeBlock(value, indent + 2, text);
        }
    }
}

}  // namespace

bool detail::isPlainText(const std::string& text) {
    if (isNull(text)) return false;
    const auto isBlank = [](char c) { return c == ' ' || c == '\t'; };
    static const std::string forbiddenFirst = "?:,[]{}#&*!|>'\"%@`";
    if (isBlank(text.front()) || isBlank(text.back()) || text.back() == ':') return false;
    if (forbiddenFirst.find(text.front()) != std::string::npos) return false;
    if (text.front() == '-' && (text.size() == 1 || isBlank(text[1]))) return false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto byte = static_cast<unsigned char>(text[i]);
        if (byte < 0x20 || byte == 0x7F) return false;
        if (i + 1 < text.size() && text[i] == ':' && isBlank(text[i + 1])) return false;
        if (i + 1 < text.size() && isBlank(text[i]) && text[i + 1] == '#') return false;
    }
    return true;
}

std::string writeConfig(const ConfigNode& node) {
    std::string text;
    writeBlock(node, 0, text);
    return text;
}

}  // namespace viable
