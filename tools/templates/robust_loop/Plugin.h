#pragma once

#include "viable/plugin/RobustLoop.h"

/** Pulls the real joint to the nominal one with a spring and a damper: the starting point for a loop of your own.

Method: tau_a = K (q_nominal - q_real) + D (qd_nominal - qd_real). Without an integral part a constant disturbance
leaves an error behind. */
class @CLASS@ : public viable::RobustLoop {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override;
    void reset(const viable::MotionState&) override {}  // nothing is remembered from tick to tick
    viable::TickStatus compute(const viable::JointState& real, const viable::MotionState& nominal,
                               const viable::JointVector& filterTorque, viable::JointVector& torque) override;

private:
    int n_ = 0;
    viable::JointVector stiffness_;  // [Nm/rad]
    viable::JointVector damping_;    // [Nm s/rad]
};
