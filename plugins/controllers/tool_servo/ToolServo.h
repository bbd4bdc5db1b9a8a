#pragma once

#include "tracking/ToolFollower.h"
#include "viable/plugin/NominalController.h"

namespace viable {

/** ToolFollower as a controller: leads the tool to a commanded pose, as fast as the joints' limits allow.

Real time: no allocation, lock or throw after configure(). */
class ToolServo : public NominalController {
public:
    void configure(const RunSetup& setup, const Parameters& parameters) override;
    void reset(const MotionState& start) override;
    ControllerTraits traits() const override { return {false, true}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override;

private:
    Pose place(const Pose& command) const;

    int n_ = 0;
    const SurroundingsFeed* surroundings_ = nullptr;
    bool isRelative_ = false;
    bool hasOrigin_ = false;
    Pose startTool_, origin_;
    ToolFollower follower_;
    JointVector jerk_;
};

}  // namespace viable
