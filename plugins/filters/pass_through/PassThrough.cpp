#include "PassThrough.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

void PassThrough::configure(const RunSetup& setup, const Parameters&) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
}

FilterStatus PassThrough::filter(const FilterInput& input, FilterDecision& decision) {
    if (!isFinite(input, n_)) return FilterStatus::InvalidInput;
    if (!calcDesiredAcceleration(input, tick_s_, acceleration_)) return FilterStatus::Faulted;
    decision.holdAcceleration(acceleration_);
    decision.joints.fill({});
    return FilterStatus::Passed;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::PassThrough, "pass_through",
              "Does not change the desired torque: no limit is kept.", viable::NoOptions)
