#pragma once

#include "viable/limits/ArmLimit.h"

namespace viable::detail {

// The kinds that the program brings along, each beside its class.
LimitRow makeClearanceRow();
LimitRow makePointSpeedRow();
LimitRow makeSeparationRow();

}  // namespace viable::detail
