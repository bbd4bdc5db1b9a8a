#include "core/Text.h"

#include <cctype>
#include <charconv>
#include <cmath>
#include <sstream>

#include "core/Characters.h"
#include "viable/core/JointLimits.h"

namespace viable {

std::string makePrintable(std::string text) {
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto byte = static_cast<unsigned char>(text[i]);
        if (byte == '\n' || byte == '\r' || byte == '\t') {
            text[i] = ' ';
        } else if (byte < 0x20 || byte == 0x7f) {
            text[i] = '?';
        } else if (byte == 0xc2 && i + 1 < text.size() && static_cast<unsigned char>(text[i + 1]) >= 0x80 &&
                   static_cast<unsigned char>(text[i + 1]) < 0xa0) {
            text.replace(i, 2, "?");
        }
    }
    return text;
}

namespace detail {

std::string formatNumber(double value) {
    char buffer[32];
    return std::string(buffer, std::to_chars(buffer, buffer + sizeof(buffer), value).ptr);
}

std::string formatPercent(double share) {
    if (std::isinf(share)) return "inf";
    if (share > 1.0 + kOutsideShare && share < 1.0 + 5e-5)
        return share < 1.0 + 1e-6 ? ">100" : format("%.4f", 100.0 * share);
    return format(share < 10.0 ? "%.2f" : "%.0f", 100.0 * share);
}

std::string formatPlain(double x) {
    const double size = std::abs(x);
    return format(size >= 1000.0 && size < 1e7 ? "%.0f" : "%.3g", x);
}

void addItem(std::string& list, const std::string& item, const char* separator) {
    list += (list.empty() ? "" : separator) + item;
}

std::string wrap(const std::string& text, std::size_t indent, std::size_t begin) {
    constexpr std::size_t kMostColumns = 100;
    std::string lines;
    std::istringstream words(text);
    std::size_t column = begin;
    for (std::string word; words >> word; column += countCharacters(word)) {
        if (column > indent && column + 1 + countCharacters(word) > kMostColumns) {
            lines += "\n" + std::string(indent, ' ');
            column = indent;
        } else if (!lines.empty()) {
            lines += ' ';
            ++column;
        }
        lines += word;
    }
    return lines;
}

std::string join(const std::vector<std::string>& items, const char* separator) {
    std::string text;
    for (const std::string& item : items) addItem(text, item, separator);
    return text;
}

std::string quoteDoubled(std::string_view text) {
    return '"' + replaceAll(std::string(text), "\"", "\"\"") + '"';
}

std::string quoteCsv(std::string_view text) {
    return text.find_first_of(",\"\r\n") == std::string_view::npos ? std::string(text) : quoteDoubled(text);
}

std::string replaceAll(const std::string& text, const std::string& what, const std::string& by) {
    std::string replaced;
    std::size_t from = 0;
    for (std::size_t at; (at = text.find(what, from)) != std::string::npos; from = at + what.size())
        replaced.append(text, from, at - from) += by;
    return replaced.append(text, from);
}

std::string makeUnitSuffix(const std::string& unit) {
    return replaceAll(replaceAll(unit, "/", "p"), "^", "");
}

std::string quoteForShell(const std::string& text) {
    const auto isPlain = [](unsigned char c) {
        return std::isalnum(c) != 0 || std::string_view("_-./+=:,@%").find(static_cast<char>(c)) != std::string::npos;
    };
    if (!text.empty() && std::all_of(text.begin(), text.end(), isPlain)) return text;
    return "'" + replaceAll(text, "'", "'\\''") + "'";
}

}  // namespace detail

}  // namespace viable
