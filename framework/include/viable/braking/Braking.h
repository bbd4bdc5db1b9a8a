#pragma once

#include <cstdint>

#include "viable/core/JointLimits.h"

namespace viable {

/** The paper's types of a braking trajectory (Tables I and II). They differ in sigma = v + a |a| / (2 J), with J the
jerk that brings `a` to zero. */
enum class BrakingType : unsigned char {
    I,    ///< sigma < 0, with a phase at the acceleration limit
    II,   ///< sigma < 0
    III,  ///< sigma >= 0
    IV    ///< sigma >= 0, with a phase at the acceleration limit
};

/** The common part of both braking policies: jerk towards the braking acceleration for T1, none for T2. */
struct BrakingStop {
    /** Upper: types III and IV, which end at the largest position and so bound the upper position limit. Lower: the
    mirror image, types I and II. */
    LimitSide side = LimitSide::Upper;
    bool cruises = false;       ///< types I and IV: the acceleration limit is reached, T2 >= 0
    double T1 = 0.0;            ///< [s]
    double T2 = 0.0;            ///< [s]
    double jerk = 0.0;          ///< the jerk of the first phase [rad/s^3]
    double displacement = 0.0;  ///< stop position minus present position [rad]
    double gradientV = 0.0;     ///< d displacement / d v [s], >= 0
    double gradientA = 0.0;     ///< d displacement / d a [s^2], >= 0

    BrakingType type() const {
        if (side == LimitSide::Upper) return cruises ? BrakingType::IV : BrakingType::III;
        return cruises ? BrakingType::I : BrakingType::II;
    }
};

/** Stationary policy (paper, Table I): the fastest motion of one joint to v = 0 and a = 0 within jerk
and acceleration limits. The third phase brings acceleration back to zero. */
struct StationaryStop : BrakingStop {
    double T3 = 0.0;  ///< [s]

    double duration() const { return T1 + T2 + T3; }  ///< [s]
};

/** Velocity-zeroing policy (paper, Table II with T2 = |v1| / A): to v = 0 with `a` free. For type III with v >= 0
this is the fastest motion to v = 0. A joint that moves away from its side (v < 0, sigma >= 0) first reverses. The
stop is at the second zero of its velocity, where its position is largest. */
struct VelocityZeroingStop : BrakingStop {
    double endAcceleration = 0.0;  ///< acceleration at v = 0 [rad/s^2]; braking: <= 0 for Upper
};

/** The stationary stop from velocity `v` [rad/s] and acceleration `a` [rad/s^2] within the acceleration and jerk
limits of `limits`. Jerk limits are finite and not zero; acceleration limits may be infinite; each side has its own.
The displacement is continuous in (v, a), and its gradients jump on sigma = 0. For |a| beyond the acceleration limit
the first phase is left out. No allocation, no throw. */
StationaryStop calcStationaryStop(double v, double a, const AxisLimits& limits);

/** Longest time in which a joint stops from one of its velocity limits, at no acceleration [s]; 0: no such limit.
Without a jerk limit it stops at its deceleration limit from the start; a joint without either stops at once. */
double calcLongestStop(const JointLimits& limits);
/** The same in ticks, and one more; a second where it is 0. */
std::int64_t calcLongestStopTicks(const JointLimits& limits, double tick_s);

/** The velocity-zeroing stop; arguments as for calcStationaryStop. The displacement is continuous between types on
the same side, but JUMPS on sigma = 0 for a != 0. On one side of that curve the joint passes v = 0 with full
deceleration. On the other it ends there with a = 0. */
VelocityZeroingStop calcVelocityZeroingStop(double v, double a, const AxisLimits& limits);

/** The velocity-zeroing stop of a joint that moves towards `side` (Upper: v >= 0, Lower: v <= 0) or begins to. It is
the fastest motion to v = 0, even where sigma, which belongs to a = 0, has the other sign. */
VelocityZeroingStop calcVelocityZeroingStop(double v, double a, const AxisLimits& limits, LimitSide side);

/** The velocity at which acceleration reaches zero under full jerk. It is the velocity peak for a > 0, the dip for a
< 0, and `v` itself for a = 0. It is sigma (see BrakingType). */
double calcVelocityPeak(double v, double a, const AxisLimits& limits);

}  // namespace viable
