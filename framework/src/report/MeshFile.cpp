#include "report/MeshFile.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>

namespace viable::detail {

Mesh readMesh(const std::string& file, const Eigen::Vector3d& scale) {
    Assimp::Importer importer;
    // PreTransformVertices: all nodes in the file's own frame.
    const aiScene* scene =
        importer.ReadFile(file, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices |
                                    aiProcess_PreTransformVertices | aiProcess_SortByPType);
    Mesh mesh;
    if (!scene) return mesh;
    for (unsigned m = 0; m < scene->mNumMeshes; ++m) {
        const aiMesh& part = *scene->mMeshes[m];
        if (!(part.mPrimitiveTypes & aiPrimitiveType_TRIANGLE)) continue;
        const auto first = static_cast<std::uint32_t>(mesh.positions.size() / 3);
        for (unsigned v = 0; v < part.mNumVertices; ++v)
            for (int k = 0; k < 3; ++k)
                mesh.positions.push_back(static_cast<float>(part.mVertices[v][k] * scale[k]));
        for (unsigned f = 0; f < part.mNumFaces; ++f)
            for (unsigned k = 0; k < part.mFaces[f].mNumIndices; ++k)
                mesh.indices.push_back(first + part.mFaces[f].mIndices[k]);
    }
    return mesh;
}

}  // namespace viable::detail
