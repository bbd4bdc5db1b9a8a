#include "experiment/CaseBlocks.h"

#include "experiment/ResolvedNodes.h"

namespace viable::detail {

LimitSettings readLimitsBlock(const ConfigNode* block, const RobotDescription& robot, double tick_s,
                              const std::string& place) {
    LimitSettings read{robot.limits, robot.allowLargeAngles};
    if (block) readSettings(*block, read, robot.size());
    checkLimits(read.limits, tick_s, read.allowsLargeAngles, place, robot.jointNames());
    return read;
}

ConfigNode resolveLimits(const CasePlan& plan) {
    ConfigNode limits = makeMap({{"position_rad", makeBounds(plan.limits.position)},
                                 {"velocity_radps", makeBounds(plan.limits.velocity)},
                                 {"acceleration_radps2", makeBounds(plan.limits.acceleration)},
                                 {"jerk_radps3", makeBounds(plan.limits.jerk)}});
    if (plan.holdsOnReal) limits.entries.emplace_back("hold_on", makeScalar("real"));
    if (plan.allowsLargeAngles) limits.entries.emplace_back("allow_large_angles", makeScalar("true"));
    return limits;
}

}  // namespace viable::detail
