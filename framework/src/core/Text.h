#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace viable {

/** `text` on one line, without what would command a terminal: text from a file of somebody else is printed so. Line
ends and tabs become blanks, other control characters (C1 ones in UTF-8 too) `?`. */
std::string makePrintable(std::string text);

namespace detail {

/** The name of an enum's value, of those in the enum's order up to its `last`; `other` for a number that is none. */
template <auto last, std::size_t n>
const char* enumName(decltype(last) value, const char* const (&names)[n], const char* other = "unknown") {
    static_assert(n == static_cast<std::size_t>(last) + 1, "a name for each value");
    const auto at = static_cast<std::size_t>(value);
    return at < n ? names[at] : other;
}

/** What printf takes of a value. */
template <class Value>
const Value& forPrintf(const Value& value) {
    static_assert(std::is_scalar_v<Value> || std::is_array_v<Value>, "no argument of printf");
    return value;
}
inline const char* forPrintf(const std::string& text) {
    return text.c_str();
}
inline long long forPrintf(std::int64_t number) {
    return number;
}

/** As printf does it, also of strings (%s) and std::int64_t (%lld); up to 511 characters. */
template <class... Arguments>
std::string format(const char* pattern, const Arguments&... arguments) {
    char text[512];
    std::snprintf(text, sizeof text, pattern, forPrintf(arguments)...);
    return text;
}

/** The shortest text that reads back to the same double, whatever the locale: "0.001", "1e-06", "inf". */
std::string formatNumber(double value);

/** "[12.2, 282, 7.03]": a list for people, to three digits, that a file takes as well. */
template <class Values>
std::string formatList(const Values& values) {
    std::string text = "[";
    for (const double value : values) text += (text.size() > 1 ? ", " : "") + format("%.3g", value);
    return text + "]";
}

/** Percent, with enough digits that a limit passed by a hair does not read as 100.00. */
std::string formatPercent(double share);

/** Three digits, and no exponent where people read the number faster without. */
std::string formatPlain(double x);

/** Adds `item` to a list in words: "a", "a, b", ... */
void addItem(std::string& list, const std::string& item, const char* separator = ", ");
std::string join(const std::vector<std::string>& items, const char* separator = ", ");

/** The words in lines of at most 100 columns, all but the first one indented, that one begun at column `begin`. */
std::string wrap(const std::string& text, std::size_t indent = 0, std::size_t begin = 0);

/** `by` in every place of `what` in `text`; what `by` holds is not replaced again. */
std::string replaceAll(const std::string& text, const std::string& what, const std::string& by);

/** A unit as names have it: "rad/s^2" is "radps2". */
std::string makeUnitSuffix(const std::string& unit);

/** Between double quotes, those inside doubled: a name in SQL. */
std::string quoteDoubled(std::string_view text);
/** A field of a CSV file, in quotes only where it needs them (RFC 4180). */
std::string quoteCsv(std::string_view text);
/** One word for a shell. */
std::string quoteForShell(const std::string& text);

}  // namespace detail

}  // namespace viable
