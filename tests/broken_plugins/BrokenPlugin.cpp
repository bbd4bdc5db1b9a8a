#include "BrokenPlugin.h"

namespace broken {

viable::FilterStatus Filter::filter(const viable::MotionState& nominal, const viable::JointVector& torque,
                                    const viable::Dynamics& dynamics, viable::FilterDecision& decision) {
    ++ticks_;
    const viable::JointVector desired = dynamics.M.llt().solve(torque - dynamics.b);
    viable::holdAcceleration(nominal, dynamics, desired, tick_s_, decision);
    return viable::FilterStatus::Passed;
}

}  // namespace broken
