#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <sstream>
#include <system_error>
#include <unordered_map>

#include "config/ConfigText.h"
#include "core/Text.h"

namespace viable {

namespace {

using detail::joinKeyPath;
using detail::quoteText;

/** More brackets than this open at once are an attack on the parser's look-ahead, not text. Far
above kMaxConfigDepth because brackets in comments and quotes are counted too. */
constexpr int kMaxOpenBrackets = 1000;

struct Position {
    int line = 0;    // 1-based
    int column = 0;  // 1-based, in characters
};

std::string formatPlace(const std::string& fileName, Position at, const std::string& keyPath = {}) {
    ConfigNode node;
    node.file = fileName;
    node.line = at.line;
    node.column = at.column;
    node.keyPath = keyPath;
    return node.place();
}

/** Line and column of byte offsets that mostly grow, without counting from the start each time. */
class PositionFinder {
public:
    explicit PositionFinder(const std::string& text) : text_(text) {}

    Position find(std::size_t offset) {
        offset = std::min(offset, text_.size());
        if (offset < offset_) {
            offset_ = 0;
            at_ = {1, 1};
        }
        for (; offset_ < offset; ++offset_) {
            const auto byte = static_cast<unsigned char>(text_[offset_]);
            if (byte == '\n') {
                ++at_.line;
                at_.column = 1;
            } else if ((byte & 0xC0) != 0x80) {
                ++at_.column;
            }
        }
        // Inside a character counts as at it.
        return at_;
    }

private:
    const std::string& text_;
    std::size_t offset_ = 0;
    Position at_{1, 1};
};

/** Number of bytes of the valid UTF-8 character at `i`, or 0. */
std::size_t findCharacterSize(const std::string& text, std::size_t i) {
    const auto byte = [&](std::size_t k) -> unsigned {
        return k < text.size() ? static_cast<unsigned char>(text[k]) : 0u;
    };
    const unsigned first = byte(i), second = byte(i + 1);
    const std::size_t size = first < 0x80                     ? 1
                             : first >= 0xC2 && first <= 0xDF ? 2
                             : first >= 0xE0 && first <= 0xEF ? 3
                             : first >= 0xF0 && first <= 0xF4 ? 4
                                                              : 0;
    for (std::size_t k = 1; k < size; ++k)
        if ((byte(i + k) & 0xC0u) != 0x80u) return 0;
    const bool isOverlong = (first == 0xE0 && second < 0xA0) || (first == 0xF0 && second < 0x90);
    // A surrogate, or beyond U+10FFFF.
    const bool isNone = (first == 0xED && second > 0x9F) || (first == 0xF4 && second > 0x8F);
    return isOverlong || isNone ? 0 : size;
}

void checkSize(std::uintmax_t bytes, const std::string& fileName) {
    if (bytes <= kMaxConfigBytes) return;
    throw badInput(fileName,
                   "holds " + std::to_string(bytes) + " bytes, more than the " + std::to_string(kMaxConfigBytes) +
                       " that a configuration may have",
                   "Keep recorded data in files of their own and name them in the configuration");
}

/** The text without byte-order mark and with plain line feeds; throws when it is no text, is too
large, or would keep the parser busy for long. */
std::string cleanText(const std::string& raw, const std::string& fileName) {
    checkSize(raw.size(), fileName);
    std::string text;
    text.reserve(raw.size());
    Position at{1, 1};
    bool isIndentation = true;
    int openBrackets = 0;
    int commas = 0;
    for (std::size_t i = raw.compare(0, 3, "\xEF\xBB\xBF") == 0 ? 3 : 0; i < raw.size();) {
        const auto byte = static_cast<unsigned char>(raw[i]);
        const std::size_t size = findCharacterSize(raw, i);
        if (size == 0)
            throw badInput(formatPlace(fileName, at), "is not UTF-8 text",
                           "Save the file as UTF-8; a binary file is not a configuration");
        if (byte == '\r' && i + 1 < raw.size() && raw[i + 1] == '\n') {
            ++i;
            continue;
        }
        if ((byte < 0x20 && byte != '\n' && byte != '\t') || byte == 0x7F)
            throw badInput(
                formatPlace(fileName, at), detail::format("holds the control byte 0x%02x", byte),
                "Only text is allowed, with lines that end in LF or CR LF; a binary file is not a configuration");
        if (isIndentation && byte == '\t')
            throw badInput(formatPlace(fileName, at), "a tab stands in the indentation", "Indent with blanks only");
        if (byte == '[' || byte == '{') ++openBrackets;
        if ((byte == ']' || byte == '}') && openBrackets > 0) --openBrackets;
        if (openBrackets > kMaxOpenBrackets)
            throw badInput(
                formatPlace(fileName, at), "more than " + std::to_string(kMaxOpenBrackets) + " brackets are open here",
                "At most " + std::to_string(kMaxConfigDepth) + " maps and lists may stand inside each other");
        if (byte == ',' && ++commas > kMaxConfigNodes)
            throw badInput(formatPlace(fileName, at),
                           "more than " + std::to_string(kMaxConfigNodes) + " list entries stand before here",
                           "Keep recorded data in files of their own");
        text.append(raw, i, size);
        i += size;
        if (byte == '\n') {
            ++at.line;
            at.column = 1;
            isIndentation = true;
        } else {
            ++at.column;
            if (byte != ' ') isIndentation = false;
        }
    }
    return text;
}

/** Builds the tree from yaml-cpp's events, and refuses what YAML allows but a configuration must
not contain. It looks at the text itself where yaml-cpp 0.7 is silent: keys without a colon, quotes
that are never closed, the lone tag `!`. */
class TreeBuilder : public YAML::EventHandler {
public:
    TreeBuilder(const std::string& text, const std::string& fileName, const std::string& keyPath, int depth,
                bool isWholeFile)
        : text_(text),
          fileName_(fileName),
          rootPath_(keyPath),
          outerDepth_(depth),
          isWholeFile_(isWholeFile),
          finder_(text) {}

    bool hasDocument() const { return hasDocument_; }
    ConfigNode releaseRoot() { return std::move(root_); }
    Position calcPosition(const YAML::Mark& mark) { return finder_.find(findOffset(mark)); }

    void OnDocumentStart(const YAML::Mark& mark) override {
        const std::size_t offset = findOffset(mark);
        if (hasDocument_) {
            if (text_.compare(offset, 3, "---") == 0)
                fail(mark, rootPath_, "a second document begins here",
                     "Keep one document in a file: remove the line `---` or what follows it");
            fail(mark, rootPath_, "this does not belong to what stands above it",
                 "Check the indentation: entries of one map begin in the same column");
        }
        hasDocument_ = true;
        // yaml-cpp passes over directives; none has a meaning here.
        for (std::size_t i = 0; i < offset; ++i)
            if (text_[i] == '%' && (i == 0 || text_[i - 1] == '\n'))
                failAt(i, rootPath_, "a YAML directive (`%...`) is not allowed",
                       "Remove the line; write text that begins with % in quotes");
    }
    void OnDocumentEnd() override {}

    void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
        refuseProperties(mark, "?", anchor);
        countNode(mark);
        if (isKeyExpected()) failKey(mark);
        checkRoot(mark, "nothing");
        ConfigNode node = makeNode(mark, ConfigNode::Kind::Empty);
        // The mark of an absent value is that of the next thing in the file.
        if (!stack_.empty() && stack_.back().node.kind == ConfigNode::Kind::Map) place(node, stack_.back().keyAt);
        add(std::move(node));
    }

    void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override {
        fail(mark, findPath(), "an alias (`*name`) is not allowed",
             "Write the value out; text that begins with * goes in quotes");
    }

    void OnAnchor(const YAML::Mark& mark, const std::string&) override { failAnchor(mark); }

    void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  const std::string& value) override {
        refuseProperties(mark, tag, anchor);
        countNode(mark);
        const std::size_t end = findScalarEnd(mark, value);
        // Lines that YAML joins would let `1` above ` -2` pass for the number -1.
        if (tag == "?" && text_.compare(findOffset(mark), value.size(), value) != 0)
            fail(mark, findPath(), "the value " + quoteText(value) + " goes over several lines without quotes",
                 "Check the indentation and the commas; put long text in quotes or behind `|`");
        if (value.find('\0') != std::string::npos)
            fail(mark, findPath(), "the text holds a NUL character", "Remove `\\0` from it");
        if (isKeyExpected()) return addKey(mark, value, end);
        checkRoot(mark, "the text " + quoteText(value));
        ConfigNode node = makeNode(mark, ConfigNode::Kind::Scalar);
        node.text = value;
        node.quoted = tag == "!" || !detail::isPlainText(value);
        add(std::move(node));
    }

    void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                         YAML::EmitterStyle::value) override {
        open(mark, tag, anchor, ConfigNode::Kind::List);
    }
    void OnSequenceEnd() override { close(); }
    void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                    YAML::EmitterStyle::value) override {
        open(mark, tag, anchor, ConfigNode::Kind::Map);
    }
    void OnMapEnd() override { close(); }

private:
    struct Frame {
        ConfigNode node;
        std::string key;  // of the entry whose value comes next
        Position keyAt;
        bool hasKey = false;
        std::unordered_map<std::string, int> keyLines;
    };

    std::size_t findOffset(const YAML::Mark& mark) const {
        return mark.pos < 0 ? 0 : std::min(static_cast<std::size_t>(mark.pos), text_.size());
    }
    char at(std::size_t offset) const { return offset < text_.size() ? text_[offset] : '\0'; }

    [[noreturn]] void failAt(std::size_t offset, const std::string& keyPath, const std::string& what,
                             const std::string& remedy) {
        throw badInput(formatPlace(fileName_, finder_.find(offset), keyPath), what, remedy);
    }
    [[noreturn]] void fail(const YAML::Mark& mark, const std::string& keyPath, const std::string& what,
                           const std::string& remedy) {
        failAt(findOffset(mark), keyPath, what, remedy);
    }
    [[noreturn]] void failAnchor(const YAML::Mark& mark) {
        fail(mark, findPath(), "an anchor (`&name`) is not allowed",
             "Write values out where they are used; text that begins with & goes in quotes");
    }
    [[noreturn]] void failKey(const YAML::Mark& mark) {
        fail(mark, findPath(), "a key must be text, not a list, a map or nothing",
             "Write entries as `key: value`; close every `[` with `]` and every `{` with `}`");
    }

    void refuseProperties(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) {
        if (anchor != 0) failAnchor(mark);
        // yaml-cpp gives "?" to plain and "!" to quoted text; a written `!` looks the same as "!".
        if ((tag != "?" && tag != "!") || at(findOffset(mark)) == '!')
            fail(mark, findPath(), "a tag (`!...`) is not allowed",
                 "Write the value alone; text that begins with ! goes in quotes");
    }

    void countNode(const YAML::Mark& mark) {
        if (++nodes_ > kMaxConfigNodes)
            fail(mark, findPath(),
                 "more than " + std::to_string(kMaxConfigNodes) + " keys and values stand in the file",
                 "Keep recorded data in files of their own");
    }

    /** Offset behind the scalar that begins at the mark. Throws for a quote that is not closed,
    which yaml-cpp 0.7 accepts at the end of the file. */
    std::size_t findScalarEnd(const YAML::Mark& mark, const std::string& value) {
        const std::size_t begin = findOffset(mark);
        const char quote = at(begin);
        if (quote != '\'' && quote != '"') return begin + value.size();
        for (std::size_t i = begin + 1; i < text_.size(); ++i) {
            if (quote == '"' && text_[i] == '\\') {
                ++i;
            } else if (text_[i] == quote) {
                if (quote == '"' || at(i + 1) != '\'') return i + 1;
                ++i;
            }
        }
        fail(mark, findPath(), std::string("the quote ") + quote + " is never closed",
             std::string("Write the closing ") + quote);
    }

    bool isKeyExpected() const {
        return !stack_.empty() && stack_.back().node.kind == ConfigNode::Kind::Map && !stack_.back().hasKey;
    }

    void addKey(const YAML::Mark& mark, const std::string& key, std::size_t end) {
        Frame& frame = stack_.back();
        const std::string path = joinKeyPath(frame.node.keyPath, key);
        if (key == "<<") fail(mark, frame.node.keyPath, "a merge key (`<<`) is not allowed", "Write the entries out");
        if (key.empty()) fail(mark, frame.node.keyPath, "a key is empty", "Write entries as `key: value`");
        for (const char c : key)
            if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F)
                fail(mark, frame.node.keyPath, "the key " + quoteText(key) + " holds a control character",
                     "Use letters, digits and `_`");
        if (path.size() > detail::kMaxKeyPathBytes)
            fail(mark, frame.node.keyPath,
                 "the key " + quoteText(key) + " makes a key path of " + std::to_string(path.size()) +
                     " bytes; at most " + std::to_string(detail::kMaxKeyPathBytes) + " are allowed",
                 "Use shorter keys");
        while (at(end) == ' ' || at(end) == '\t') ++end;
        if (text_.find_first_not_of(" \t\n", end) == std::string::npos) {
            // yaml-cpp also takes the last entry of a list that is never closed for a key.
            fail(mark, frame.node.keyPath, "the file ends behind " + quoteText(key),
                 "Write entries as `key: value`; close every `[` with `]` and every `{` with `}`");
        }
        if (at(end) != ':' && !frame.node.entries.empty()) {
            // `{a: ~uniform(0, 1)}`: what stands behind the comma is taken for the next key.
            const std::string& before = frame.node.entries.back().second.text;
            if (!before.empty() && before[0] == '~' &&
                std::count(before.begin(), before.end(), '(') > std::count(before.begin(), before.end(), ')'))
                fail(mark, frame.node.entries.back().second.keyPath,
                     "the draw " + quoteText(before) + " ends at its comma", detail::quoteDrawRemedy(before));
        }
        if (at(end) != ':')
            fail(mark, frame.node.keyPath, quoteText(key) + " stands where a key is expected",
                 "Write entries as `key: value`, on one line, with a blank after the colon");
        const Position position = calcPosition(mark);
        const auto [known, isNew] = frame.keyLines.emplace(key, position.line);
        if (!isNew)
            fail(mark, path,
                 "the key " + quoteText(key) + " stands twice: on line " + std::to_string(known->second) +
                     " and on line " + std::to_string(position.line),
                 "Remove one of the two");
        frame.key = key;
        frame.keyAt = position;
        frame.hasKey = true;
    }

    /** Key path of the value that comes next. */
    std::string findPath() const {
        if (stack_.empty()) return rootPath_;
        const Frame& frame = stack_.back();
        if (frame.node.kind == ConfigNode::Kind::List)
            return frame.node.keyPath + "[" + std::to_string(frame.node.items.size()) + "]";
        return frame.hasKey ? joinKeyPath(frame.node.keyPath, frame.key) : frame.node.keyPath;
    }

    void checkRoot(const YAML::Mark& mark, const std::string& found) {
        if (!stack_.empty() || !isWholeFile_) return;
        if (found == "nothing")
            throw badInput(fileName_, "is empty: there is no entry in it", "Write entries as `key: value`");
        fail(mark, {}, "the file must be a map of entries; found " + found,
             "Write entries as `key: value`, with a blank after the colon");
    }

    static void place(ConfigNode& node, Position position) {
        node.line = position.line;
        node.column = position.column;
    }

    ConfigNode makeNode(const YAML::Mark& mark, ConfigNode::Kind kind) {
        ConfigNode node;
        node.kind = kind;
        node.file = fileName_;
        node.keyPath = findPath();
        place(node, calcPosition(mark));
        return node;
    }

    void open(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor, ConfigNode::Kind kind) {
        refuseProperties(mark, tag, anchor);
        countNode(mark);
        if (isKeyExpected()) failKey(mark);
        if (kind == ConfigNode::Kind::List) checkRoot(mark, "a list");
        if (outerDepth_ + static_cast<int>(stack_.size()) >= kMaxConfigDepth)
            fail(mark, findPath(),
                 "more than " + std::to_string(kMaxConfigDepth) + " maps and lists stand inside each other",
                 "Make the structure flatter");
        ConfigNode node = makeNode(mark, kind);
        stack_.emplace_back().node = std::move(node);
    }

    void close() {
        ConfigNode node = std::move(stack_.back().node);
        stack_.pop_back();
        add(std::move(node));
    }

    void add(ConfigNode&& node) {
        if (stack_.empty()) {
            root_ = std::move(node);
            return;
        }
        Frame& frame = stack_.back();
        if (frame.node.kind == ConfigNode::Kind::List) {
            frame.node.items.push_back(std::move(node));
        } else {
            frame.node.entries.emplace_back(std::move(frame.key), std::move(node));
            frame.key.clear();
            frame.hasKey = false;
        }
    }

    const std::string& text_;
    const std::string& fileName_;
    const std::string& rootPath_;
    int outerDepth_;
    bool isWholeFile_;
    PositionFinder finder_;
    ConfigNode root_;
    std::vector<Frame> stack_;
    int nodes_ = 0;
    bool hasDocument_ = false;
};

/** yaml-cpp's terse message in the words of somebody who edits the file. */
Error explain(const YAML::Exception& problem, const std::string& where) {
    struct Explanation {
        const char* message;
        const char* what;
        const char* remedy;
    };
    static const Explanation explanations[] = {
        {YAML::ErrorMsg::END_OF_MAP, "this does not fit into the map around it",
         "Check that each entry is `key: value`, that entries of one map begin in the same column, and that nothing "
         "follows a closed quote or bracket"},
        {YAML::ErrorMsg::END_OF_SEQ, "this does not fit into the list around it",
         "Check that the `-` of one list stand in the same column"},
        {YAML::ErrorMsg::END_OF_MAP_FLOW, "a map in braces does not continue or end properly",
         "Close `{` with `}` and put a comma between entries"},
        {YAML::ErrorMsg::END_OF_SEQ_FLOW, "a list in brackets does not continue or end properly",
         "Close `[` with `]` and put a comma between entries"},
        {YAML::ErrorMsg::FLOW_END, "a closing bracket has no opening one", "Remove it"},
        {YAML::ErrorMsg::MAP_VALUE, "a colon stands where none can stand",
         "Check the indentation of this line and the one before; put text with a colon in quotes"},
        {YAML::ErrorMsg::MAP_KEY, "a `?` stands where none can stand", "Put text that begins with ? in quotes"},
        {YAML::ErrorMsg::BLOCK_ENTRY, "a list entry (`- `) stands where none can stand",
         "Begin the list on the line below its key, or write it as `[a, b]`"},
        {YAML::ErrorMsg::EOF_IN_SCALAR, "a quote is never closed", "Write the closing quote"},
        {YAML::ErrorMsg::DOC_IN_SCALAR, "a line `---` or `...` stands inside quoted text", "Write the closing quote"},
        {YAML::ErrorMsg::TAB_IN_INDENTATION, "a tab stands in the indentation", "Indent with blanks only"},
        {YAML::ErrorMsg::UNKNOWN_TOKEN, "this character cannot begin a value",
         "Put text that begins with @, % or a backquote in quotes"},
        {YAML::ErrorMsg::UNKNOWN_ANCHOR, "an alias (`*name`) is not allowed",
         "Write the value out; text that begins with * goes in quotes"},
        {YAML::ErrorMsg::ALIAS_NOT_FOUND, "a value begins with `*`", "Put text that begins with * in quotes"},
        {YAML::ErrorMsg::ANCHOR_NOT_FOUND, "a value begins with `&`", "Put text that begins with & in quotes"},
    };
    for (const Explanation& explanation : explanations) {
        // Its beginning: yaml-cpp 0.8 puts the name of an unknown anchor behind the message.
        if (problem.msg.rfind(explanation.message, 0) == 0)
            return badInput(where, explanation.what, explanation.remedy);
    }
    return badInput(where, "is not valid YAML: " + problem.msg,
                    "Check indentation, quotes and brackets on this line and the one before");
}

}  // namespace

ConfigNode detail::parseYaml(const std::string& raw, const std::string& fileName, const std::string& keyPath, int depth,
                             bool isWholeFile) {
    const std::string text = cleanText(raw, fileName);
    TreeBuilder builder(text, fileName, keyPath, depth, isWholeFile);
    try {
        std::istringstream stream(text);
        YAML::Parser parser(stream);
        while (parser.HandleNextDocument(builder)) {
        }
    } catch (const YAML::Exception& problem) {
        const Position at = problem.mark.is_null() ? Position{} : builder.calcPosition(problem.mark);
        throw explain(problem, formatPlace(fileName, at, keyPath));
    }
    if (!builder.hasDocument())
        throw badInput(fileName, "is empty: there is no entry in it", "Write entries as `key: value`");
    return builder.releaseRoot();
}

ConfigNode parseConfig(const std::string& text, const std::string& fileName) {
    return detail::parseYaml(text, fileName, {}, 0, true);
}

ConfigNode readConfigFile(const std::filesystem::path& file) {
    namespace fs = std::filesystem;
    const std::string name = file.string();
    std::error_code code;
    const fs::file_status status = fs::status(file, code);
    if (status.type() == fs::file_type::not_found) {
        const bool isLink = fs::is_symlink(fs::symlink_status(file, code));
        throw badInput(name, isLink ? "is a symbolic link to a missing file" : "does not exist",
                       "Check the spelling; relative paths start in the current folder");
    }
    if (!fs::status_known(status))
        throw badInput(name, "cannot be looked at: " + code.message(), "Check its permissions");
    if (fs::is_directory(status)) throw badInput(name, "is a folder", "Name the file inside it");
    if (!fs::is_regular_file(status)) throw badInput(name, "is not a regular file", "Copy its content into a file");
    const std::uintmax_t size = fs::file_size(file, code);
    if (!code) checkSize(size, name);

    const auto fail = [&](int number) {
        throw badInput(name, std::string("cannot be read: ") + std::strerror(number), "Check its permissions");
    };
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> stream(std::fopen(file.c_str(), "rb"), &std::fclose);
    if (!stream) fail(errno);
    // The file may grow after its size was asked for: never take more than one byte too many.
    std::string text(kMaxConfigBytes + 1, '\0');
    errno = 0;
    text.resize(std::fread(text.data(), 1, text.size(), stream.get()));
    if (std::ferror(stream.get())) fail(errno);
    return parseConfig(text, name);
}

}  // namespace viable
