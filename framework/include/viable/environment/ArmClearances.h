#pragma once

#include <memory>
#include <vector>

#include "viable/environment/Surroundings.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

/** How near the parts of an arm at a pose are to obstacles and to each other, and which way of the joints leads apart: for
controllers that keep away where they are free to. What keeps clear for certain is a filter's work.
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
        int obstacle = -1;      ///< of the surroundings; -1: another capsule
        bool isNearest = true;  ///< false: at an end of a capsule, which may come to be the nearest place
        double distance = 0.0;  ///< of two capsules, or a lower bound of a capsule's from an obstacle [m]
        JointVector gradient;   ///< how it changes with each joint [m/rad]
    };
    /** What is nearer than `within_m`: each capsule that a joint moves from each obstacle (the nearest nine), and each pair of
    capsules; each at its nearest place and at the ends of the capsules.
    @param surroundings  null: only pairs
    @param time_s        of the run, see Surroundings::calcDistance
    @return valid until the next call; empty where a position is no number */
    const std::vector<Item>& find(const JointVector& q, const Surroundings* surroundings, double time_s,
                                  double within_m);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
