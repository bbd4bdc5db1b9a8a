#pragma once

#include "viable/filter/BrakingPolicyFilter.h"

namespace viable {

/** Keeps position, velocity, acceleration and jerk limits by the time-optimal stationary braking
policy (TOSBP; C2 and S4 of the paper), faithful to the paper with its slips corrected.

Method: BrakingPolicyFilter with the stationary stop (Table I), which ends at v = 0 and a = 0.
Assumes: continuous time, see there.
Guarantees: jerk and acceleration limits at every tick; position and velocity only approximately.
Real time: no allocation, lock or throw after configure(). */
class Tosbp : public BrakingPolicyFilter {
public:
    Tosbp() : BrakingPolicyFilter("tosbp") {}

private:
    BrakingStop calcStop(double v, double a, const AxisLimits& limits) const override;
};

}  // namespace viable
