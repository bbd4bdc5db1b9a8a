#include "@CLASS@.h"

#include "viable/plugin/PluginExport.h"

namespace {

// Each setting described once: its member, initial value and line here are all that reading, range errors and
// `viable plugins --describe @NAME@` need.
struct Options {
    double share = 1.0;

    template <class V>
    void describe(V& v) {
        v(share, "share", "", "Share of the acceleration limits that may be used.").above(0).upTo(1);
    }
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    n_ = setup.size();
    const double share = parameters.get<Options>().share;
    lower_ = share * setup.limits.acceleration.lower;
    upper_ = share * setup.limits.acceleration.upper;
}

viable::FilterStatus @CLASS@::filter(const viable::FilterInput& input, viable::FilterDecision& decision) {
    if (!isFinite(input, n_)) return viable::FilterStatus::InvalidInput;
    viable::JointVector acceleration;
    if (!calcForwardDynamics(input.dynamics, input.torque, acceleration)) return viable::FilterStatus::Faulted;
    viable::FilterStatus status = viable::FilterStatus::Passed;
    decision.joints.fill({});
    for (int i = 0; i < n_; ++i) {
        const bool tooHigh = acceleration[i] > upper_[i], tooLow = acceleration[i] < lower_[i];
        if (!tooHigh && !tooLow) continue;
        acceleration[i] = tooHigh ? upper_[i] : lower_[i];
        decision.joints[static_cast<std::size_t>(i)] = {viable::LimitKind::Acceleration,
                                                        tooHigh ? viable::LimitSide::Upper : viable::LimitSide::Lower};
        status = viable::FilterStatus::Modified;
    }
    decision.holdAcceleration(acceleration);
    return status;
}

VIABLE_PLUGIN(viable::SafetyFilter, @CLASS@, "@NAME@", "Clamps the acceleration of each joint.", Options)
