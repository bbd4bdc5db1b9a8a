#include "CertifiedBrakingFilter.h"

#include <cmath>
#include <cstdio>
#include <string>

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

/** Beyond a limit by less is rounding; relative to the limit. */
constexpr double kRounding = 1e-12;

std::string formatNumber(double value, const char* pattern = "%g") {
    char text[32];
    std::snprintf(text, sizeof text, pattern, value);
    return text;
}

/** What of a joint's start is itself beyond a limit, and the keys that say so. */
struct Outside {
    std::string what, keys;  // empty: nothing is
};

Outside findOutside(const RunSetup& setup, int joint) {
    Outside outside;
    const auto check = [&](LimitKind kind, double value, const JointBounds& bounds,
                           const char* key) {
        const bool below = value < bounds.lower[joint];
        const double bound = below ? bounds.lower[joint] : bounds.upper[joint];
        const double excess = below ? bound - value : value - bound;
        if (!(excess > kRounding * std::abs(bound))) return;
        const std::string unit = std::string(" ") + getUnit(kind);
        outside.what +=
            (outside.what.empty() ? "" : ", ") + std::string(getName(kind, LimitSide::Neither)) +
            " " + formatNumber(value) + unit + " is beyond " +
            getName(kind, below ? LimitSide::Lower : LimitSide::Upper) + " by " +
            formatNumber(excess, "%.3g") + unit + " (limit " + formatNumber(bound) + unit + ")";
        outside.keys += (outside.keys.empty() ? "`start." : ", `start.") + std::string(key) + "`";
    };
    check(LimitKind::Position, setup.start.q[joint], setup.limits.position, "position_rad");
    check(LimitKind::Velocity, setup.start.qd[joint], setup.limits.velocity, "velocity_radps");
    check(LimitKind::Acceleration, setup.start.qdd[joint], setup.limits.acceleration,
          "acceleration_radps2");
    return outside;
}

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
                       "k_alpha * tick_s is " + formatNumber(approach) + ", allowed (0, 1]",
                       "Choose k_alpha at most 1 / tick_s, or .inf.");
    if (gamma * tick_s_ >= 2.0)
        throw badInput(
            parameters.place("gamma"),
            "gamma * tick_s is " + formatNumber(gamma * tick_s_, "%#.3g") + ", allowed (0, 2)",
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
        const std::string who = "the start of " + setup.robot.joints[i].name + " is ";
        const Outside outside = findOutside(setup, i);
        if (!outside.what.empty())
            throw badInput(parameters.place("recovery"),
                           who + "outside its limits: " + outside.what,
                           "Change " + outside.keys +
                               ", or set `recovery: true` here, which leads the arm back.");
        throw badInput(parameters.place("recovery"),
                       who + "not viable: its stop would pass the limit " +
                           getName(excess.limit, excess.side) + " by " +
                           formatNumber(excess.excess, "%.3g") + " " + getUnit(excess.limit),
                       "Change `start` (at rest, or further inside the limits), or set "
                       "`recovery: true` here, which leads the arm back.");
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
