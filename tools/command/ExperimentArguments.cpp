#include "ExperimentArguments.h"

#include <algorithm>

#include "Commands.h"
#include "config/Draws.h"
#include "core/ErrorList.h"
#include "core/Text.h"

namespace viable {

Experiment readDrawnExperiment(const std::string& file, const std::vector<std::string>& overrides,
                               const std::string& draw, const PluginLoader& loader) {
    ConfigNode root = readExperimentTree(file, overrides);
    if (!draw.empty()) {
        const DrawIndex index = parseDrawIndex(draw, "--draw");
        if (resolveDraws(root, index).empty())
            throw badInput("--draw " + draw, file + " has no value that is drawn",
                           "Leave --draw out, or write a value such as ~uniform(0, 1)");
    }
    return readExperiment(root, file, overrides, loader, makeRobotSearchPath(file));
}

void refuseLog(const std::string& file) {
    if (std::filesystem::path(file).extension() != ".mcap") return;
    throw badInput(
        file, "this is a log, and an experiment file is asked for",
        "To decide its ticks again: viable run " + file +
            " --again; to look at it: viable report FOLDER; its own experiment file is in it as experiment.yaml.");
}

static std::vector<std::string> listNames(const Experiment& experiment) {
    std::vector<std::string> names;
    for (const CasePlan& plan : experiment.cases) names.push_back(plan.name);
    return names;
}

void selectOneCase(Experiment& experiment, const std::string& wanted, const char* deed) {
    if (!wanted.empty()) return selectCases(experiment, {wanted});
    const std::vector<std::string> names = listNames(experiment);
    if (names.size() > 1)
        throw badInput(experiment.file.string(),
                       "it has " + std::to_string(names.size()) + " cases, and one arm is " + deed,
                       "Name it with --case: " + detail::join(names) + ".");
}

void selectCases(Experiment& experiment, const std::vector<std::string>& wanted) {
    if (wanted.empty()) return;
    const std::vector<std::string> names = listNames(experiment);
    detail::ErrorList errors;
    for (const std::string& name : wanted) {
        if (std::find(names.begin(), names.end(), name) != names.end()) continue;
        const std::string closest = findClosestName(name, names);
        errors.add(
            "--case " + name, experiment.file.string() + " has no case of that name",
            (closest.empty() ? "" : "Did you mean '" + closest + "'? ") + "Its cases: " + detail::join(names) + ".");
    }
    errors.throwIfAny(experiment.file.string());
    experiment.cases.erase(std::remove_if(experiment.cases.begin(), experiment.cases.end(),
                                          [&](const CasePlan& plan) {
                                              return std::find(wanted.begin(), wanted.end(), plan.name) == wanted.end();
                                          }),
                           experiment.cases.end());
}

}  // namespace viable
