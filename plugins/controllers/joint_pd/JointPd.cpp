#include "JointPd.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct JointPdOptions {
    PerJoint stiffness = 5.0, damping = 1.0;
    bool feedforward = false;

    template <class V>
    void describe(V& v) {
        v(stiffness, "stiffness", "1/s^2", "k_p: acceleration per position error.").atLeast(0);
        v(damping, "damping", "1/s", "k_d: deceleration per velocity.").atLeast(0);
        v(feedforward, "velocity_feedforward",
          "Damp the difference to the commanded velocity instead of the velocity itself.");
    }
};

}  // namespace

void JointPd::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    const auto options = parameters.get<JointPdOptions>();
    stiffness_ = options.stiffness.expand(n_);
    damping_ = options.damping.expand(n_);
    feedforward_ = options.feedforward ? 1.0 : 0.0;
}

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
              "Joint-space PD with inverse dynamics (the paper's simulations).", viable::JointPdOptions)
