#include "braking/AxisServo.h"

#include "braking/GridPhases.h"
#include "braking/JerkBounds.h"
#include "braking/ShortestStop.h"

namespace viable {

namespace {

using detail::calcContinuousBound, detail::calcVelocityBound, detail::GridPhases, detail::makeStop, detail::planQuickly,
    detail::ShortestStop;

/** What is asked for stays this far inside the limits, relative to them: on its way through a torque and back it is
rounded, and must still be admitted. */
constexpr double kInside = 1e-10;
/** A state is the expected one when it differs by less than a jerk of this share of its limit makes in a tick. */
constexpr double kSameMotion = 1e-6;
/** Rounding of states, relative to them; of positions at least that of 1 rad. */
constexpr double kStateRounding = 1e-14;
/** Rounding of the position where a stop ends, relative to the distance. */
constexpr double kPassed = 1e-13;
/** What is left of the velocity limit for the motion towards a target that itself moves as fast as that or faster. */
constexpr double kLeastVelocity = 0.05;

AxisLimits shrink(const AxisLimits& l) {
    constexpr double share = 1.0 - kInside;
    const double p =
        std::min(kInside * calcLimitScale(l.positionLower, l.positionUpper), (l.positionUpper - l.positionLower) / 4.0);
    return {l.positionLower + p,         l.positionUpper - p,         l.velocityLower * share, l.velocityUpper * share,
            l.accelerationLower * share, l.accelerationUpper * share, l.jerkLower * share,     l.jerkUpper * share};
}

/** The largest jerk of one tick after which a stop ends before position 0 or on it, and that stop: of a joint whose
present stop ends before it. */
class Search {
public:
    Search(const AxisState& s, const AxisLimits& l, double tick_s)
        : s_(s), l_(l), tick_s_(tick_s), rounding_(kPassed * std::abs(s.p)) {
        most_ = std::max(l.jerkLower, std::min({l.jerkUpper, (l.accelerationUpper - s.a) / tick_s,
                                                calcVelocityBound(s, l.velocityUpper, l, tick_s)}));
        comesBack_ = kInside * std::max(std::abs(s.v), (l.jerkUpper - l.jerkLower) * tick_s * tick_s);
        jerk_ = bound_ = calcContinuousBound(s, l.jerkLower, most_, l, 0.0, tick_s, fastest_);
    }

    /** False when no stop was found after jerk(), which is then that of continuous time. */
    bool find() {
        const bool isFar = bound_ >= most_;  // the target is no bound in this tick
        if (isFar && plans()) return true;
        ShortestStop shortest(fastest_, l_, tick_s_);
        const auto keep = [this](const GridStop& stop) {
            stop_ = stop;
            return endsBefore(bound_, stop);
        };
        if (isFar && shortest.find(advance(s_, bound_, tick_s_), keep)) return true;
        const auto keepsLimits = [this](double jerk, const GridStop& stop) {
            return jerk <= most_ && endsBefore(jerk, stop);
        };
        if (shortest.findJerkTo(0.0, s_, jerk_, stop_, keepsLimits)) return true;
        jerk_ = bound_;
        return !isFar && plans();
    }
    double jerk() const { return jerk_; }
    const GridStop& stop() const { return stop_; }

private:
    bool plans() {
        const AxisState after = advance(s_, bound_, tick_s_);
        GridPhases phases;
        if (!planQuickly(after.v, after.a, l_, tick_s_, phases)) return false;
        stop_ = makeStop(phases);
        return endsBefore(bound_, stop_);
    }

    /** Within the acceleration limits, and without going beyond and coming back. */
    bool endsBefore(double jerk, const GridStop& stop) const {
        const auto passes = [this](const AxisState& x) { return s_.p <= 0.0 && x.p > rounding_; };
        AxisState x = advance(s_, jerk, tick_s_);
        if (passes(x)) return false;
        for (int i = 0; i < GridStop::kSegments; ++i) {
            const GridStop::Segment segment = stop.remaining(i);
            if (segment.ticks == 0) continue;
            const bool wasAhead = x.v > 0.0;
            x = advance(x, segment.jerk, static_cast<double>(segment.ticks) * tick_s_);
            if (wasAhead && x.v < -comesBack_) return false;
            if (x.a > l_.accelerationUpper * (1.0 + kInside) || x.a < l_.accelerationLower * (1.0 + kInside))
                return false;
            if (passes(x)) return false;
        }
        return x.p <= rounding_;
    }

    AxisState s_;
    AxisLimits l_;
    double tick_s_, rounding_, comesBack_, most_, bound_, jerk_;
    StationaryStop fastest_;
    GridStop stop_;
};

}  // namespace

void AxisServo::configure(const AxisLimits& limits, double tick_s, double share) {
    tick_s_ = tick_s;
    share_ = share;
    limits_ = shrink(limits);
    certificate_.configure(limits_, tick_s, 1.0);
}

void AxisServo::reset(const AxisState& state) {
    certificate_.reset(state);
    approach_.isKnown = hasLastTarget_ = hasExpected_ = false;
}

void AxisServo::changeLimits(const AxisLimits& limits) {
    limits_ = shrink(limits);
    certificate_.changeLimits(limits_);
    approach_.isKnown = false;
}

void AxisServo::skipTicks(std::int64_t ticks) {
    certificate_.skipTicks(ticks);
    approach_.isKnown = hasLastTarget_ = hasExpected_ = false;
}

/** But for rounding. */
bool AxisServo::isSame(const AxisState& s, const AxisState& x) const {
    const double a = kSameMotion * std::max(-limits_.jerkLower, limits_.jerkUpper) * tick_s_;
    const double v = a * tick_s_, p = v * tick_s_;
    return std::abs(s.a - x.a) <= a + kStateRounding * std::abs(s.a) &&
           std::abs(s.v - x.v) <= v + kStateRounding * std::abs(s.v) &&
           std::abs(s.p - x.p) <= p + kStateRounding * (1.0 + std::abs(s.p));
}

/** The jerk relative to the target, which is at 0. */
double AxisServo::aim(const AxisState& relative, const AxisLimits& limits, Approach& approach) const {
    const StationaryStop now = calcStationaryStop(relative.v, relative.a, limits);
    // Seen from the side on which the present stop ends before the target.
    const bool mirrored = relative.p + now.displacement > 0.0;
    const auto turn = [mirrored](const auto& x) { return mirrored ? detail::mirror(x) : x; };
    Search search(turn(relative), turn(limits), tick_s_);
    const bool isFound = search.find();
    double jerk = mirrored ? -search.jerk() : search.jerk();

    // The approach of the last tick goes on, unless there is a faster one.
    approach.isKnown = approach_.isKnown && isSame(relative, approach_.expected);
    if (approach.isKnown) {
        approach.stop = approach_.stop;
        const double next = approach.stop.popJerk();
        if (!isFound || (mirrored ? next <= jerk : next >= jerk))
            jerk = next;
        else
            approach.isKnown = false;
    }
    if (isFound && !approach.isKnown) {
        approach.isKnown = true;
        approach.stop = turn(search.stop());
    }
    approach.expected = advance(relative, jerk, tick_s_);
    return jerk;
}

double AxisServo::calc(const AxisState& state, const AxisState& wanted) {
    // Where somebody else decided what the joint does, a new plan: it does not follow a stop of ours.
    isLed_ = hasExpected_ && !isSame(state, expected_);
    if (isLed_)
        certificate_.reset(state);
    else
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
    if (!(rests && approach.isKnown && certificate_.isAdmissible(jerk, approach.stop)) &&
        !certificate_.isAdmissible(jerk))
        jerk = certificate_.findBound(jerk).jerk;
    jerk = certificate_.commit(jerk);
    expected_ = advance(state, jerk, tick_s_);
    hasExpected_ = true;
    return jerk;
}

}  // namespace viable
