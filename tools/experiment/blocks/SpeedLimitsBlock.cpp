#include "experiment/CaseBlocks.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

ConfigNode resolveSpeedLimits(const SpeedLimits& limits) {
    ConfigNode block = makeMap({{"arm_mps", makeNumber(limits.arm)}, {"tool_mps", makeNumber(limits.tool)}});
    ConfigNode regions = makeMap({});
    for (const SpeedLimits::Region& region : limits.regions)
        regions.entries.emplace_back(region.name, makeMap({{"lower_m", makeList(JointVector(region.lower))},
                                                           {"upper_m", makeList(JointVector(region.upper))},
                                                           {"speed_mps", makeNumber(region.speed)}}));
    block.entries.emplace_back("regions", std::move(regions));
    return block;
}

}  // namespace viable::detail
