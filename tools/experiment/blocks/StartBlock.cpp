#include "experiment/CaseBlocks.h"

#include "experiment/ResolvedNodes.h"

namespace viable::detail {

MotionState readStart(const ConfigNode* block, const RobotDescription& robot) {
    const int n = robot.size();
    StartSettings start;
    if (block) readSettings(*block, start, n);
    return {start.position ? start.position->expand(n) : robot.home, start.velocity.expand(n),
            start.acceleration.expand(n)};
}

ConfigNode resolveStart(const MotionState& start) {
    return makeMap({{"position_rad", makeList(start.q)},
                    {"velocity_radps", makeList(start.qd)},
                    {"acceleration_radps2", makeList(start.qdd)}});
}

}  // namespace viable::detail
