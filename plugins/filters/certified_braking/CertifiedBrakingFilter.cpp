#include "CertifiedBrakingFilter.h"

#include <cmath>
#include <cstdio>

#include "viable/core/Error.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::number("k_alpha", "1/s", ".inf",
                      "How fast a limit may be approached; k_alpha * tick_s must not exceed 1. "
                      "Infinite: as fast as the limits allow.")
        .above(0)
        .orInfinite(),
    parameter::number(
        "gamma", "1/s", "20.0",
        "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
        .above(0),
    parameter::flag(
        "recovery", "false",
        "Accept a start outside the limits, or one that must leave them, and lead the arm back."),
};

}  // namespace

void CertifiedBrakingFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    recovery_ = parameters.flag("recovery");
    const double approach =
        std::isinf(parameters.number("k_alpha")) ? 1.0 : parameters.number("k_alpha") * tick_s_;
    const double gamma = parameters.number("gamma");
    if (approach > 1.0)
        throw badInput(parameters.place("k_alpha"),
                       "k_alpha * tick_s is " + std::to_string(approach) + ", allowed (0, 1]",
                       "Choose k_alpha at most 1 / tick_s, or .inf.");
    if (gamma * tick_s_ >= 2.0)
        throw badInput(parameters.place("gamma"),
                       "gamma * tick_s is " + std::to_string(gamma * tick_s_) + ", allowed (0, 2)",
                       "The sampled law is unstable from 2 on; choose gamma below 2 / tick_s.");
    if (!setup.limits.jerk.lower.allFinite() || !setup.limits.jerk.upper.allFinite())
        throw badInput(parameters.place("recovery"),
                       "the filter certified_braking needs a finite jerk limit on every joint",
                       "Set limits.jerk_radps3.");
    desiredJerk_.configure(gamma, tick_s_);
    braking_.configure(setup.limits, tick_s_, approach);
    reset(setup.start);
    for (int i = 0; i < n_ && !recovery_; ++i) {
        const PassedLimit& excess = braking_.findExcess(i);
        if (excess.limit == LimitKind::None) continue;
        char distance[32];
        std::snprintf(distance, sizeof distance, "%.3g", excess.excess);
        throw badInput(parameters.place("recovery"),
                       "the start of " + setup.robot.joints[i].name +
                           " is not viable: its stop passes the limit " +
                           getName(excess.limit, excess.side) + " by " + distance + " " +
                           getUnit(excess.limit),
                       "Start at rest or further inside the limits, or set `recovery: true`.");
    }
}

void CertifiedBrakingFilter::reset(const MotionState& start) {
    desiredJerk_.reset();
    braking_.reset(start);
}

bool CertifiedBrakingFilter::changeLimits(const JointLimits& limits) {
    if (!limits.jerk.lower.allFinite() || !limits.jerk.upper.allFinite()) return false;
    braking_.changeLimits(limits);
    return true;
}

void CertifiedBrakingFilter::skipTicks(std::int64_t ticks) {
    desiredJerk_.reset();  // the difference quotient would span the gap
    braking_.skipTicks(ticks);
}

FilterStatus CertifiedBrakingFilter::filter(const MotionState& nominal, const JointVector& torque,
                                            const Dynamics& dynamics, FilterDecision& decision) {
    if (!isFinite(nominal, n_) || !isFinite(torque, n_) || !isFinite(dynamics, n_))
        return FilterStatus::InvalidInput;
    if (!calcForwardDynamics(dynamics, torque, desiredAcceleration_)) return FilterStatus::Faulted;
    desiredJerk_.calc(nominal.qdd, desiredAcceleration_, desired_);

    std::array<CertifiedBraking::ActingLimit, kMaxJoints> acting;
    const CertifiedBraking::Status status =
        braking_.choose(nominal, dynamics.M, desired_, jerk_, acting);
    holdJerk(nominal, dynamics, jerk_, tick_s_, decision);
    decision.hasStops = true;
    for (int i = 0; i < n_; ++i) {
        decision.joints[i] = {acting[i].limit, acting[i].side};
        decision.stops[i] = braking_.stop(i);
    }
    switch (status) {
        case CertifiedBraking::Status::Passed:
            return FilterStatus::Passed;
        case CertifiedBraking::Status::Modified:
            return FilterStatus::Modified;
        case CertifiedBraking::Status::Returning:
            return FilterStatus::Returning;
    }
    return FilterStatus::Faulted;
}

}  // namespace viable

VIABLE_PLUGIN(
    viable::SafetyFilter, viable::CertifiedBrakingFilter, "certified_braking",
    "Keeps position, velocity, acceleration and jerk limits in sampled time, always: every tick "
    "holds a checked stop.",
    viable::kParameters)
