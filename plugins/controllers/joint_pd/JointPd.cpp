#include "JointPd.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::jointNumbers("stiffness", "1/s^2", "5.0", "k_p: acceleration per position error.").atLeast(0),
    parameter::jointNumbers("damping", "1/s", "1.0", "k_d: deceleration per velocity.").atLeast(0),
    parameter::flag("velocity_feedforward", "false",
                    "Damp the difference to the commanded velocity instead of the velocity itself."),
};

}  // namespace

void JointPd::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    stiffness_ = parameters.jointNumbers("stiffness");
    damping_ = parameters.jointNumbers("damping");
    feedforward_ = parameters.flag("velocity_feedforward") ? 1.0 : 0.0;
}

void JointPd::reset(const MotionState&) {}

TickStatus JointPd::compute(const ControllerInput& input, ControllerOutput& output) {
    const auto& [command, nominal, dynamics, tick] = input;
    if (command.space != MotionCommand::Space::Joint || !isFinite(command.q, n_) || !isFinite(command.qd, n_) ||
        !isFinite(nominal, n_) || !isFinite(dynamics, n_))
        return TickStatus::InvalidInput;
    acceleration_ =
        stiffness_.cwiseProduct(command.q - nominal.q) - damping_.cwiseProduct(nominal.qd - feedforward_ * command.qd);
    calcInverseDynamics(dynamics, acceleration_, output.torque);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::NominalController, viable::JointPd, "joint_pd",
              "Joint-space PD with inverse dynamics (the paper's simulations).", viable::kParameters)
