#pragma once

#include "viable/filter/JerkIntervalFilter.h"

namespace viable {

struct VelocityDamperOptions {
    double xi = 1.0, influence_rad = 0.2, safety_rad = 0.02;
    JerkIntervalOptions following;

    template <class V>
    void describe(V& v) {
        v(xi, "xi", "rad/s",
          "Largest velocity towards a limit at the influence distance; xi * tick_s at most influence_rad - safety_rad.")
            .above(0);
        v(influence_rad, "influence_rad", "rad", "d_i: distance from a limit where damping begins.").above(0);
        v(safety_rad, "safety_rad", "rad",
          "d_s: distance from a limit where no velocity towards it is left; at most half of the range.")
            .atLeast(0);
        following.describe(v);
    }
};

/** Slows each joint down in proportion to its distance from a position limit: the velocity damper of Faverjon
and Tournassoud (1987), and velocity, acceleration and jerk limits for the one tick to come.

Method: the jerk j of each joint, nearest to the desired one (14) in torque (13), held for a tick, with
v+ = v + a dt + j dt^2 / 2 its velocity afterwards, subject to
    position       v+ <= xi (d - d_s) / (d_i - d_s),  d = P - p,  where d < d_i
    velocity       v+ <= V
    acceleration   -A <= a + j dt <= A
    jerk           -J <= j <= J
and the mirror image below; d_i influence distance, d_s safety distance, xi the velocity allowed at d_i. Nearer
than d_s the joint is led away.
Assumes: that velocity can be changed at once. It cannot, with limited acceleration and jerk: the rows are often
missed (Infeasible). The joint then takes the first jerk of the fastest way to the nearest allowed velocity and
a = 0, as far as acceleration and jerk limits let it.
Guarantees: jerk and acceleration limits at every tick, from a start within them; nothing about velocity and
position.
Real time: no allocation, lock or throw after configure(). */
class VelocityDamper : public JerkIntervalFilter {
public:
    VelocityDamper() : JerkIntervalFilter("velocity_damper") {}
    void configure(const RunSetup& setup, const Parameters& parameters) override;

private:
    Rows calcRows(const AxisState& state, const AxisLimits& limits) const override;
    double calcDampedVelocity(double toLimit) const;

    VelocityDamperOptions options_;
};

}  // namespace viable
