#pragma once

#include "host/PluginLoader.h"

namespace viable {

/** JSON Schema of an experiment file, for editors: completion, help and marks at mistakes while writing (UTF-8, ends with
a line break). Draft-07, the newest draft that every editor's YAML support knows.

It never refuses what readExperiment() takes, and refuses unknown keys and parameters, wrong forms, choices and numbers out
of range. What only the reader sees: whether robots, files and lists of joints fit, rules between keys (robust_loop with
real_plant, a parameter that another level supplies), the value of an expression, and quotes around a number.
@param plugins  those whose names and parameters are known; others may be named by the path of their library */
std::string makeExperimentSchema(const std::vector<PluginInfo>& plugins);

}  // namespace viable
