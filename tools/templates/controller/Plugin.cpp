#include "@CLASS@.h"

#include "viable/plugin/PluginExport.h"

namespace {

// Declared once: parsing, range errors and `viable plugins --describe @NAME@` come from this table.
const viable::ParameterSpec kParameters[] = {
    viable::parameter::jointNumbers("stiffness", "Nm/rad", "100", "Torque per position error.").atLeast(0),
    viable::parameter::jointNumbers("damping", "Nm s/rad", "20", "Torque per velocity.").atLeast(0),
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    n_ = setup.size();
    stiffness_ = parameters.jointNumbers("stiffness");
    damping_ = parameters.jointNumbers("damping");
}

void @CLASS@::reset(const viable::MotionState&) {}  // nothing is remembered from tick to tick

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
              kParameters)
