#include "@CLASS@.h"

#include <cmath>

#include "viable/plugin/PluginExport.h"

namespace {

// Each setting described once: its member, initial value and line here are all that reading, range errors and
// `viable plugins --describe @NAME@` need.
struct Options {
    viable::PerJoint amplitude_rad = 0.5;
    double frequency_hz = 0.5;

    template <class V>
    void describe(V& v) {
        v(amplitude_rad, "amplitude_rad", "rad", "From the start to the far end.");
        v(frequency_hz, "frequency_hz", "Hz", "Swings per second.").above(0).upTo(50);
    }
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    const auto options = parameters.get<Options>();
    amplitude_ = options.amplitude_rad.expand(setup.size());
    angularFrequency_ = 2.0 * M_PI * options.frequency_hz;
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

VIABLE_PLUGIN(viable::CommandSource, @CLASS@, "@NAME@", "Swings every joint about its start.", Options)
