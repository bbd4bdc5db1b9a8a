#pragma once

#include <string>
#include <vector>

#include "viable/limits/ArmLimit.h"

namespace viable::detail {

/** No kind of limit, nor its block in summary.json, may have a name of that list. For static objects: the list is asked
for when a kind is added, without a lock.
@param what  has these names, "a channel of the log" */
bool reserveLimitNames(const char* what, std::vector<std::string> (*list)());

/** "rad/s^2" as names have it: "radps2". */
std::string makeUnitSuffix(const std::string& unit);

// The kinds that the program brings along, each beside its class.
LimitRow makeClearanceRow();
LimitRow makePointSpeedRow();
LimitRow makeSeparationRow();

}  // namespace viable::detail
