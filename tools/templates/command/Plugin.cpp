#include "@CLASS@.h"

#include <cmath>

#include "viable/plugin/PluginExport.h"

namespace {

// Declared once: parsing, range errors and `viable plugins --describe @NAME@` come from this table.
const viable::ParameterSpec kParameters[] = {
    viable::parameter::jointNumbers("amplitude_rad", "rad", "0.5", "From the start to the far end."),
    viable::parameter::number("frequency_hz", "Hz", "0.5", "Swings per second.").above(0).upTo(50),
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    amplitude_ = parameters.jointNumbers("amplitude_rad");
    angularFrequency_ = 2.0 * M_PI * parameters.number("frequency_hz");
    start_ = setup.start.q;
}

void @CLASS@::reset(const viable::MotionState& start) {
    start_ = start.q;
}

viable::TickStatus @CLASS@::sample(double t, viable::MotionCommand& out) {
    if (!std::isfinite(t)) return viable::TickStatus::InvalidInput;
    const double w = angularFrequency_;
    out.space = viable::MotionCommand::Space::Joint;
    out.q = start_ + 0.5 * (1.0 - std::cos(w * t)) * amplitude_;
    out.qd = 0.5 * w * std::sin(w * t) * amplitude_;
    return viable::TickStatus::Ok;
}

VIABLE_PLUGIN(viable::CommandSource, @CLASS@, "@NAME@", "Swings every joint about its start.", kParameters)
