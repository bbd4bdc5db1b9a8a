#include "viable/filter/JerkIntervalFilter.h"

#include <algorithm>

namespace viable {

void JerkIntervalFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    limits_ = setup.limits;
    const double gamma = parameters.get<JerkIntervalOptions>().gamma;
    if (gamma * tick_s_ >= 2.0)
        throw badInput(parameters.place("gamma"),
                       "gamma * tick_s is " + std::to_string(gamma * tick_s_) + ", allowed (0, 2)",
                       "The sampled law is unstable from 2 on; choose gamma below 2 / tick_s.");
    requireJerkLimits(limits_, parameters.place("gamma"), std::string("the filter ") + name_);
    desiredJerk_.configure(gamma, tick_s_);
    choice_.configure(limits_.jerk);
}

void JerkIntervalFilter::reset(const MotionState&) {
    desiredJerk_.reset();
    choice_.reset();
}

void JerkIntervalFilter::checkKAlpha(double kAlpha, const RunSetup& setup, const Parameters& parameters) {
    if (kAlpha * setup.tick_s > 1.0)
        throw badInput(parameters.place("k_alpha"),
                       "k_alpha * tick_s is " + std::to_string(kAlpha * setup.tick_s) + ", allowed (0, 1]",
                       "Choose k_alpha at most 1 / tick_s.");
}

JointInterval JerkIntervalFilter::calcHardLimits(const AxisState& s, const AxisLimits& l) const {
    JointInterval jerk{l.jerkLower, l.jerkUpper, LimitKind::Jerk, LimitKind::Jerk};
    jerk.restrictLower((l.accelerationLower - s.a) / tick_s_, LimitKind::Acceleration);
    jerk.restrictUpper((l.accelerationUpper - s.a) / tick_s_, LimitKind::Acceleration);
    return jerk;
}

JerkIntervalFilter::Rows JerkIntervalFilter::finishRows(const JointInterval& jerk, double braking, const AxisState& s,
                                                        const AxisLimits& l) const {
    Rows rows{jerk, jerk.isEmpty()};
    if (rows.empty) {
        const double accelerated =
            std::min(std::max(braking, (l.accelerationLower - s.a) / tick_s_), (l.accelerationUpper - s.a) / tick_s_);
        rows.jerk.collapse(std::min(std::max(accelerated, l.jerkLower), l.jerkUpper));
    }
    return rows;
}

FilterStatus JerkIntervalFilter::chooseJerk(const MotionState& nominal, const Dynamics& dynamics,
                                            const JointVector& desired, JointVector& jerk,
                                            std::array<JointIntervention, kMaxJoints>& joints) {
    bool infeasible = false;
    std::array<JointInterval, kMaxJoints> intervals{};
    for (int i = 0; i < n_; ++i) {
        const Rows rows = calcRows({nominal.q[i], nominal.qd[i], nominal.qdd[i]}, limits_.axis(i));
        infeasible |= rows.empty;
        intervals[i] = rows.jerk;
    }
    const FilterStatus status = choice_.choose(dynamics.M, desired, intervals, jerk, joints);
    return infeasible ? FilterStatus::Infeasible : status;
}

void JerkIntervalFilter::skipTicks(std::int64_t) {
    desiredJerk_.reset();
}

FilterStatus JerkIntervalFilter::filter(const FilterInput& input, FilterDecision& decision) {
    if (!isFinite(input, n_)) return FilterStatus::InvalidInput;
    if (!calcForwardDynamics(input.dynamics, input.torque, desiredAcceleration_)) return FilterStatus::Faulted;
    desiredJerk_.calc(input.nominal.qdd, desiredAcceleration_, input.accelerationRate, desired_);
    const FilterStatus status = chooseJerk(input.nominal, input.dynamics, desired_, jerk_, decision.joints);
    decision.holdJerk(jerk_);
    return status;
}

}  // namespace viable
