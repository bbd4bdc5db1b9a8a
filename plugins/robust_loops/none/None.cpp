#include "None.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

TickStatus None::compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                         JointVector& torque) {
    if (!isFinite(real, n_) || !isFinite(nominal, n_) || !isFinite(filterTorque, n_)) return TickStatus::InvalidInput;
    torque.setZero(n_);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::RobustLoop, viable::None, "none", "Adds no torque, for comparison.", viable::NoOptions)
