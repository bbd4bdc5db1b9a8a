#pragma once

namespace viable {

/** The rotation by |r| about r. [rad] */
Eigen::Quaterniond calcRotation(const Eigen::Vector3d& r);

/** The shortest rotation vector of the unit quaternion `q` (of either sign): |result| <= pi. [rad] */
Eigen::Vector3d calcRotationVector(const Eigen::Quaterniond& q);

/** The angular velocity [rad/s], in the axes that r is given in (not the rotated ones), of
calcRotation(r) when r changes at the rate `rRate`:

    w = r' + (1 - cos t) / t^2  r x r' + (t - sin t) / t^3  r x (r x r'),   t = |r|

(the left Jacobian of SO(3); e.g. Barfoot, State Estimation for Robotics, eq. 7.77). */
Eigen::Vector3d calcAngularVelocity(const Eigen::Vector3d& r, const Eigen::Vector3d& rRate);

// No function here allocates, locks or throws.

}  // namespace viable
