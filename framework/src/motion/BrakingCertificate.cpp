#include "viable/motion/BrakingCertificate.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "motion/GridPhases.h"
#include "viable/motion/Braking.h"

namespace viable {

namespace {

using detail::GridPhases;
using detail::roundDownToTicks;
using detail::roundUpToTicks;

/** Rounding of states and stops, relative to the size of the limit: what a stop may pass it by ... */
constexpr double kRounding = 1e-13;
/** ... and what adds up when a stop is followed over thousands of ticks. */
constexpr double kDrift = 1e-11;
/** A state differs from the expected one when it does by more than this, relative to the state and the limits. */
constexpr double kSameState = 1e-9;
constexpr int kRepairRounds = 6;
constexpr int kNewtonRounds = 6;
/** A correction smaller than this share of the jerk range ends Newton's method. */
constexpr double kNewtonStep = 1e-6;

/** Extremes of a path that is walked stretch by stretch. */
class Walk {
public:
    explicit Walk(const AxisState& start)
        : Walk(start, {start.p, start.p, start.v, start.v, start.a, start.a}) {}
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
                if (when > 0.0 && when < t) seePosition(advance(s_, jerk, when).p);
        }
        seeVelocity(least);
        seeVelocity(largest);
        seePosition(end.p);
        seeAcceleration(end.a);
        s_ = end;
    }

    /** A whole stop. */
    void follow(const GridStop& stop, double tick_s) {
        for (int i = 0; i < GridStop::kStretches; ++i) {
            const GridStop::Stretch stretch = stop.remaining(i);
            if (stretch.ticks > 0) hold(stretch.jerk, static_cast<double>(stretch.ticks) * tick_s);
        }
    }

private:
    void seePosition(double p) {
        e_.positionLower = std::min(e_.positionLower, p);
        e_.positionUpper = std::max(e_.positionUpper, p);
    }
    void seeVelocity(double v) {
        e_.velocityLower = std::min(e_.velocityLower, v);
        e_.velocityUpper = std::max(e_.velocityUpper, v);
    }
    void seeAcceleration(double a) {
        e_.accelerationLower = std::min(e_.accelerationLower, a);
        e_.accelerationUpper = std::max(e_.accelerationUpper, a);
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

AxisState mirror(const AxisState& s) {
    return {-s.p, -s.v, -s.a};
}

AxisLimits mirror(const AxisLimits& l) {
    return {-l.positionUpper,     -l.positionLower,     -l.velocityUpper, -l.velocityLower,
            -l.accelerationUpper, -l.accelerationLower, -l.jerkUpper,     -l.jerkLower};
}

/** Whole ticks in which jerk brings acceleration to zero, at least one. */
std::int64_t calcRampTicks(double a, const AxisLimits& limits, double tick_s) {
    const double J = a > 0.0 ? -limits.jerkLower : limits.jerkUpper;
    return std::max<std::int64_t>(1, roundUpToTicks(std::abs(a) / J, tick_s));
}

/** The velocity at which acceleration reaches zero on the grid: what bounds velocity. Unlike the true peak it lets a
velocity limit be approached without ringing: one tick's jerk takes v there exactly, the next keeps it. */
double calcLevelVelocity(const AxisState& s, const AxisLimits& limits, double tick_s) {
    return s.v + s.a * static_cast<double>(calcRampTicks(s.a, limits, tick_s)) * tick_s / 2.0;
}

/** The level velocity as far as it bounds velocity from above (a > 0) or below (a < 0), else v. */
double calcUpperLevel(const AxisState& s, const AxisLimits& limits, double tick_s) {
    return s.a > 0.0 ? calcLevelVelocity(s, limits, tick_s) : s.v;
}
double calcLowerLevel(const AxisState& s, const AxisLimits& limits, double tick_s) {
    return s.a < 0.0 ? calcLevelVelocity(s, limits, tick_s) : s.v;
}

/** Phases of the stationary stop, rounded up, then mended until acceleration and jerk limits hold. */
bool planQuickly(double v, double a, const AxisLimits& limits, double tick_s, GridPhases& g) {
    const StationaryStop stop = calcStationaryStop(v, a, limits);
    g.n1 = std::max<std::int64_t>(1, roundUpToTicks(stop.T1, tick_s));
    g.n2 = roundUpToTicks(stop.T2, tick_s);
    g.n3 = std::max<std::int64_t>(1, roundUpToTicks(stop.T3, tick_s));
    for (int round = 0; round < kRepairRounds; ++round) {
        if (g.solve(v, a, limits, tick_s)) return true;
        if (!g.fitsAcceleration) ++g.n2;
        if (!g.fitsFirst) ++g.n1;
        if (!g.fitsLast) ++g.n3;
    }
    return false;
}

GridStop makeStop(const GridPhases& g) {
    GridStop stop;
    stop.set({{{g.n1, g.j1}, {g.n2, 0.0}, {g.n3, g.j3}}});
    return stop;
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

/** The largest jerk of this tick after which the stop with the given phases keeps acceleration and jerk limits and does
not end beyond the upper position bound. For given phases all of it is linear in the jerk. */
double calcLargestJerk(const AxisState& s, const GridPhases& g, const AxisLimits& l,
                       double positionUpper, double dt) {
    const double t1 = static_cast<double>(g.n1) * dt;
    const double t2 = static_cast<double>(g.n2) * dt;
    const double t3 = static_cast<double>(g.n3) * dt;
    const double weight = 1.0 / (t1 / 2.0 + t2 + t3 / 2.0);
    // With jerk u: v+ = v0 + u dt^2/2, a+ = a + u dt, a1 = alpha + u beta.
    const double v0 = s.v + s.a * dt;
    const double alpha = -(v0 + s.a * t1 / 2.0) * weight;
    const double beta = -(dt * dt / 2.0 + dt * t1 / 2.0) * weight;
    const double cv = t1 + t2, ca = t1 * (t1 / 3.0 + t2 / 2.0);
    const double c1 = t1 * (t1 / 6.0 + t2 / 2.0) + (t2 * t2) / 2.0 - t3 * t3 / 6.0;
    const double stop0 = s.p + dt * (s.v + dt * s.a / 2.0) + cv * v0 + ca * s.a + c1 * alpha;
    const double stop1 = dt * dt * dt / 6.0 + cv * dt * dt / 2.0 + ca * dt + c1 * beta;
    const double lowestA1 = std::max(l.accelerationLower, -l.jerkUpper * t3);
    double u = (lowestA1 - alpha) / beta;
    u = std::min(u, (-l.jerkLower * t1 + alpha - s.a) / (dt - beta));
    if (stop1 > 0.0) u = std::min(u, (positionUpper - stop0) / stop1);
    return u;
}

/** The largest jerk of this tick whose level velocity does not pass `level`: with n ticks of ramp from a+ back to zero
that is v + (a + a+) dt/2 + n a+ dt/2. */
double calcVelocityBound(const AxisState& s, double level, const AxisLimits& l, double dt) {
    const double room = 2.0 * (level - s.v) / dt - s.a;  // for (1 + n) a+
    if (!std::isfinite(room)) return std::numeric_limits<double>::infinity();
    double next = room;
    if (room > 0.0) {
        const double step = -l.jerkLower * dt;
        const double n =
            std::max(1.0, std::ceil((std::sqrt(1.0 + 4.0 * room / step) - 1.0) / 2.0 - 1e-9));
        next = std::min(room / (1.0 + n), n * step);
        if (n > 1.0) next = std::max(next, std::min(room / n, (n - 1.0) * step));
    }
    return (next - s.a) / dt;
}

/** The largest jerk in [least, most] after which the fastest stop in continuous time does not end beyond the upper
position bound: no grid plan can do better by more than a hair. Newton's method from `most`; the stop position is
convex in the jerk, so that it comes down to the root and not past it. `fastest` gets the stop there. */
double calcContinuousBound(const AxisState& s, double least, double most, const AxisLimits& l,
                           double positionUpper, double dt, StationaryStop& fastest) {
    double u = most;
    for (int round = 0; round < kNewtonRounds; ++round) {
        const AxisState after = advance(s, u, dt);
        fastest = calcStationaryStop(after.v, after.a, l);
        const double beyond = after.p + fastest.displacement - positionUpper;
        if (fastest.side == LimitSide::Lower || !(beyond > 0.0)) break;
        const double slope =
            dt * (dt * dt / 6.0 + fastest.gradientV * dt / 2.0 + fastest.gradientA);
        const double correction = beyond / slope;
        u -= correction;
        if (u <= least) return least;
        if (correction < kNewtonStep * (l.jerkUpper - l.jerkLower)) break;
    }
    return u;
}

/** Of the phases next to those of the continuous stop, the ones that allow the largest jerk. Returns it, or `least`. */
double findBestPhases(const AxisState& s, double least, const StationaryStop& fastest,
                      const AxisLimits& l, double positionUpper, double dt, GridPhases& best) {
    const std::int64_t f1 = std::max<std::int64_t>(1, roundDownToTicks(fastest.T1, dt));
    const std::int64_t f2 = roundDownToTicks(fastest.T2, dt);
    const std::int64_t f3 = std::max<std::int64_t>(1, roundDownToTicks(fastest.T3, dt));
    const std::int64_t longestCruise = fastest.cruises ? f2 + 1 : 0;
    double largest = least;
    GridPhases g;
    for (g.n2 = std::max<std::int64_t>(0, f2 - 1); g.n2 <= longestCruise; ++g.n2)
        for (g.n1 = f1; g.n1 <= f1 + 2; ++g.n1)
            for (g.n3 = f3; g.n3 <= f3 + 2; ++g.n3) {
                const double most = calcLargestJerk(s, g, l, positionUpper, dt);
                if (most > largest) largest = most, best = g;
            }
    return largest;
}

}  // namespace

void BrakingCertificate::configure(const AxisLimits& limits, double tick_s, double approach) {
    tick_s_ = tick_s;
    approach_ = approach;
    changeLimits(limits);
}

void BrakingCertificate::changeLimits(const AxisLimits& limits) {
    limits_ = limits;
    const auto size = [](double lower, double upper) {
        const double a = std::isfinite(lower) ? std::abs(lower) : 0.0;
        const double b = std::isfinite(upper) ? std::abs(upper) : 0.0;
        return kRounding * std::max(a, b);
    };
    const double p = size(limits.positionLower, limits.positionUpper);
    const double v = size(limits.velocityLower, limits.velocityUpper);
    const double a = size(limits.accelerationLower, limits.accelerationUpper);
    rounding_ = {p, p, v, v, a, a, 0.0, 0.0};
    mayExceed_ = true;
}

void BrakingCertificate::skipTicks(std::int64_t ticks) {
    stored_.skip(ticks);
    knowsExpected_ = false;
}

void BrakingCertificate::reset(const AxisState& state) {
    state_ = state;
    knowsExpected_ = false;
    trial_.valid = bound_.valid = false;
    bounds_ = limits_;
    allowed_ = rounding_;
    levelLower_ = limits_.velocityLower;
    levelUpper_ = limits_.velocityUpper;
    const Walk here(state);
    if (!findStop(state, here.extremes(), stored_))
        stored_.plan(state.v, state.a, limits_, tick_s_);
    mayExceed_ = true;
    judge();
}

/** The stop of fewest ticks, or another close to it, that keeps the bounds. */
bool BrakingCertificate::findStop(const AxisState& from, const PathExtremes& before,
                                  GridStop& stop) const {
    const auto fits = [&] { return keepsBounds(stop, from, before); };
    if (stop.plan(from.v, from.a, limits_, tick_s_) && fits()) return true;
    if (planLevelled(from, limits_, tick_s_, stop) && fits()) return true;
    return findShortestStop(from, before, stop);
}

/** The shortest stop that jerks held over ticks allow: full jerk, a tick in between, perhaps a cruise at the
acceleration limit, a tick, full jerk back, a tick. (A linear programme with the two equations v = 0 and a = 0
at the end has at most two jerks that stand at no limit.) */
bool BrakingCertificate::findShortestStop(const AxisState& from, const PathExtremes& before,
                                          GridStop& stop) const {
    const StationaryStop fastest = calcStationaryStop(from.v, from.a, limits_);
    const double dt = tick_s_;
    const double first = fastest.jerk;
    const double back = first < 0.0 ? limits_.jerkUpper : limits_.jerkLower;
    const auto whole = [&](double seconds) { return roundDownToTicks(seconds, dt); };
    const std::int64_t m0 = whole(fastest.T3);

    // From (v, a): k ticks of `first`, one of x, m ticks of `back`, one of y end at v = 0 and a = 0.
    const auto solve = [&](double v, double a, std::int64_t k, std::int64_t m, double& x,
                           double& y) {
        const double kd = static_cast<double>(k), md = static_cast<double>(m), n = kd + md + 2.0;
        const double sum = -a / dt - kd * first - md * back;
        const double moment = -v / (dt * dt) - a * n / dt - first * kd * (n - kd / 2.0) -
                              back * md * (n - kd - 1.0 - md / 2.0);
        x = (moment - sum / 2.0) / (md + 1.0);
        y = sum - x;
        return std::min(x, y) >= limits_.jerkLower && std::max(x, y) <= limits_.jerkUpper;
    };
    double x = 0.0, y = 0.0;
    if (fastest.T2 < 2.0 * dt) {
        const std::int64_t k0 = whole(fastest.T1);
        for (std::int64_t k = std::max<std::int64_t>(0, k0 - 2); k <= k0 + 1; ++k)
            for (std::int64_t m = std::max<std::int64_t>(0, m0 - 2); m <= m0 + 1; ++m) {
                if (!solve(from.v, from.a, k, m, x, y)) continue;
                stop.set({{{k, first}, {1, x}, {m, back}, {1, y}}});
                if (keepsBounds(stop, from, before)) return true;
            }
    }
    if (!fastest.cruises) return false;
    const double cruise = first < 0.0 ? limits_.accelerationLower : limits_.accelerationUpper;
    const std::int64_t k = whole((cruise - from.a) / first);
    AxisState at = advance(from, first, static_cast<double>(k) * dt);
    const double rest = std::clamp((cruise - at.a) / dt, limits_.jerkLower, limits_.jerkUpper);
    at = advance(at, rest, dt);
    const std::int64_t c0 = whole(fastest.T2);
    for (std::int64_t c = std::max<std::int64_t>(0, c0 - 2); c <= c0 + 1; ++c)
        for (std::int64_t m = std::max<std::int64_t>(0, m0 - 2); m <= m0 + 1; ++m) {
            if (!solve(at.v + at.a * static_cast<double>(c) * dt, at.a, 0, m, x, y)) continue;
            stop.set({{{k, first}, {1, rest}, {c, 0.0}, {1, x}, {m, back}, {1, y}}});
            if (keepsBounds(stop, from, before)) return true;
        }
    return false;
}

/** Which limits the stored stop passes from this state on, and the bounds that follow from it. */
void BrakingCertificate::judge() {
    excess_ = {};
    bounds_ = limits_;
    allowed_ = rounding_;
    levelLower_ = limits_.velocityLower;
    levelUpper_ = limits_.velocityUpper;
    drifts_ = false;
    if (!mayExceed_ && approach_ >= 1.0) return;

    Walk walk(state_);
    walk.follow(stored_, tick_s_);
    const PathExtremes& e = walk.extremes();
    const auto keep = [&](LimitKind limit, LimitSide side, double excess) {
        if (excess_.limit == LimitKind::None) excess_ = {limit, side, excess};
    };
    const auto widen = [&](LimitKind limit, double least, double largest, double& lower,
                           double& upper, double& lowerRounding, double& upperRounding) {
        const auto see = [&](LimitSide side, double excess, double extreme, double& bound,
                             double& rounding) {
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
    widen(LimitKind::Acceleration, e.accelerationLower, e.accelerationUpper,
          bounds_.accelerationLower, bounds_.accelerationUpper, allowed_.accelerationLower,
          allowed_.accelerationUpper);
    widen(LimitKind::Position, e.positionLower, e.positionUpper, bounds_.positionLower,
          bounds_.positionUpper, allowed_.positionLower, allowed_.positionUpper);
    widen(LimitKind::Velocity, e.velocityLower, e.velocityUpper, bounds_.velocityLower,
          bounds_.velocityUpper, allowed_.velocityLower, allowed_.velocityUpper);
    for (int i = 0; i < GridStop::kStretches; ++i) {
        const GridStop::Stretch stretch = stored_.remaining(i);
        if (stretch.ticks == 0) continue;
        if (stretch.jerk > limits_.jerkUpper)
            keep(LimitKind::Jerk, LimitSide::Upper, stretch.jerk - limits_.jerkUpper);
        if (stretch.jerk < limits_.jerkLower)
            keep(LimitKind::Jerk, LimitSide::Lower, limits_.jerkLower - stretch.jerk);
    }
    const bool exceeds = excess_.limit != LimitKind::None;
    mayExceed_ |= exceeds;

    const double upperLevel = calcUpperLevel(state_, limits_, tick_s_);
    const double lowerLevel = calcLowerLevel(state_, limits_, tick_s_);
    if (exceeds) {
        levelUpper_ = std::max(bounds_.velocityUpper, upperLevel);
        levelLower_ = std::min(bounds_.velocityLower, lowerLevel);
    } else if (approach_ < 1.0) {
        // `share` of the way to the limit from where the stop and the level velocity are now.
        const auto approach = [share = approach_](double limit, double now) {
            return std::isfinite(limit) ? limit - (1.0 - share) * (limit - now) : limit;
        };
        const AxisLimits& l = limits_;
        bounds_.positionUpper =
            approach(l.positionUpper, std::min(e.positionUpper, l.positionUpper));
        bounds_.positionLower =
            approach(l.positionLower, std::max(e.positionLower, l.positionLower));
        levelUpper_ = approach(l.velocityUpper, std::min(upperLevel, l.velocityUpper));
        levelLower_ = approach(l.velocityLower, std::max(lowerLevel, l.velocityLower));
    }
}

void BrakingCertificate::beginTick(const AxisState& state) {
    const auto differs = [](double x, double y, double scale) {
        return !(std::abs(x - y) <= kSameState * (std::abs(x) + std::abs(y) + scale));
    };
    const auto span = [](double rounding) { return rounding / kRounding; };
    if (knowsExpected_ && (differs(state.p, expected_.p, span(rounding_.positionUpper)) ||
                           differs(state.v, expected_.v, span(rounding_.velocityUpper)) ||
                           differs(state.a, expected_.a, span(rounding_.accelerationUpper)))) {
        reset(state);
        return;
    }
    state_ = state;
    trial_.valid = bound_.valid = false;
    if (!mayExceed_) {
        const Walk here(state);
        mayExceed_ = !isInside(here.extremes(), limits_, rounding_);
    }
    judge();
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
           calcUpperLevel(candidate.after, limits_, tick_s_) <=
               levelUpper_ + rounding_.velocityUpper &&
           calcLowerLevel(candidate.after, limits_, tick_s_) >=
               levelLower_ - rounding_.velocityLower;
}

bool BrakingCertificate::keepsBounds(const GridStop& stop, const AxisState& from,
                                     const PathExtremes& before) const {
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
    return candidate.valid = planLevelled(after, limits_, tick_s_, candidate.stop) &&
                             keepsBounds(candidate.stop, after, path);
}

bool BrakingCertificate::isAdmissible(double jerk) {
    if (jerk == storedJerk() || (bound_.valid && jerk == bound_.jerk) ||
        (trial_.valid && jerk == trial_.jerk))
        return true;
    return certify(jerk, trial_);
}

/** findBound() seen so that the bound is an upper one: of the jerks between `stored` and `jerk` the largest that is found
admissible. `candidate` gets its certificate, not mirrored; it is not valid when none was found. */
void BrakingCertificate::findBest(double jerk, double stored, bool mirrored, LimitKind& limit,
                                  Candidate& candidate) const {
    const double sign = mirrored ? -1.0 : 1.0;
    const AxisState s = mirrored ? mirror(state_) : state_;
    const AxisLimits l = mirrored ? mirror(limits_) : limits_;
    const AxisLimits b = mirrored ? mirror(bounds_) : bounds_;
    const double level = mirrored ? -levelLower_ : levelUpper_;
    const double dt = tick_s_;

    double u = jerk;
    limit = LimitKind::None;
    const auto restrict = [&](double bound, LimitKind kind) {
        if (bound < u) u = bound, limit = kind;
    };
    restrict(l.jerkUpper, LimitKind::Jerk);
    restrict((b.accelerationUpper - s.a) / dt, LimitKind::Acceleration);
    restrict(calcVelocityBound(s, level, l, dt), LimitKind::Velocity);
    if (!(u > stored)) return;

    StationaryStop fastest;
    const double most = u;
    restrict(calcContinuousBound(s, stored, most, l, b.positionUpper, dt, fastest),
             LimitKind::Position);
    if (limit == LimitKind::Position) {
        GridPhases best;
        const double largest =
            std::min(most, findBestPhases(s, stored, fastest, l, b.positionUpper, dt, best));
        const AxisState after = advance(s, largest, dt);
        if (largest > stored && best.solve(after.v, after.a, l, dt)) {
            if (mirrored) best.j1 = -best.j1, best.j3 = -best.j3;
            if (certify(sign * largest, makeStop(best), candidate)) return;
        }
        u = std::min(u, largest);
    }
    if (certify(sign * u, candidate)) return;

    // Something else stands in the way: half of the way, once. More rounds bring nothing that can be measured, because
    // the next tick tries again, and cost the worst tick most.
    certify(sign * (stored + u) / 2.0, candidate);
}

BrakingCertificate::Bound BrakingCertificate::findBound(double jerk) {
    if (stored_.atRest() && (state_.v != 0.0 || state_.a != 0.0)) {
        GridStop rest;  // from what rounding left at the end of the stop
        if (findStop(state_, Walk(state_).extremes(), rest)) stored_ = rest;
    }
    const double stored = storedJerk();
    bound_.valid = false;
    if (jerk == stored) return {stored, LimitKind::None};
    LimitKind limit = LimitKind::None;
    const bool mirrored = jerk < stored;
    const double lowest = drifts_ ? (mirrored ? -limits_.jerkUpper : limits_.jerkLower)
                                  : (mirrored ? -stored : stored);
    findBest(mirrored ? -jerk : jerk, lowest, mirrored, limit, bound_);
    return {bound_.valid ? bound_.jerk : stored, limit};
}

double BrakingCertificate::commit(double jerk) {
    const Candidate* chosen = bound_.valid && jerk == bound_.jerk   ? &bound_
                              : trial_.valid && jerk == trial_.jerk ? &trial_
                                                                    : nullptr;
    if (chosen && jerk != storedJerk()) {
        stored_ = chosen->stop;
        expected_ = chosen->after;
    } else {
        jerk = stored_.takeJerk();
        expected_ = advance(state_, jerk, tick_s_);
    }
    knowsExpected_ = true;
    return jerk;
}

}  // namespace viable
