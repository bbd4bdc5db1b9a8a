#include "JerkLimitedRate.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

void JerkLimitedRate::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    limits_ = setup.limits;
    for (const JointBounds* bounds : {&limits_.acceleration, &limits_.jerk})
        if (!bounds->lower.allFinite() || !bounds->upper.allFinite())
            throw badInput(parameters.resolved().place(),
                           "the filter jerk_limited_rate needs finite acceleration and jerk limits on every joint",
                           "Set limits.acceleration_radps2 and limits.jerk_radps3.");
}

double JerkLimitedRate::calcAcceleration(double v, double a, double desired, const AxisLimits& l,
                                         JointIntervention& acting) const {
    double x = desired;
    acting = {};
    const auto cap = [&](double bound, LimitKind limit) {
        if (!(x > bound)) return;
        x = bound;
        acting = {limit, LimitSide::Upper};
    };
    const auto raise = [&](double bound, LimitKind limit) {
        if (!(x < bound)) return;
        x = bound;
        acting = {limit, LimitSide::Lower};
    };
    cap(a + l.jerkUpper * tick_s_, LimitKind::Jerk);
    raise(a + l.jerkLower * tick_s_, LimitKind::Jerk);
    cap(l.accelerationUpper, LimitKind::Acceleration);
    cap(-l.jerkLower / l.accelerationUpper * (l.velocityUpper - v), LimitKind::Velocity);
    raise(l.accelerationLower, LimitKind::Acceleration);
    raise(-l.jerkUpper / l.accelerationLower * (l.velocityLower - v), LimitKind::Velocity);
    return x;
}

FilterStatus JerkLimitedRate::filter(const FilterInput& input, FilterDecision& decision) {
    if (!isFinite(input, n_)) return FilterStatus::InvalidInput;
    if (!calcDesiredAcceleration(input, tick_s_, desired_)) return FilterStatus::Faulted;
    acceleration_.resize(n_);
    for (int i = 0; i < n_; ++i)
        acceleration_[i] = calcAcceleration(input.nominal.qd[i], input.nominal.qdd[i], desired_[i], limits_.axis(i),
                                            decision.joints[i]);
    decision.holdAcceleration(acceleration_);
    return acceleration_ == desired_ ? FilterStatus::Passed : FilterStatus::Modified;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::JerkLimitedRate, "jerk_limited_rate",
              "The velocity rate limiter of robot vendors: velocity, acceleration and jerk, no position.",
              viable::NoOptions)
