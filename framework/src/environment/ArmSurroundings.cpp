#include "environment/ArmSurroundings.h"

#include "robot/ArmReach.h"

namespace viable {

/** A distance field tells distances up to here apart [m]: farther than any arm needs to stop. */
constexpr double kFieldReach_m = 1.0;

std::shared_ptr<const Surroundings> makeSurroundings(const Environment& environment, const RobotDescription& robot,
                                                     const ArmGeometry& geometry, const JointLimits& limits) {
    const Eigen::AlignedBox3d reach = calcReach(robot, geometry, limits);
    if (environment.map && !reach.sizes().allFinite())
        throw badInput(environment.map->place,
                       "the arm has a sliding joint without position limits, so that the part of the map that it can "
                       "reach has no end",
                       "Give the joint position limits.");
    return std::make_shared<const Surroundings>(environment, reach.min(), reach.max(), kFieldReach_m);
}

}  // namespace viable
