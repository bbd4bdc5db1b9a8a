#pragma once

#include "ToolReference.h"
#include "viable/braking/Servo.h"
#include "viable/plugin/NominalController.h"

namespace viable {

/** Leads the tool to a commanded pose, as fast as the joints' limits allow: a joint reference within the position limits
follows the pose (ToolReference), and each joint follows its reference (Servo).

Real time: no allocation, lock or throw after configure(). */
class ToolServo : public NominalController {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    bool follows(MotionCommand::Space space) const override { return space == MotionCommand::Space::Tool; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override;

private:
    Pose place(const Pose& command) const;

    int n_ = 0;
    const SurroundingsFeed* surroundings_ = nullptr;
    double tick_s_ = 0.0;
    bool isRelative_ = false;
    bool hasOrigin_ = false;
    Pose startTool_, origin_;
    ToolReference reference_;
    Servo servo_;
    TargetVelocity velocity_;  ///< of the reference
    MotionState target_;
    JointVector jerk_;
};

}  // namespace viable
