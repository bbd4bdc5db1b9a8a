#pragma once

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

namespace viable::detail {

inline nlohmann::json toJson(const Eigen::Vector3d& v) {
    return {v.x(), v.y(), v.z()};
}

/** As the page wants poses: {"xyz" [m], "quat": [w, x, y, z]}. */
inline nlohmann::json toJson(const Eigen::Isometry3d& pose) {
    const Eigen::Quaterniond q(pose.linear());
    return {{"xyz", toJson(Eigen::Vector3d(pose.translation()))}, {"quat", {q.w(), q.x(), q.y(), q.z()}}};
}

}  // namespace viable::detail
