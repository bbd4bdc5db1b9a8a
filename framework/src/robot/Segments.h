#pragma once

#include <Eigen/Core>
#include <algorithm>

namespace viable::detail {

/** Distance of point p from the segment from a to b. */
inline double calcPointDistance(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    const Eigen::Vector3d along = b - a;
    const double length2 = along.squaredNorm();
    const double t = length2 > 0.0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0.0;
    return (a + t * along - p).norm();
}

/** The nearest points of the segments from a to b and from c to d, `onFirst` and `onSecond` (Ericson, Real-Time Collision
Detection, 2005, 5.1.9). */
inline void findNearestPoints(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                              const Eigen::Vector3d& d, Eigen::Vector3d& onFirst, Eigen::Vector3d& onSecond) {
    const Eigen::Vector3d u = b - a, v = d - c, w = a - c;
    const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v);
    const double uw = u.dot(w), vw = v.dot(w);
    const double determinant = uu * vv - uv * uv;
    // Parallel ones are as near at any common place: begin at a.
    double s = determinant > 0.0 ? std::clamp((uv * vw - uw * vv) / determinant, 0.0, 1.0) : 0.0;
    double t = vv > 0.0 ? (uv * s + vw) / vv : 0.0;
    if (t < 0.0 || t > 1.0 || vv == 0.0) {
        t = std::clamp(t, 0.0, 1.0);
        s = uu > 0.0 ? std::clamp((uv * t - uw) / uu, 0.0, 1.0) : 0.0;
    }
    onFirst = a + s * u;
    onSecond = c + t * v;
}

/** Distance between the segments from a to b and from c to d. */
inline double calcSegmentDistance(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                                  const Eigen::Vector3d& d) {
    Eigen::Vector3d onFirst, onSecond;
    findNearestPoints(a, b, c, d, onFirst, onSecond);
    return (onFirst - onSecond).norm();
}

}  // namespace viable::detail
