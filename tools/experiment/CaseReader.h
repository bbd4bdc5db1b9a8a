#pragma once

#include "experiment/CasePlan.h"

namespace viable::detail {

/** Reads one case. Throws Error (BadInput) with what is wrong in its blocks, together.
@param node       the file's root overlaid by the case
@param overrides  those in `node`, for messages
@param lacking    required keys that no case has: their lack is told at the file, not at the case */
CasePlan readCase(const ConfigNode& node, const std::string& name, const std::string& title, const PluginLoader& loader,
                  const std::vector<std::filesystem::path>& robotPath, const std::vector<std::string>& overrides,
                  const std::vector<std::string>& lacking);

}  // namespace viable::detail
