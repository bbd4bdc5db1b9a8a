#pragma once

#include "viable/plugin/RobustLoop.h"

namespace viable {

/** Adds no torque: the real arm gets the filter's torque alone, for comparison. */
class None : public RobustLoop {
public:
    void configure(const RunSetup& setup, const Parameters&) override { n_ = setup.size(); }
    void reset(const MotionState&) override {}
    TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override;

private:
    int n_ = 0;
};

}  // namespace viable
