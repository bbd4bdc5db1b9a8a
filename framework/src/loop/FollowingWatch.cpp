#include "loop/FollowingWatch.h"

#include <algorithm>
#include <cmath>

namespace viable::detail {

namespace {

/** Without a velocity limit a joint may be away by this share of its range, and without that by so much [rad, m]. */
constexpr double kShareOfRange = 0.1, kFarRad = 1.0, kFarM = 0.3;
/** A motor this near to its limit is at it. */
constexpr double kAtLimit = 0.999;
/** A motor that gives less than this share of a torque that is more than nothing, a share of its limit, is weak. */
constexpr double kWeak = 0.9, kSomething = 0.05;

double calcFastest(const JointLimits& limits, int i) {
    return std::max(limits.velocity.upper[i], -limits.velocity.lower[i]);
}

}  // namespace

void FollowingWatch::begin(const RunSetup& setup) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    tick_ = 0;
    delayTicks_ = setup.delayTicks;
    torqueLimit_ = setup.robot.actuation.torqueLimit;
    for (JointVector* v : {&allowedError_, &fastest_, &count_, &saturation_, &weakness_}) v->setZero(n_);
    swings_ = {};
    for (int i = 0; i < n_; ++i) {
        count_[i] = setup.robot.encoderStep(i);
        allowedError_[i] = std::max(kLeastError, kCounts * count_[i]);
    }
    widen(setup.limits);
    for (int i = 0; i < n_; ++i) {
        if (std::isfinite(calcFastest(setup.limits, i))) continue;
        const double range = setup.limits.position.upper[i] - setup.limits.position.lower[i];
        const bool slides = setup.robot.joints[static_cast<std::size_t>(i)].type == JointType::Prismatic;
        const double far = std::isfinite(range) ? kShareOfRange * range : slides ? kFarM : kFarRad;
        allowedError_[i] = std::max(allowedError_[i], far);
        fastest_[i] = allowedError_[i] / kLag_s;
    }
}

void FollowingWatch::widen(const JointLimits& limits) {
    for (int i = 0; i < n_; ++i) {
        const double fastest = calcFastest(limits, i);
        if (!std::isfinite(fastest)) continue;
        fastest_[i] = std::max(fastest_[i], fastest);
        allowedError_[i] = std::max(allowedError_[i], kLag_s * fastest);
    }
}

bool FollowingWatch::runsAway(const JointState& real, const MotionState& nominal) const {
    for (int i = 0; i < n_; ++i)
        if (!(std::abs(real.q[i] - nominal.q[i]) <= kRunaway * allowedError_[i])) return true;
    return false;
}

double FollowingWatch::halfPeriod() const {
    return std::max(kHalfPeriod_s, 2.5 * tick_s_);
}

/** True once the joint has swung often enough. */
bool FollowingWatch::swings(int joint, double velocityError, bool isAtLimit) {
    Swing& swing = swings_[static_cast<std::size_t>(joint)];
    const int sign = velocityError > 0.0 ? 1 : velocityError < 0.0 ? -1 : swing.sign;
    const bool isLate = static_cast<double>(tick_ - swing.since) * tick_s_ > halfPeriod();
    if (sign != swing.sign) {
        const double least = std::max(
            {(swing.isAtLimit ? kShare : kFarShare) * fastest_[joint], kLeastSwing, kCounts * count_[joint] / tick_s_});
        const bool counts = swing.largest > least && std::abs(swing.travel) > kLeastTravel && !isLate;
        // One that the ticks happened to sample where it is small is taken back, not all before it.
        const int halves = counts ? swing.halves + 1 : isLate ? 0 : std::max(0, swing.halves - 1);
        swing = {sign, halves, tick_, 0.0, 0.0, swing.largest, false};
    } else if (isLate) {
        swing.halves = 0;
    }
    swing.largest = std::max(swing.largest, std::abs(velocityError));
    swing.travel += velocityError * tick_s_;
    swing.isAtLimit |= isAtLimit;
    return swing.halves >= kHalfPeriods;
}

FollowingWatch::Finding FollowingWatch::look(const JointState& real, const MotionState& nominal,
                                             const JointVector& asked, const JointVector& given) {
    ++tick_;
    Finding finding;
    const double share = std::min(1.0, tick_s_ / kRecent_s);
    for (int i = 0; i < n_; ++i) {
        const double used = std::min(std::abs(asked[i]), torqueLimit_[i]);
        // With a delay they give something else anyway.
        const bool isWeak =
            delayTicks_ == 0 && std::abs(given[i]) < kWeak * used && !(used <= kSomething * torqueLimit_[i]);
        const bool isAtLimit = !isWeak && used >= kAtLimit * torqueLimit_[i];
        saturation_[i] += share * ((isAtLimit ? 1.0 : 0.0) - saturation_[i]);
        weakness_[i] += share * ((isWeak ? 1.0 : 0.0) - weakness_[i]);
        if (swings(i, real.qd[i] - nominal.qd[i], isAtLimit || isWeak) && finding.cause == Cause::None)
            finding = {Cause::Oscillation, i, -1, swings_[static_cast<std::size_t>(i)].last, fastest_[i]};
    }
    if (finding.cause != Cause::None) return finding;
    double worst = 1.0;
    for (int i = 0; i < n_; ++i) {
        const double error = std::abs(real.q[i] - nominal.q[i]);
        if (error <= worst * allowedError_[i]) continue;
        worst = error / allowedError_[i];
        finding = {Cause::Drift, i, -1, error, allowedError_[i]};
    }
    if (finding.cause == Cause::None) return finding;
    // So fast that it was away before it had swung often enough to tell.
    const Swing& swing = swings_[static_cast<std::size_t>(finding.joint)];
    if (swing.halves > 1) return {Cause::Oscillation, finding.joint, -1, swing.last, fastest_[finding.joint]};
    const auto blame = [&](const JointVector& shares, Cause cause) {
        Eigen::Index motor = 0;
        if (shares.maxCoeff(&motor) < kSaturated) return;
        finding.cause = cause;
        finding.motor = static_cast<int>(motor);
    };
    blame(saturation_, Cause::Saturation);
    blame(weakness_, Cause::Weakness);
    return finding;
}

}  // namespace viable::detail
