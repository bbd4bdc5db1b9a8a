#pragma once

#include "viable/motion/CertifiedBraking.h"
#include "viable/motion/DesiredJerk.h"
#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** Keeps position, velocity, acceleration and jerk limits in sampled time, always: a jerk is taken only
if a stop within the limits exists on the time grid after it; otherwise the stop found before goes on.
The law is CertifiedBraking; here stand its parameters and the desired jerk (paper, eq. 14).

Guarantees: every limit, at every tick and between, for any input and any missed ticks; a desired jerk
that is admissible is taken bit for bit. With `recovery` also from starts that break a limit: nothing gets
worse then, and the limits hold from the moment they are met.
Real time: no allocation, lock or throw after configure(). */
class CertifiedBrakingFilter : public SafetyFilter {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    bool promisesLimits() const override { return true; }
    bool recovers() const override { return recovery_; }
    bool changeLimits(const JointLimits& limits) override;
    void skipTicks(std::int64_t ticks) override;
    FilterStatus filter(const MotionState& nominal, const JointVector& torque,
                        const Dynamics& dynamics, FilterDecision& decision) override;

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    bool recovery_ = false;
    DesiredJerk desiredJerk_;
    CertifiedBraking braking_;
    JointVector desiredAcceleration_, desired_, jerk_;
};

}  // namespace viable
