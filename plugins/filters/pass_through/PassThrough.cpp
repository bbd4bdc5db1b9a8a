#include "PassThrough.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

void PassThrough::configure(const RunSetup& setup, const Parameters&) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
}

void PassThrough::reset(const MotionState&) {}

FilterStatus PassThrough::filter(const MotionState& nominal, const JointVector& torque, const Dynamics& dynamics,
                                 FilterDecision& decision) {
    if (!isFinite(nominal, n_) || !isFinite(torque, n_) || !isFinite(dynamics, n_)) return FilterStatus::InvalidInput;
    if (!calcForwardDynamics(dynamics, torque, acceleration_)) return FilterStatus::Faulted;
    holdAcceleration(nominal, dynamics, acceleration_, tick_s_, decision);
    decision.torque = torque;  // not M (M^-1 (tau - b)) + b, which differs in the last bits
    decision.joints.fill({});
    return FilterStatus::Passed;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::PassThrough, "pass_through",
              "Leaves the desired torque as it is: no limit is kept.", nullptr)
