#pragma once

#include "viable/environment/Surroundings.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

/** What stands around an arm, prepared as far as the arm can ever reach. Throws Error (BadInput) as Surroundings does, and
for a map around an arm whose reach has no end.
@param limits  of the joints, for the travel of sliding ones */
std::shared_ptr<const Surroundings> makeSurroundings(const Environment& environment, const RobotDescription& robot,
                                                     const ArmGeometry& geometry, const JointLimits& limits);

}  // namespace viable
