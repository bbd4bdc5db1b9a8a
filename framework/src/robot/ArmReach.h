#pragma once

#include "viable/robot/ArmGeometry.h"

namespace viable {

/** A box that no moving part of an arm ever leaves, base frame [m]; the base's origin is in it, too. Around the first joint
of each branch, as far as links, capsules and the travel of sliding joints add up to: simple, and generous.
Without end where a joint slides without position limits.
@param limits  of the joints, for the travel */
Eigen::AlignedBox3d calcReach(const RobotDescription& robot, const ArmGeometry& geometry, const JointLimits& limits);

}  // namespace viable
