#include "experiment/CaseBlocks.h"

#include "config/MapReader.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

MotionState readStart(const ConfigNode* block, const RobotDescription& robot) {
    MotionState start;
    start.q = robot.home;
    start.qd.setZero(robot.size());
    start.qdd.setZero(robot.size());
    if (!block) return start;
    Complaints complaints;
    complaints.gather([&] { refuseMissingUnit(*block, startKeys()); });
    MapReader map(*block, listNames(startKeys()), complaints);
    const auto read = [&](const char* key, JointVector& values) {
        map.offer(key, [&](const ConfigNode& node) { values = toJointVector(node, robot.size()); });
    };
    read("position_rad", start.q);
    read("velocity_radps", start.qd);
    read("acceleration_radps2", start.qdd);
    complaints.throwIfAny(block->place());
    return start;
}

ConfigNode resolveStart(const MotionState& start) {
    return makeMap({{"position_rad", makeList(start.q)},
                    {"velocity_radps", makeList(start.qd)},
                    {"acceleration_radps2", makeList(start.qdd)}});
}

}  // namespace viable::detail
