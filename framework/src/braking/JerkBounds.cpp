#include "braking/JerkBounds.h"

#include <cmath>

namespace viable::detail {

constexpr int kNewtonRounds = 6;
/** A correction smaller than this share of the jerk range ends Newton's method. */
constexpr double kNewtonStep = 1e-6;

AxisState mirror(const AxisState& s) {
    return {-s.p, -s.v, -s.a};
}

AxisLimits mirror(const AxisLimits& l) {
    return {-l.positionUpper,     -l.positionLower,     -l.velocityUpper, -l.velocityLower,
            -l.accelerationUpper, -l.accelerationLower, -l.jerkUpper,     -l.jerkLower};
}

GridStop mirror(const GridStop& stop) {
    std::array<GridStop::Segment, GridStop::kSegments> segments;
    for (int i = 0; i < GridStop::kSegments; ++i) segments[i] = {stop.remaining(i).ticks, -stop.remaining(i).jerk};
    GridStop mirrored;
    mirrored.set(segments);
    return mirrored;
}

double calcVelocityBound(const AxisState& s, double peak, const AxisLimits& l, double dt) {
    if (!std::isfinite(peak)) return std::numeric_limits<double>::infinity();
    const double room = 2.0 * (peak - s.v) / dt - s.a;
    const double next = room > 0.0 ? room / (1.0 + std::sqrt(1.0 + room / (-l.jerkLower * dt))) : room;
    return (next - s.a) / dt;
}

double calcContinuousBound(const AxisState& s, double least, double most, const AxisLimits& l, double positionUpper,
                           double dt, StationaryStop& fastest) {
    double u = most;
    for (int round = 0; round < kNewtonRounds; ++round) {
        const AxisState after = advance(s, u, dt);
        fastest = calcStationaryStop(after.v, after.a, l);
        const double beyond = after.p + fastest.displacement - positionUpper;
        if (fastest.side == LimitSide::Lower || !(beyond > 0.0)) break;
        const double slope = dt * (dt * dt / 6.0 + fastest.gradientV * dt / 2.0 + fastest.gradientA);
        const double correction = beyond / slope;
        u -= correction;
        if (u <= least) return least;
        if (correction < kNewtonStep * (l.jerkUpper - l.jerkLower)) break;
    }
    return u;
}

}  // namespace viable::detail
