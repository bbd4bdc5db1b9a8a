#pragma once

#include <charconv>
#include <string>

namespace viable::detail {

/** The shortest text that reads back to the same double, whatever the locale: "0.001", "1e-06",
"inf". For messages and tables. */
inline std::string formatNumber(double value) {
    char buffer[32];
    const auto result = std::to_chars(buffer, buffer + sizeof(buffer), value);
    return std::string(buffer, result.ptr);
}

}  // namespace viable::detail
