#pragma once

#include <Eigen/Core>
#include <vector>

namespace viable {

/** A place on a path that is known: straight and at constant speed to the next. */
struct Waypoint {
    double time_s = 0.0;                                 ///< rising
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< base frame [m]
};

/** The place on a path at time t [s] of the run. Before the first waypoint it is at rest there. After the last it is
at rest or, where the path repeats, on its way again. @param path  at least one */
Eigen::Vector3d calcPlaceOnPath(const std::vector<Waypoint>& path, bool repeats, double t);

}  // namespace viable
