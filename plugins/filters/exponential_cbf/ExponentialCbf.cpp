#include "ExponentialCbf.h"

#include "viable/braking/Braking.h"
#include "viable/braking/ExponentialBarrier.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::number("k_alpha", "1/s", "5.0",
                      "Every pole of every barrier lies at -k_alpha; k_alpha * tick_s must not exceed 1.")
        .above(0),
    parameter::number("gamma", "1/s", "20.0",
                      "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
        .above(0),
    parameter::choice("on_infeasible", "stop|brake", "stop",
                      "At the first tick without an admissible jerk: end the run there, or brake in each "
                      "such tick, count it and go on."),
};

}  // namespace

void ExponentialCbf::configure(const RunSetup& setup, const Parameters& parameters) {
    kAlpha_ = readKAlpha(setup, parameters);
    stops_ = parameters.text("on_infeasible") == "stop";
    hasEnded_ = false;
    JerkIntervalFilter::configure(setup, parameters);
}

void ExponentialCbf::reset(const MotionState& start) {
    hasEnded_ = false;
    JerkIntervalFilter::reset(start);
}

JerkIntervalFilter::Rows ExponentialCbf::calcRows(const AxisState& s, const AxisLimits& l) const {
    JointInterval jerk{l.jerkLower, l.jerkUpper, LimitKind::Jerk, LimitKind::Jerk};
    const ExponentialBarrierRows rows = calcExponentialBarrierRows(s, l, kAlpha_);
    for (std::size_t r = 0; r < ExponentialBarrierRows::kRows; ++r) {
        jerk.restrictLower(rows.lower[r], ExponentialBarrierRows::kLimits[r]);
        jerk.restrictUpper(rows.upper[r], ExponentialBarrierRows::kLimits[r]);
    }
    return finishRows(jerk, calcStationaryStop(s.v, s.a, l).jerk, s, l);
}

FilterStatus ExponentialCbf::filter(const FilterInput& input, FilterDecision& decision) {
    if (hasEnded_) return FilterStatus::Ended;
    const FilterStatus status = JerkIntervalFilter::filter(input, decision);
    hasEnded_ = stops_ && status == FilterStatus::Infeasible;
    return status;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::ExponentialCbf, "exponential_cbf",
              "Exponential control barrier functions, each limit by itself (the paper's S3); soon has no "
              "admissible jerk.",
              viable::kParameters)
