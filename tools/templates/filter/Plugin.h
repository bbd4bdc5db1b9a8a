#pragma once

#include "viable/plugin/SafetyFilter.h"

/** Keeps acceleration limits, and nothing else: the starting point for a law of your own.

Method: the desired torque's acceleration M^-1 (tau_d - b), each joint clamped to its limits.
Guarantees: acceleration limits. Position, velocity and jerk are not looked at.
A law with one interval of jerks per joint is written with less: derive from viable/filter/JerkIntervalFilter.h. */
class @CLASS@ : public viable::SafetyFilter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override;
    void reset(const viable::MotionState&) override {}  // nothing is remembered from tick to tick
    /** It guarantees no set of limits that the host could hold it to. */
    viable::FilterTraits traits() const override { return {}; }
    viable::FilterStatus filter(const viable::FilterInput& input, viable::FilterDecision& decision) override;

private:
    int n_ = 0;
    viable::JointVector lower_, upper_;  // [rad/s^2]
};
