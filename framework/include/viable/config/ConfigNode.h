#pragma once

#include <cstdint>
#include <filesystem>
#include <utility>

#include "viable/core/Error.h"
#include "viable/core/JointTypes.h"

namespace viable {

/** A part of a YAML file as it was written, with its place. So every later message can name file, line, column and key
path.

The reader is strict where YAML is lax. Duplicate keys, anchors, aliases, merge keys, tags, several documents in one
file and non-text keys are errors. No file is read partly. */
struct ConfigNode {
    enum class Kind { Empty, Scalar, List, Map };

    Kind kind = Kind::Empty;
    std::string text;               ///< a Scalar as written (without quotes)
    bool quoted = false;            ///< the Scalar was in quotes, or must be when written: never a number
    std::vector<ConfigNode> items;  ///< entries of a List
    std::vector<std::pair<std::string, ConfigNode>> entries;  ///< entries of a Map, in file order

    std::string file;     ///< as given by the user; "--set" for an override
    int line = 0;         ///< 1-based; 0 when there is no place
    int column = 0;       ///< 1-based
    std::string keyPath;  ///< "cases.C2.filter.gamma", "waypoints[3]"; empty at the root

    /** `file:line:column: key.path`: the `where` of an Error. */
    std::string place() const;
    /** The entry's value, or null; a Map only. */
    const ConfigNode* find(const std::string& key) const;
    ConfigNode* find(const std::string& key);
};

/** Bounds of the work that a configuration file may cause: any file is read or refused in about
0.1 s. Nodes are keys and values together. */
inline constexpr std::uintmax_t kMaxConfigBytes = 1u << 20;
inline constexpr int kMaxConfigNodes = 50000;
inline constexpr int kMaxConfigDepth = 32;

/** Reads a whole file; throws Error (BadInput) with the place of the first fault. UTF-8 with or
without byte-order mark, LF or CRLF; the root must be a map. Files larger than the bounds above are
refused before they are parsed. */
ConfigNode readConfigFile(const std::filesystem::path& file);

/** The same for text in memory; `fileName` is used in messages only. */
ConfigNode parseConfig(const std::string& text, const std::string& fileName);

/** The node as YAML text that parseConfig reads back to the same tree. */
std::string writeConfig(const ConfigNode& node);

/** Replaces or adds one entry: `assignment` is `key.path=value`, value in YAML (`3`, `[1, 2]`,
`{plugin: nric}`, `text`); `key[2]` is an existing entry of a list. Missing maps on the path are
created. Setting the `plugin` of a block to another plugin drops the block's other entries, which
were those of the previous plugin. */
void applyOverride(ConfigNode& root, const std::string& assignment);

/** `base` overlaid by `top`: maps entry by entry, anything else replaced as a whole; a block whose
`plugin` differs is replaced as a whole too. Places and key paths stay those of the files. */
ConfigNode overlay(const ConfigNode& base, const ConfigNode& top);

/** The placeholder in a file made by `viable new` where the user has to write a value. */
inline constexpr const char* kBlank = "TODO";
/** Throws when `node` is such a placeholder. toNumber calls it. */
void refuseBlank(const ConfigNode& node);

/** Allowed numbers. */
struct NumberRange {
    double min = -std::numeric_limits<double>::infinity();
    double max = std::numeric_limits<double>::infinity();
    bool minIsOpen = false;  ///< min itself is not allowed
    bool maxIsOpen = false;
    bool mayBeInfinite = false;  ///< accepts `.inf` and `-.inf` ("no limit")

    bool contains(double value) const;
    /** "[0, 2)", "(0, inf)", ...: for messages and tables. */
    std::string text() const;
};

/** A finite number or an expression of numbers, `pi`, + - * / and parentheses, such as `2*pi/3`.
Refuses text, .nan, .inf (unless allowed), numbers that underflow or overflow, leading zeros, units
in the value, and values outside the range. */
double toNumber(const ConfigNode& node, const NumberRange& range = {});
std::int64_t toInteger(const ConfigNode& node, std::int64_t min, std::int64_t max);
/** `true` or `false`, nothing else. */
bool toFlag(const ConfigNode& node);
/** Any scalar, as written. */
std::string toText(const ConfigNode& node);
/** One of `choices`; a miss names the closest and all. */
std::string toChoice(const ConfigNode& node, const std::vector<std::string>& choices);
/** A list of between minCount and maxCount numbers. */
std::vector<double> toNumbers(const ConfigNode& node, int minCount, int maxCount, const NumberRange& range = {});
/** A list with exactly n numbers, or a single number that stands for all n joints. */
JointVector toJointVector(const ConfigNode& node, int n, const NumberRange& range = {});

/** Reads the entries of a map one by one and refuses those that were never asked for. */
class ConfigMap {
public:
    /** Throws unless `node` is a Map. The node must outlive this object. */
    explicit ConfigMap(const ConfigNode& node);

    /** The entry's value, or null when the key is absent; either way the key is now known. */
    const ConfigNode* find(const std::string& key);
    /** The same; a missing key is an error. */
    const ConfigNode& require(const std::string& key);
    const ConfigNode& node() const { return node_; }

    /** Throws when the map has keys that were never asked for: all of them together, each with the closest known one. */
    void finish() const;

private:
    const ConfigNode& node_;
    std::vector<std::string> known_;
};

}  // namespace viable
