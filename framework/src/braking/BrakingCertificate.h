#pragma once

#include "viable/braking/GridStop.h"

namespace viable {

/** Smallest and largest position [rad], velocity [rad/s] and acceleration [rad/s^2] along a path. */
struct PathExtremes {
    double positionLower, positionUpper;
    double velocityLower, velocityUpper;
    double accelerationLower, accelerationUpper;
};

/** A limit that is passed, and by how much. `limit` None: no limit is passed. */
struct PassedLimit {
    LimitKind limit = LimitKind::None;
    LimitSide side = LimitSide::Neither;
    double excess = 0.0;  ///< in the limit's unit, > 0
};

/** Decides which jerks one joint may take so that a stop within its limits always exists, on the time
grid and without exception (framework/MATH.md, section 4).

The joint always holds a certificate: a backup stop on the grid from its present state, whose complete path was
checked in closed form. A jerk is admissible exactly when such a stop exists from the state that it
leads to. Otherwise the joint follows the backup stop, and the rest of it is the new certificate. The next jerk
of the backup stop is therefore always admissible: the choice is never empty, for any state, limit or input.

Use in each tick: beginTick(state); any number of isAdmissible() and findBound(); commit(jerk) with a
jerk that one of them certified, or storedJerk().

Limits that the backup stop cannot meet (a start outside, limits that have shrunk) do not empty the
choice either: until they are met, no choice may pass them farther than the backup stop does (see
findExcess), so that the excess never grows.

Assumes: jerk limits finite; velocity, acceleration and jerk limits contain zero in their interior.
Real time: no allocation, lock or throw; bounded work. */
class BrakingCertificate {
public:
    /** @param approach  share in (0, 1] of the distance between the stop and its limit (and of the
       velocity peak and its limit) that one tick may use up; 1: all of it. A discrete barrier. */
    void configure(const AxisLimits& limits, double tick_s, double approach);

    /** Plans the stop from `state`. It keeps the limits if any grid plan is found that does. */
    void reset(const AxisState& state);

    /** New limits from now on; the backup stop stays until a better one is found. */
    void changeLimits(const AxisLimits& limits);

    /** The joint followed the backup stop for so many ticks without a choice. */
    void skipTicks(std::int64_t ticks);

    /** The state of this tick. False when it is neither the state that the last commit() led to nor on the backup stop
    up to 1000 ticks later: the stop is then planned anew from it, as by reset(). */
    bool beginTick(const AxisState& state);

    /** The first limit that the backup stop passes by more than rounding, in the order acceleration,
    jerk, position, velocity; valid after reset() and beginTick(). */
    const PassedLimit& findExcess() const { return excess_; }

    double storedJerk() const { return stored_.nextJerk(); }

    /** True when a stop within the limits exists after `jerk` is held for this tick. */
    bool isAdmissible(double jerk);

    struct Bound {
        double jerk;      ///< admissible, between storedJerk() and the one asked for [rad/s^3]
        LimitKind limit;  ///< that acts there
    };
    /** The admissible jerk nearest to `jerk` that is found between storedJerk() and `jerk`, which
    may be any finite number. Where rounding has carried the backup stop slightly over a limit, it may lie before
    storedJerk(). Bounded work: a few dozen plans. */
    Bound findBound(double jerk);

    /** True when `stop` after `jerk` keeps the limits; for a stop that was found earlier in this tick and may have been
    replaced since. commit(jerk) then takes it. */
    bool isAdmissible(double jerk, const GridStop& stop);

    /** The stop that certifies `jerk` and the state it begins from, at the end of this tick; false where none does:
    `jerk` is neither storedJerk() nor that of the last isAdmissible() that was true, nor that of
    the last findBound(). */
    bool findStop(double jerk, AxisState& after, GridStop& stop) const;

    /** The jerk of this tick is `jerk`. Returns the jerk to apply: `jerk` when it was certified,
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
    void checkStop();
    void followStored() { expected_ = advance(expected_, stored_.popJerk(), tick_s_); }
    bool isExpected(const AxisState& state) const;
    bool tryTick(double jerk, Candidate& candidate, PathExtremes& path) const;
    bool certify(double jerk, const GridStop& stop, Candidate& candidate) const;
    bool certify(double jerk, Candidate& candidate) const;
    void findBest(double jerk, double stored, bool mirrored, LimitKind& limit, Candidate& candidate) const;

    AxisLimits limits_{};
    AxisLimits rounding_{};  ///< threshold for rounding beyond a limit, positive numbers
    AxisLimits allowed_{};   ///< the same for this tick: where rounding has accumulated, that much
    AxisLimits bounds_{};    ///< of this tick: the limits; the barrier; or the backup stop's extremes
    double peakLower_ = 0.0, peakUpper_ = 0.0;  ///< bounds of the velocity peak in this tick
    double tick_s_ = 0.0;
    double approach_ = 1.0;

    AxisState state_, expected_;
    bool knowsExpected_ = false;
    bool mayExceed_ = false;  ///< the backup stop may pass a limit: to be checked again
    bool drifts_ = false;     ///< it does so by accumulated rounding
    GridStop stored_;
    PassedLimit excess_;
    Candidate trial_, bound_;
};

}  // namespace viable
