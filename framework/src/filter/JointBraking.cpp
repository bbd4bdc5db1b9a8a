#include "filter/JointBraking.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "core/Text.h"
#include "viable/robot/RobotModel.h"

namespace viable::detail {

namespace {

/** Weight of the torques beside the tool's jerk, both relative to their size: enough for joints that the tool leaves free
and for singular poses. */
constexpr double kTorqueWeight = 0.01;

/** Beyond a limit by less is rounding; relative to the limit. */
constexpr double kRounding = 1e-12;

/** What of a joint's start is itself beyond a limit, and the keys that say so. */
struct Outside {
    std::string what, keys;  // empty: nothing is
};

Outside findOutside(const RunSetup& setup, int joint) {
    Outside outside;
    const auto check = [&](LimitKind kind, double value, const JointBounds& bounds, const char* key) {
        const bool below = value < bounds.lower[joint];
        const double bound = below ? bounds.lower[joint] : bounds.upper[joint];
        const double excess = below ? bound - value : value - bound;
        if (!(excess > kRounding * std::abs(bound))) return;
        const std::string unit = std::string(" ") + getUnit(kind, setup.robot.slides(joint));
        outside.what += (outside.what.empty() ? "" : ", ") + std::string(getName(kind, LimitSide::Neither)) + " " +
                        format("%g", value) + unit + " is beyond " +
                        getName(kind, below ? LimitSide::Lower : LimitSide::Upper) + " by " + format("%.3g", excess) +
                        unit + " (limit " + format("%g", bound) + unit + ")";
        outside.keys += (outside.keys.empty() ? "`start." : ", `start.") + std::string(key) + "`";
    };
    check(LimitKind::Position, setup.start.q[joint], setup.limits.position, "position_rad");
    check(LimitKind::Velocity, setup.start.qd[joint], setup.limits.velocity, "velocity_radps");
    check(LimitKind::Acceleration, setup.start.qdd[joint], setup.limits.acceleration, "acceleration_radps2");
    return outside;
}

}  // namespace

/** How messages speak to whoever configures: by an experiment file, or in code. */
struct JointBraking::Wording {
    std::string kAlpha, gamma, recovery;  // places
    std::string infinity, jerkRemedy, recoveryRemedy;
    bool namesKeys;  // of the start
};

void JointBraking::configure(const RunSetup& setup, const CertifiedBrakingOptions& options,
                             const Parameters& parameters) {
    configure(setup, options,
              {parameters.place("k_alpha"), parameters.place("gamma"), parameters.place("recovery"), ".inf",
               "Set limits.jerk_radps3.", "or set `recovery: true` here, which recovers from such a start.", true});
}

void JointBraking::configure(const RunSetup& setup, const CertifiedBrakingOptions& options, const std::string& owner) {
    const std::string place = owner + "::";
    configure(setup, options,
              {place + "kAlpha", place + "gamma", place + "recovery", "infinity",
               "Give JointLimits::jerk a number for every joint and side.",
               "or set " + place + "recovery, which recovers from such a start.", false});
}

void JointBraking::configure(const RunSetup& setup, const CertifiedBrakingOptions& options, const Wording& wording) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    recovery_ = options.recovery;
    objective_ = options.objective;
    if (objective_ == Objective::Tool) {
        Dynamics dynamics;
        RobotModel(setup.robot).calcDynamics(setup.start.q, setup.start.qd, dynamics);
        leverArm_m_ = calcLeverArm(dynamics.J);
    }
    metric_.setIdentity(n_, n_);
    const double approach = std::isinf(options.kAlpha) && options.kAlpha > 0.0 ? 1.0 : options.kAlpha * tick_s_;
    const double follow = options.gamma * tick_s_;
    if (!(approach > 0.0 && approach <= 1.0))
        throw badInput(wording.kAlpha, "k_alpha * tick_s is " + format("%g", approach) + ", allowed (0, 1]",
                       "Choose k_alpha at most 1 / tick_s, or " + wording.infinity + ".");
    if (!(follow > 0.0 && follow < 2.0))
        throw badInput(wording.gamma, "gamma * tick_s is " + format("%#.3g", follow) + ", allowed (0, 2)",
                       "The sampled law is unstable from 2 on; choose gamma below 2 / tick_s.");
    requireJerkLimits(setup.limits, wording.recovery, "this filter", wording.jerkRemedy);
    desiredJerk_.configure(options.gamma, tick_s_);
    braking_.configure(setup.limits, tick_s_, approach);
    reset(setup.start);
    if (!recovery_) checkStart(setup, wording);
}

void JointBraking::checkStart(const RunSetup& setup, const Wording& wording) const {
    for (int i = 0; i < n_; ++i) {
        const PassedLimit& excess = braking_.findExcess(i);
        if (excess.limit == LimitKind::None) continue;
        const std::string who = "the start of " + setup.robot.joints[i].name + " is ";
        const Outside outside = findOutside(setup, i);
        if (!outside.what.empty())
            throw badInput(wording.recovery, who + "outside its limits: " + outside.what,
                           (wording.namesKeys ? "Change " + outside.keys : "Start inside the limits") + ", " +
                               wording.recoveryRemedy);
        throw badInput(wording.recovery,
                       who + "not viable: its stop would pass the limit " + getName(excess.limit, excess.side) +
                           " by " + format("%.3g", excess.excess) + " " + getUnit(excess.limit, setup.robot.slides(i)),
                       (wording.namesKeys ? "Change `start` (at rest, or further inside the limits), "
                                          : "Start at rest, or further inside the limits, ") +
                           wording.recoveryRemedy);
    }
}

void JointBraking::reset(const MotionState& start) {
    desiredJerk_.reset();
    braking_.reset(start);
}

bool JointBraking::changeLimits(const JointLimits& limits) {
    if (!limits.hasJerkLimits()) return false;
    braking_.changeLimits(limits);
    return true;
}

void JointBraking::skipTicks(std::int64_t ticks) {
    desiredJerk_.reset();  // the difference quotient would span the gap
    braking_.skipTicks(ticks);
}

FilterStatus JointBraking::findDesired(const FilterInput& input) {
    if (!isFinite(input, n_)) return FilterStatus::InvalidInput;
    if (!calcForwardDynamics(input.dynamics, input.torque, desiredAcceleration_)) return FilterStatus::Faulted;
    desiredJerk_.calc(input.nominal.qdd, desiredAcceleration_, input.accelerationRate, desired_);
    return FilterStatus::Passed;
}

const JointMatrix* JointBraking::findMetric(const Dynamics& dynamics) {
    if (objective_ == Objective::Torque) return &dynamics.M;
    if (objective_ == Objective::Joint) return &metric_;
    if (objective_ == Objective::Path) return nullptr;
    // The triangular factor of W'W, W = [S J; share of M].
    ToolJacobian weighted = dynamics.J;
    weighted.bottomRows<3>() *= leverArm_m_;
    const double share = kTorqueWeight * weighted.norm() / dynamics.M.norm();
    JointMatrix square = weighted.transpose().lazyProduct(weighted);
    square += (share * share) * dynamics.M.transpose().lazyProduct(dynamics.M);
    const Eigen::LLT<JointMatrix> factors(square);
    if (factors.info() != Eigen::Success) return &dynamics.M;
    metric_ = factors.matrixU();
    return &metric_;
}

void JointBraking::decide(const JointVector& jerk, FilterDecision& decision) const {
    decision.holdJerk(jerk);
    decision.hasStops = true;
    for (int i = 0; i < n_; ++i) decision.stops[i] = braking_.stop(i);
}

}  // namespace viable::detail
