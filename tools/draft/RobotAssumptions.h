#pragma once

#include "draft/CollisionDraft.h"

namespace viable::detail {

/** Fills in whatever a run needs and the URDF does not say, so that nothing is NaN, and notes each rule in the draft's
assumptions: limits, rotors, friction, the tool, and a home pose from which the tool can move. Same draft, same figures.
@param draft  with joints, links and contacts */
void assumeFigures(const UrdfRobot& robot, const LinkDistances& distances, RobotDraft& draft);

}  // namespace viable::detail
