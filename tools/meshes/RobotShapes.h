#pragma once

#include "robot/LinkShapes.h"
#include "viable/robot/RobotDescription.h"

namespace viable {

/** The solids of a robot: from its URDF's visual elements, else from the collision elements. Meshes are read, from
the robot's folder or the package around it. A link whose mesh is lost has the capsules of
collision.yaml beside its other shapes; where nothing of the URDF can be drawn, all capsules are. Empty when nothing is
known.
Throws Error (BadInput) when a file is there and wrong. */
std::vector<LinkShapes> loadShapes(const RobotDescription& robot);

}  // namespace viable
