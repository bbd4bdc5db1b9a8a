#include <algorithm>
#include <charconv>
#include <cmath>

#include "config/ConfigText.h"
#include "core/ErrorList.h"
#include "core/Text.h"

namespace viable {

namespace {

using detail::describeNode;
using detail::formatNumber;
using detail::quoteText;

/** Longest text of one number, and most parentheses and signs inside each other. */
constexpr std::size_t kMaxExpressionBytes = 256;
constexpr int kMaxExpressionDepth = 32;

constexpr const char* kNumberRemedy =
    "Write a number or an expression of numbers, `pi`, + - * / and parentheses, such as `2*pi/3`";

bool isDigit(char c) {
    return c >= '0' && c <= '9';
}
bool isLetter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' || (static_cast<unsigned char>(c) & 0x80) != 0;
}

/** Why a text is no number; becomes an Error where the place is known. */
struct NoNumber {
    std::string what;  // continues "`text` is not a number: "
    std::string remedy;
};

/** sum = product (+|- product)*, product = factor (*|/ factor)*,
factor = (+|-) factor | number | pi | ( sum ). */
class Expression {
public:
    explicit Expression(const std::string& text) : text_(text) {}

    double calc() {
        if (text_.size() > kMaxExpressionBytes)
            throw NoNumber{"it is longer than " + std::to_string(kMaxExpressionBytes) + " bytes", kNumberRemedy};
        const double value = calcSum();
        if (peek() != '\0') failUnexpected();
        return value;
    }

private:
    /** The next character that is no blank; NUL at the end. */
    char peek() {
        while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\t')) ++at_;
        return at_ < text_.size() ? text_[at_] : '\0';
    }

    std::string readWord() {
        const std::size_t begin = at_;
        while (at_ < text_.size() && (isLetter(text_[at_]) || isDigit(text_[at_]))) ++at_;
        return text_.substr(begin, at_ - begin);
    }

    [[noreturn]] void failUnexpected() {
        const char c = peek();
        if (c == '\0') throw NoNumber{"it ends too early", kNumberRemedy};
        if (!isLetter(c)) {
            std::string remedy = kNumberRemedy;
            if (c == ',') remedy = "Write a decimal point; a list stands in brackets";
            throw NoNumber{quoteText(text_.substr(at_)) + " is not expected here", remedy};
        }
        const bool followsValue = at_ > 0 && valueEnd_ > 0 && isOnlyBlanks(valueEnd_, at_);
        const bool isGlued = valueEnd_ > 0 && valueEnd_ == at_;
        const std::string rest = text_.substr(at_);
        const std::string word = readWord();
        if (isGlued && word[0] == '_') throw NoNumber{"`_` may not stand between digits", "Write the digits together"};
        if (isGlued && (word[0] == 'x' || word[0] == 'X' || word[0] == 'b' || word[0] == 'o') &&
            text_[valueEnd_ - 1] == '0')
            throw NoNumber{"only decimal numbers are allowed", "Write the decimal number"};
        if (followsValue && word == "pi")
            throw NoNumber{"`pi` follows a value without an operator", "Write a product as `2*pi`"};
        if (followsValue) {
            const bool isDegrees = word.compare(0, 3, "deg") == 0 || word == "\xC2\xB0";
            throw NoNumber{quoteText(rest) + " follows the number",
                           std::string("Write the number alone: the unit is in the key") +
                               (isDegrees ? "; degrees become radians as `90*pi/180`" : "")};
        }
        throw NoNumber{quoteText(word) + " is neither a number nor pi", kNumberRemedy};
    }

    bool isOnlyBlanks(std::size_t begin, std::size_t end) const {
        return std::all_of(text_.begin() + static_cast<std::ptrdiff_t>(begin),
                           text_.begin() + static_cast<std::ptrdiff_t>(end),
                           [](char c) { return c == ' ' || c == '\t'; });
    }

    /** Refuses a result that a double cannot hold to full precision. */
    static double check(double value, bool isZeroExact) {
        if (!std::isfinite(value)) throw NoNumber{"it is too large for a double", "Check the exponent"};
        const double size = std::abs(value);
        if (size < std::numeric_limits<double>::min() && !(size == 0.0 && isZeroExact))
            throw NoNumber{"it is too small for a double, but not zero", "Write 0 or a number of at least 1e-300"};
        return value;
    }

    /** `1 -2` is more likely two numbers without their comma than a difference. */
    void refuseSignOfNextNumber() const {
        const bool hasBlankBefore = isOnlyBlanks(at_ - 1, at_);
        const bool hasBlankBehind = at_ + 1 >= text_.size() || isOnlyBlanks(at_ + 1, at_ + 2);
        if (hasBlankBefore && !hasBlankBehind)
            throw NoNumber{quoteText(text_.substr(at_)) + " follows a value without a comma",
                           "Put a comma between two numbers, or blanks on both sides of the sign of a sum"};
    }

    double calcSum() {
        double value = calcProduct();
        while (peek() == '+' || peek() == '-') {
            refuseSignOfNextNumber();
            const char sign = text_[at_++];
            const double right = calcProduct();
            value = check(sign == '+' ? value + right : value - right, true);
        }
        return value;
    }

    double calcProduct() {
        double value = calcFactor();
        while (peek() == '*' || peek() == '/') {
            const char sign = text_[at_++];
            const double right = calcFactor();
            if (sign == '/' && right == 0.0) throw NoNumber{"it divides by zero", "Check the divisor"};
            const bool isZero = value == 0.0 || (sign == '*' && right == 0.0);
            value = check(sign == '*' ? value * right : value / right, isZero);
        }
        return value;
    }

    double calcFactor() {
        if (++depth_ > kMaxExpressionDepth)
            throw NoNumber{
                "it has more than " + std::to_string(kMaxExpressionDepth) + " signs and parentheses inside each other",
                kNumberRemedy};
        double value = 0.0;
        const char c = peek();
        if (c == '+' || c == '-') {
            ++at_;
            value = calcFactor();
            if (c == '-') value = -value;
        } else if (c == '(') {
            ++at_;
            value = calcSum();
            if (peek() != ')') {
                if (peek() != '\0') failUnexpected();
                throw NoNumber{"a `)` is missing", "Close the parenthesis"};
            }
            valueEnd_ = ++at_;
        } else if (isDigit(c) || c == '.') {
            value = readNumber();
        } else if (c == 'p' && isPi()) {
            at_ += 2;
            valueEnd_ = at_;
            value = kPi;
        } else {
            failUnexpected();
        }
        --depth_;
        return value;
    }

    bool isPi() const {
        return text_.compare(at_, 2, "pi") == 0 &&
               (at_ + 2 >= text_.size() || !(isLetter(text_[at_ + 2]) || isDigit(text_[at_ + 2])));
    }

    double readNumber() {
        const std::size_t begin = at_;
        const auto skipDigits = [&] {
            const std::size_t from = at_;
            while (at_ < text_.size() && isDigit(text_[at_])) ++at_;
            return at_ - from;
        };
        std::size_t digits = skipDigits();
        const bool hasLeadingZero = digits > 1 && text_[begin] == '0';
        if (at_ < text_.size() && text_[at_] == '.') {
            ++at_;
            digits += skipDigits();
        }
        if (digits == 0) {
            at_ = begin;
            throw NoNumber{quoteText(text_.substr(begin)) + " is not expected here", kNumberRemedy};
        }
        const bool isZero = text_.find_first_of("123456789", begin) >= at_;
        if (at_ < text_.size() && (text_[at_] == 'e' || text_[at_] == 'E')) {
            const std::size_t mantissaEnd = at_++;
            if (at_ < text_.size() && (text_[at_] == '+' || text_[at_] == '-')) ++at_;
            if (skipDigits() == 0) at_ = mantissaEnd;  // not an exponent: a letter behind a number
        }
        valueEnd_ = at_;
        if (hasLeadingZero)
            throw NoNumber{"it begins with a zero, which some read as octal", "Write the number without leading zeros"};
        double value = 0.0;
        const char* first = text_.data() + begin;
        const char* last = text_.data() + at_;
        const auto result = std::from_chars(first, last, value);
        if (result.ec == std::errc::result_out_of_range) {
            // The value is then not set. A text of at most kMaxExpressionBytes leaves the doubles
            // only through its exponent, whose sign says at which end.
            const std::string literal(first, last);
            const std::size_t exponent = literal.find_first_of("eE");
            value = exponent != std::string::npos && literal.compare(exponent + 1, 1, "-") == 0 ? 0.0 : kInfinity;
        }
        return check(value, isZero);
    }

    const std::string& text_;
    std::size_t at_ = 0;
    std::size_t valueEnd_ = 0;  // offset behind the last number, pi or closed parenthesis
    int depth_ = 0;
};

bool isOneOf(const std::string& text, std::initializer_list<const char*> words) {
    return std::any_of(words.begin(), words.end(), [&](const char* w) { return text == w; });
}

/** The value without its range. */
double calcNumber(const ConfigNode& node, bool mayBeInfinite) {
    if (node.kind != ConfigNode::Kind::Scalar)
        throw badInput(node.place(), "must be a number; it is " + describeNode(node), kNumberRemedy);
    const std::string& text = node.text;
    const std::string shown = quoteText(text);
    if (node.quoted)
        throw badInput(node.place(), "must be a number; " + shown + " in quotes is text", "Remove the quotes");
    refuseBlank(node);
    // std::string's own letters: no locale.
    std::string lower = text;
    for (char& c : lower)
        if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    const std::string unsignedText = !lower.empty() && (lower[0] == '-' || lower[0] == '+') ? lower.substr(1) : lower;
    if (isOneOf(unsignedText, {".nan", "nan"})) throw badInput(node.place(), shown + " is not a number", kNumberRemedy);
    if (isOneOf(unsignedText, {".inf", "inf", "infinity"})) {
        if (!mayBeInfinite)
            throw badInput(node.place(), shown + " is not allowed: the value must be finite", kNumberRemedy);
        if (unsignedText != ".inf")
            throw badInput(node.place(), shown + " is not a number", "Write `.inf` or `-.inf` for \"no limit\"");
        return lower[0] == '-' ? -kInfinity : kInfinity;
    }
    try {
        return Expression(text).calc();
    } catch (const NoNumber& problem) {
        throw badInput(node.place(), shown + " is not a number: " + problem.what, problem.remedy);
    }
}

std::string formatCount(int minCount, int maxCount) {
    const std::string most = std::to_string(maxCount);
    const std::string numbers = maxCount == 1 ? " number" : " numbers";
    if (minCount == maxCount) return most + numbers;
    if (maxCount == std::numeric_limits<int>::max())
        return "at least " + std::to_string(minCount) + (minCount == 1 ? " number" : " numbers");
    return std::to_string(minCount) + " to " + most + numbers;
}

}  // namespace

bool NumberRange::contains(double value) const {
    if (std::isnan(value)) return false;
    // "No limit" lies beyond any finite bound, but only on a side that reaches that far.
    if (std::isinf(value)) return mayBeInfinite && (value > 0 ? max > 0.0 : min < 0.0);
    return (minIsOpen ? value > min : value >= min) && (maxIsOpen ? value < max : value <= max);
}

std::string NumberRange::text() const {
    std::string text = minIsOpen || std::isinf(min) ? "(" : "[";
    text += formatNumber(min) + ", " + formatNumber(max);
    text += maxIsOpen || std::isinf(max) ? ")" : "]";
    if (contains(kInfinity)) text += contains(-kInfinity) ? ", .inf or -.inf" : " or .inf";
    if (!contains(kInfinity) && contains(-kInfinity)) text += " or -.inf";
    return text;
}

double toNumber(const ConfigNode& node, const NumberRange& range) {
    const double value = calcNumber(node, range.mayBeInfinite);
    if (!range.contains(value)) {
        const std::string number = formatNumber(value);
        const std::string shown = number == node.text ? number : quoteText(node.text) + " = " + number;
        throw badInput(node.place(), shown + " is out of range; allowed is " + range.text(),
                       "Choose a value inside the range");
    }
    return value;
}

std::int64_t toInteger(const ConfigNode& node, std::int64_t min, std::int64_t max) {
    const std::string allowed = "a whole number in [" + std::to_string(min) + ", " + std::to_string(max) + "]";
    const std::string remedy = "Write digits only, without point, exponent or leading zeros";
    if (node.kind != ConfigNode::Kind::Scalar || node.quoted)
        throw badInput(node.place(), "must be " + allowed + "; it is " + describeNode(node),
                       node.quoted ? "Remove the quotes" : remedy);
    const std::string& text = node.text;
    const std::string digits = !text.empty() && text[0] == '-' ? text.substr(1) : text;
    const bool isWhole = !digits.empty() && digits.find_first_not_of("0123456789") == std::string::npos;
    if (!isWhole || (digits.size() > 1 && digits[0] == '0'))
        throw badInput(node.place(), quoteText(text) + " is not " + allowed, remedy);
    std::int64_t value = 0;
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc() || value < min || value > max)
        throw badInput(node.place(), quoteText(text) + " is out of range; allowed is " + allowed,
                       "Choose a value inside the range");
    return value;
}

bool toFlag(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::Scalar && !node.quoted) {
        if (node.text == "true") return true;
        if (node.text == "false") return false;
    }
    throw badInput(node.place(), "must be `true` or `false`; it is " + describeNode(node),
                   "Write `true` or `false` without quotes");
}

void refuseBlank(const ConfigNode& node) {
    if (node.kind == ConfigNode::Kind::Scalar && !node.quoted && node.text == kBlank)
        throw badInput(
            node.place(), "not filled in yet",
            std::string("Write the value in place of ") + kBlank + "; the comment beside it says how to find it");
}

std::string toText(const ConfigNode& node) {
    if (node.kind != ConfigNode::Kind::Scalar)
        throw badInput(node.place(), "must be text; it is " + describeNode(node),
                       "Write one text; empty text is `\"\"`");
    return node.text;
}

std::string toChoice(const ConfigNode& node, const std::vector<std::string>& choices) {
    const std::string text = toText(node);
    if (std::find(choices.begin(), choices.end(), text) != choices.end()) return text;
    const std::string closest = findClosestName(text, choices);
    throw badInput(node.place(), quoteText(text) + " is not one of the choices",
                   (closest.empty() ? "" : "Did you mean `" + closest + "`? ") +
                       ("Choices: `" + detail::join(choices, "`, `") + "`"));
}

std::vector<double> toNumbers(const ConfigNode& node, int minCount, int maxCount, const NumberRange& range) {
    const std::string wanted = "a list of " + formatCount(minCount, maxCount);
    if (node.kind != ConfigNode::Kind::List) {
        std::string example = "`[1";
        for (int i = 2; i <= std::max(minCount, 1); ++i) example += ", " + std::to_string(i);
        throw badInput(node.place(), "must be " + wanted + "; it is " + describeNode(node),
                       "Write the numbers in brackets, such as " + example + "]`");
    }
    const auto count = static_cast<long long>(node.items.size());
    if (count < minCount || count > maxCount)
        throw badInput(node.place(), "must be " + wanted + "; it is " + describeNode(node),
                       "Write " + formatCount(minCount, maxCount));
    std::vector<double> values;
    values.reserve(node.items.size());
    detail::ErrorList errors;
    for (const ConfigNode& item : node.items) errors.collect([&] { values.push_back(toNumber(item, range)); });
    errors.throwIfAny(node.place());
    return values;
}

JointVector toJointVector(const ConfigNode& node, int n, const NumberRange& range) {
    VIABLE_CHECK(n >= 0 && n <= kMaxJoints, "the number of joints is beyond the capacity");
    if (node.kind == ConfigNode::Kind::Scalar) return JointVector::Constant(n, toNumber(node, range));
    if (node.kind != ConfigNode::Kind::List || static_cast<int>(node.items.size()) != n)
        throw badInput(node.place(),
                       "must be a list of " + formatCount(n, n) +
                           ", one per joint, or a single number for all; it is " + describeNode(node),
                       "Write " + formatCount(n, n) + " in brackets, or a single one");
    return JointVector::Map(toNumbers(node, n, n, range).data(), n);
}

}  // namespace viable
