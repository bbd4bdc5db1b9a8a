#include "braking/BrakingCertificate.h"

#include "braking/GridPhases.h"
#include "braking/JerkBounds.h"
#include "braking/ShortestStop.h"

namespace viable {

namespace {

using detail::calcContinuousBound, detail::calcLowerPeak, detail::calcUpperPeak, detail::calcVelocityBound,
    detail::GridPhases, detail::makeStop, detail::mirror, detail::planQuickly, detail::roundUpToTicks,
    detail::ShortestStop;

/** Rounding of states and stops, relative to the size of the limit: what a stop may pass it by ... */
constexpr double kRounding = 1e-13;
/** ... and what adds up when a stop is followed over thousands of ticks. */
constexpr double kDrift = 1e-11;
/** A state differs from the expected one when it does by more than this, relative to the state and the limits. */
constexpr double kSameState = 1e-9;
/** So many ticks of a backup stop are followed one by one; of more the state is taken as it comes. */
constexpr int kMaxFollowedTicks = 1000;
constexpr int kRestRounds = 12;

/** Extremes of a path that is walked segment by segment. */
class Walk {
public:
    explicit Walk(const AxisState& start) : Walk(start, {start.p, start.p, start.v, start.v, start.a, start.a}) {}
    /** @param before  extremes of the path that led to `start` */
    Walk(const AxisState& start, const PathExtremes& before) : s_(start), e_(before) {}

    const AxisState& state() const { return s_; }
    const PathExtremes& extremes() const { return e_; }

    /** The state `jerk` leads to in `t`, and everything between. */
    void hold(double jerk, double t) {
        const AxisState end = advance(s_, jerk, t);
        double least = std::min(s_.v, end.v), largest = std::max(s_.v, end.v);
        if (s_.a * end.a < 0.0) {  // velocity turns inside
            const double turn = s_.v - s_.a * s_.a / (2.0 * jerk);
            least = std::min(least, turn);
            largest = std::max(largest, turn);
        }
        if (least < 0.0 && largest > 0.0) {  // position turns inside
            const double root = std::sqrt(std::max(0.0, s_.a * s_.a - 2.0 * jerk * s_.v));
            const double q = -(s_.a + std::copysign(root, s_.a));
            for (const double when : {q / jerk, 2.0 * s_.v / q})
                if (when > 0.0 && when < t) see(advance(s_, jerk, when).p, e_.positionLower, e_.positionUpper);
        }
        see(least, e_.velocityLower, e_.velocityUpper);
        see(largest, e_.velocityLower, e_.velocityUpper);
        see(end.p, e_.positionLower, e_.positionUpper);
        see(end.a, e_.accelerationLower, e_.accelerationUpper);
        s_ = end;
    }

    /** A whole stop. */
    void follow(const GridStop& stop, double tick_s) {
        for (int i = 0; i < GridStop::kSegments; ++i) {
            const GridStop::Segment segment = stop.remaining(i);
            if (segment.ticks > 0) hold(segment.jerk, static_cast<double>(segment.ticks) * tick_s);
        }
    }

private:
    static void see(double x, double& lower, double& upper) {
        lower = std::min(lower, x);
        upper = std::max(upper, x);
    }

    AxisState s_;
    PathExtremes e_;
};

bool isInside(const PathExtremes& e, const AxisLimits& bounds, const AxisLimits& rounding) {
    return e.positionUpper <= bounds.positionUpper + rounding.positionUpper &&
           e.positionLower >= bounds.positionLower - rounding.positionLower &&
           e.velocityUpper <= bounds.velocityUpper + rounding.velocityUpper &&
           e.velocityLower >= bounds.velocityLower - rounding.velocityLower &&
           e.accelerationUpper <= bounds.accelerationUpper + rounding.accelerationUpper &&
           e.accelerationLower >= bounds.accelerationLower - rounding.accelerationLower;
}

/** Whole ticks in which jerk brings acceleration to zero, at least one. */
std::int64_t calcRampTicks(double a, const AxisLimits& limits, double tick_s) {
    const double J = a > 0.0 ? -limits.jerkLower : limits.jerkUpper;
    return std::max<std::int64_t>(1, roundUpToTicks(std::abs(a) / J, tick_s));
}

/** First acceleration to zero, then the stop from there: what a joint at its velocity limit needs, because the phases of
the direct stop do not let acceleration go fast enough. */
bool planLevelled(const AxisState& s, const AxisLimits& limits, double tick_s, GridStop& stop) {
    const std::int64_t ticks = calcRampTicks(s.a, limits, tick_s);
    const double t = static_cast<double>(ticks) * tick_s;
    const double jerk = std::clamp(-s.a / t, limits.jerkLower, limits.jerkUpper);
    GridPhases g;
    if (!planQuickly(s.v + s.a * t / 2.0, 0.0, limits, tick_s, g)) return false;
    stop.set({{{ticks, jerk}, {g.n1, g.j1}, {g.n2, 0.0}, {g.n3, g.j3}}});
    return true;
}

}  // namespace

void BrakingCertificate::configure(const AxisLimits& limits, double tick_s, double approach) {
    tick_s_ = tick_s;
    approach_ = approach;
    changeLimits(limits);
}

void BrakingCertificate::changeLimits(const AxisLimits& limits) {
    limits_ = limits;
    const double p = kRounding * calcLimitScale(limits.positionLower, limits.positionUpper);
    const double v = kRounding * calcLimitScale(limits.velocityLower, limits.velocityUpper);
    const double a = kRounding * calcLimitScale(limits.accelerationLower, limits.accelerationUpper);
    rounding_ = {p, p, v, v, a, a, 0.0, 0.0};
    mayExceed_ = true;
}

void BrakingCertificate::skipTicks(std::int64_t ticks) {
    for (int i = 0; i < kMaxFollowedTicks && ticks > 0 && !stored_.atRest(); ++i, --ticks) followStored();
    if (stored_.atRest()) return;
    stored_.skip(ticks);
    knowsExpected_ = knowsExpected_ && ticks <= 0;
}

void BrakingCertificate::reset(const AxisState& state) {
    state_ = state;
    knowsExpected_ = false;
    trial_.valid = bound_.valid = false;
    bounds_ = limits_;
    allowed_ = rounding_;
    peakLower_ = limits_.velocityLower;
    peakUpper_ = limits_.velocityUpper;
    if (!planWithin(state, Walk(state).extremes(), stored_)) stored_.plan(state.v, state.a, limits_, tick_s_);
    mayExceed_ = true;
    checkStop();
}

/** The stop of fewest ticks, or another close to it, that keeps the bounds. */
bool BrakingCertificate::planWithin(const AxisState& from, const PathExtremes& before, GridStop& stop) const {
    const auto fits = [&] { return keepsBounds(stop, from, before); };
    if (stop.plan(from.v, from.a, limits_, tick_s_) && fits()) return true;
    if (planLevelled(from, limits_, tick_s_, stop) && fits()) return true;
    return ShortestStop(calcStationaryStop(from.v, from.a, limits_), limits_, tick_s_)
        .find(from, [&](const GridStop& shortest) {
            stop = shortest;
            return fits();
        });
}

/** Which limits the backup stop passes from this state on, and the bounds that follow from it. */
void BrakingCertificate::checkStop() {
    excess_ = {};
    bounds_ = limits_;
    allowed_ = rounding_;
    peakLower_ = limits_.velocityLower;
    peakUpper_ = limits_.velocityUpper;
    drifts_ = false;
    if (!mayExceed_ && approach_ >= 1.0) return;

    Walk walk(state_);
    walk.follow(stored_, tick_s_);
    const PathExtremes& e = walk.extremes();
    const auto keep = [&](LimitKind limit, LimitSide side, double excess) {
        if (excess_.limit == LimitKind::None) excess_ = {limit, side, excess};
    };
    const auto widen = [&](LimitKind limit, double least, double largest, double& lower, double& upper,
                           double& lowerRounding, double& upperRounding) {
        const auto see = [&](LimitSide side, double excess, double extreme, double& bound, double& rounding) {
            if (excess <= rounding) return;
            if (excess <= rounding * (kDrift / kRounding)) {
                rounding = excess;  // what lies ahead must still aim at the limit itself
                mayExceed_ = drifts_ = true;
                return;
            }
            keep(limit, side, excess);
            bound = extreme;
        };
        see(LimitSide::Upper, largest - upper, largest, upper, upperRounding);
        see(LimitSide::Lower, lower - least, least, lower, lowerRounding);
    };
    mayExceed_ = false;
    widen(LimitKind::Acceleration, e.accelerationLower, e.accelerationUpper, bounds_.accelerationLower,
          bounds_.accelerationUpper, allowed_.accelerationLower, allowed_.accelerationUpper);
    for (int i = 0; i < GridStop::kSegments; ++i) {
        const GridStop::Segment segment = stored_.remaining(i);
        if (segment.ticks == 0) continue;
        if (segment.jerk > limits_.jerkUpper) keep(LimitKind::Jerk, LimitSide::Upper, segment.jerk - limits_.jerkUpper);
        if (segment.jerk < limits_.jerkLower) keep(LimitKind::Jerk, LimitSide::Lower, limits_.jerkLower - segment.jerk);
    }
    widen(LimitKind::Position, e.positionLower, e.positionUpper, bounds_.positionLower, bounds_.positionUpper,
          allowed_.positionLower, allowed_.positionUpper);
    widen(LimitKind::Velocity, e.velocityLower, e.velocityUpper, bounds_.velocityLower, bounds_.velocityUpper,
          allowed_.velocityLower, allowed_.velocityUpper);
    const bool exceeds = excess_.limit != LimitKind::None;
    mayExceed_ |= exceeds;

    const double upperPeak = calcUpperPeak(state_, limits_, tick_s_);
    const double lowerPeak = calcLowerPeak(state_, limits_, tick_s_);
    if (exceeds) {
        peakUpper_ = std::max(bounds_.velocityUpper, upperPeak);
        peakLower_ = std::min(bounds_.velocityLower, lowerPeak);
    } else if (approach_ < 1.0) {
        // `share` of the way to the limit from where the stop and the velocity peak are now.
        const auto approach = [share = approach_](double limit, double now) {
            return std::isfinite(limit) ? limit - (1.0 - share) * (limit - now) : limit;
        };
        const AxisLimits& l = limits_;
        bounds_.positionUpper = approach(l.positionUpper, std::min(e.positionUpper, l.positionUpper));
        bounds_.positionLower = approach(l.positionLower, std::max(e.positionLower, l.positionLower));
        peakUpper_ = approach(l.velocityUpper, std::min(upperPeak, l.velocityUpper));
        peakLower_ = approach(l.velocityLower, std::max(lowerPeak, l.velocityLower));
    }
}

bool BrakingCertificate::isExpected(const AxisState& state) const {
    const auto differs = [](double x, double y, double scale) {
        return !(std::abs(x - y) <= kSameState * (std::abs(x) + std::abs(y) + scale));
    };
    const auto span = [](double rounding) { return rounding / kRounding; };
    return !differs(state.p, expected_.p, span(rounding_.positionUpper)) &&
           !differs(state.v, expected_.v, span(rounding_.velocityUpper)) &&
           !differs(state.a, expected_.a, span(rounding_.accelerationUpper));
}

bool BrakingCertificate::beginTick(const AxisState& state) {
    if (knowsExpected_ && !isExpected(state)) {
        // Perhaps the backup stop went on for some ticks and nobody said so.
        for (int i = 0; i < kMaxFollowedTicks && !stored_.atRest() && !isExpected(state); ++i) followStored();
        if (!isExpected(state)) {
            reset(state);
            return false;
        }
    }
    state_ = state;
    trial_.valid = bound_.valid = false;
    mayExceed_ = mayExceed_ || !isInside(Walk(state).extremes(), limits_, rounding_);
    if (stored_.atRest() && (state.v != 0.0 || state.a != 0.0)) {
        GridStop rest;  // what rounding left at the end of the stop would carry the joint on for ever
        if (rest.plan(state.v, state.a, limits_, tick_s_)) stored_ = rest;
    }
    checkStop();
    return true;
}

/** The tick itself: whether its path and the state after it keep this tick's bounds. */
bool BrakingCertificate::tryTick(double jerk, Candidate& candidate, PathExtremes& path) const {
    candidate.valid = false;
    if (!(jerk >= limits_.jerkLower && jerk <= limits_.jerkUpper)) return false;
    Walk tick(state_);
    tick.hold(jerk, tick_s_);
    path = tick.extremes();
    candidate.jerk = jerk;
    candidate.after = tick.state();
    return isInside(path, bounds_, allowed_) &&
           candidate.after.a <= bounds_.accelerationUpper + rounding_.accelerationUpper &&
           candidate.after.a >= bounds_.accelerationLower - rounding_.accelerationLower &&
           calcUpperPeak(candidate.after, limits_, tick_s_) <= peakUpper_ + rounding_.velocityUpper &&
           calcLowerPeak(candidate.after, limits_, tick_s_) >= peakLower_ - rounding_.velocityLower;
}

bool BrakingCertificate::keepsBounds(const GridStop& stop, const AxisState& from, const PathExtremes& before) const {
    Walk walk(from, before);
    walk.follow(stop, tick_s_);
    return isInside(walk.extremes(), bounds_, allowed_) &&
           walk.state().p <= bounds_.positionUpper + rounding_.positionUpper &&
           walk.state().p >= bounds_.positionLower - rounding_.positionLower;
}

/** Tries `stop` after `jerk`. */
bool BrakingCertificate::certify(double jerk, const GridStop& stop, Candidate& candidate) const {
    PathExtremes path;
    if (!tryTick(jerk, candidate, path)) return false;
    candidate.stop = stop;
    return candidate.valid = keepsBounds(stop, candidate.after, path);
}

/** Looks for a stop after `jerk`. */
bool BrakingCertificate::certify(double jerk, Candidate& candidate) const {
    PathExtremes path;
    if (!tryTick(jerk, candidate, path)) return false;
    const AxisState& after = candidate.after;
    GridPhases g;
    if (after.v == 0.0 && after.a == 0.0) {
        candidate.stop = GridStop{};
        return candidate.valid = true;
    }
    if (planQuickly(after.v, after.a, limits_, tick_s_, g)) {
        candidate.stop = makeStop(g);
        if (keepsBounds(candidate.stop, after, path)) return candidate.valid = true;
    }
    return candidate.valid =
               planLevelled(after, limits_, tick_s_, candidate.stop) && keepsBounds(candidate.stop, after, path);
}

bool BrakingCertificate::isAdmissible(double jerk) {
    if (jerk == storedJerk() || (bound_.valid && jerk == bound_.jerk) || (trial_.valid && jerk == trial_.jerk))
        return true;
    return certify(jerk, trial_);
}

bool BrakingCertificate::isAdmissible(double jerk, const GridStop& stop) {
    bound_.valid = false;  // it may hold another stop after the same jerk
    if (jerk != storedJerk()) return certify(jerk, stop, trial_);
    GridStop tail = stored_;
    tail.skip(1);
    return tail == stop;
}

/** findBound() seen so that the bound is an upper one: of the jerks between `stored` and `jerk` the largest that is found
admissible. `candidate` gets its certificate, not mirrored; it is not valid when none was found. */
void BrakingCertificate::findBest(double jerk, double stored, bool mirrored, LimitKind& limit,
                                  Candidate& candidate) const {
    const double sign = mirrored ? -1.0 : 1.0;
    const AxisState s = mirrored ? mirror(state_) : state_;
    const AxisLimits l = mirrored ? mirror(limits_) : limits_;
    const AxisLimits b = mirrored ? mirror(bounds_) : bounds_;
    const double peak = mirrored ? -peakLower_ : peakUpper_;
    const double dt = tick_s_;

    double u = jerk;
    limit = LimitKind::None;
    const auto restrict = [&](double bound, LimitKind kind) {
        if (bound < u) u = bound, limit = kind;
    };
    restrict(l.jerkUpper, LimitKind::Jerk);
    restrict((b.accelerationUpper - s.a) / dt, LimitKind::Acceleration);
    restrict(calcVelocityBound(s, peak, l, dt), LimitKind::Velocity);
    if (!(u > stored)) return;

    StationaryStop fastest;
    const double most = u;
    restrict(calcContinuousBound(s, stored, most, l, b.positionUpper, dt, fastest), LimitKind::Position);
    if (limit != LimitKind::Position && certify(sign * u, candidate)) return;

    // Near the position limit phases that are rounded to ticks go too far.
    ShortestStop shortest(fastest, l, dt);
    const auto accept = [&](double accepted, const GridStop& stop) {
        return certify(sign * accepted, mirrored ? mirror(stop) : stop, candidate);
    };
    if (limit != LimitKind::Position &&
        shortest.find(advance(s, u, dt), [&](const GridStop& stop) { return accept(u, stop); }))
        return;
    GridStop stop;
    double exact = 0.0;
    if (shortest.findJerkTo(b.positionUpper, s, exact, stop) && exact <= most) {
        limit = LimitKind::Position;
        if (exact <= stored || accept(exact, stop)) return;
        u = std::min(u, exact);
    }
    if (limit == LimitKind::Position && certify(sign * u, candidate)) return;

    // Something else stands in the way: half of the way, once. More rounds bring nothing that can be measured, because
    // the next tick tries again, and cost the worst tick most; but at rest the next tick is like this one.
    const bool atRest = s.v == 0.0 && s.a == 0.0;
    for (int round = 0; round < (atRest ? kRestRounds : 1); ++round) {
        u = (stored + u) / 2.0;
        if (certify(sign * u, candidate)) return;
    }
}

BrakingCertificate::Bound BrakingCertificate::findBound(double jerk) {
    const double stored = storedJerk();
    bound_.valid = false;
    if (jerk == stored) return {stored, LimitKind::None};
    LimitKind limit = LimitKind::None;
    const bool mirrored = jerk < stored;
    const double lowest = drifts_ ? (mirrored ? -limits_.jerkUpper : limits_.jerkLower) : (mirrored ? -stored : stored);
    findBest(mirrored ? -jerk : jerk, lowest, mirrored, limit, bound_);
    return {bound_.valid ? bound_.jerk : stored, limit};
}

/** Null: the backup stop certifies it, or nothing does. */
const BrakingCertificate::Candidate* BrakingCertificate::findCandidate(double jerk) const {
    if (jerk == storedJerk()) return nullptr;
    return bound_.valid && jerk == bound_.jerk ? &bound_ : trial_.valid && jerk == trial_.jerk ? &trial_ : nullptr;
}

bool BrakingCertificate::findStop(double jerk, AxisState& after, GridStop& stop) const {
    const Candidate* const candidate = findCandidate(jerk);
    if (!candidate && jerk != storedJerk()) return false;
    after = candidate ? candidate->after : advance(state_, jerk, tick_s_);
    stop = candidate ? candidate->stop : stored_;
    if (!candidate) stop.skip(1);
    return true;
}

double BrakingCertificate::commit(double jerk) {
    if (const Candidate* const chosen = findCandidate(jerk)) {
        stored_ = chosen->stop;
        expected_ = chosen->after;
    } else {
        jerk = stored_.popJerk();
        expected_ = advance(state_, jerk, tick_s_);
    }
    knowsExpected_ = true;
    return jerk;
}

}  // namespace viable
