#include "ExponentialCbf.h"

#include "viable/braking/Braking.h"
#include "viable/braking/ExponentialBarrier.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

void ExponentialCbf::configure(const RunSetup& setup, const Parameters& parameters) {
    options_ = parameters.get<ExponentialCbfOptions>();
    checkKAlpha(options_.kAlpha, setup, parameters);
    hasEnded_ = false;
    JerkIntervalFilter::configure(setup, parameters);
}

void ExponentialCbf::reset(const MotionState& start) {
    hasEnded_ = false;
    JerkIntervalFilter::reset(start);
}

JerkIntervalFilter::Rows ExponentialCbf::calcRows(const AxisState& s, const AxisLimits& l) const {
    JointInterval jerk{l.jerkLower, l.jerkUpper, LimitKind::Jerk, LimitKind::Jerk};
    const ExponentialBarrierRows rows = calcExponentialBarrierRows(s, l, options_.kAlpha);
    for (std::size_t r = 0; r < ExponentialBarrierRows::kRows; ++r) {
        jerk.restrictLower(rows.lower[r], ExponentialBarrierRows::kLimits[r]);
        jerk.restrictUpper(rows.upper[r], ExponentialBarrierRows::kLimits[r]);
    }
    return finishRows(jerk, calcStationaryStop(s.v, s.a, l).jerk, s, l);
}

FilterStatus ExponentialCbf::filter(const FilterInput& input, FilterDecision& decision) {
    if (hasEnded_) return FilterStatus::Ended;
    const FilterStatus status = JerkIntervalFilter::filter(input, decision);
    hasEnded_ = !options_.brakes && status == FilterStatus::Infeasible;
    return status;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::ExponentialCbf, "exponential_cbf",
              "Exponential control barrier functions, each limit by itself (the paper's S3); soon has no "
              "admissible jerk.",
              viable::ExponentialCbfOptions)
