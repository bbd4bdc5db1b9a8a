#include "Tosbp.h"

#include <algorithm>
#include <limits>

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

/** A stop or a peak this little beyond its limit is on the limit, up to rounding. [rad, rad/s] */
constexpr double kRounding = 1e-12;

/** The upper end of the jerk interval that a row sets, `-J + weight h / slope`, or `open` where it
does not restrict; the quotient is formed only where it does, so `slope` may be zero. Beyond the
limit (h < 0) the row asks for less than -J: no jerk does that. */
double calcRow(double J, double h, double weight, double slope, double open) {
    if (h < -kRounding) return -std::numeric_limits<double>::infinity();
    if (h <= 0.0) return -J;
    const double gain = weight * h;
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
    desiredJerk_.configure(gamma, tick_s_);
    choice_.configure(limits_.jerk);
}

void Tosbp::reset(const MotionState&) {
    desiredJerk_.reset();
    choice_.reset();
}

Tosbp::Rows Tosbp::calcRows(const AxisState& s, const AxisLimits& l) const {
    const double Ju = l.jerkUpper, Jd = -l.jerkLower;
    Rows rows{{-Jd, Ju, LimitKind::Jerk, LimitKind::Jerk}, false};
    JointInterval& jerk = rows.jerk;

    const double accelerationLower = (l.accelerationLower - s.a) / tick_s_;
    const double accelerationUpper = (l.accelerationUpper - s.a) / tick_s_;
    jerk.restrictLower(accelerationLower, LimitKind::Acceleration);
    jerk.restrictUpper(accelerationUpper, LimitKind::Acceleration);

    const double peak = calcVelocityPeak(s.v, s.a, l);
    if (s.a > 0.0)
        jerk.restrictUpper(calcRow(Jd, l.velocityUpper - peak, Jd * kAlpha_, s.a, Ju),
                           LimitKind::Velocity);
    if (s.a < 0.0)
        jerk.restrictLower(-calcRow(Ju, peak - l.velocityLower, Ju * kAlpha_, -s.a, Jd),
                           LimitKind::Velocity);

    const StationaryStop stop = calcStationaryStop(s.v, s.a, l);
    const double stopPosition = s.p + stop.displacement;
    if (stop.side == LimitSide::Upper) {
        const double h = l.positionUpper - stopPosition;
        jerk.restrictUpper(calcRow(Jd, h, kAlpha_, stop.gradientA, Ju),
                           LimitKind::Position);
    } else {
        const double h = stopPosition - l.positionLower;
        jerk.restrictLower(-calcRow(Ju, h, kAlpha_, stop.gradientA, Jd),
                           LimitKind::Position);
    }

    if (jerk.isEmpty()) {
        rows.empty = true;
        // The policy's own jerk, as far as acceleration and jerk limits let it.
        const double brake = std::min(std::max(stop.jerk, accelerationLower), accelerationUpper);
        jerk.collapse(std::min(std::max(brake, -Jd), Ju));
    }
    return rows;
}

FilterStatus Tosbp::filter(const MotionState& nominal, const JointVector& torque,
                           const Dynamics& dynamics, FilterDecision& decision) {
    if (!isFinite(nominal, n_) || !isFinite(torque, n_) || !isFinite(dynamics, n_))
        return FilterStatus::InvalidInput;
    if (!calcForwardDynamics(dynamics, torque, desiredAcceleration_)) return FilterStatus::Faulted;
    desiredJerk_.calc(nominal.qdd, desiredAcceleration_, desired_);

    bool infeasible = false;
    std::array<JointInterval, kMaxJoints> intervals;
    for (int i = 0; i < n_; ++i) {
        const Rows rows = calcRows({nominal.q[i], nominal.qd[i], nominal.qdd[i]}, limits_.axis(i));
        infeasible |= rows.empty;
        intervals[i] = rows.jerk;
    }
    const FilterStatus status =
        choice_.choose(dynamics.M, desired_, intervals, jerk_, decision.joints);
    holdJerk(nominal, dynamics, jerk_, tick_s_, decision);
    return infeasible ? FilterStatus::Infeasible : status;
}

}  // namespace viable

VIABLE_PLUGIN(
    viable::SafetyFilter, viable::Tosbp, "tosbp",
    "Keeps position, velocity, acceleration and jerk limits by the time-optimal stationary braking "
    "policy (the paper's C2 and S4).",
    viable::kParameters)
