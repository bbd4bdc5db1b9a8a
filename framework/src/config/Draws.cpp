#include "config/Draws.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "config/ConfigText.h"
#include "core/Text.h"

namespace viable {

namespace {

using detail::formatNumber;
using detail::quoteText;

constexpr double kLn2 = 0.693147180559945309417;
constexpr double kSqrt2 = 1.41421356237309504880;
/** A cut that leaves less of a normal distribution would be drawn again and again. */
constexpr double kLeastShare = 1e-3;
constexpr std::size_t kMostChoices = 1000;

const char kForms[] =
    "Write ~uniform(a, b), ~log_uniform(a, b), ~normal(mean, sd), ~normal(mean, sd, min, max), ~integer(a, b) or "
    "~choice(a, b, ...)";

enum class Kind { Uniform, LogUniform, Normal, Integer, Choice };

const std::vector<std::string> kKindNames = {"uniform", "log_uniform", "normal", "integer", "choice"};

// Written out, as the C library's last digit differs from machine to machine. Both to a few 1e-16, relative.

/** @param x  > 0, finite */
double calcLog(double x) {
    int exponent = 0;
    double m = std::frexp(x, &exponent);
    if (m < kSqrt2 / 2.0) {
        m *= 2.0;
        --exponent;
    }
    const double s = (m - 1.0) / (m + 1.0), square = s * s;  // |s| < 0.172
    double sum = 0.0;
    for (int k = 23; k >= 1; k -= 2) sum = sum * square + 1.0 / k;
    return 2.0 * s * sum + exponent * kLn2;
}

double calcExp(double x) {
    const double k = std::floor(x / kLn2 + 0.5);
    const double r = x - k * kLn2;  // |r| < 0.35
    double sum = 1.0;
    for (int i = 18; i >= 1; --i) sum = 1.0 + r / i * sum;
    return std::ldexp(sum, static_cast<int>(k));
}

std::uint64_t mix(std::uint64_t x) {  // the finalizer of splitmix64 (Steele, Lea, Flood 2014)
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
    return x ^ (x >> 31);
}

constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15u;

std::uint64_t hashText(const std::string& text) {  // FNV-1a, 64 bits
    std::uint64_t hash = 0xCBF29CE484222325u;
    for (const unsigned char byte : text) hash = (hash ^ byte) * 0x100000001B3u;
    return hash;
}

/** The random numbers of one key in one run. */
class Stream {
public:
    Stream(const DrawIndex& index, const std::string& keyPath)
        : state_(mix(mix(mix(index.seed + kGolden) + static_cast<std::uint64_t>(index.run)) + hashText(keyPath))) {}

    std::uint64_t next() { return mix(state_ += kGolden); }
    /** Evenly in (0, 1): never the ends. */
    double uniform() { return (static_cast<double>(next() >> 12) + 0.5) * 0x1p-52; }
    /** Evenly in [0, count). */
    std::uint64_t below(std::uint64_t count) {
        const std::uint64_t unfair = (0 - count) % count;  // 2^64 mod count
        std::uint64_t x;
        do x = next();
        while (x < unfair);
        return x % count;
    }
    double normal() {
        for (;;) {
            const double u = 2.0 * uniform() - 1.0, v = 2.0 * uniform() - 1.0;
            const double s = u * u + v * v;
            if (s < 1.0 && s > 0.0) return u * std::sqrt(-2.0 * calcLog(s) / s);
        }
    }

private:
    std::uint64_t state_;
};

/** What a text between the parentheses says, checked. */
struct Distribution {
    Kind kind = Kind::Uniform;
    double a = 0.0, b = 0.0;  ///< the ends; mean and standard deviation of a normal one
    bool isCut = false;
    double min = 0.0, max = 0.0;       ///< of a cut
    std::int64_t first = 0, last = 0;  ///< of whole numbers
    std::vector<std::string> choices;
    bool isOfWords = false;  ///< not all choices are numbers

    std::string draw(Stream stream) const {
        if (kind == Kind::Choice) return choices[stream.below(choices.size())];
        if (kind == Kind::Integer) {
            const auto count = static_cast<std::uint64_t>(last - first) + 1;
            return std::to_string(first + static_cast<std::int64_t>(stream.below(count)));
        }
        double x;
        if (kind == Kind::Normal) {
            do x = a + b * stream.normal();
            while (isCut && !(x >= min && x <= max));
            return formatNumber(x);
        }
        const double u = stream.uniform();
        x = kind == Kind::Uniform ? (1.0 - u) * a + u * b : calcExp((1.0 - u) * calcLog(a) + u * calcLog(b));
        return formatNumber(std::clamp(x, a, b));
    }

    std::vector<std::string> ends() const {
        if (kind == Kind::Choice) return choices;
        if (kind == Kind::Integer) return {std::to_string(first), std::to_string(last)};
        if (kind == Kind::Uniform || kind == Kind::LogUniform) return {formatNumber(a), formatNumber(b)};
        if (!isCut) return {};
        return {formatNumber(min), formatNumber(max)};
    }
};

bool isWordLetter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
}

std::string trim(const std::string& text) {
    const std::size_t begin = text.find_first_not_of(" \t");
    if (begin == std::string::npos) return {};
    return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

/** The word behind the `~`; empty where the node is no draw. `~/file`, `~name/file` and `~` are none. */
std::string findWord(const ConfigNode& node) {
    if (node.kind != ConfigNode::Kind::Scalar || node.text.empty() || node.text[0] != '~') return {};
    std::size_t end = 1;
    while (end < node.text.size() && isWordLetter(node.text[end])) ++end;
    const std::string word = node.text.substr(1, end - 1);
    const bool isCall = end < node.text.size() && node.text[end] == '(';
    return isCall || std::find(kKindNames.begin(), kKindNames.end(), word) != kKindNames.end() ? word : "";
}

class DrawParser {
public:
    DrawParser(const ConfigNode& node, std::string word) : node_(node), word_(std::move(word)) {}

    Distribution parse() const {
        const auto name = std::find(kKindNames.begin(), kKindNames.end(), word_);
        if (name == kKindNames.end()) {
            const std::string closest = findClosestName(word_, kKindNames);
            fail("`~" + word_ + "` is not a distribution",
                 (closest.empty() ? "" : "Did you mean `~" + closest + "`? ") + std::string(kForms));
        }
        const std::vector<std::string> arguments = split();
        Distribution d;
        d.kind = static_cast<Kind>(name - kKindNames.begin());
        if (d.kind == Kind::Choice) {
            if (arguments.size() > kMostChoices) fail("more than " + std::to_string(kMostChoices) + " choices", kForms);
            d.choices = arguments;
            d.isOfWords = !evaluateAll(d.choices);
            for (std::string& choice : d.choices) choice = unquote(choice);
            return d;
        }
        if (arguments.size() != 2 && !(d.kind == Kind::Normal && arguments.size() == 4))
            fail(quoteText(node_.text) + " has " + std::to_string(arguments.size()) +
                     (arguments.size() == 1 ? " number" : " numbers"),
                 kForms);
        if (d.kind == Kind::Integer) {
            constexpr std::int64_t kMost = std::int64_t{1} << 53;
            d.first = toInteger(makeNode(arguments[0]), -kMost, kMost);
            d.last = toInteger(makeNode(arguments[1]), -kMost, kMost);
            if (d.first > d.last)
                fail("the first end of " + quoteText(node_.text) + " is above the second",
                     "Write the smaller number first");
            return d;
        }
        d.a = toNumber(makeNode(arguments[0]));
        d.b = toNumber(makeNode(arguments[1]));
        if (d.kind != Kind::Normal) {
            if (!(d.a < d.b))
                fail("the first end of " + quoteText(node_.text) + " is not below the second",
                     "Write the smaller number first");
            if (d.kind == Kind::LogUniform && !(d.a > 0.0))
                fail(quoteText(node_.text) + " begins at " + formatNumber(d.a) + ", which has no logarithm",
                     "Both ends of ~log_uniform(a, b) must be above 0");
            return d;
        }
        if (!(d.b > 0.0))
            fail("the standard deviation of " + quoteText(node_.text) + " is not above 0",
                 "Write ~normal(mean, sd) with sd above 0");
        d.isCut = arguments.size() == 4;
        if (!d.isCut) return d;
        d.min = toNumber(makeNode(arguments[2]));
        d.max = toNumber(makeNode(arguments[3]));
        if (!(d.min < d.max))
            fail("the cut of " + quoteText(node_.text) + " is empty: min is not below max",
                 "Write ~normal(mean, sd, min, max)");
        const auto share = [&](double x) { return 0.5 * std::erfc((d.a - x) / d.b / kSqrt2); };
        // The share above for the upper tail, where both shares below round to 1.
        const double kept =
            d.min > d.a ? share(2.0 * d.a - d.min) - share(2.0 * d.a - d.max) : share(d.max) - share(d.min);
        if (!(kept >= kLeastShare))
            fail("the cut of " + quoteText(node_.text) + " keeps less than a thousandth of it",
                 "Move the cut to where the distribution is");
        return d;
    }

private:
    [[noreturn]] void fail(const std::string& what, const std::string& remedy) const {
        throw badInput(node_.place(), what, remedy);
    }

    /** Expressions become their numbers; false, and nothing changed: not all are numbers. */
    bool evaluateAll(std::vector<std::string>& texts) const {
        std::vector<std::string> numbers;
        for (const std::string& text : texts) {
            std::int64_t whole = 0;
            const char* const end = text.data() + text.size();
            const auto read = std::from_chars(text.data(), end, whole);
            try {
                const double number = toNumber(makeNode(text));
                // Whole ones as written: a large one has more digits than a double.
                numbers.push_back(read.ec == std::errc() && read.ptr == end ? text : formatNumber(number));
            } catch (const Error&) {
                return false;
            }
        }
        texts = std::move(numbers);
        return true;
    }

    static bool isQuote(char c) { return c == '"' || c == '\''; }

    static std::string unquote(const std::string& text) {
        const bool isQuoted = text.size() >= 2 && isQuote(text.front()) && text.back() == text.front();
        return isQuoted ? text.substr(1, text.size() - 2) : text;
    }

    ConfigNode makeNode(const std::string& text) const {
        ConfigNode node = node_;
        node.text = text;
        node.quoted = false;
        return node;
    }

    /** What stands between the parentheses, at its commas; parentheses inside belong to expressions. */
    std::vector<std::string> split() const {
        const std::string& text = node_.text;
        const std::string shown = quoteText(text);
        const std::size_t open = word_.size() + 1;
        if (open >= text.size() || text[open] != '(') fail(shown + " has no parentheses", kForms);
        std::vector<std::string> parts(1);
        int depth = 1;
        std::size_t i = open + 1;
        for (; i < text.size() && depth > 0; ++i) {
            const char c = text[i];
            if (isQuote(c) && trim(parts.back()).empty()) {  // up to its end nothing has a meaning
                const std::size_t end = text.find(c, i + 1);
                if (end != std::string::npos) {
                    parts.back() += text.substr(i, end - i + 1);
                    i = end;
                    continue;
                }
            }
            depth += c == '(' ? 1 : c == ')' ? -1 : 0;
            if (depth == 0) break;
            if (c == ',' && depth == 1)
                parts.emplace_back();
            else
                parts.back() += c;
        }
        if (depth > 0) fail(shown + " has no closing parenthesis", detail::quoteDrawRemedy(text));
        if (!trim(text.substr(i + 1)).empty())
            fail("there is more behind the draw in " + shown, "A draw stands alone; put factors into its numbers");
        for (std::string& part : parts) {
            part = trim(part);
            if (part.empty()) fail(shown + " has an empty place between its commas", kForms);
        }
        return parts;
    }

    const ConfigNode& node_;
    const std::string word_;
};

/** Calls `visit(node, distribution)` for each draw of a tree. */
template <class Node, class Visit>
void forEachDraw(Node& node, const Visit& visit) {
    for (auto& item : node.items) forEachDraw(item, visit);
    for (auto& entry : node.entries) forEachDraw(entry.second, visit);
    const std::string word = findWord(node);
    if (word.empty()) return;
    const std::string& path = node.keyPath;
    const std::string key = path.substr(path.rfind('.') == std::string::npos ? 0 : path.rfind('.') + 1);
    const bool isTop = path == "schema" || path == "title";
    const bool isRobot = key == "robot" && (path == key || path.compare(0, 6, "cases.") == 0);
    if (isTop || isRobot)
        throw badInput(node.place(), "this must be the same in every run, so it cannot be drawn",
                       "Write the value; several robots are several cases");
    visit(node, DrawParser(node, word).parse());
}

}  // namespace

std::string detail::quoteDrawRemedy(const std::string& begun) {
    const std::string name = begun.substr(0, begun.find('('));
    return "Between [ ] or { } a draw needs quotes because of its commas, such as '" + name + "(1, 2)'";
}

DrawIndex parseDrawIndex(const std::string& text, const std::string& where) {
    DrawIndex index;
    const char* const end = text.data() + text.size();
    const auto seed = std::from_chars(text.data(), end, index.seed);
    const bool hasColon = seed.ec == std::errc() && seed.ptr != end && *seed.ptr == ':';
    const auto run = hasColon ? std::from_chars(seed.ptr + 1, end, index.run) : seed;
    if (!hasColon || run.ec != std::errc() || run.ptr != end || index.run < 0)
        throw badInput(where, quoteText(text) + " is not a draw",
                       "Write SEED:INDEX, such as 1:42: the seed of the sweep and the run's number from 0");
    return index;
}

std::vector<DrawnKey> listDraws(const ConfigNode& root) {
    std::vector<DrawnKey> keys;
    forEachDraw(root, [&](const ConfigNode& node, const Distribution& distribution) {
        keys.push_back({node.keyPath, node.text.substr(1), node.place(), distribution.ends(), distribution.isOfWords});
    });
    return keys;
}

std::map<std::string, std::string> resolveDraws(ConfigNode& root, const DrawIndex& index,
                                                const std::map<std::string, std::string>& held) {
    std::map<std::string, std::string> values;
    forEachDraw(root, [&](ConfigNode& node, const Distribution& distribution) {
        const auto known = held.find(node.keyPath);
        node.text = known != held.end() ? known->second : distribution.draw(Stream(index, node.keyPath));
        node.quoted = !detail::isPlainText(node.text);
        values[node.keyPath] = node.text;
    });
    return values;
}

}  // namespace viable
