#pragma once

#include "viable/config/ConfigNode.h"

namespace viable::detail {

/** `text` between backquotes for a message: cut when long, control bytes replaced, so that a broken
file cannot flood or garble the terminal. */
std::string quoteText(const std::string& text);

/** "the text `abc`", "a list of 3", "a map", "empty": what stands at a node, for a message. */
std::string describeNode(const ConfigNode& node);

/** Whether `text` can stand in a block of YAML without quotes and is read back as the same text. */
bool isPlainText(const std::string& text);

/** Takes line and column from the node and all below it: assignments and declared defaults stand in
no file. */
void clearLines(ConfigNode& node);

/** "gamma" below "cases.C2.filter". */
std::string joinKeyPath(const std::string& parent, const std::string& key);

/** One YAML value of any kind. Places are those of `fileName`; key paths begin with `keyPath`;
`depth` is how many maps and lists already stand around the value.
@param isWholeFile  the root must be a map, as in a configuration file */
ConfigNode parseYaml(const std::string& text, const std::string& fileName, const std::string& keyPath, int depth,
                     bool isWholeFile);

/** Longest key path: bounds the memory that nested long keys can cause. [bytes] */
inline constexpr std::size_t kMaxKeyPathBytes = 400;

/** What to do about a draw whose text ends before its closing parenthesis; `begun` is that text. */
std::string quoteDrawRemedy(const std::string& begun);

/** The file name that stands for an assignment on the command line. */
inline constexpr const char* kOverrideFile = "--set";

}  // namespace viable::detail
