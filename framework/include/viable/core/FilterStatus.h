#pragma once

namespace viable {

/** Effect of a filter on the desired torque. */
enum class FilterStatus : unsigned char {
    Passed,         ///< the controller's wish is admissible and is done as it is; apply
    Modified,       ///< changed to keep the limits; apply
    StoppedByPlan,  ///< a backup stop is being followed; apply
    Recovering,     ///< a limit cannot be met yet (recovery, shrunk limits): approached as fast as jerk allows; apply
    Infeasible,     ///< no admissible choice existed; the braking fallback is in the decision; apply
    InvalidInput,   ///< input of wrong size or not finite; decision not written, do not apply
    Faulted,        ///< the filter cannot go on; decision not written, do not apply
    /** The filter has no admissible choice left and ends the case here, as its user asked it to; decision not
    written, do not
    apply. The arm is braked; a result and no failure, unless the filter guarantees limits. */
    Ended,
};

/** "passed", "modified", ... as in logs. */
const char* getName(FilterStatus status);

}  // namespace viable
