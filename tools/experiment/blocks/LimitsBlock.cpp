#include "experiment/CaseBlocks.h"

#include <algorithm>

#include "config/MapReader.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

LimitsBlock readLimitsBlock(const ConfigNode* block, const RobotDescription& robot, double tick_s,
                            const std::string& place) {
    LimitsBlock read{robot.limits, robot.allowLargeAngles};
    if (block) {
        Complaints complaints;
        complaints.gather([&] { refuseMissingUnit(*block, limitKeys()); });
        MapReader map(*block, listNames(limitKeys()), complaints);
        ConfigNode quantities = *block;  // a robot's own limits have no hold_on
        map.offer("hold_on", [&](const ConfigNode& held) {
            read.holdsOnReal = toChoice(held, {"nominal", "real"}) == "real";
        });
        quantities.entries.erase(std::remove_if(quantities.entries.begin(), quantities.entries.end(),
                                                [](const auto& entry) { return entry.first == "hold_on"; }),
                                 quantities.entries.end());
        complaints.gather([&] { read.limits = readLimits(quantities, robot.limits, read.allowsLargeAngles); });
        complaints.throwIfAny(place);
    }
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
