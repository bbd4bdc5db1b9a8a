#include "experiment/CaseBlocks.h"

namespace viable::detail {

RobotDescription readRobot(const ConfigNode& name, const std::vector<std::filesystem::path>& robotPath) {
    return loadRobot(findRobot(toText(name), robotPath, name.place()));
}

std::optional<Parameters> readPayload(const ConfigNode& experiment) {
    ConfigNode own = experiment;
    own.entries.clear();
    const std::vector<ParameterSpec>& specs = settingsOf<PayloadSettings>();
    for (const ParameterSpec& spec : specs)
        if (const ConfigNode* value = experiment.find(spec.name)) own.entries.emplace_back(spec.name, *value);
    if (own.entries.empty()) return {};
    if (!own.find(specs[0].name))
        throw badInput(own.entries.front().second.place(), "there is no payload at this place",
                       std::string("Add `") + specs[0].name + ": ...` (0: none), or leave this out.");
    return readParameters(own, specs.data(), specs.size(), 0);
}

}  // namespace viable::detail
