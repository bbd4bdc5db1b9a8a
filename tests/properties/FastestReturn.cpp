#include "FastestReturn.h"

#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** From rest to a velocity (or, seen backwards, from there to rest): acceleration is built up with jerk J1, held at
most at A, and taken back with J2. */
struct SpeedChange {
    Real seconds, distance;

    SpeedChange(Real v, Real J1, Real A, Real J2) {
        const Real ramps = 1 / J1 + 1 / J2;
        const Real a = std::min(A, std::sqrt(2 * v / ramps));
        const Real t1 = a / J1, t3 = a / J2;
        const Real t2 = std::max(Real(0), (v - a * a / 2 * ramps) / a);
        const Real v1 = a * t1 / 2, v2 = v1 + a * t2;
        seconds = t1 + t2 + t3;
        distance = v1 * t1 / 3 + t2 * (v1 + a * t2 / 2) + t3 * (v2 + a * t3 / 3);
    }
};

/** From rest to rest over `distance` > 0 upwards. */
Real calcMoveTime(Real distance, const AxisLimits& l) {
    const auto calcFor = [&](Real v, Real& covered) {
        const SpeedChange up(v, l.jerkUpper, l.accelerationUpper, -l.jerkLower);
        const SpeedChange down(v, l.jerkUpper, -l.accelerationLower, -l.jerkLower);
        covered = up.distance + down.distance;
        return up.seconds + down.seconds;
    };
    Real covered = 0, fast = l.velocityUpper;
    if (std::isinf(fast))
        for (fast = 1e-9L; calcFor(fast, covered), covered < distance;) fast *= 2;
    const Real seconds = calcFor(fast, covered);
    if (covered <= distance) return seconds + (distance - covered) / fast;
    Real slow = 0;
    for (int round = 0; round < 100; ++round) {
        const Real v = (slow + fast) / 2;
        calcFor(v, covered);
        (covered > distance ? fast : slow) = v;
    }
    return calcFor(fast, covered);
}

AxisLimits mirror(const AxisLimits& l) {
    return {-l.positionUpper,     -l.positionLower,     -l.velocityUpper, -l.velocityLower,
            -l.accelerationUpper, -l.accelerationLower, -l.jerkUpper,     -l.jerkLower};
}

}  // namespace

double followFastestStop(PathRange& path, const AxisLimits& l) {
    double before = 0.0;
    const auto bring = [&](double limit, double jerk) {
        before = (limit - path.end().a) / jerk;
        path.hold(jerk, before);
    };
    if (path.end().a > l.accelerationUpper) bring(l.accelerationUpper, l.jerkLower);
    if (path.end().a < l.accelerationLower) bring(l.accelerationLower, l.jerkUpper);
    const AxisState s = path.end();
    const StationaryStop stop = calcStationaryStop(s.v, s.a, l);
    path.hold(stop.jerk, stop.T1);
    path.hold(0.0, stop.T2);
    path.hold(stop.side == LimitSide::Upper ? l.jerkUpper : l.jerkLower, stop.T3);
    return before + stop.duration();
}

FastestReturn::FastestReturn(const AxisState& s, const AxisLimits& stopLimits, const AxisLimits& l, double tick_s)
    : stop(s) {
    seconds = followFastestStop(stop, stopLimits);
    const Real end = stop.endPosition();
    if (end > l.positionUpper)
        seconds += static_cast<double>(calcMoveTime(end - l.positionUpper, mirror(l)));
    else if (end < l.positionLower)
        seconds += static_cast<double>(calcMoveTime(l.positionLower - end, l));
    const double v = static_cast<double>(stop.v.size()), a = static_cast<double>(stop.a.size());
    const double J = std::max({-l.jerkLower, l.jerkUpper, -stopLimits.jerkLower, stopLimits.jerkUpper}), dt = tick_s;
    tickTravel[0] = dt * (v + dt * (a / 2.0 + dt * J / 6.0));
    tickTravel[1] = dt * (a + dt * J / 2.0);
    tickTravel[2] = dt * J;
}

}  // namespace viable
