#pragma once

#include <cstdint>

#include "viable/core/JointLimits.h"

namespace viable {

/** The fastest jerk- and acceleration-limited way of one joint to v = 0 and a = 0: jerk towards the
braking acceleration for T1, none for T2, back to zero acceleration for T3 (paper, Table I; for
limits that differ by side see the derivation in Braking.cpp). */
struct StationaryStop {
    /** Upper: the stop ends at the largest position still reached (types III and IV, sigma >= 0),
    so it bounds the upper position limit; Lower: the mirror image (types I and II). */
    LimitSide side = LimitSide::Upper;
    bool cruises = false;       ///< types I and IV: the acceleration limit is reached, T2 >= 0
    double T1 = 0.0;            ///< [s]
    double T2 = 0.0;            ///< [s]
    double T3 = 0.0;            ///< [s]
    double jerk = 0.0;          ///< of the first phase [rad/s^3]
    double displacement = 0.0;  ///< stop position minus present position [rad]
    double gradientV = 0.0;     ///< d displacement / d v [s], >= 0
    double gradientA = 0.0;     ///< d displacement / d a [s^2], >= 0
};

/** The stationary stop from velocity `v` and acceleration `a` within the acceleration and jerk
limits of `limits` (jerk limits finite and not zero; acceleration limits may be infinite). For |a|
beyond the acceleration limit the first phase is left out. No allocation, no throw. */
StationaryStop calcStationaryStop(double v, double a, const AxisLimits& limits);

/** The velocity at which acceleration reaches zero when it is brought there at full jerk: the
velocity peak for a > 0, the dip for a < 0, `v` itself for a = 0. */
double calcVelocityPeak(double v, double a, const AxisLimits& limits);

/** A stop on the time grid: up to three stretches of whole ticks with constant jerk, ending at v =
0 and a = 0 up to rounding. Taking its jerks one by one, tick by tick, stops the joint. */
class GridStop {
public:
    /** Plans the stop from (v, a). Every phase of the stationary stop is rounded up to whole ticks
    and the jerks are solved anew, so that acceleration and jerk limits hold. When (v, a) lies so
    far outside the acceleration limit that no such plan is found, the stop brings `a` to zero first
    at full jerk. Returns false in that case. No allocation; bounded work. */
    bool plan(double v, double a, const AxisLimits& limits, double tick_s);

    bool atRest() const { return tick_ >= totalTicks(); }
    std::int64_t remainingTicks() const { return totalTicks() - tick_; }

    /** The jerk to hold in the next tick, and one tick further; 0 when the stop has ended. */
    double takeJerk();

private:
    struct Stretch {
        std::int64_t ticks = 0;
        double jerk = 0.0;
    };
    std::int64_t totalTicks() const {
        return stretches_[0].ticks + stretches_[1].ticks + stretches_[2].ticks;
    }
    /** Solves the jerks for phases of n1, n2, n3 ticks; keeps them and returns true when the limits
    hold, else says in fits..._ which do. */
    bool fits(std::int64_t n1, std::int64_t n2, std::int64_t n3, double v, double a,
              const AxisLimits& limits, double tick_s);

    Stretch stretches_[3];
    std::int64_t tick_ = 0;
    bool fitsAcceleration_ = false, fitsFirst_ = false, fitsLast_ = false;
};

}  // namespace viable
