#include "viable/robot/SpeedLimits.h"

#include "core/Text.h"

namespace viable {

namespace {

using detail::formatNumber;

/** Farthest corner of a region [m]. */
constexpr double kFarthest_m = 1000.0;

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

void SpeedLimits::Region::check(const ConfigNode& block) const {
    checkRegion(*this, block.place());
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
