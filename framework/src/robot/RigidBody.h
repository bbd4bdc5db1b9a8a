#pragma once

#include "viable/robot/RobotDescription.h"

namespace viable::detail {

/** -(p x)(p x): times mass, what a point mass at p adds to the inertia about the origin. [m^2] */
Eigen::Matrix3d calcPointInertia(const Eigen::Vector3d& p);

/** The same body seen from a frame in which its own frame has the pose `placement`. */
BodyInertia transformBody(const Eigen::Isometry3d& placement, const BodyInertia& body);

/** Two bodies fixed to each other; both in the same frame. */
BodyInertia mergeBodies(const BodyInertia& a, const BodyInertia& b);

/** A rotation that takes z to `axis`, a unit vector; exactly none for z itself. */
Eigen::Matrix3d makeAxisFrame(const Eigen::Vector3d& axis);

/** What is wrong with an inertia tensor about a centre of mass, with its numbers, or empty: no
principal moment may be negative (with `mustTurn`: nor zero), none above the sum of the other two.
*/
std::string findInertiaFault(const Eigen::Matrix3d& inertia, bool mustTurn);

}  // namespace viable::detail
