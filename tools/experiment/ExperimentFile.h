#pragma once

#include "experiment/CasePlan.h"

namespace viable {

/** An experiment file, read and checked: one question, several cases side by side. */
struct Experiment {
    std::filesystem::path file;
    std::string title;
    std::vector<CasePlan> cases;  ///< in file order, at least one
};

/** The tree of an experiment file, not yet judged.
@param overrides  `key.path=value`, applied in order (see applyOverride) */
ConfigNode readExperimentTree(const std::filesystem::path& file, const std::vector<std::string>& overrides);

/** Reads an experiment file. Strict: an unknown, duplicate or missing key, a wrong size, range or
name is an Error (BadInput) with file:line:column, key path, value and remedy; those of different blocks are told
together.
@param root         of readExperimentTree(); a value still to be drawn (see resolveDraws) is an error
@param overrides    those in `root`, for messages
@param robotPath    folders searched for robots, see findRobot */
Experiment readExperiment(const ConfigNode& root, const std::filesystem::path& file,
                          const std::vector<std::string>& overrides, const PluginLoader& loader,
                          const std::vector<std::filesystem::path>& robotPath);

/** The same from the file at once. */
Experiment readExperiment(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                          const PluginLoader& loader, const std::vector<std::filesystem::path>& robotPath);

}  // namespace viable
