#pragma once

#include "tracking/InertiaSample.h"
#include "tracking/PoseTorques.h"
#include "tracking/TrackingBound.h"

namespace viable::detail {

/** Joint torques from lower to upper [Nm]. */
struct TorqueRange {
    JointVector lower, upper;

    static TorqueRange within(const JointVector& size) { return {-size, size}; }
    JointVector calcLargest() const { return lower.cwiseAbs().cwiseMax(upper.cwiseAbs()); }
};

/** Sizes of what appears in the equations of motion of nominal and real arm, over a sample of poses and, in closed form,
all velocities and accelerations within limits. */
struct ArmExtremes {
    std::vector<PoseInertia> inertias;  ///< of real arms: heavy, light, and light on one half with heavy on the other
    Eigen::MatrixXd inertia;            ///< largest |M_ij|, as all that follows of any arm of the set
    Eigen::MatrixXd inertiaRange;       ///< largest change of M_ij from pose to pose
    PoseTorques torques;                ///< of real arms
    JointVector nominalTorque;          ///< largest |M qdd + b| of the nominal arm [Nm]
    /** What each takes from the torque that moves the arm. The payload: the whole of it; a smaller one takes that share,
    in a run always the same, and does less. */
    TorqueRange massError, payload, tilt;
    JointVector massErrorRate, payloadRate;      ///< how fast at most, as far as the nominal arm moves [Nm/s]
    Eigen::MatrixXd tiltSlope;                   ///< largest change of the tilt's torque over each position [Nm/rad]
    JointVector massErrorWeight, payloadWeight;  ///< in an arm at rest, at most [Nm]
};

/** The largest velocity, acceleration and jerk of each joint, finite. */
struct MotionSize {
    JointVector velocity, acceleration, jerk;
};

/** @param gain  K_r, for the poses in which the loop is nearest to instability. Throws Error (BadInput) at `source` where M qdd + b is not finite in some pose. */
ArmExtremes findArmExtremes(const RobotDescription& robot, const JointLimits& limits, const MotionSize& motion,
                            const DisturbanceSet& set, const JointVector& gain, const std::string& source);

}  // namespace viable::detail
