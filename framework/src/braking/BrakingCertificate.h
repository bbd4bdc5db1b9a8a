#pragma once

#include "viable/braking/GridStop.h"
#include "viable/core/TripleIntegrator.h"

namespace viable {

/** Least and largest position [rad], velocity [rad/s] and acceleration [rad/s^2] along a path. */
struct PathExtremes {
    double positionLower, positionUpper;
    double velocityLower, velocityUpper;
    double accelerationLower, accelerationUpper;
};

/** A limit that is passed, and how far. `limit` None: none is. */
struct PassedLimit {
    LimitKind limit = LimitKind::None;
    LimitSide side = LimitSide::Neither;
    double excess = 0.0;  ///< in the limit's unit, > 0
};

/** Which jerks one joint may choose so that it can always still stop within its limits, on the time
grid and without exception (MATH: certified braking).

The joint always holds a certificate: a stop on the grid from its present state, whose whole path was
checked in closed form. A jerk is admissible exactly when such a stop exists from the state that it
leads to. Otherwise the stored stop goes on, and what is left of it is the new certificate. The stored
stop's next jerk is therefore always a choice: no state, limit or input leaves none.

Use in each tick: beginTick(state); any number of isAdmissible() and findBound(); commit(jerk) with a
jerk for which one of them vouched, or storedJerk().

Limits that the stored stop cannot meet (a start outside, limits that have shrunk) do not empty the
choice either: until they are met, nothing may pass them farther than the stored stop does (see
findExcess), so that every tick brings the joint nearer or leaves it where it is.

Assumes: jerk limits finite; velocity, acceleration and jerk limits contain zero in their inside.
Real time: no allocation, lock or throw; bounded work. */
class BrakingCertificate {
public:
    /** @param approach  share in (0, 1] of the distance between the stop and its limit (and of the
       velocity peak and its limit) that one tick may use up; 1: all of it. A discrete barrier. */
    void configure(const AxisLimits& limits, double tick_s, double approach);

    /** Plans the stop from `state`. It keeps the limits if any grid plan is found that does. */
    void reset(const AxisState& state);

    /** New limits from now on; the stored stop stays until a better one is found. */
    void changeLimits(const AxisLimits& limits);

    /** The joint followed the stored stop for so many ticks without being asked. */
    void skipTicks(std::int64_t ticks);

    /** The state of this tick. Where it is not what the last commit() led to, nor lies on the stored stop up to 1000
    ticks later, the stop is planned anew from it, as reset() does, and the answer is false. */
    bool beginTick(const AxisState& state);

    /** The first limit that the stored stop passes by more than rounding, in the order acceleration,
    jerk, position, velocity; valid after reset() and beginTick(). */
    const PassedLimit& findExcess() const { return excess_; }

    double storedJerk() const { return stored_.nextJerk(); }

    /** True when a stop within the limits exists after `jerk` is held for this tick. */
    bool isAdmissible(double jerk);

    struct Bound {
        double jerk;      ///< admissible, from storedJerk() on towards the one asked for [rad/s^3]
        LimitKind limit;  ///< what stands there
    };
    /** The farthest admissible jerk that is found on the way from storedJerk() towards `jerk`, which
    may be any finite number; where rounding has carried the stored stop over a limit by a hair, it may lie short of
    storedJerk(). Bounded work: a few dozen plans. */
    Bound findBound(double jerk);

    /** True when `stop` after `jerk` keeps the limits: a stop that was found in this tick, and that others than
    the last isAdmissible() and findBound() may have replaced since. commit(jerk) then takes it. */
    bool isAdmissible(double jerk, const GridStop& stop);

    /** The stop that vouches for `jerk` and the state it begins from, at the end of this tick; false where none does:
    `jerk` is neither storedJerk() nor that of the last isAdmissible() that was true, nor that of the last findBound(). */
    bool findStop(double jerk, AxisState& after, GridStop& stop) const;

    /** The jerk of this tick is `jerk`. Returns what is really to be applied: `jerk` when it was vouched for,
    else storedJerk(). */
    double commit(double jerk);

    /** The stop from the state at the end of the tick that was committed last. */
    const GridStop& stop() const { return stored_; }

private:
    /** A jerk that was found admissible, with its stop. */
    struct Candidate {
        bool valid = false;
        double jerk = 0.0;
        AxisState after;
        GridStop stop;
    };

    bool planWithin(const AxisState& from, const PathExtremes& before, GridStop& stop) const;
    const Candidate* findCandidate(double jerk) const;
    bool keepsBounds(const GridStop& stop, const AxisState& from, const PathExtremes& before) const;
    void judge();
    void followStored();
    bool isExpected(const AxisState& state) const;
    bool tryTick(double jerk, Candidate& candidate, PathExtremes& path) const;
    bool certify(double jerk, const GridStop& stop, Candidate& candidate) const;
    bool certify(double jerk, Candidate& candidate) const;
    void findBest(double jerk, double stored, bool mirrored, LimitKind& limit, Candidate& candidate) const;

    AxisLimits limits_{};
    AxisLimits rounding_{};  ///< what counts as rounding beyond a limit, positive numbers
    AxisLimits allowed_{};   ///< the same for this tick: where rounding has added up, that much
    AxisLimits bounds_{};    ///< of this tick: the limits; the barrier; or the stored stop's extremes
    double peakLower_ = 0.0, peakUpper_ = 0.0;  ///< bounds of the velocity peak in this tick
    double tick_s_ = 0.0;
    double approach_ = 1.0;

    AxisState state_, expected_;
    bool knowsExpected_ = false;
    bool mayExceed_ = false;  ///< the stored stop may pass a limit: to be judged anew
    bool drifts_ = false;     ///< it does so by rounding that has added up
    GridStop stored_;
    PassedLimit excess_;
    Candidate trial_, bound_;
};

}  // namespace viable
