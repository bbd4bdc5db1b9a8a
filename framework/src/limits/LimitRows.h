#pragma once

#include <set>

#include "viable/limits/ArmLimit.h"

namespace viable::detail {

/** No kind of limit, nor its block in summary.json, may have a name of that list. For static objects: the list is asked
for when a kind is added, without a lock.
@param what  has these names, "a channel of the log" */
bool reserveLimitNames(const char* what, std::vector<std::string> (*list)());

/** Runs open() of a plugin library, a file: the kinds that it adds are that library's. */
void addLimitsOf(const std::string& library, void (*open)());
/** The plugin libraries that count that kind, all by the same code; empty: the program does, or nobody. */
std::set<std::string> findLimitLibraries(LimitKind kind);

/** What the row leaves open follows from the kind's name and unit. */
LimitRow complete(LimitRow row, LimitKind kind);

// The kinds that the program brings along, each beside its class.
LimitRow makeClearanceRow();
LimitRow makePointSpeedRow();
LimitRow makeSeparationRow();

}  // namespace viable::detail
