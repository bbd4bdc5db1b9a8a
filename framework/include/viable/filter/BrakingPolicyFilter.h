#pragma once

#include "viable/braking/Braking.h"
#include "viable/filter/JerkIntervalFilter.h"

namespace viable {

struct BrakingPolicyOptions {
    double kAlpha = 5.0;
    JerkIntervalOptions following;

    template <class V>
    void describe(V& v) {
        v(kAlpha, "k_alpha", "1/s",
          "Slope of alpha: how fast a limit may be approached; k_alpha * tick_s must not exceed 1.")
            .above(0);
        following.describe(v);
    }
};

/** The law that the paper builds on a braking policy, without the policy: what tosbp and tovzbp have in common, slips
of the paper corrected.

Method: the jerk j of each joint, nearest to the desired one (14) in torque (13), subject to
    position       j <= -J + alpha(h_p) / (dp_f/da),  h_p = P - p_f,  types III and IV      (18, 21)
    velocity       j <= -J + J alpha(h_v) / a,  h_v = V - v - a^2 / (2 J),  for a > 0           (19)
    acceleration   -A <= a + j dt <= A                                                (in place of 22)
    jerk           -J <= j <= J
and the mirror image below; p_f is the position where the policy's stop ends, alpha(h) = k_alpha h. (21) takes this
short form with every policy whose first phase leaves p_f where it is.
Assumes: continuous time. With jerk held over a tick a stop may come to lie beyond its limit (h < 0), where the row has
no solution. Or rows contradict each other. Such ticks are reported as Infeasible. The joint then brakes by the policy's
own jerk as far as acceleration and jerk limits let it.
Guarantees: jerk and acceleration limits at every tick, from a start within them; nothing else.
Real time: no allocation, lock or throw after configure(). */
class BrakingPolicyFilter : public JerkIntervalFilter {
public:
    /** Reads BrakingPolicyOptions. */
    void configure(const RunSetup& setup, const Parameters& parameters) override;

protected:
    using JerkIntervalFilter::JerkIntervalFilter;

private:
    /** The policy's stop from velocity `v` [rad/s] and acceleration `a` [rad/s^2]. Real time. */
    virtual BrakingStop calcStop(double v, double a, const AxisLimits& limits) const = 0;
    Rows calcRows(const AxisState& state, const AxisLimits& limits) const override;

    double kAlpha_ = 0.0;
};

}  // namespace viable
