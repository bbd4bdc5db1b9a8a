#pragma once

#include "viable/environment/Environment.h"

namespace viable::test {

/** A solid sphere, base frame [m]. */
inline Solid makeBall(const Eigen::Vector3d& centre, double radius, const std::string& name = "ball") {
    Solid ball;
    ball.name = name;
    ball.kind = Solid::Kind::Sphere;
    ball.radius = radius;
    ball.pose.translation() = centre;
    return ball;
}

}  // namespace viable::test
