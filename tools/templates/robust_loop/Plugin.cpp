#include "@CLASS@.h"

#include "viable/plugin/PluginExport.h"

namespace {

// Each setting described once: its member, initial value and line here are all that reading, range errors and
// `viable plugins --describe @NAME@` need.
struct Options {
    viable::PerJoint stiffness = 500.0, damping = 50.0;

    template <class V>
    void describe(V& v) {
        v(stiffness, "stiffness", "Nm/rad", "Torque per position error.").atLeast(0);
        v(damping, "damping", "Nm s/rad", "Torque per velocity error.").atLeast(0);
    }
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    n_ = setup.size();
    const auto options = parameters.get<Options>();
    stiffness_ = options.stiffness.expand(n_);
    damping_ = options.damping.expand(n_);
}

viable::TickStatus @CLASS@::compute(const viable::JointState& real, const viable::MotionState& nominal,
                                      const viable::JointVector& filterTorque, viable::JointVector& torque) {
    using viable::isFinite;
    if (!isFinite(real, n_) || !isFinite(nominal, n_) || !isFinite(filterTorque, n_))
        return viable::TickStatus::InvalidInput;
    torque = stiffness_.cwiseProduct(nominal.q - real.q) + damping_.cwiseProduct(nominal.qd - real.qd);
    return viable::TickStatus::Ok;
}

VIABLE_PLUGIN(viable::RobustLoop, @CLASS@, "@NAME@", "Spring and damper between the real joint and the nominal one.",
              Options)
