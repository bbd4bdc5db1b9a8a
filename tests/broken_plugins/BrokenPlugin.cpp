#include "BrokenPlugin.h"

namespace broken {

viable::FilterStatus Filter::filter(const viable::FilterInput& input, viable::FilterDecision& decision) {
    ++ticks_;
    decision.holdAcceleration(input.dynamics.M.llt().solve(input.torque - input.dynamics.b));
    return viable::FilterStatus::Passed;
}

}  // namespace broken
