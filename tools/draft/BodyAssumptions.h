#pragma once

#include "draft/CollisionDraft.h"

namespace viable::detail {

/** The body of a shape as if of 1 kg/m^3, in the link's frame.
@param mesh  of a mesh: its triangles, in the shape's frame
@param capsule  that contains it: stands for a mesh without a volume, such as one of loose faces */
BodyInertia calcSolid(const LinkShape& shape, const Mesh& mesh, const DraftCapsule& capsule);

/** Writes the bodies that nobody gave into the document, in place of their placeholders, and notes them in the draft's
assumptions: from what the links look like, or where nothing is drawn, from where the next joints are.
@param draft  with links */
void assumeBodies(UrdfDocument& document, const UrdfRobot& robot, const std::map<std::string, MissingBody>& bodies,
                  RobotDraft& draft);

}  // namespace viable::detail
