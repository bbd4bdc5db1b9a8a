#pragma once

#include "viable/robot/RobotDescription.h"

namespace viable {

/** A capsule around a part of a link: all points within `radius` of the segment from a to b. */
struct LinkCapsule {
    int link = 0;                                 ///< index into ArmGeometry::links
    int carrier = -1;                             ///< joint whose moving frame it is fixed to; -1: the base
    Eigen::Vector3d a = Eigen::Vector3d::Zero();  ///< in the carrier's frame [m]
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    double radius = 0.0;  ///< [m], > 0
};

/** The parts of an arm that can collide: capsules around its links, and which of them can collide with each other.
Obstacles are checked for links that a joint moves, not for those fixed to the base. */
struct ArmGeometry {
    std::vector<std::string> links;  ///< links with capsules
    std::vector<LinkCapsule> capsules;
    /** Indices into `capsules`, first < second: pairs on links that must not touch. Pairs of links that the file
    allows to touch, of one link, and of two links without a joint between them are left out. */
    std::vector<std::pair<int, int>> pairs;
};

/** Reads collision.yaml of a robot folder:

    schema: 1
    links:
      link1: [{from: [x, y, z], to: [x, y, z], radius: r}, ...]     in the link's frame [m]
    may_touch: [[link0, link1], ...]                                links that are next to each other

Links are those of the URDF, also on fixed joints; links that are left out cannot collide.
Throws Error (BadInput) for a missing file and for a placeholder of `viable new robot` in it (each with the remedy).
It throws also for an unknown link, a size that is NaN or not positive, and a duplicate pair. */
ArmGeometry loadArmGeometry(const RobotDescription& robot);

}  // namespace viable
