#include "@CLASS@.h"

#include "viable/plugin/PluginExport.h"

namespace {

// Declared once: parsing, range errors and `viable plugins --describe @NAME@` come from this table.
const viable::ParameterSpec kParameters[] = {
    viable::parameter::jointNumbers("stiffness", "Nm/rad", "500", "Torque per position error.").atLeast(0),
    viable::parameter::jointNumbers("damping", "Nm s/rad", "50", "Torque per velocity error.").atLeast(0),
};

}  // namespace

void @CLASS@::configure(const viable::RunSetup& setup, const viable::Parameters& parameters) {
    n_ = setup.size();
    stiffness_ = parameters.jointNumbers("stiffness");
    damping_ = parameters.jointNumbers("damping");
}

void @CLASS@::reset(const viable::MotionState&) {}  // nothing is remembered from tick to tick

viable::TickStatus @CLASS@::compute(const viable::JointState& real, const viable::MotionState& nominal,
                                      const viable::JointVector& filterTorque, viable::JointVector& torque) {
    using viable::isFinite;
    if (!isFinite(real, n_) || !isFinite(nominal, n_) || !isFinite(filterTorque, n_))
        return viable::TickStatus::InvalidInput;
    torque = stiffness_.cwiseProduct(nominal.q - real.q) + damping_.cwiseProduct(nominal.qd - real.qd);
    return viable::TickStatus::Ok;
}

VIABLE_PLUGIN(viable::RobustLoop, @CLASS@, "@NAME@", "Spring and damper between the real joint and the nominal one.",
              kParameters)
