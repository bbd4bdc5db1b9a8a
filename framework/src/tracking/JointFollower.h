#pragma once

#include "tracking/ToolFollower.h"

namespace viable {

/** Leads an arm to joint targets (Servo), also where something bars the way.

Servo plans for each joint alone, with all of its jerk. Where a filter holds joints back beside an obstacle, others pull
on against one that brakes, so that it goes too far, and the arm swings for ever. So once the arm is led elsewhere than
it was to go, it follows a reference that keeps clear of what is around (ToolReference), until the reference has been at
the target, and the arm been left alone, for as long as its longest stop. Before that nothing is looked at, and the jerk
is that of Servo to the bit.
Real time: no allocation, lock or throw after configure(). */
class JointFollower {
public:
    /** @param share     see Servo
        @param geometry  null: it is Servo alone; need not outlive this call */
    void configure(const RobotDescription& robot, const JointLimits& limits, double tick_s, const MotionState& start,
                   double share = 1.0, const ArmGeometry* geometry = nullptr);
    void reset(const MotionState& start);
    void skipTicks(std::int64_t ticks);

    /** The jerk to hold in this tick [rad/s^3]. @param target  see Servo. @param surroundings  null: none are known */
    void calc(const MotionState& state, const MotionState& target, const Surroundings* surroundings, double time_s,
              JointVector& jerk);

private:
    Servo servo_;
    std::optional<ToolFollower> guide_;
    JointBounds range_;
    JointVector goal_;
    std::int64_t longest_ = 0, ticksLeft_ = 0;  ///< of being guided
    bool wasGuided_ = false;                    ///< and servo_ knows nothing of the arm's state
};

}  // namespace viable
