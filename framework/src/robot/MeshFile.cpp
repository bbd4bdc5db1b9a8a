#include "robot/MeshFile.h"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>

namespace viable::detail {

namespace fs = std::filesystem;

Mesh readMesh(const std::string& file, const Eigen::Vector3d& scale) {
    Assimp::Importer importer;
    // As ROS reads meshes: a Collada file's own axes, whatever it calls up. Assimp would turn them.
    importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
    // PreTransformVertices: all nodes in the file's own frame.
    const aiScene* scene = importer.ReadFile(file, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices |
                                                       aiProcess_PreTransformVertices | aiProcess_SortByPType);
    Mesh mesh;
    if (!scene) return mesh;
    for (unsigned m = 0; m < scene->mNumMeshes; ++m) {
        const aiMesh& part = *scene->mMeshes[m];
        if (!(part.mPrimitiveTypes & aiPrimitiveType_TRIANGLE)) continue;
        const auto first = static_cast<std::uint32_t>(mesh.positions.size() / 3);
        for (unsigned v = 0; v < part.mNumVertices; ++v)
            for (int k = 0; k < 3; ++k) mesh.positions.push_back(static_cast<float>(part.mVertices[v][k] * scale[k]));
        for (unsigned f = 0; f < part.mNumFaces; ++f)
            for (unsigned k = 0; k < part.mFaces[f].mNumIndices; ++k)
                mesh.indices.push_back(first + part.mFaces[f].mIndices[k]);
    }
    return mesh;
}

fs::path findMesh(const std::string& name, const fs::path& folder) {
    std::string path = name;
    for (const char* scheme : {"package://", "file://"})
        if (path.rfind(scheme, 0) == 0) path = path.substr(std::string(scheme).size());
    std::error_code failed;
    for (fs::path rest = path; !rest.empty();) {
        const fs::path file = folder / rest.relative_path();
        const fs::path inside =
            fs::weakly_canonical(file, failed).lexically_relative(fs::weakly_canonical(folder, failed));
        if (!inside.empty() && *inside.begin() != ".." && fs::is_regular_file(file, failed)) return file;
        // package://NAME/meshes/x.stl: the package's own name is no folder here
        fs::path shorter;
        for (auto part = ++rest.begin(); part != rest.end(); ++part) shorter /= *part;
        rest = shorter;
    }
    return {};
}

}  // namespace viable::detail
