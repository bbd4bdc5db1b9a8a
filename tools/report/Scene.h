#pragma once

#include <filesystem>

#include "report/BinaryBlock.h"

namespace viable::detail {

/** The robot of a folder as a tree of links with shapes, for the replay; null where the folder is no longer there or says
nothing about shapes: then the links are drawn as lines from joint to joint. Meshes go into `block`, a note names those
that are missing; `joints` gets the joints' kinds. */
nlohmann::json describeScene(const std::filesystem::path& robotFolder, BinaryBlock& block, nlohmann::json& joints);

}  // namespace viable::detail
