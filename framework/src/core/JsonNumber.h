#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

namespace viable::detail {

// JSON has neither infinity nor NaN. NaN becomes null; infinity becomes null or a word.

/** Infinity as an experiment file has it. */
inline constexpr char kFileInfinity[] = ".inf";

/** Infinity as `infinity` or, with a minus before it, the other one. */
template <class Json = nlohmann::json>
Json makeNumberOrWord(double x, const std::string& infinity = "inf") {
    if (std::isinf(x)) return x > 0.0 ? infinity : "-" + infinity;
    return std::isnan(x) ? Json(nullptr) : Json(x);
}

inline nlohmann::json makeNumberOrNull(double x) {
    return std::isfinite(x) ? nlohmann::json(x) : nlohmann::json(nullptr);
}

}  // namespace viable::detail
