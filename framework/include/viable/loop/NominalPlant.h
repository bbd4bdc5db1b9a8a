#pragma once

#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** Moves the nominal arm through one tick as `decision` says: closed form, exact (paper, eq. 17).
It has no friction and its M and b are known, so tau_c makes it an integrator chain per joint;
nothing is integrated numerically. `tick_s` is the configured tick, never measured time. No
allocation, no throw. */
void advanceNominal(const FilterDecision& decision, double tick_s, MotionState& nominal);

}  // namespace viable
