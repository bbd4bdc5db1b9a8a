#include "viable/plugin/SafetyFilter.h"

namespace viable {

const char* getName(FilterStatus status) {
    switch (status) {
        case FilterStatus::Passed:
            return "passed";
        case FilterStatus::Modified:
            return "modified";
        case FilterStatus::StoppedByPlan:
            return "stopped_by_plan";
        case FilterStatus::Recovering:
            return "recovering";
        case FilterStatus::Infeasible:
            return "infeasible";
        case FilterStatus::InvalidInput:
            return "invalid_input";
        case FilterStatus::Ended:
            return "ended";
        case FilterStatus::Faulted:
            return "faulted";
    }
    return "unknown";
}

bool SafetyFilter::guaranteesClearance() const {
    return false;
}

bool SafetyFilter::recovers() const {
    return false;
}

bool SafetyFilter::changeLimits(const JointLimits&) {
    return false;
}

void SafetyFilter::skipTicks(std::int64_t) {}

namespace {

// lazyProduct: Eigen's blocked product may take scratch memory, this one never does.
void calcTorque(const Dynamics& dynamics, FilterDecision& decision) {
    decision.torque = dynamics.M.lazyProduct(decision.acceleration);
    decision.torque += dynamics.b;
}

}  // namespace

// The argument is copied into the decision first: a caller may pass a vector of the decision
// itself.

void holdJerk(const MotionState& nominal, const Dynamics& dynamics, const JointVector& jerk, double tick_s,
              FilterDecision& decision) {
    decision.held = HeldQuantity::Jerk;
    decision.jerk = jerk;
    decision.acceleration = nominal.qdd + (0.5 * tick_s) * decision.jerk;
    calcTorque(dynamics, decision);
}

void holdAcceleration(const MotionState& nominal, const Dynamics& dynamics, const JointVector& acceleration,
                      double tick_s, FilterDecision& decision) {
    decision.held = HeldQuantity::Acceleration;
    decision.acceleration = acceleration;
    decision.jerk = (decision.acceleration - nominal.qdd) / tick_s;
    calcTorque(dynamics, decision);
}

}  // namespace viable
