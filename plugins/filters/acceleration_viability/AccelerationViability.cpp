#include "AccelerationViability.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

void AccelerationViability::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    kAlpha_ = parameters.get<AccelerationViabilityOptions>().kAlpha;
    limits_ = setup.limits;
    if (kAlpha_ * tick_s_ > 1.0)
        throw badInput(parameters.place("k_alpha"),
                       "k_alpha * tick_s is " + std::to_string(kAlpha_ * tick_s_) + ", allowed (0, 1]",
                       "Choose k_alpha at most 1 / tick_s.");
    if (!limits_.acceleration.lower.allFinite() || !limits_.acceleration.upper.allFinite())
        throw badInput(parameters.place("k_alpha"),
                       "the filter acceleration_viability needs a finite acceleration limit on every joint",
                       "Set limits.acceleration_radps2.");
    choice_.configure(limits_.acceleration);
}

AccelerationViability::Bound AccelerationViability::calcUpperBound(double v, double toLimit, double V, double A,
                                                                   double Ad) const {
    Bound bound{A, LimitKind::Acceleration};
    const double velocityBound = (V - v) / tick_s_;
    if (velocityBound < bound.value) bound = {velocityBound, LimitKind::Velocity};
    if (v > 0.0) {
        const double h = toLimit - v * v / (2.0 * Ad);
        // alpha(h) / v only where it restricts: v may be tiny and h may have passed zero.
        const double positionBound = h <= 0.0                            ? -Ad
                                     : kAlpha_ * h >= v * (A / Ad + 1.0) ? A
                                                                         : Ad * (kAlpha_ * h / v - 1.0);
        if (positionBound < bound.value) bound = {positionBound, LimitKind::Position};
    } else if (toLimit <= 0.0) {
        // (16) says nothing for v <= 0, but a tick that begins so may end with v > 0. At the limit
        // the joint would creep on by A dt^2 every other tick: let it come to rest at most.
        const double restBound = -v / tick_s_;
        if (restBound < bound.value) bound = {restBound, LimitKind::Position};
    }
    return bound;
}

FilterStatus AccelerationViability::filter(const FilterInput& input, FilterDecision& decision) {
    if (!isFinite(input, n_)) return FilterStatus::InvalidInput;
    if (!calcDesiredAcceleration(input, tick_s_, desired_)) return FilterStatus::Faulted;

    bool infeasible = false;
    std::array<JointInterval, kMaxJoints> intervals;
    for (int i = 0; i < n_; ++i) {
        const AxisLimits l = limits_.axis(i);
        const double q = input.nominal.q[i], v = input.nominal.qd[i];
        const double A = l.accelerationUpper, B = -l.accelerationLower;
        const Bound upper = calcUpperBound(v, l.positionUpper - q, l.velocityUpper, A, B);
        const Bound lower = calcUpperBound(-v, q - l.positionLower, -l.velocityLower, B, A);
        intervals[i] = {-lower.value, upper.value, lower.limit, upper.limit};
        if (intervals[i].isEmpty()) {
            // Brake as hard as the other rows allow; they only conflict where one tick of braking
            // would pass the velocity limit on the other side.
            infeasible = true;
            intervals[i].collapse(v > 0.0 ? intervals[i].lower : intervals[i].upper);
        }
    }
    const FilterStatus status = choice_.choose(input.dynamics.M, desired_, intervals, acceleration_, decision.joints);
    decision.holdAcceleration(acceleration_);
    return infeasible ? FilterStatus::Infeasible : status;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::AccelerationViability, "acceleration_viability",
              "Keeps position, velocity and acceleration limits, not jerk (the paper's C1 and S2).",
              viable::AccelerationViabilityOptions)
