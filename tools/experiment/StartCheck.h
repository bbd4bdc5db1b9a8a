#pragma once

#include "experiment/CasePlan.h"

namespace viable::detail {

/** Refuses a start from which a filter that leads no arm back cannot begin: one outside a limit, or one inside whose
fastest stop leaves them. Filters that keep limits by a certificate of their own judge the start by that as well.
Throws Error (BadInput). @param limits  of the nominal arm */
void checkStart(const CasePlan& plan, const JointLimits& limits);

}  // namespace viable::detail
