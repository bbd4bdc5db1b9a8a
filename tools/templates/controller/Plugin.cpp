#include "@CLASS@.h"

#include "viable/plugin/PluginExport.h"

namespace {

// Each setting described once: its member, initial value and line here are all that reading, range errors and
// `viable plugins --describe @NAME@` need.
struct Options {
    viable::PerJoint stiffness = 100.0, damping = 20.0;

    template <class V>
    void describe(V& v) {
        v(stiffness, "stiffness", "Nm/rad", "Torque per position error.").atLeast(0);
        v(damping, "damping", "Nm s/rad", "Torque per velocity.").atLeast(0);
    }
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    n_ = setup.size();
    const auto options = parameters.get<Options>();
    stiffness_ = options.stiffness.expand(n_);
    damping_ = options.damping.expand(n_);
}

viable::TickStatus @CLASS@::compute(const viable::ControllerInput& input, viable::ControllerOutput& output) {
    using viable::isFinite;
    const auto& [command, nominal, dynamics, tick] = input;
    if (command.space != viable::MotionCommand::Space::Joint || !isFinite(command.q, n_) || !isFinite(nominal, n_) ||
        !isFinite(dynamics, n_))
        return viable::TickStatus::InvalidInput;
    output.torque =
        dynamics.gravity + stiffness_.cwiseProduct(command.q - nominal.q) - damping_.cwiseProduct(nominal.qd);
    return viable::TickStatus::Ok;
}

VIABLE_PLUGIN(viable::NominalController, @CLASS@, "@NAME@", "Spring and damper at each joint, with gravity carried.",
              Options)
