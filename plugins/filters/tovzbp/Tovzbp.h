#pragma once

#include "viable/filter/BrakingPolicyFilter.h"

namespace viable {

/** Tries to keep position, velocity, acceleration and jerk limits by the time-optimal velocity-zeroing
braking policy (TOVZBP; S5 of the paper), with the slip in its Table II corrected.

Method: BrakingPolicyFilter with the velocity-zeroing stop (Table II with T2 = |v1| / A), which ends at
v = 0 and leaves the acceleration there as it is. The side (upper: types III and IV) is that of the
velocity: only so is the stop the fastest way to v = 0. The paper prints no formula for the type; sigma, which
tells it for the stationary policy, would here let the joint coast through the limit when it brakes hard.
Assumes: continuous time, see there. And that v = 0 is a rest, which it is not: the joint arrives at the
limit braking, and swings back from it; where v changes its sign with a > 0 the stop position jumps by
2 a^3 / (3 J^2) (without cruise), which may be beyond the limit.
Guarantees: jerk and acceleration limits at every tick; nothing about position and velocity.
Real time: no allocation, lock or throw after configure(). */
class Tovzbp : public BrakingPolicyFilter {
public:
    Tovzbp() : BrakingPolicyFilter("tovzbp") {}

private:
    BrakingStop calcStop(double v, double a, const AxisLimits& limits) const override;
};

}  // namespace viable
