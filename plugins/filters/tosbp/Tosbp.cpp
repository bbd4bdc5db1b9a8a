#include "Tosbp.h"

#include <algorithm>

#include "viable/core/Error.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::number(
        "k_alpha", "1/s", "5.0",
        "Slope of alpha: how fast a limit may be approached; k_alpha * tick_s must not exceed 1.")
        .above(0),
    parameter::number(
        "gamma", "1/s", "20.0",
        "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
        .above(0),
};

/** Beyond this the size of a torque says nothing more, and M^-1 tau or its difference quotient
could overflow. [Nm] */
constexpr double kLargestTorque = 1e100;

/** An upper end `-J + gain / slope` of the jerk interval, or `open` where it does not restrict. The
quotient is formed only where it does, so `slope` may be zero. */
double calcRow(double J, double gain, double slope, double open) {
    if (gain <= 0.0) return -J;
    if (gain >= slope * (J + open)) return open;
    return -J + gain / slope;
}

}  // namespace

void Tosbp::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    kAlpha_ = parameters.number("k_alpha");
    const double gamma = parameters.number("gamma");
    limits_ = setup.limits;
    if (kAlpha_ * tick_s_ > 1.0)
        throw badInput(
            parameters.place("k_alpha"),
            "k_alpha * tick_s is " + std::to_string(kAlpha_ * tick_s_) + ", allowed (0, 1]",
            "Choose k_alpha at most 1 / tick_s.");
    if (gamma * tick_s_ >= 2.0)
        throw badInput(parameters.place("gamma"),
                       "gamma * tick_s is " + std::to_string(gamma * tick_s_) + ", allowed (0, 2)",
                       "The sampled law is unstable from 2 on; choose gamma below 2 / tick_s.");
    if (!limits_.jerk.lower.allFinite() || !limits_.jerk.upper.allFinite())
        throw badInput(parameters.place("gamma"),
                       "the filter tosbp needs a finite jerk limit on every joint",
                       "Set limits.jerk_radps3.");
    desiredJerk_.configure(gamma, tick_s_, limits_.jerk);
}

void Tosbp::reset(const MotionState&) {
    desiredJerk_.reset();
    qp_.reset();
}

Tosbp::Interval Tosbp::calcInterval(const AxisState& s, const AxisLimits& l) const {
    const double Ju = l.jerkUpper, Jd = -l.jerkLower;
    Interval interval{-Jd, Ju, LimitKind::Jerk, LimitKind::Jerk, 0.0, false};
    const auto restrictUpper = [&](double bound, LimitKind limit) {
        if (bound < interval.upper) interval.upper = bound, interval.upperLimit = limit;
    };
    const auto restrictLower = [&](double bound, LimitKind limit) {
        if (bound > interval.lower) interval.lower = bound, interval.lowerLimit = limit;
    };

    const double accelerationLower = (l.accelerationLower - s.a) / tick_s_;
    const double accelerationUpper = (l.accelerationUpper - s.a) / tick_s_;
    restrictLower(accelerationLower, LimitKind::Acceleration);
    restrictUpper(accelerationUpper, LimitKind::Acceleration);

    const double peak = calcVelocityPeak(s.v, s.a, l);
    if (s.a > 0.0)
        restrictUpper(calcRow(Jd, Jd * kAlpha_ * (l.velocityUpper - peak), s.a, Ju),
                      LimitKind::Velocity);
    if (s.a < 0.0)
        restrictLower(-calcRow(Ju, Ju * kAlpha_ * (peak - l.velocityLower), -s.a, Jd),
                      LimitKind::Velocity);

    const StationaryStop stop = calcStationaryStop(s.v, s.a, l);
    const double stopPosition = s.p + stop.displacement;
    if (stop.side == LimitSide::Upper) {
        interval.margin = l.positionUpper - stopPosition;
        restrictUpper(calcRow(Jd, kAlpha_ * interval.margin, stop.gradientA, Ju),
                      LimitKind::Position);
    } else {
        interval.margin = stopPosition - l.positionLower;
        restrictLower(-calcRow(Ju, kAlpha_ * interval.margin, stop.gradientA, Jd),
                      LimitKind::Position);
    }

    if (interval.lower > interval.upper) {
        interval.empty = true;
        // The policy's own jerk, as far as the acceleration row lets it.
        double brake = std::min(std::max(stop.jerk, accelerationLower), accelerationUpper);
        brake = std::min(std::max(brake, -Jd), Ju);
        interval.lower = interval.upper = brake;
    }
    return interval;
}

FilterStatus Tosbp::filter(const MotionState& nominal, const JointVector& torque,
                           const Dynamics& dynamics, FilterDecision& decision) {
    if (!isFinite(nominal, n_) || !isFinite(torque, n_) || !isFinite(dynamics, n_))
        return FilterStatus::InvalidInput;
    const JointVector wanted = torque.cwiseMax(-kLargestTorque).cwiseMin(kLargestTorque);
    if (!calcForwardDynamics(dynamics, wanted, desiredAcceleration_)) return FilterStatus::Faulted;
    desiredJerk_.calc(nominal.qdd, desiredAcceleration_, desired_);

    bool infeasible = false;
    Interval intervals[kMaxJoints];
    lower_.resize(n_);
    upper_.resize(n_);
    for (int i = 0; i < n_; ++i) {
        intervals[i] = calcInterval({nominal.q[i], nominal.qd[i], nominal.qdd[i]}, limits_.axis(i));
        infeasible |= intervals[i].empty;
        lower_[i] = intervals[i].lower;
        upper_[i] = intervals[i].upper;
    }
    const BoxQp::Status solved = qp_.solve(dynamics.M, desired_, lower_, upper_, jerk_);
    holdJerk(nominal, dynamics, jerk_, tick_s_, decision);
    for (int i = 0; i < n_; ++i) {
        JointIntervention& joint = decision.joints[i];
        joint = {LimitKind::None, LimitSide::Neither, intervals[i].margin};
        if (jerk_[i] >= upper_[i] && desired_[i] > upper_[i])
            joint.limit = intervals[i].upperLimit, joint.side = LimitSide::Upper;
        else if (jerk_[i] <= lower_[i] && desired_[i] < lower_[i])
            joint.limit = intervals[i].lowerLimit, joint.side = LimitSide::Lower;
    }
    if (infeasible) return FilterStatus::Infeasible;
    return solved == BoxQp::Status::TargetInside ? FilterStatus::Passed : FilterStatus::Modified;
}

}  // namespace viable

VIABLE_PLUGIN(
    viable::SafetyFilter, viable::Tosbp, "tosbp",
    "Keeps position, velocity, acceleration and jerk limits by the time-optimal stationary braking "
    "policy (the paper's C2 and S4).",
    viable::kParameters)
