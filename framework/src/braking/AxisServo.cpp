#include "braking/AxisServo.h"

#include <algorithm>
#include <cmath>

#include "braking/GridPhases.h"
#include "braking/JerkBounds.h"
#include "braking/ShortestStop.h"
#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** What is asked for stays this far inside the limits, relative to them: on its way through a torque and back it is
rounded, and must still be admitted. */
constexpr double kInside = 1e-10;
/** A state is the expected one when it differs by less than a jerk of this share of its limit makes in a tick. */
constexpr double kSameState = 1e-6;
/** Rounding of the position where a stop ends, relative to the distance. */
constexpr double kPassed = 1e-13;
/** What is left of the velocity limit for the motion towards a target that itself moves as fast as that or faster. */
constexpr double kLeastVelocity = 0.05;

AxisLimits shrink(const AxisLimits& l) {
    constexpr double share = 1.0 - kInside;
    const double p = kInside * calcLimitScale(l.positionLower, l.positionUpper);
    return {l.positionLower + p,         l.positionUpper - p,         l.velocityLower * share, l.velocityUpper * share,
            l.accelerationLower * share, l.accelerationUpper * share, l.jerkLower * share,     l.jerkUpper * share};
}

}  // namespace

void AxisServo::configure(const AxisLimits& limits, double tick_s, double share) {
    tick_s_ = tick_s;
    share_ = share;
    limits_ = shrink(limits);
    certificate_.configure(limits_, tick_s, 1.0);
}

void AxisServo::reset(const AxisState& state) {
    certificate_.reset(state);
    approach_.isKnown = hasLastTarget_ = false;
}

void AxisServo::skipTicks(std::int64_t ticks) {
    certificate_.skipTicks(ticks);
    approach_.isKnown = hasLastTarget_ = false;
}

/** Whether the relative state is the one that the approach goes on from. */
bool AxisServo::continues(const AxisState& e) const {
    if (!approach_.isKnown) return false;
    const double J = std::max(-limits_.jerkLower, limits_.jerkUpper) * kSameState;
    const AxisState& x = approach_.expected;
    return std::abs(e.a - x.a) <= J * tick_s_ && std::abs(e.v - x.v) <= J * tick_s_ * tick_s_ &&
           std::abs(e.p - x.p) <= J * tick_s_ * tick_s_ * tick_s_;
}

/** The jerk relative to the target, which is at 0. */
double AxisServo::aim(const AxisState& relative, const AxisLimits& limits, Approach& approach) const {
    approach.isKnown = false;
    const StationaryStop now = calcStationaryStop(relative.v, relative.a, limits);
    // Seen from the side on which the present stop ends before the target.
    const bool mirrored = relative.p + now.displacement > 0.0;
    const AxisState s = mirrored ? detail::mirror(relative) : relative;
    const AxisLimits l = mirrored ? detail::mirror(limits) : limits;
    const double most = std::max(l.jerkLower, std::min({l.jerkUpper, (l.accelerationUpper - s.a) / tick_s_,
                                                        detail::calcVelocityBound(s, l.velocityUpper, l, tick_s_)}));
    StationaryStop fastest;
    const double bound = detail::calcContinuousBound(s, l.jerkLower, most, l, 0.0, tick_s_, fastest);

    // A stop that ends before the target or on it; rounding of the target's own position is no passing.
    double jerk = bound;
    GridStop stop;
    const double rounding = kPassed * std::abs(s.p);
    const auto endsBefore = [&](double u, const GridStop& candidate) {
        AxisState end = advance(s, u, tick_s_);
        if (s.p <= 0.0 && end.p > rounding) return false;
        for (int i = 0; i < GridStop::kSegments; ++i) {
            const GridStop::Segment segment = candidate.remaining(i);
            if (segment.ticks == 0) continue;
            const bool wasAhead = end.v > 0.0;
            end = advance(end, segment.jerk, static_cast<double>(segment.ticks) * tick_s_);
            if (wasAhead && end.v < -kInside * l.velocityUpper) return false;
            if (end.a > l.accelerationUpper * (1.0 + kInside) || end.a < l.accelerationLower * (1.0 + kInside)) return false;
            if (s.p <= 0.0 && end.p > rounding) return false;
        }
        return end.p <= rounding;
    };
    const auto plans = [&](double u) {
        const AxisState after = advance(s, u, tick_s_);
        detail::GridPhases phases;
        if (!detail::planQuickly(after.v, after.a, l, tick_s_, phases)) return false;
        stop = detail::makeStop(phases);
        jerk = u;
        return endsBefore(u, stop);
    };
    const auto find = [&] {
        if (bound >= most && plans(bound)) return true;
        detail::ShortestStop shortest(fastest, l, tick_s_);
        const AxisState after = advance(s, bound, tick_s_);
        jerk = bound;
        if (bound >= most && shortest.find(after, [&](const GridStop& found) {
                stop = found;
                return endsBefore(bound, found);
            }))
            return true;
        if (shortest.findJerkTo(0.0, s, jerk, stop, [&](double u, const GridStop& found) { return u <= most && endsBefore(u, found); })) return true;
        jerk = bound;
        return bound < most && plans(bound);
    };
    const bool goesOn = continues(relative);
    const double tail = !goesOn ? 0.0 : mirrored ? -approach_.stop.nextJerk() : approach_.stop.nextJerk();
    const bool isFound = find();
    if (isFound && !(goesOn && tail >= jerk)) {
        approach.isKnown = true;
        approach.stop = mirrored ? detail::mirror(stop) : stop;
    } else if (goesOn) {
        jerk = tail;
        approach.isKnown = true;
        approach.stop = approach_.stop;
        approach.stop.skip(1);
    }
    if (mirrored) jerk = -jerk;
    approach.expected = advance(relative, jerk, tick_s_);
    return jerk;
}

double AxisServo::calc(const AxisState& state, const AxisState& wanted) {
    certificate_.beginTick(state);
    AxisState target = wanted;
    if (!(wanted.p >= limits_.positionLower && wanted.p <= limits_.positionUpper))
        target = {std::clamp(wanted.p, limits_.positionLower, limits_.positionUpper), 0.0, 0.0};
    // The target's own jerk, where its acceleration does not jump.
    double targetJerk = hasLastTarget_ ? (target.a - lastTarget_.a) / tick_s_ : 0.0;
    if (!(targetJerk >= limits_.jerkLower && targetJerk <= limits_.jerkUpper)) targetJerk = 0.0;
    lastTarget_ = target;
    hasLastTarget_ = true;

    AxisLimits l = limits_;
    l.velocityUpper = std::max(l.velocityUpper - target.v, kLeastVelocity * l.velocityUpper);
    l.velocityLower = std::min(l.velocityLower - target.v, kLeastVelocity * l.velocityLower);
    l.accelerationLower *= share_;
    l.accelerationUpper *= share_;
    l.jerkLower *= share_;
    l.jerkUpper *= share_;
    Approach approach;
    double jerk = aim({state.p - target.p, state.v - target.v, state.a - target.a}, l, approach) + targetJerk;
    const bool rests = target.v == 0.0 && target.a == 0.0 && targetJerk == 0.0;
    approach_ = approach;
    if (rests && approach.isKnown && certificate_.isAdmissible(jerk, approach.stop)) return certificate_.commit(jerk);
    return certificate_.commit(certificate_.isAdmissible(jerk) ? jerk : certificate_.findBound(jerk).jerk);
}

}  // namespace viable
