#pragma once

#include "viable/environment/Environment.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {

/** Judges poses of an arm after the fact: does it touch anything, and by how much? Shares no arithmetic with the
filters: exact distances between capsules, solids and the cells of the octree itself, without any field, and link poses
from the robot's description one by one; what it has in common with them is the reader of the map and the tree in which
its cells are found (its tests ask all cells, one after the other). Slower, and it allocates: not for a tick.

A capsule's distance from a convex solid is the least signed distance along its segment, a convex function of one
variable, less its radius; it is found by cutting planes to kAccuracy_m. Where they meet the distance is negative: how
deep the segment lies in the solid plus the radius. Any number of threads. */
class CollisionChecker {
public:
    /** Reads the map file, if there is one. Throws Error (BadInput). All arguments are copied. */
    CollisionChecker(const RobotDescription& robot, const ArmGeometry& geometry, const Environment& environment);
    ~CollisionChecker();

    static constexpr double kAccuracy_m = 1e-9;
    static constexpr double kMostHorizon_m = 1.0;

    /** What comes nearest. */
    struct Contact {
        double distance = 0.0;  ///< between the surfaces [m]; negative: that deep inside
        int link = -1;          ///< index into ArmGeometry::links; -1: nothing is near
        int obstacle = -1;      ///< solids, then spheres, then the map, as in Surroundings; -1: otherLink
        int otherLink = -1;
    };
    /** The nearest contact at pose q at time t of the run, moving spheres where they are then. Exact up to `horizon`
    [m], at most kMostHorizon_m; beyond it the distance is the horizon and the link -1. A q that is NaN:
    -infinity, link -1. */
    Contact findContact(const JointVector& q, double t, double horizon) const;

private:
    struct Scene;
    std::unique_ptr<Scene> scene_;
};

}  // namespace viable
