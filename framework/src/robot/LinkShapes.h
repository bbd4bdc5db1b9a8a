#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace viable {

namespace detail {

/** Triangles in one frame. */
struct Mesh {
    std::vector<float> positions;        ///< x, y, z of each vertex [m]
    std::vector<std::uint32_t> indices;  ///< three per triangle
};

}  // namespace detail

/** One solid of a link, for pictures. */
struct LinkShape {
    enum class Kind : unsigned char { Capsule, Sphere, Box, Cylinder, Mesh };
    Kind kind = Kind::Capsule;
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< in the link's frame; capsules: identity
    Eigen::Vector3d from = Eigen::Vector3d::Zero();          ///< Capsule: ends of its axis [m]
    Eigen::Vector3d to = Eigen::Vector3d::Zero();
    Eigen::Vector3d size = Eigen::Vector3d::Ones();  ///< Box: edges [m]; Mesh: scale
    double radius = 0.0;                             ///< [m]
    double length = 0.0;                             ///< Cylinder, along z [m]
    std::string mesh;                                ///< file, as the URDF names it
    detail::Mesh triangles;                          ///< Mesh: in `pose`, scaled; empty until `loadShapes` reads it
};

/** A mesh of a URDF that cannot be drawn. */
struct LostMesh {
    std::string name;      ///< as the URDF names it
    bool isThere = false;  ///< the file was found, but holds no mesh of a format that is read
};

/** What one link looks like. */
struct LinkShapes {
    std::string link;
    int carrier = -1;                                             ///< joint that moves the link, -1: none
    Eigen::Isometry3d placement = Eigen::Isometry3d::Identity();  ///< link frame in the joint's moving frame
    std::vector<LinkShape> shapes;
    std::vector<LostMesh> lostMeshes;  ///< from `loadShapes`; capsules stand in for them where the link has some
    std::array<double, 4> color{};     ///< red, green, blue, opacity, 0 to 1
    bool hasColor = false;
};

}  // namespace viable
