#include "viable/motion/Braking.h"

#include <algorithm>
#include <cmath>

// Derivation, upper side (the lower one is its mirror image). Jd, Ju: size of the jerk downwards
// and upwards, Ad: size of the deceleration limit. Phase 1 takes a to a1 < 0 with -Jd, phase 3
// takes a1 to 0 with +Ju and uses up the velocity a1^2 / (2 Ju). Without a cruise the velocities
// add up to zero when
//     a1^2 = K (v + a^2 / (2 Jd)),   K = 2 Jd Ju / (Jd + Ju);
// with one (|a1| would exceed Ad) a1 = -Ad and T2 = v1 / Ad - T3 / 2 with v1 the velocity after
// phase 1. Differentiating the displacement, every term but these cancels, with and without cruise:
//     d/dv = T1 + T2 + T3 / 2,     d/da = T1 (T1 / 2 + T2 + T3 / 2).
// They satisfy v + a d/dv - Jd d/da = 0: braking at full jerk leaves the stop position where it is.

namespace viable {

namespace {

/** The magnitudes that matter for one direction of braking. */
struct BrakingSizes {
    double Jd, Ju, Ad;
};

StationaryStop calcUpperStop(double v, double a, const BrakingSizes& s) {
    StationaryStop stop;
    stop.side = LimitSide::Upper;
    stop.jerk = -s.Jd;
    const double K = 2.0 * s.Jd * s.Ju / (s.Jd + s.Ju);
    const double w =
        std::sqrt(std::max(0.0, K * (v + a * a / (2.0 * s.Jd))));  // -a1 without cruise
    if (w > s.Ad) {
        stop.cruises = true;
        stop.T1 = std::max(0.0, (a + s.Ad) / s.Jd);
        stop.T3 = s.Ad / s.Ju;
        const double v1 = v + a * stop.T1 - s.Jd * stop.T1 * stop.T1 / 2.0;
        stop.T2 = std::max(0.0, v1 / s.Ad - stop.T3 / 2.0);
    } else {
        stop.T1 = std::max(0.0, (a + w) / s.Jd);
        stop.T3 = w / s.Ju;
    }
    const double T1 = stop.T1, T2 = stop.T2, T3 = stop.T3;
    const double a1 = -s.Ju * T3;
    const double v2 = s.Ju * T3 * T3 / 2.0;  // velocity at the beginning of phase 3
    stop.displacement = T1 * (v + T1 * (a / 2.0 - s.Jd * T1 / 6.0))  // phase 1
                        + T2 * (v2 - a1 * T2 / 2.0)                  // cruise, seen from its end
                        + s.Ju * T3 * T3 * T3 / 6.0;                 // phase 3, seen from its end
    stop.gradientV = T1 + T2 + T3 / 2.0;
    stop.gradientA = T1 * (T1 / 2.0 + T2 + T3 / 2.0);
    return stop;
}

double calcSigma(double v, double a, const AxisLimits& limits) {
    const double J = a > 0.0 ? -limits.jerkLower : limits.jerkUpper;
    return v + a * std::abs(a) / (2.0 * J);
}

}  // namespace

StationaryStop calcStationaryStop(double v, double a, const AxisLimits& limits) {
    if (calcSigma(v, a, limits) >= 0.0)
        return calcUpperStop(v, a,
                             {-limits.jerkLower, limits.jerkUpper, -limits.accelerationLower});
    StationaryStop stop =
        calcUpperStop(-v, -a, {limits.jerkUpper, -limits.jerkLower, limits.accelerationUpper});
    stop.side = LimitSide::Lower;
    stop.jerk = -stop.jerk;
    stop.displacement = -stop.displacement;
    return stop;
}

double calcVelocityPeak(double v, double a, const AxisLimits& limits) {
    return calcSigma(v, a, limits);
}

namespace {

/** No phase of a stop is longer: states that would need it are no arm's. */
constexpr std::int64_t kMaxTicks = 1'000'000'000'000;

/** Seconds as whole ticks, rounded up; a hair above a whole number counts as that number. */
std::int64_t roundUpToTicks(double seconds, double tick_s) {
    const double ticks = std::ceil(seconds / tick_s - 1e-9);
    return static_cast<std::int64_t>(
        std::min(std::max(ticks, 0.0), static_cast<double>(kMaxTicks)));
}

/** Relative overshoot of acceleration and jerk limits that counts as rounding. */
constexpr double kPlanRounding = 1e-12;
constexpr int kMaxPlanRounds = 128;
/** A cruise of so few ticks may be left out for a slower ramp. */
constexpr int kShortCruise = 3;

}  // namespace

bool GridStop::fits(std::int64_t n1, std::int64_t n2, std::int64_t n3, double v, double a,
                    const AxisLimits& limits, double tick_s) {
    const double t1 = n1 * tick_s, t2 = n2 * tick_s, t3 = n3 * tick_s;
    const double a1 = -(v + a * t1 / 2.0) / (t1 / 2.0 + t2 + t3 / 2.0);
    const double j1 = (a1 - a) / t1;
    const double j3 = -a1 / t3;
    const double slack = 1.0 + kPlanRounding;
    const auto within = [&](double x, double lower, double upper) {
        return x >= lower * slack && x <= upper * slack;
    };
    fitsAcceleration_ = within(a1, limits.accelerationLower, limits.accelerationUpper);
    fitsFirst_ = within(j1, limits.jerkLower, limits.jerkUpper);
    fitsLast_ = within(j3, limits.jerkLower, limits.jerkUpper);
    if (!fitsAcceleration_ || !fitsFirst_ || !fitsLast_) return false;
    stretches_[0] = {n1, j1};
    stretches_[1] = {n2, 0.0};
    stretches_[2] = {n3, j3};
    return true;
}

bool GridStop::plan(double v, double a, const AxisLimits& limits, double tick_s) {
    tick_ = 0;
    for (Stretch& stretch : stretches_) stretch = {};
    if (v == 0.0 && a == 0.0) return true;

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
                if (m3 >= 1 && fits(m1, m2, m3, v, a, limits, tick_s)) return true;
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
                    if (m1 >= 1 && m1 < total && fits(m1, 0, total - m1, v, a, limits, tick_s))
                        return true;
                }
        }
    }

    for (int round = 0; round < kMaxPlanRounds && std::max({n1, n2, n3}) < kMaxTicks; ++round) {
        if (fits(n1, n2, n3, v, a, limits, tick_s)) return true;
        if (!fitsAcceleration_) {
            const double t1 = n1 * tick_s, t3 = n3 * tick_s;
            const double a2 =
                v + a * t1 / 2.0 < 0.0 ? limits.accelerationUpper : limits.accelerationLower;
            const double t2Needed = -(v + a * t1 / 2.0) / a2 - t1 / 2.0 - t3 / 2.0;
            n2 = std::max(n2 + 1, roundUpToTicks(t2Needed, tick_s));
        }
        if (!fitsFirst_) n1 += (n1 + 7) / 8;
        if (!fitsLast_) n3 += (n3 + 7) / 8;
    }
    // Outside the limits: first acceleration to zero, then the remaining velocity in one even ramp
    // pair.
    const double j1 = a > 0.0 ? limits.jerkLower : limits.jerkUpper;
    const std::int64_t rampTicks =
        std::max<std::int64_t>(1, roundUpToTicks(std::abs(a / j1), tick_s));
    stretches_[0] = {rampTicks, -a / (rampTicks * tick_s)};
    const double v1 = v + a * rampTicks * tick_s / 2.0;
    const double a2 = v1 > 0.0 ? limits.accelerationLower : limits.accelerationUpper;
    const double J = std::min(-limits.jerkLower, limits.jerkUpper);
    const double T = std::max(std::sqrt(std::abs(v1) / J), std::abs(v1 / a2));
    const std::int64_t half = std::max<std::int64_t>(1, roundUpToTicks(T, tick_s));
    const double j = v1 / (half * tick_s * half * tick_s);
    stretches_[1] = {half, -j};
    stretches_[2] = {half, j};
    return false;
}

double GridStop::takeJerk() {
    std::int64_t tick = tick_;
    for (const Stretch& stretch : stretches_) {
        if (tick < stretch.ticks) {
            ++tick_;
            return stretch.jerk;
        }
        tick -= stretch.ticks;
    }
    return 0.0;
}

}  // namespace viable
