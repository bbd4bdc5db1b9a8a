#pragma once

#include "experiment/CasePlan.h"
#include "tracking/TrackingBound.h"

namespace viable::detail {

/** The bound on the tracking error of a case with a disturbance_set. It takes seconds and depends on little: the same
inputs, of several cases or of the runs of a sweep, are computed once. Throws Error (BadInput) where none exists. */
TrackingBound findBound(const CasePlan& plan, const LinearErrorLoop& loop);

/** The nominal arm's limits: the file's, under `hold_on: real` with the bound less on each side. Throws Error (BadInput)
where nothing is left. @param bound  null: the case has none */
JointLimits findNominalLimits(const CasePlan& plan, const TrackingBound* bound);

}  // namespace viable::detail
