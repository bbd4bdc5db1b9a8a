#include "viable/plugin/SafetyFilter.h"

#include <cmath>

namespace viable {

bool SafetyFilter::changeLimits(const JointLimits&) {
    return false;
}

void SafetyFilter::skipTicks(std::int64_t) {}

bool isFinite(const FilterInput& input, int n) {
    return isFinite(input.nominal, n) && isFinite(input.torque, n) && isFinite(input.dynamics, n) &&
           (!input.accelerationRate || isFinite(*input.accelerationRate, n));
}

bool calcDesiredAcceleration(const FilterInput& input, double tick_s, JointVector& qdd) {
    if (!calcForwardDynamics(input.dynamics, input.torque, qdd)) return false;
    if (input.accelerationRate)
        qdd = (qdd + tick_s * *input.accelerationRate).cwiseMin(kLargestAcceleration).cwiseMax(-kLargestAcceleration);
    return true;
}

/** Rounding of M M^-1 (tau_d - b) + b, relative to its terms; where M is ill-conditioned some digits are lost. */
constexpr double kTorqueRounding = 1e-6;

/** True when `needed` = M x + b is the torque `desired` but for rounding. */
static bool isSameTorque(const JointVector& needed, const JointVector& desired, const Dynamics& dynamics,
                         const JointVector& x) {
    for (Eigen::Index i = 0; i < needed.size(); ++i) {
        double size = 1.0 + std::abs(dynamics.b[i]);
        for (Eigen::Index k = 0; k < needed.size(); ++k) size += std::abs(dynamics.M(i, k) * x[k]);
        if (!(std::abs(desired[i] - needed[i]) <= kTorqueRounding * size)) return false;
    }
    return true;
}

void calcHeldMotion(const FilterInput& input, FilterStatus status, const FilterDecision& decision, double tick_s,
                    HeldMotion& motion) {
    const bool holdsJerk = decision.held == HeldQuantity::Jerk;
    if (holdsJerk) {
        motion.jerk = decision.value;
        motion.acceleration = input.nominal.qdd + (0.5 * tick_s) * motion.jerk;
    } else {
        motion.acceleration = decision.value;
        motion.jerk = (motion.acceleration - input.nominal.qdd) / tick_s;
    }
    // lazyProduct: Eigen's blocked product may take scratch memory, this one never does.
    motion.torque = input.dynamics.M.lazyProduct(motion.acceleration);
    motion.torque += input.dynamics.b;
    if (!holdsJerk && status == FilterStatus::Passed &&
        isSameTorque(motion.torque, input.torque, input.dynamics, motion.acceleration))
        motion.torque = input.torque;
}

}  // namespace viable
