#pragma once

#include "viable/environment/Surroundings.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

/** Distances of the parts of an arm at a pose from obstacles and from each other, and the way of the joints that
leads apart. They are for controllers that keep away where they are free to. Only a filter keeps clear for certain.
Real time after construction: no allocation, lock or throw. */
class ArmClearances {
public:
    ArmClearances(const RobotDescription& robot, const ArmGeometry& geometry);
    ~ArmClearances();
    ArmClearances(ArmClearances&&) noexcept;
    ArmClearances& operator=(ArmClearances&&) noexcept;

    struct Item {
        int capsule = 0;        ///< index into ArmGeometry::capsules
        int otherCapsule = -1;  ///< -1: the distance is that from an obstacle
        int obstacle = -1;      ///< index into the surroundings; -1: another capsule
        bool isNearest = true;  ///< false: at an end of a capsule, which may come to be the nearest place
        double distance = 0.0;  ///< distance of two capsules, or a lower bound of that from an obstacle [m]
        JointVector gradient;   ///< how it changes with each joint [m/rad]
    };
    /** The distances below `within_m`: of each capsule that a joint moves from each obstacle (the nearest nine), and of
    each pair of capsules. Each is given at its nearest place and at the ends of the capsules.
    @param surroundings  null: only pairs
    @param time_s        of the run, see Surroundings::calcDistance
    @return valid until the next call; empty where a position is NaN */
    const std::vector<Item>& find(const JointVector& q, const Surroundings* surroundings, double time_s,
                                  double within_m);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
