#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace viable::detail {

/** Triangles in one frame. */
struct Mesh {
    std::vector<float> positions;        ///< x, y, z of each vertex [m]
    std::vector<std::uint32_t> indices;  ///< three per triangle
};

/** Reads a mesh file of any usual format (STL, DAE, OBJ, ...) with assimp; empty when it cannot be read. */
Mesh readMesh(const std::string& file, const Eigen::Vector3d& scale);

/** The mesh file that a URDF names, looked for in and below the folder; empty when there is none. */
std::filesystem::path findMesh(const std::string& name, const std::filesystem::path& folder);

}  // namespace viable::detail
