#include "experiment/CaseBlocks.h"

#include "experiment/ResolvedNodes.h"

namespace viable::detail {

MotionState readStart(const ConfigNode* block, const RobotDescription& robot) {
    MotionState start;
    start.q = robot.home;
    start.qd.setZero(robot.size());
    start.qdd.setZero(robot.size());
    if (!block) return start;
    ConfigMap map(*block);
    if (const ConfigNode* node = map.find("position_rad")) start.q = toJointVector(*node, robot.size());
    if (const ConfigNode* node = map.find("velocity_radps")) start.qd = toJointVector(*node, robot.size());
    if (const ConfigNode* node = map.find("acceleration_radps2")) start.qdd = toJointVector(*node, robot.size());
    refuseMissingUnit(*block, startKeys());
    map.finish();
    return start;
}

ConfigNode resolveStart(const MotionState& start) {
    return makeMap({{"position_rad", makeList(start.q)},
                    {"velocity_radps", makeList(start.qd)},
                    {"acceleration_radps2", makeList(start.qdd)}});
}

}  // namespace viable::detail
