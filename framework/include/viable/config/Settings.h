#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <type_traits>
#include <variant>

#include "viable/config/ConfigNode.h"
#include "viable/core/JointLimits.h"

namespace viable {

// A setting is described once, by the struct that holds it:
//
//     struct SpeedCapOptions {
//         double share = 0.5;
//         template <class V>
//         void describe(V& v) {
//             v(share, "share", "", "Share of the velocity limits that may be used.").above(0).upTo(1);
//         }
//     };
//
// The member's type says what may be written, its initial value is the default. The reader with its errors, the resolved
// file, `viable plugins --describe`, the tables in the documentation, the JSON Schema and Python's keywords come from it.

enum class ParameterType : std::uint32_t {
    Number,        ///< double
    Integer,       ///< any whole number
    Flag,          ///< bool
    Choice,        ///< an enum or a bool, by the words of its values in their order, or a std::string
    Text,          ///< std::string
    File,          ///< std::filesystem::path of an existing file, relative to the file that names it
    JointNumbers,  ///< PerJoint: a number for all joints or a list with one each
    Numbers,       ///< std::vector<double>, or an Eigen matrix of fixed size, row by row
    Rows,          ///< std::vector<std::vector<double>>
    // Not in a plugin's table:
    Texts,      ///< std::vector<std::string>
    Bounds,     ///< JointBounds: JointNumbers for both sides of zero, or {lower, upper}
    Positions,  ///< the same, or {center, half_range}
    Block,      ///< a struct with settings of its own, or std::optional of one
    Blocks,     ///< std::vector of such
    Named,      ///< the same, by name in a map; the struct has a member `name`
};

/** One row of a table of settings. Plain data, because a plugin's table crosses the library border before the ABI has been
compared field by field. */
struct ParameterSpec {
    const char* name;  ///< snake_case, with its unit as suffix where it has one
    const char* unit;  ///< "1/s", "N/m", "" for none
    ParameterType type;
    const char* defaultText;  ///< in YAML; null: required; empty: none
    const char* help;         ///< one sentence
    double min = -std::numeric_limits<double>::infinity();
    double max = std::numeric_limits<double>::infinity();
    bool minIsOpen = false;
    bool maxIsOpen = false;
    bool mayBeInfinite = false;
    const char* choices = nullptr;  ///< "a|b|c" for Choice; for JointNumbers and Numbers words in place of numbers
    int minCount = 0;               ///< numbers of a Numbers, or of each row of Rows; entries of Blocks and Named
    int maxCount = 0;               ///< the most; 0 for Blocks and Named: any
    const std::vector<ParameterSpec>& (*inner)() = nullptr;  ///< the rows of a Block, Blocks or Named

    // Restricting a setting: `v(k, "k", "1/s", "...").above(0).upTo(10)`.
    ParameterSpec& above(double bound) { return min = bound, minIsOpen = true, *this; }
    ParameterSpec& atLeast(double bound) { return min = bound, *this; }
    ParameterSpec& below(double bound) { return max = bound, maxIsOpen = true, *this; }
    ParameterSpec& upTo(double bound) { return max = bound, *this; }
    ParameterSpec& orInfinite() { return mayBeInfinite = true, *this; }
    /** So many numbers, or in each row of Rows; so many entries of Blocks and Named. */
    ParameterSpec& count(int least, int most) { return minCount = least, maxCount = most, *this; }
    /** Must be written: the initial value is no default. */
    ParameterSpec& required() { return defaultText = nullptr, *this; }
    /** May be left out: there is no default to speak of. */
    ParameterSpec& optional() { return defaultText = "", *this; }
    /** An optional JointNumbers or Numbers may be `auto`. The member is then empty, and the plugin finds the value. */
    ParameterSpec& orAuto() {
        return defaultText = defaultText && !*defaultText ? "auto" : defaultText, choices = "auto", *this;
    }
    /** JointBounds that need not have zero between them, and may be written around a center. */
    ParameterSpec& positions() { return type = ParameterType::Positions, *this; }

    NumberRange range() const { return {min, max, minIsOpen, maxIsOpen, mayBeInfinite}; }
};

/** The value of a setting as it was read; a Choice is its text. */
using SettingValue =
    std::variant<double, std::int64_t, bool, std::string, std::filesystem::path, JointVector, std::vector<double>,
                 std::vector<std::vector<double>>, std::vector<std::string>, JointBounds>;

class SettingList;
template <class Options>
const std::vector<ParameterSpec>& settingsOf();
template <class Options>
void readSettings(const ConfigNode& block, Options& options, int jointCount = 0);

namespace detail {

/** The type in a std::optional or std::vector; any other type itself. */
template <class T>
struct InnerOf {
    using Type = T;
    static constexpr bool isOptional = false, isVector = false;
};
template <class T>
struct InnerOf<std::optional<T>> {
    using Type = T;
    static constexpr bool isOptional = true, isVector = false;
};
template <class T>
struct InnerOf<std::vector<T>> {
    using Type = T;
    static constexpr bool isOptional = false, isVector = true;
};
template <class T, class = void>
struct IsDescribed : std::false_type {};
template <class T>
struct IsDescribed<T, std::void_t<decltype(std::declval<T&>().describe(std::declval<SettingList&>()))>>
    : std::true_type {};
template <class T, class = void>
struct HasName : std::false_type {};
template <class T>
struct HasName<T, std::void_t<decltype(T::name)>> : std::true_type {};
template <class T, class = void>
struct HasCheck : std::false_type {};
template <class T>
struct HasCheck<T, std::void_t<decltype(&T::check)>> : std::true_type {};

// A value as it is written in YAML.
std::string writeSetting(double value);
std::string writeSetting(const PerJoint& value);
std::string writeSetting(const std::vector<double>& value);
std::string writeSetting(const std::vector<std::vector<double>>& value);
/** The word at `index` in "a|b|c", and the other way round. */
std::string getWord(const char* words, int index);
int findWord(const char* words, const std::string& word);
/** No numbers, of `auto`. */
bool isEmpty(const SettingValue& value);

}  // namespace detail

/** The visitor of describe(): the rows of a struct's settings, and the way into its members. */
class SettingList {
public:
    SettingList() = default;
    SettingList(SettingList&&) = default;  // rows point into it: no copies

    /** A number or several: double, PerJoint, std::vector<double>, rows of such, an Eigen matrix of fixed size, or a
    std::optional of one. Or a word: an enum, a bool or a text, whose words "a|b|c" stand in the place of the unit. */
    template <class T>
    ParameterSpec& operator()(T& member, const char* name, const char* unitOrWords, const char* help) {
        return add(member, name, unitOrWords, help);
    }
    /** A setting without a unit: an integer, bool (true or false), std::string or std::filesystem::path. Or a described
    struct, or a std::optional or std::vector of one. The struct may have a
    check(const ConfigNode& block), called when it has been read, to throw Error (BadInput) for what describe() cannot say. */
    template <class T>
    ParameterSpec& operator()(T& member, const char* name, const char* help) {
        using Inner = typename detail::InnerOf<T>::Type;
        static_assert(std::is_integral_v<Inner> || std::is_same_v<Inner, std::string> ||
                          std::is_same_v<Inner, std::filesystem::path> || detail::IsDescribed<Inner>::value,
                      "a setting of this type has a unit (or words)");
        return add(member, name, nullptr, help);
    }

    const std::vector<ParameterSpec>& specs() const { return specs_; }

    /** Fills every member from the entry of its name.
    @param block       complete, as Parameters::resolved()
    @param jointCount  of the robot */
    void fill(const ConfigNode& block, int jointCount) const;
    /** Fills the members that are written in `block`, a map. Throws Error (BadInput) with all that is wrong: unknown keys,
    required ones that are missing, values out of range. */
    void read(const ConfigNode& block, int jointCount = 0) const;

private:
    struct Target {
        void* member;
        void (*assign)(void* member, const SettingValue& value, const ParameterSpec& spec);
        /** Reads one more described struct; without a block: empties the vector of them. */
        void (*readInner)(void* member, const ConfigNode* block, const std::string& name, int jointCount);
    };

    template <class T>
    static void assign(void* member, const SettingValue& value, const ParameterSpec& spec) {
        set(*static_cast<T*>(member), value, spec);
    }
    template <class T>
    static void set(T& member, const SettingValue& value, const ParameterSpec& spec) {
        if constexpr (detail::InnerOf<T>::isOptional) {
            member.reset();
            if (!detail::isEmpty(value)) set(member.emplace(), value, spec);
        } else if constexpr (std::is_same_v<T, PerJoint>) {
            member = std::get<JointVector>(value);
        } else if constexpr (std::is_enum_v<T> || std::is_same_v<T, bool>) {
            const bool* const flag = std::get_if<bool>(&value);
            member = static_cast<T>(flag ? *flag : detail::findWord(spec.choices, std::get<std::string>(value)));
        } else if constexpr (std::is_integral_v<T>) {
            member = static_cast<T>(std::get<std::int64_t>(value));
        } else {
            member = std::get<T>(value);
        }
    }
    template <int rows, int columns>
    static void set(Eigen::Matrix<double, rows, columns>& member, const SettingValue& value, const ParameterSpec&) {
        const auto& numbers = std::get<std::vector<double>>(value);
        if (numbers.empty()) {  // `auto` of a member that is no optional
            member.setZero();
            return;
        }
        for (int i = 0; i < rows * columns; ++i)
            member(i / columns, i % columns) = numbers[static_cast<std::size_t>(i)];
    }
    template <class T>
    static void readInner(void* member, const ConfigNode* block, const std::string& name, int jointCount) {
        T& outer = *static_cast<T*>(member);
        if constexpr (detail::InnerOf<T>::isVector) {
            if (!block) return outer.clear();
            auto& item = outer.emplace_back();
            if constexpr (detail::HasName<typename T::value_type>::value) item.name = name;
            readSettings(*block, item, jointCount);
        } else if constexpr (detail::InnerOf<T>::isOptional) {
            if (!outer) outer.emplace();
            readSettings(*block, *outer, jointCount);
        } else {
            readSettings(*block, outer, jointCount);
        }
    }

    /** Type and default of a member. */
    template <class T>
    static std::string complete(ParameterSpec& spec, const T& member) {
        if constexpr (detail::InnerOf<T>::isOptional) {
            const std::string standard = complete(spec, member.value_or(typename T::value_type{}));
            return member ? standard : "";
        } else if constexpr (std::is_enum_v<T> || std::is_same_v<T, bool>) {
            spec.type = spec.choices ? ParameterType::Choice : ParameterType::Flag;
            return detail::getWord(spec.choices ? spec.choices : "false|true", static_cast<int>(member));
        } else if constexpr (std::is_integral_v<T>) {
            spec.type = ParameterType::Integer;
            if (sizeof(T) < sizeof(std::int64_t) || std::is_unsigned_v<T>) spec.min = std::numeric_limits<T>::min();
            if (sizeof(T) < sizeof(std::int64_t)) spec.max = std::numeric_limits<T>::max();
            return std::to_string(member);
        } else if constexpr (std::is_same_v<T, std::string>) {
            spec.type = spec.choices ? ParameterType::Choice : ParameterType::Text;
            return member;
        } else if constexpr (std::is_same_v<T, std::filesystem::path>) {
            spec.type = ParameterType::File;
            return member.string();
        } else if constexpr (std::is_same_v<T, JointBounds>) {
            spec.type = ParameterType::Bounds;
            spec.above(0).orInfinite();
            return "";  // the robot's
        } else if constexpr (std::is_same_v<T, std::vector<std::string>>) {
            spec.type = ParameterType::Texts;
            return "";
        } else {
            spec.type = std::is_same_v<T, double>                ? ParameterType::Number
                        : std::is_same_v<T, PerJoint>            ? ParameterType::JointNumbers
                        : std::is_same_v<T, std::vector<double>> ? ParameterType::Numbers
                                                                 : ParameterType::Rows;
            return detail::writeSetting(member);
        }
    }
    template <int rows, int columns>
    static std::string complete(ParameterSpec& spec, const Eigen::Matrix<double, rows, columns>& member) {
        spec.type = ParameterType::Numbers;
        spec.count(rows * columns, rows * columns);
        std::vector<double> numbers;
        for (int i = 0; i < rows * columns; ++i) numbers.push_back(member(i / columns, i % columns));
        return detail::writeSetting(numbers);
    }
    template <int rows, int columns>
    static std::string complete(ParameterSpec& spec,
                                const std::optional<Eigen::Matrix<double, rows, columns>>& member) {
        const std::string standard = complete(spec, member.value_or(Eigen::Matrix<double, rows, columns>::Zero()));
        return member ? standard : "";
    }
    template <class T>
    ParameterSpec& add(T& member, const char* name, const char* unitOrWords, const char* help) {
        using Inner = typename detail::InnerOf<T>::Type;
        constexpr bool isWord =
            std::is_enum_v<Inner> || std::is_same_v<Inner, bool> || std::is_same_v<Inner, std::string>;
        ParameterSpec& spec = specs_.emplace_back(ParameterSpec{name, "", ParameterType::Block, nullptr, help});
        (isWord ? spec.choices : spec.unit) = unitOrWords ? unitOrWords : isWord ? nullptr : "";
        Target& target = targets_.emplace_back(Target{&member, nullptr, nullptr});
        std::string& standard = texts_.emplace_back();
        if constexpr (detail::IsDescribed<Inner>::value) {
            if (detail::InnerOf<T>::isVector)
                spec.type = detail::HasName<Inner>::value ? ParameterType::Named : ParameterType::Blocks;
            spec.inner = &settingsOf<Inner>;
            target.readInner = &SettingList::readInner<T>;
        } else {
            standard = complete(spec, member);
            target.assign = &SettingList::assign<T>;
        }
        spec.defaultText = standard.c_str();
        return spec;
    }
    void readNested(const ParameterSpec& spec, const Target& target, const ConfigNode& node, int jointCount) const;

    std::vector<ParameterSpec> specs_;
    std::vector<Target> targets_;
    std::deque<std::string> texts_;  // defaultText points here
};

/** The settings of a struct, with its initial values as defaults. Static: the rows outlive who asks. */
template <class Options>
const std::vector<ParameterSpec>& settingsOf() {
    static const SettingList list = [] {
        Options options;
        SettingList described;
        options.describe(described);
        return described;
    }();
    return list.specs();
}

/** Reads what is written in `block` over what `options` holds; see SettingList::read(). */
template <class Options>
void readSettings(const ConfigNode& block, Options& options, int jointCount) {
    SettingList list;
    options.describe(list);
    list.read(block, jointCount);
    if constexpr (detail::HasCheck<Options>::value) options.check(block);
}

/** A plugin's block, checked and complete: every declared name has a value. */
class Parameters {
public:
    /** The block in the plugin's own words. Asking for names that were not declared is a mistake in the plugin's code and
    throws Error (PluginFailed) that says so. */
    template <class Options>
    Options get() const {
        Options options;
        SettingList list;
        options.describe(list);
        list.fill(resolved_, jointCount_);
        return options;
    }

    /** `file:line:column: key.path` of a parameter (of its block when it has its default), for
    errors that a plugin finds in configure(). */
    const std::string& place(const char* name) const;

    /** The complete block as configuration: defaults filled in, files by their absolute paths. */
    const ConfigNode& resolved() const { return resolved_; }

private:
    friend Parameters readParameters(const ConfigNode&, const ParameterSpec*, std::size_t, int);

    std::map<std::string, std::string> places_;
    ConfigNode resolved_;
    int jointCount_ = 0;
};

/** Reads a plugin's block (a map; the key `plugin` is passed over) by its declaration. File
parameters must exist. They are resolved against the folder of the file that names them; for overrides from the
command line that is the current folder. Throws Error (BadInput) with place, value
and range, those of different parameters together. */
Parameters readParameters(const ConfigNode& block, const ParameterSpec* specs, std::size_t count, int jointCount);

}  // namespace viable
