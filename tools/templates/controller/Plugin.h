#pragma once

#include "viable/plugin/NominalController.h"

/** Spring and damper at each joint, with gravity carried: the starting point for a controller of your own.

Method: tau_d = g(q) + K (q_command - q) - D qd. It need not know of any limit; the filter does. */
class @CLASS@ : public viable::NominalController {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override;
    void reset(const viable::MotionState&) override {}  // nothing is remembered from tick to tick
    /** It follows commands of joints, not of the tool. */
    viable::ControllerTraits traits() const override { return {true, false}; }
    viable::TickStatus compute(const viable::ControllerInput& input, viable::ControllerOutput& output) override;

private:
    int n_ = 0;
    viable::JointVector stiffness_;  // [Nm/rad]
    viable::JointVector damping_;    // [Nm s/rad]
};
