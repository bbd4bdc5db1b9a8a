#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "viable/config/ConfigNode.h"
#include "viable/core/JointTypes.h"

namespace viable {

enum class ParameterType : std::uint32_t {
    Number,        ///< double
    Integer,       ///< std::int64_t
    Flag,          ///< bool
    Choice,        ///< std::string, one of `choices`
    Text,          ///< std::string
    File,          ///< path of an existing file, relative to the experiment file
    JointNumbers,  ///< JointVector: a number for all joints or a list with one each
    Numbers,       ///< std::vector<double>: a list with minCount..maxCount numbers
    Rows,          ///< std::vector<std::vector<double>>: a list of such lists
};

/** One parameter of a plugin, declared once: parsing, range errors, `viable plugins --describe`,
the tables in the documentation and the range tests all come from this. Plain data with static
lifetime, because it crosses the library border before the ABI has been compared field by field. */
struct ParameterSpec {
    const char* name;  ///< snake_case, with its unit as suffix where it has one
    const char* unit;  ///< "1/s", "N/m", "" for none
    ParameterType type;
    const char* defaultText;  ///< in YAML; null: required
    const char* help;         ///< one sentence
    double min = -std::numeric_limits<double>::infinity();
    double max = std::numeric_limits<double>::infinity();
    bool minIsOpen = false;
    bool maxIsOpen = false;
    bool mayBeInfinite = false;
    const char* choices = nullptr;  ///< "a|b|c" for Choice; for JointNumbers and Numbers words in place of numbers
    int minCount = 0;               ///< of Numbers and of each row of Rows
    int maxCount = 0;

    // Restricting a declaration: `number("k", "1/s", "5", "...").above(0).upTo(10)`.
    constexpr ParameterSpec above(double bound) const {
        auto s = *this;
        s.min = bound;
        s.minIsOpen = true;
        return s;
    }
    constexpr ParameterSpec atLeast(double bound) const {
        auto s = *this;
        s.min = bound;
        return s;
    }
    constexpr ParameterSpec below(double bound) const {
        auto s = *this;
        s.max = bound;
        s.maxIsOpen = true;
        return s;
    }
    constexpr ParameterSpec upTo(double bound) const {
        auto s = *this;
        s.max = bound;
        return s;
    }
    constexpr ParameterSpec orInfinite() const {
        auto s = *this;
        s.mayBeInfinite = true;
        return s;
    }

    /** Of JointNumbers and Numbers: `auto` may stand there, the value is then of size 0, and the plugin finds it. */
    constexpr ParameterSpec orAuto() const {
        auto s = *this;
        s.choices = "auto";
        return s;
    }

    NumberRange range() const { return {min, max, minIsOpen, maxIsOpen, mayBeInfinite}; }
};

namespace parameter {
constexpr ParameterSpec number(const char* name, const char* unit, const char* defaultText, const char* help) {
    return {name, unit, ParameterType::Number, defaultText, help};
}
constexpr ParameterSpec integer(const char* name, const char* defaultText, const char* help) {
    return {name, "", ParameterType::Integer, defaultText, help};
}
constexpr ParameterSpec flag(const char* name, const char* defaultText, const char* help) {
    return {name, "", ParameterType::Flag, defaultText, help};
}
constexpr ParameterSpec choice(const char* name, const char* choices, const char* defaultText, const char* help) {
    ParameterSpec s{name, "", ParameterType::Choice, defaultText, help};
    s.choices = choices;
    return s;
}
constexpr ParameterSpec text(const char* name, const char* defaultText, const char* help) {
    return {name, "", ParameterType::Text, defaultText, help};
}
constexpr ParameterSpec file(const char* name, const char* defaultText, const char* help) {
    return {name, "", ParameterType::File, defaultText, help};
}
constexpr ParameterSpec jointNumbers(const char* name, const char* unit, const char* defaultText, const char* help) {
    return {name, unit, ParameterType::JointNumbers, defaultText, help};
}
constexpr ParameterSpec numbers(const char* name, const char* unit, int minCount, int maxCount, const char* defaultText,
                                const char* help) {
    ParameterSpec s{name, unit, ParameterType::Numbers, defaultText, help};
    s.minCount = minCount;
    s.maxCount = maxCount;
    return s;
}
constexpr ParameterSpec rows(const char* name, const char* unit, int minCount, int maxCount, const char* defaultText,
                             const char* help) {
    ParameterSpec s{name, unit, ParameterType::Rows, defaultText, help};
    s.minCount = minCount;
    s.maxCount = maxCount;
    return s;
}
}  // namespace parameter

/** Declarations one after the other, as one table:
    constexpr auto kParameters = joinParameters(kArmHardwareParameters, kOwnParameters); */
template <std::size_t... Counts>
constexpr std::array<ParameterSpec, (Counts + ...)> joinParameters(const ParameterSpec (&... tables)[Counts]) {
    std::array<ParameterSpec, (Counts + ...)> joined{};
    std::size_t next = 0;
    const auto append = [&](const ParameterSpec* table, std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) joined[next++] = table[i];
    };
    (append(tables, Counts), ...);
    return joined;
}

/** The parameters of one plugin instance, checked and complete: every declared name has a value.
Asking for a name that was not declared, or as another type, is a mistake in the plugin's code and
throws Error (PluginFailed) that says so. */
class Parameters {
public:
    double number(const char* name) const;
    std::int64_t integer(const char* name) const;
    bool flag(const char* name) const;
    const std::string& text(const char* name) const;  ///< Text, Choice
    const std::filesystem::path& file(const char* name) const;
    const JointVector& jointNumbers(const char* name) const;
    const std::vector<double>& numbers(const char* name) const;
    const std::vector<std::vector<double>>& rows(const char* name) const;

    /** `file:line:column: key.path` of a parameter (of its block when it has its default), for
    errors that a plugin finds in configure(). */
    const std::string& place(const char* name) const;

    /** The complete block as configuration: defaults filled in, files by their absolute paths. */
    const ConfigNode& resolved() const { return resolved_; }

private:
    friend Parameters readParameters(const ConfigNode&, const ParameterSpec*, std::size_t, int);
    using Value = std::variant<double, std::int64_t, bool, std::string, std::filesystem::path, JointVector,
                               std::vector<double>, std::vector<std::vector<double>>>;
    template <class T>
    const T& get(const char* name) const;

    std::map<std::string, Value> values_;
    std::map<std::string, std::string> places_;
    ConfigNode resolved_;
};

/** Reads a plugin's block (a map; the key `plugin` is passed over) by its declaration. File
parameters are resolved against the folder of the file in which they were written (for overrides
from the command line: the current folder) and must exist. Throws Error (BadInput) with place, value
and range, those of different parameters together. */
Parameters readParameters(const ConfigNode& block, const ParameterSpec* specs, std::size_t count, int jointCount);

/** The declaration as lines of text for `viable plugins --describe`. */
std::string describeParameters(const ParameterSpec* specs, std::size_t count);

}  // namespace viable
