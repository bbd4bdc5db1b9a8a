#pragma once

#include "viable/filter/JerkIntervalFilter.h"

namespace viable {

struct AccelerationViabilityOptions {
    double kAlpha = 5.0;

    template <class V>
    void describe(V& v) {
        v(kAlpha, "k_alpha", "1/s",
          "Slope of alpha: how fast the position limit may be approached; k_alpha * tick_s must not exceed 1.")
            .above(0);
    }
};

/** Keeps position, velocity and acceleration limits, and lets the jerk be what it may (C1 and S2 of
the paper).

Method: the acceleration x of each joint, nearest to the desired one in torque (13), subject to
    position       x <= Ad (alpha(h) / v - 1),  h = P - p - v^2 / (2 Ad),  for v > 0     (eq. 16)
                   v + x dt <= 0,  for v <= 0 at or past P
    velocity       v + x dt <= V
    acceleration   x <= A
and the mirror image below; alpha(h) = k_alpha h, Ad the deceleration limit [rad/s^2]. The second
row is not in the paper: without it the sampled law creeps through P by A dt^2 every other tick.
Assumes: acceleration can change at once.
Guarantees: velocity and acceleration at every tick; the
position limit is passed by at most (1 + A / Ad) A dt^2 / 2 (and Ad dt^2 / 2 more where one tick of
braking passes the velocity limit, which is reported as Infeasible); nothing about jerk.
Real time: no allocation, lock or throw after configure(). */
class AccelerationViability : public SafetyFilter {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override { choice_.reset(); }
    FilterTraits traits() const override { return {}; }
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    /** An end of one joint's interval and the limit that put it there. */
    struct Bound {
        double value;
        LimitKind limit;
    };
    /** The largest acceleration in the direction of growing position; `toLimit` = P - p. */
    Bound calcUpperBound(double v, double toLimit, double V, double A, double Ad) const;

    int n_ = 0;
    double tick_s_ = 0.0;
    double kAlpha_ = 0.0;
    JointLimits limits_;
    IntervalChoice choice_;
    JointVector desired_, acceleration_;
};

}  // namespace viable
