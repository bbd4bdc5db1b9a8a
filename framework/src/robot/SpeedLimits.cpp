#include "viable/robot/SpeedLimits.h"

#include <cmath>
#include <utility>

#include "core/Text.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

using detail::formatNumber;

/** Farthest corner of a region [m]. */
constexpr double kFarthest_m = 1000.0;

double readSpeed(const ConfigNode& node) {
    NumberRange range{kSmallestSpeedLimit, std::numeric_limits<double>::infinity()};
    range.mayBeInfinite = true;
    return toNumber(node, range);
}

Eigen::Vector3d readCorner(const ConfigNode& node) {
    const std::vector<double> x = toNumbers(node, 3, 3, {-kFarthest_m, kFarthest_m});
    return {x[0], x[1], x[2]};
}

void checkRegion(const SpeedLimits::Region& region, const std::string& where) {
    if (!(region.speed >= kSmallestSpeedLimit))
        throw badInput(where,
                       "the speed limit of region `" + region.name + "` is " + formatNumber(region.speed) + " m/s",
                       "Give at least " + formatNumber(kSmallestSpeedLimit) + " m/s.");
    for (const Eigen::Vector3d& corner : {region.lower, region.upper})
        if (!(corner.cwiseAbs().maxCoeff() <= kFarthest_m))
            throw badInput(
                where, "a corner of region `" + region.name + "` is beyond what is allowed",
                "Give numbers from -" + formatNumber(kFarthest_m) + " to " + formatNumber(kFarthest_m) + " m.");
    if ((region.lower.array() < region.upper.array()).all()) return;
    throw badInput(where, "region `" + region.name + "` has no room between its corners",
                   "Each number of the lower corner must be below that of the upper one.");
}

}  // namespace

SpeedLimits readSpeedLimits(const ConfigNode& block, SpeedLimits limits) {
    ConfigMap map(block);
    const ConfigNode *arm = map.find("arm_mps"), *tool = map.find("tool_mps"), *regions = map.find("regions");
    map.finish();
    if (arm) limits.arm = readSpeed(*arm);
    if (tool) limits.tool = readSpeed(*tool);
    if (!regions) return limits;
    if (regions->kind != ConfigNode::Kind::Map)
        throw badInput(regions->place(), "these are no regions by name",
                       "Write `regions: {table: {lower_m: [...], upper_m: [...], speed_mps: 0.1}, ...}`.");
    limits.regions.clear();
    for (const auto& [name, node] : regions->entries) {
        ConfigMap entry(node);
        for (const char* key : {"lower_m", "upper_m", "speed_mps"}) entry.find(key);
        entry.finish();  // a misspelt key explains a missing one
        const SpeedLimits::Region region{name, readCorner(entry.require("lower_m")),
                                         readCorner(entry.require("upper_m")), readSpeed(entry.require("speed_mps"))};
        checkRegion(region, node.place());
        limits.regions.push_back(region);
    }
    return limits;
}

void checkSpeedLimits(const SpeedLimits& limits, const std::string& where) {
    for (const auto& [what, speed] : {std::pair("the arm", limits.arm), std::pair("the tool", limits.tool)})
        if (!(speed >= kSmallestSpeedLimit))
            throw badInput(
                where, std::string("the speed limit of ") + what + " is " + formatNumber(speed) + " m/s",
                "Give at least " + formatNumber(kSmallestSpeedLimit) + " m/s, infinite where there is none.");
    for (const SpeedLimits::Region& region : limits.regions) checkRegion(region, where);
}

}  // namespace viable
