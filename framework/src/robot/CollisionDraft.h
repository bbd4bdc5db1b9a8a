#pragma once

#include <filesystem>

#include "robot/RobotDraft.h"
#include "robot/UrdfReader.h"

namespace viable::detail {

/** Fills `links` and `contacts` of a draft whose `joints` are there.
@param folder  that of the URDF, an absolute path: where the meshes are looked for, and in the package around it */
void draftCollision(const UrdfRobot& robot, const std::filesystem::path& folder, RobotDraft& draft);

}  // namespace viable::detail
