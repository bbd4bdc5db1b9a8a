#pragma once

#include "viable/plugin/SafetyFilter.h"

namespace viable {

/** Leaves the torque alone: what the controller would do without any limit.

Guarantees nothing. The nominal arm moves with the acceleration of the desired torque, held for a
tick.
Real time: no allocation, lock or throw after configure(). */
class PassThrough : public SafetyFilter {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override {}
    FilterTraits traits() const override { return {}; }
    FilterStatus filter(const FilterInput& input, FilterDecision& decision) override;

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    JointVector acceleration_;
};

}  // namespace viable
