#include "experiment/CaseBlocks.h"

namespace viable::detail {

RobotBlock readRobot(const ConfigNode& robot, const ConfigNode* payload,
                     const std::vector<std::filesystem::path>& robotPath) {
    RobotBlock block{loadRobot(findRobot(toText(robot), robotPath, robot.place())), std::nullopt};
    if (!payload) return block;
    block.payload = readPayload(*payload, block.robot.size());
    const std::vector<double>& offset = block.payload->numbers("offset_m");
    block.robot =
        withPayload(std::move(block.robot), block.payload->number("mass_kg"), {offset[0], offset[1], offset[2]});
    return block;
}

}  // namespace viable::detail
