#pragma once

#include <Eigen/Core>
#include <filesystem>

#include "robot/LinkShapes.h"

namespace viable::detail {

/** Larger mesh files are not read: those of a link have some megabytes. */
inline constexpr std::uintmax_t kMostMeshBytes = 256u << 20;

/** Reads a mesh file into the link's frame; empty when it cannot be read or is of another format than these.
Axes and units are those of RViz and Drake: STL, OBJ and PLY as they are, in metres. Collada (.dae): its axes as they are,
whatever its up_axis says, its unit applied. glTF (.gltf, .glb): metres, y up by its specification, hence turned by +90
degrees about x. Nodes of a file are where the file puts them. `scale` comes last, along the link's axes. */
Mesh readMesh(const std::string& file, const Eigen::Vector3d& scale);

/** Where the meshes of a URDF may lie. */
enum class MeshReach : unsigned char {
    Package,   ///< in the URDF's folder, below it, or in the package around it
    Anywhere,  ///< also where a relative path leads, and in a folder that has the package's name
};

/** The mesh file that a URDF in `folder` (absolute) names; empty when there is none.
`package://NAME/path` is `path` in the nearest folder upwards whose package.xml has that <name>. Else, and for other names,
the file is looked for in the folder by the name's path or the end of it. */
std::filesystem::path findMesh(const std::string& name, const std::filesystem::path& folder, MeshReach reach);

}  // namespace viable::detail
