#include "loop/FollowingWatch.h"

namespace viable::detail {

/** Without a velocity limit a joint may be away by this share of its range, and without that by so much [rad, m]. */
constexpr double kShareOfRange = 0.1, kFarRad = 1.0, kFarM = 0.3;
/** A motor this near to its limit is at it. */
constexpr double kAtLimit = 0.999;
/** A motor that gives less than this share of a torque that is more than nothing, a share of its limit, is weak. */
constexpr double kWeak = 0.9, kSomething = 0.05;

static double calcFastest(const JointLimits& limits, int i) {
    return std::max(limits.velocity.upper[i], -limits.velocity.lower[i]);
}

void FollowingWatch::begin(const RunSetup& setup) {
    hasFound_ = false;
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    tick_ = 0;
    delayTicks_ = setup.delayTicks;
    torqueLimit_ = setup.robot.actuation.torqueLimit;
    for (JointVector* v : {&allowedError_, &leastError_, &largestError_, &fastest_, &leastSwing_, &leastTravel_,
                           &saturation_, &weakness_, &withheld_})
        v->setZero(n_);
    swings_ = {};
    pushes_ = {};
    for (int i = 0; i < n_; ++i) {
        const bool slides = setup.robot.joints[i].type == JointType::Prismatic;
        const double counts = kCounts * setup.robot.encoderStep(i);
        const double range = setup.limits.position.upper[i] - setup.limits.position.lower[i];
        leastError_[i] = std::max(slides ? kLeastErrorM : kLeastErrorRad, counts);
        largestError_[i] = std::max(leastError_[i], kLargestShare * range);
        leastSwing_[i] = std::max(slides ? kLeastSwingMps : kLeastSwingRadps, counts / tick_s_);
        leastTravel_[i] = slides ? kLeastTravelM : kLeastTravelRad;
        if (std::isfinite(calcFastest(setup.limits, i))) continue;
        const double far = std::isfinite(range) ? kShareOfRange * range : slides ? kFarM : kFarRad;
        allowedError_[i] = std::max(leastError_[i], far);
        fastest_[i] = allowedError_[i] / kLag_s;
    }
    widen(setup.limits);
}

void FollowingWatch::widen(const JointLimits& limits) {
    for (int i = 0; i < n_; ++i) {
        const double fastest = calcFastest(limits, i);
        if (!std::isfinite(fastest)) continue;
        fastest_[i] = std::max(fastest_[i], fastest);
        allowedError_[i] = std::max(allowedError_[i], std::clamp(kLag_s * fastest, leastError_[i], largestError_[i]));
    }
}

bool FollowingWatch::runsAway(const JointState& real, const MotionState& nominal) const {
    for (int i = 0; i < n_; ++i)
        if (!(std::abs(real.q[i] - nominal.q[i]) <= kRunaway * allowedError_[i])) return true;
    return false;
}

/** True once the joint has swung often enough. */
bool FollowingWatch::swings(int joint, double velocityError, double elapsed_s, bool isAtLimit) {
    Swing& swing = swings_[joint];
    const int sign = velocityError > 0.0 ? 1 : velocityError < 0.0 ? -1 : swing.sign;
    const bool late = isLate(swing.since);
    if (sign != swing.sign) {
        const double least = std::max((swing.isAtLimit ? kShare : kFarShare) * fastest_[joint], leastSwing_[joint]);
        const bool counts = swing.largest > least && std::abs(swing.travel) > leastTravel_[joint] && !late;
        // One that the ticks happened to sample where it is small is taken back, not all before it.
        const int halves = counts ? swing.halves + 1 : late ? 0 : std::max(0, swing.halves - 1);
        swing = {sign, halves, tick_, 0.0, 0.0, swing.largest, false};
    } else if (late) {
        swing.halves = 0;
    }
    swing.largest = std::max(swing.largest, std::abs(velocityError));
    swing.travel += velocityError * elapsed_s;
    swing.isAtLimit |= isAtLimit;
    return swing.halves >= kHalfPeriods;
}

/** True once the robust loop has pushed the motor to and fro for long enough. Where the nominal arm's own torque is not
zero only the nearer limit is met; what that torque leaves of the limit is the way to both sides. */
bool FollowingWatch::pushesToAndFro(int joint, double asked, double robust, bool isCut) {
    Push& push = pushes_[joint];
    const double limit = torqueLimit_[joint], nominal = std::abs(asked - robust);
    const int sign = robust > 0.0 ? 1 : robust < 0.0 ? -1 : push.sign;
    const bool late = isLate(push.since);
    if (late || (sign != push.sign && !push.isLarge)) push.begun = tick_;
    if (late) push.since = tick_;
    if (sign != push.sign) {
        push.sign = sign;
        push.since = tick_;
        push.isLarge = false;
    }
    // Beyond its limit the nominal torque is cut by the robust loop's.
    push.isLarge |= isCut;
    push.isLarge |= nominal < limit && std::abs(robust) >= std::max(kPush * (limit - nominal), kLeastPush * limit);
    const std::int64_t ticks = tick_ - push.begun;
    return ticks >= kPushTicks && static_cast<double>(ticks) * tick_s_ >= kHalfPeriods * halfPeriod();
}

FollowingWatch::Violation FollowingWatch::update(const JointState& real, const MotionState& nominal,
                                                 const Torques& torques, std::int64_t elapsedTicks) {
    tick_ += elapsedTicks;
    const double elapsed_s = static_cast<double>(elapsedTicks) * tick_s_;
    const double recent_s = kRecent_s / kHalfPeriod_s * halfPeriod();
    const double share = std::min(1.0, elapsed_s / recent_s);
    Violation violation;
    for (int i = 0; i < n_; ++i) {
        const double asked = std::abs(torques.asked[i]);
        const double used = std::min(asked, torqueLimit_[i]);
        // With a delay they give something else anyway.
        const bool isWeak =
            delayTicks_ == 0 && std::abs(torques.given[i]) < kWeak * used && !(used <= kSomething * torqueLimit_[i]);
        const bool isAtLimit = !isWeak && used >= kAtLimit * torqueLimit_[i];
        const bool isCut = torques.authority.isCut(i);
        saturation_[i] += share * ((isAtLimit ? 1.0 : 0.0) - saturation_[i]);
        weakness_[i] += share * ((isWeak ? 1.0 : 0.0) - weakness_[i]);
        withheld_[i] += share * ((isCut && !isAtLimit && !isWeak ? 1.0 : 0.0) - withheld_[i]);
        const bool swinging = swings(i, real.qd[i] - nominal.qd[i], elapsed_s, isAtLimit || isWeak || isCut);
        const bool pushing = pushesToAndFro(i, torques.asked[i], torques.robust[i], isCut) &&
                             saturation_[i] + weakness_[i] + withheld_[i] >= kPushedShare;
        if ((swinging || pushing) && violation.cause == Cause::None)
            violation = {Cause::Oscillation, i,           swinging ? -1 : i,
                         swings_[i].last,    fastest_[i], withheld_[i] > saturation_[i]};
    }
    if (violation.cause != Cause::None) return violation;
    double worst = 1.0;
    for (int i = 0; i < n_; ++i) {
        const double error = std::abs(real.q[i] - nominal.q[i]);
        if (error <= worst * allowedError_[i]) continue;
        worst = error / allowedError_[i];
        violation = {Cause::Drift, i, -1, error, allowedError_[i]};
    }
    if (violation.cause == Cause::None) return violation;
    // So fast that it was away before it had swung often enough to tell.
    const Swing& swing = swings_[violation.joint];
    // Where the loop was cut somebody else may have moved the joint.
    const int least = withheld_[violation.joint] < kSaturated ? 1 : 2;
    const bool isFirst = !hasFound_;
    hasFound_ = true;
    if (isFirst && swing.halves >= least)
        return {Cause::Oscillation, violation.joint, -1, swing.last, fastest_[violation.joint]};
    const auto blame = [&](const JointVector& shares, Cause cause) {
        Eigen::Index motor = 0;
        if (shares.maxCoeff(&motor) < kSaturated) return;
        violation.cause = cause;
        violation.motor = static_cast<int>(motor);
    };
    blame(withheld_, Cause::Withheld);
    blame(saturation_, Cause::Saturation);
    blame(weakness_, Cause::Weakness);
    return violation;
}

}  // namespace viable::detail
