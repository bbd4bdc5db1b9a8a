#pragma once

#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** Limits how fast each joint's velocity may change, as robot vendors do it at their interfaces: velocity,
acceleration and jerk, no position.

Method (the rule published with Franka's libfranka, rate_limiting.h, there with fixed limits): from the velocity
v and the acceleration a of the tick before and a commanded velocity v_cmd
    jerk          j = clip(((v_cmd - v) / dt - a) / dt, -J, J)
    acceleration  x = clip(a + j dt, max(J/A (-V - v), -A), min(J/A (V - v), A))
    velocity      v + x dt
Here v_cmd is the velocity that the desired torque asks for in this tick: v + qdd_d dt with
qdd_d = M^-1 (tau_d - b), so that j = clip((qdd_d - a) / dt, -J, J). Each joint by itself. With limits that
differ by side the slope towards the upper velocity limit is Jd/Au and towards the lower one Ju/Ad (u up, d down).
Assumes: nothing about position; holds accelerations, so the jerk is the difference quotient.
Guarantees: velocity, acceleration and jerk limits at every tick, from a start at rest: the slope makes the bound on
the acceleration fall by J dt a / A <= J dt per tick. (A >= J dt, see checkLimits.) Position not at all.
Real time: no allocation, lock or throw after configure(). */
class JerkLimitedRate : public SafetyFilter {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override {}  // v and a are the nominal arm's
    FilterTraits traits() const override { return {}; }
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    double calcAcceleration(double v, double a, double desired, const AxisLimits& limits,
                            JointIntervention& acting) const;

    int n_ = 0;
    double tick_s_ = 0.0;
    JointLimits limits_;
    JointVector desired_, acceleration_;
};

}  // namespace viable
