#include "experiment/CaseBlocks.h"

namespace viable::detail {

RobotDescription readRobot(const ConfigNode& name, const std::vector<std::filesystem::path>& robotPath) {
    return loadRobot(findRobot(toText(name), robotPath, name.place()));
}

RobotDescription addPayload(RobotDescription robot, const Parameters& payload) {
    const auto settings = payload.get<PayloadSettings>();
    return withPayload(std::move(robot), settings.mass_kg, settings.offset);
}

}  // namespace viable::detail
