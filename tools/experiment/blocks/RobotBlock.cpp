#include "experiment/CaseBlocks.h"

namespace viable::detail {

RobotDescription readRobot(const ConfigNode& name, const std::vector<std::filesystem::path>& robotPath) {
    return loadRobot(findRobot(toText(name), robotPath, name.place()));
}

RobotDescription addPayload(RobotDescription robot, const Parameters& payload) {
    const std::vector<double>& offset = payload.numbers("offset_m");
    return withPayload(std::move(robot), payload.number("mass_kg"), {offset[0], offset[1], offset[2]});
}

}  // namespace viable::detail
