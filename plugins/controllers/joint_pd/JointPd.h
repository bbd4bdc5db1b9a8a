#pragma once

#include "viable/plugin/NominalController.h"

namespace viable {

/** Pulls each joint towards its set-point with a chosen acceleration, whatever the arm's inertia.

Method: tau_d = M qdd_d + b with qdd_d = k_p (q_d - q) - k_d (qd - f qd_d)      (paper, eq. 24)
f = 1 with `velocity_feedforward`, else 0 as in the paper.
Real time: no allocation, lock or throw after configure(). */
class JointPd : public NominalController {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState&) override {}
    ControllerTraits traits() const override { return {true, false}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override;

private:
    int n_ = 0;
    JointVector stiffness_, damping_;
    double feedforward_ = 0.0;
    JointVector acceleration_;
};

}  // namespace viable
