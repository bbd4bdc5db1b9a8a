#pragma once

#include "tracking/JointFollower.h"
#include "viable/plugin/NominalController.h"

namespace viable {

/** Leads each joint to its set-point as fast as the limits allow, without overshoot and without gains (JointFollower).

The torque is that of the present acceleration; the jerk that the servo chose is its derivative, which filters take as
the desired jerk of (14), and certified ones pass unchanged.
Real time: no allocation, lock or throw after configure(). */
class JointServo : public NominalController {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    ControllerTraits traits() const override { return {true, false}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override;

private:
    int n_ = 0;
    double tick_s_ = 0.0;
    bool feedforward_ = true;
    JointLimits limits_;
    const SurroundingsFeed* surroundings_ = nullptr;
    JointFollower servo_;
    MotionState target_;
    bool hasTarget_ = false;
    JointVector lastRate_, jerk_;  ///< lastRate_: difference quotient of the commanded velocity
};

}  // namespace viable
