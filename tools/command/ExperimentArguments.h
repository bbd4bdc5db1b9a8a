#pragma once

#include "experiment/ExperimentFile.h"

namespace viable {

/** The experiment of a command line, with the values of one run where they are drawn. Throws Error (BadInput).
@param draw  "SEED:INDEX", or empty */
Experiment readDrawnExperiment(const std::string& file, const std::vector<std::string>& overrides,
                               const std::string& draw, const PluginLoader& loader);

/** Throws Error (BadInput) where the file is a log by its name: what one may want of it has other commands. */
void refuseLog(const std::string& file);

/** Keeps the cases called `wanted`, all where it is empty. Throws Error (BadInput) for one that is not there. */
void selectCases(Experiment& experiment, const std::vector<std::string>& wanted);
/** Keeps the case called `wanted`; where that is empty, there must be one only. @param deed  "driven": done to its arm */
void selectOneCase(Experiment& experiment, const std::string& wanted, const char* deed);

}  // namespace viable
