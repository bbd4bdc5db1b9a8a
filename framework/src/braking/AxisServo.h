#pragma once

#include "braking/BrakingCertificate.h"

namespace viable {

/** Leads one joint to a target as fast as its limits allow, without overshoot and without a gain (framework/MATH.md,
section 6).

Seen from the target, the target is a position limit that a stop must not pass: of the admissible jerks the one after
which the stop ends at the target exactly, where all of them stop short of it the one that goes farthest towards it. So
the joint approaches with the time-optimal control of a triple integrator, on the grid, and ends at rest on the target.
What the joint's own certificate admits bounds the choice: what is asked for can be had.

Real time: no allocation, lock or throw; bounded work. */
class AxisServo {
public:
    /** @param limits  as for BrakingCertificate
        @param share   in (0, 1]: of acceleration and jerk limits that the motion relative to the target may use; the
                       rest is for the target's own motion */
    void configure(const AxisLimits& limits, double tick_s, double share);
    void reset(const AxisState& state);
    void changeLimits(const AxisLimits& limits);
    void skipTicks(std::int64_t ticks);

    /** The jerk to hold in this tick [rad/s^3]. All finite. */
    double calc(const AxisState& state, const AxisState& target);
    /** In the last calc() the joint was not where the jerk before had led: somebody else decided. */
    bool isLed() const { return isLed_; }

private:
    /** A motion relative to the target that ends there at rest. */
    struct Approach {
        bool isKnown = false;
        AxisState expected;  ///< relative state that it goes on from
        GridStop stop;
    };

    double aim(const AxisState& relative, const AxisLimits& limits, Approach& approach) const;
    bool isSame(const AxisState& s, const AxisState& x) const;

    AxisLimits limits_{};
    double tick_s_ = 0.0;
    double share_ = 1.0;
    BrakingCertificate certificate_;
    Approach approach_;
    AxisState lastTarget_, expected_;
    bool hasLastTarget_ = false, hasExpected_ = false, isLed_ = false;
};

}  // namespace viable
