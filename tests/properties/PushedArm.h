#pragma once

#include "Random.h"
#include "viable/core/JointLimits.h"
#include "viable/core/JointTypes.h"
#include "viable/robot/ArmGeometry.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** A robot of the project, its model and capsules, read once. */
struct Robot {
    explicit Robot(const char* name);
    RobotDescription description;
    ArmGeometry geometry;
    RobotModel model;
};

/** What was wrong in a tick; null: nothing. */
struct Violation {
    const char* what = nullptr;
    double excess = 0.0;
};

/** Position, velocity or acceleration beyond its limit by more than `allowed`. */
Violation checkLimits(const MotionState& state, const JointLimits& limits, double allowed);

/** Wants that change now and then: to and fro, towards a pose, at random, or the tool along a direction, whatever is there. */
class Pusher {
public:
    explicit Pusher(Random& random) : random_(random) {}
    /** Accelerations. */
    JointVector want(const MotionState& state, const Dynamics& dynamics);

private:
    Random& random_;
    JointVector goal_;
    int mode_ = 0, ticksLeft_ = 0;
    double stiffness_ = 1.0;
};

}  // namespace viable
