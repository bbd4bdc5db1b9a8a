#pragma once

#include <string>

namespace viable {

/** Key in the log's metadata: the kinds of limits that were added to those of this program. */
inline constexpr char kLimitKindsKey[] = "limit_kinds";

/** What a reader without their libraries must know of these kinds, as JSON: units, words, columns and keys of figures;
empty: there are none. */
std::string writeLimitKinds();

/** Adds the kinds that a log tells of; one that a loaded library counts stays as it is. Logs of before tell units only.
A kind that finds no room here stays unknown, and its channel is skipped like all that is unknown. */
void readLimitKinds(const std::string& text);

}  // namespace viable
