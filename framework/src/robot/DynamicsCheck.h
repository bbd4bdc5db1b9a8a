#pragma once

#include "robot/ArmRecursion.h"

namespace viable::detail {

/** Where two results of one state differ most. */
struct DynamicsDifference {
    double size = 0.0;  ///< as a share of the scale below; NaN where a result holds NaN
    const char* what = "inertia M";
    int joint = -1;  ///< -1: the tool's pose
};

/** Compares M, b, gravity, tool and J of one arm in one state. Scale: what the masses of the arm, put as far from the base as
its farthest part, would give at the joint; both results are sums of such terms, so rounding is some 1e-15 of it. */
DynamicsDifference compareDynamics(const RobotDescription& robot, const JointVector& q, const JointVector& qd,
                                   const Dynamics& expected, const Dynamics& found);

/** Largest difference that is rounding. */
inline constexpr double kDynamicsTolerance = 1e-12;

/** Compares the recursion with Simbody at a few random states within the position limits, always the same ones.
Throws Error (BadInput) with joint and size where they differ by more than kDynamicsTolerance.
@param where  the robot's file, for the message */
void checkRecursion(const RobotDescription& robot, const ArmRecursion& recursion, const std::string& where);

}  // namespace viable::detail
