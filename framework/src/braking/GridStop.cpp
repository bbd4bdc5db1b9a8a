#include "viable/braking/GridStop.h"

#include "braking/GridPhases.h"

namespace viable {

using detail::GridPhases;
using detail::roundUpToTicks;

constexpr int kMaxPlanRounds = 128;
/** A cruise of so few ticks may be left out for a slower ramp. */
constexpr int kShortCruise = 3;

bool GridStop::plan(double v, double a, const AxisLimits& limits, double tick_s) {
    tick_ = 0;
    segments_ = {};
    if (v == 0.0 && a == 0.0) return true;
    GridPhases trial;
    const auto fits = [&](std::int64_t n1, std::int64_t n2, std::int64_t n3) {
        trial.n1 = n1, trial.n2 = n2, trial.n3 = n3;
        if (!trial.solve(v, a, limits, tick_s)) return false;
        segments_ = {{{n1, trial.j1}, {n2, 0.0}, {n3, trial.j3}}};
        return true;
    };

    const StationaryStop stop = calcStationaryStop(v, a, limits);
    std::int64_t n1 = std::max<std::int64_t>(1, roundUpToTicks(stop.T1, tick_s));
    std::int64_t n2 = roundUpToTicks(stop.T2, tick_s);
    std::int64_t n3 = std::max<std::int64_t>(1, roundUpToTicks(stop.T3, tick_s));

    // Near the fastest stop: its phases rounded up or down, one more tick here or there; or, near
    // the switching curve, where one phase is shorter than a tick, its ramp cut in two elsewhere.
    // Fewest ticks first.
    const std::int64_t ramp = n1 + n3;
    for (int more : {-2, -1, 0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256}) {
        for (std::int64_t m1 = std::max<std::int64_t>(1, n1 - 1); m1 <= n1 + 4; ++m1)
            for (std::int64_t m2 = std::max<std::int64_t>(0, n2 - 3); m2 <= n2 + 2; ++m2) {
                const std::int64_t m3 = ramp + n2 + more - m1 - m2;
                if (m3 >= 1 && fits(m1, m2, m3)) return true;
            }
        // Without a cruise, phases of t1 + t3 = T need v + a t1 / 2 + a1 T / 2 = 0: the cuts at
        // which the first or the last jerk is at one of its limits are the ends of what can fit.
        const std::int64_t total = ramp + n2 + more;
        const double T = total * tick_s;
        for (double j : {limits.jerkUpper, limits.jerkLower}) {
            const double cut = (2.0 * v + a * T) / (a + j * T) / tick_s;
            if (n2 > kShortCruise || !(std::abs(cut) < static_cast<double>(total) + 2.0)) continue;
            for (const double first : {-cut, static_cast<double>(total) - cut})
                for (int side = -1; side <= 2; ++side) {
                    const std::int64_t m1 = static_cast<std::int64_t>(std::floor(first)) + side;
                    if (m1 >= 1 && m1 < total && fits(m1, 0, total - m1)) return true;
                }
        }
    }

    for (int round = 0; round < kMaxPlanRounds && std::max({n1, n2, n3}) < detail::kMaxPhaseTicks; ++round) {
        if (fits(n1, n2, n3)) return true;
        if (!trial.fitsAcceleration) {
            const double t1 = n1 * tick_s, t3 = n3 * tick_s;
            const double a2 = v + a * t1 / 2.0 < 0.0 ? limits.accelerationUpper : limits.accelerationLower;
            const double t2Needed = -(v + a * t1 / 2.0) / a2 - t1 / 2.0 - t3 / 2.0;
            n2 = std::max(n2 + 1, roundUpToTicks(t2Needed, tick_s));
        }
        if (!trial.fitsFirst) n1 += (n1 + 7) / 8;
        if (!trial.fitsLast) n3 += (n3 + 7) / 8;
    }
    // Outside the limits: first acceleration to zero, then the remaining velocity in one even ramp
    // pair.
    const double j1 = a > 0.0 ? limits.jerkLower : limits.jerkUpper;
    const std::int64_t rampTicks = std::max<std::int64_t>(1, roundUpToTicks(std::abs(a / j1), tick_s));
    segments_[0] = {rampTicks, -a / (rampTicks * tick_s)};
    const double v1 = v + a * rampTicks * tick_s / 2.0;
    const double a2 = v1 > 0.0 ? limits.accelerationLower : limits.accelerationUpper;
    const double J = std::min(-limits.jerkLower, limits.jerkUpper);
    const double T = std::max(std::sqrt(std::abs(v1) / J), std::abs(v1 / a2));
    const std::int64_t half = std::max<std::int64_t>(1, roundUpToTicks(T, tick_s));
    const double j = v1 / (half * tick_s * half * tick_s);
    segments_[1] = {half, -j};
    segments_[2] = {half, j};
    return false;
}

void GridStop::set(const std::array<Segment, kSegments>& segments) {
    segments_ = segments;
    for (Segment& segment : segments_)
        segment.ticks = std::clamp<std::int64_t>(segment.ticks, 0, detail::kMaxPhaseTicks);
    tick_ = 0;
}

std::int64_t GridStop::totalTicks() const {
    std::int64_t sum = 0;
    for (const Segment& segment : segments_) sum += segment.ticks;
    return sum;
}

GridStop::Segment GridStop::remaining(int i) const {
    std::int64_t begin = 0;
    for (int k = 0; k < i; ++k) begin += segments_[k].ticks;
    const std::int64_t passed = std::clamp<std::int64_t>(tick_ - begin, 0, segments_[i].ticks);
    return {segments_[i].ticks - passed, segments_[i].jerk};
}

double GridStop::nextJerk() const {
    std::int64_t tick = tick_;
    for (const Segment& segment : segments_) {
        if (tick < segment.ticks) return segment.jerk;
        tick -= segment.ticks;
    }
    return 0.0;
}

double GridStop::popJerk() {
    const double jerk = nextJerk();
    skip(1);
    return jerk;
}

void GridStop::skip(std::int64_t ticks) {
    tick_ += std::clamp<std::int64_t>(ticks, 0, remainingTicks());
}

}  // namespace viable
