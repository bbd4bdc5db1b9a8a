#pragma once

#include "viable/filter/JerkIntervalFilter.h"

namespace viable {

struct ExponentialCbfOptions {
    double kAlpha = 5.0;
    JerkIntervalOptions following;
    bool brakes = false;

    template <class V>
    void describe(V& v) {
        v(kAlpha, "k_alpha", "1/s", "Every pole of every barrier lies at -k_alpha; k_alpha * tick_s must not exceed 1.")
            .above(0);
        following.describe(v);
        v(brakes, "on_infeasible", "stop|brake",
          "At the first tick without an admissible jerk: end the run there, or brake in each such tick, count it and "
          "go on.");
    }
};

/** Tries to keep position, velocity, acceleration and jerk limits by exponential control barrier functions,
each limit by itself (S3 of the paper).

Method: the jerk j of each joint, nearest to the desired one (14) in torque (13), subject to
    position       j <= k^3 (P - p) - 3 k^2 v - 3 k a
    velocity       j <= k^2 (V - v) - 2 k a
    acceleration   j <= k (A - a)
    jerk           -J <= j <= J
and the mirror image below, k = k_alpha: all poles of all barriers at -k (see ExponentialBarrierRows).
Assumes: continuous time, and that the rows never ask for a jerk beyond the limit or contradict each other.
They do: the barriers know nothing of the jerk that braking takes. The law has no answer then. The tick is
Infeasible and the joint takes the first jerk of its fastest stop, as far as acceleration and jerk limits let
it. With `on_infeasible: stop` it ends the case in the next tick (Ended).
Guarantees: jerk limits at every tick; acceleration limits at every tick, from a start within them (the
row is exact for k dt <= 1).
Real time: no allocation, lock or throw after configure(). */
class ExponentialCbf : public JerkIntervalFilter {
public:
    ExponentialCbf() : JerkIntervalFilter("exponential_cbf") {}
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    Rows calcRows(const AxisState& state, const AxisLimits& limits) const override;

    ExponentialCbfOptions options_;
    bool hasEnded_ = false;  // the first tick without a solution has been
};

}  // namespace viable
