#include "meshes/MeshFile.h"

#include <assimp/config.h>
#include <assimp/importerdesc.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <climits>
#include <sstream>

#include "core/WholeFile.h"

namespace viable::detail {

namespace fs = std::filesystem;

namespace {

/** A format whose axes and units are agreed upon among programs that read URDF files. */
struct MeshFormat {
    const char* extension;  ///< one that assimp's reader of the format names
    bool isYUp;
};

constexpr MeshFormat kFormats[] = {
    {"stl", false}, {"obj", false}, {"ply", false}, {"dae", false}, {"gltf", true},
};

/** The format as which the file was read, null for any other. */
const MeshFormat* findFormat(const Assimp::Importer& importer) {
    const int index = importer.GetPropertyInteger("importerIndex", -1);
    const aiImporterDesc* reader = index < 0 ? nullptr : importer.GetImporterInfo(static_cast<std::size_t>(index));
    if (!reader) return nullptr;
    std::istringstream extensions(reader->mFileExtensions);
    for (std::string extension; extensions >> extension;)
        for (const MeshFormat& format : kFormats)
            if (extension == format.extension) return &format;
    return nullptr;
}

/** The link's frame from a file's: z is up in a link's. */
Eigen::Vector3d toLinkFrame(const aiVector3D& v, bool isYUp) {
    return isYUp ? Eigen::Vector3d(v.x, -v.z, v.y) : Eigen::Vector3d(v.x, v.y, v.z);
}

}  // namespace

Mesh readMesh(const std::string& file, const Eigen::Vector3d& scale) {
    std::error_code failed;
    if (fs::file_size(file, failed) > kMostMeshBytes) return {};
    Assimp::Importer importer;
    // The axes of a Collada file as they are; assimp would turn them. Its unit is applied to its root node.
    importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
    // PreTransformVertices: all nodes in the file's own frame.
    const aiScene* scene = importer.ReadFile(file, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices |
                                                       aiProcess_PreTransformVertices | aiProcess_SortByPType);
    const MeshFormat* format = findFormat(importer);
    Mesh mesh;
    if (!scene || !format) return mesh;
    for (unsigned m = 0; m < scene->mNumMeshes; ++m) {
        const aiMesh& part = *scene->mMeshes[m];
        if (!(part.mPrimitiveTypes & aiPrimitiveType_TRIANGLE)) continue;
        const auto first = static_cast<std::uint32_t>(mesh.positions.size() / 3);
        for (unsigned v = 0; v < part.mNumVertices; ++v) {
            const Eigen::Vector3d p = scale.cwiseProduct(toLinkFrame(part.mVertices[v], format->isYUp));
            for (int k = 0; k < 3; ++k) mesh.positions.push_back(static_cast<float>(p[k]));
        }
        for (unsigned f = 0; f < part.mNumFaces; ++f)
            for (unsigned k = 0; k < part.mFaces[f].mNumIndices; ++k)
                mesh.indices.push_back(first + part.mFaces[f].mIndices[k]);
    }
    return mesh;
}

const std::string kPackage = "package://";

/** A regular file inside of `folder`, empty for any other. */
static fs::path findInside(const fs::path& folder, const fs::path& path) {
    std::error_code failed;
    const fs::path file = folder / path.relative_path();
    const fs::path inside = fs::weakly_canonical(file, failed).lexically_relative(fs::weakly_canonical(folder, failed));
    return !inside.empty() && *inside.begin() != ".." && fs::is_regular_file(file, failed) ? file : fs::path();
}

static fs::path dropFirst(const fs::path& path) {
    fs::path rest;
    for (auto part = path.begin(); part != path.end(); ++part)
        if (part != path.begin()) rest /= *part;
    return rest;
}

/** The <name> in a folder's package.xml, empty where there is none. By search and not by an XML reader, which would follow
a hostile file to any depth. */
static std::string readPackageName(const fs::path& folder) {
    constexpr std::uintmax_t kMostBytes = 1u << 20;
    const fs::path file = folder / "package.xml";
    std::error_code failed;
    if (!fs::is_regular_file(file, failed) || fs::file_size(file, failed) > kMostBytes) return {};
    std::string text = readWhole(file).value_or("");
    for (std::size_t at; (at = text.find("<!--")) != std::string::npos;) {
        const std::size_t end = text.find("-->", at);
        text.erase(at, end == std::string::npos ? end : end + 3 - at);
    }
    const std::string opening = "<name>", blanks = " \t\r\n";
    const std::size_t begin = text.find(opening), end = text.find("</name>");
    if (begin == std::string::npos || end == std::string::npos || end < begin) return {};
    const std::string name = text.substr(begin + opening.size(), end - begin - opening.size());
    const std::size_t first = name.find_first_not_of(blanks);
    return first == std::string::npos ? "" : name.substr(first, name.find_last_not_of(blanks) + 1 - first);
}

/** `path` begins with the package's name. */
static fs::path findInPackage(const fs::path& path, const fs::path& folder, MeshReach reach) {
    if (path.empty()) return {};
    const fs::path package = *path.begin(), rest = dropFirst(path);
    std::error_code failed;
    fs::path file;
    for (fs::path at = fs::weakly_canonical(folder, failed); at.has_relative_path() && file.empty();
         at = at.parent_path())
        if (readPackageName(at) == package || (reach == MeshReach::Anywhere && at.filename() == package))
            file = findInside(at, rest);
    return file;
}

fs::path findMesh(const std::string& name, const fs::path& folder, MeshReach reach) {
    if (name.size() > PATH_MAX) return {};
    fs::path path = name;
    if (name.rfind(kPackage, 0) == 0) {
        path = name.substr(kPackage.size());
        if (fs::path file = findInPackage(path, folder, reach); !file.empty()) return file;
    } else if (const std::string scheme = "file://"; name.rfind(scheme, 0) == 0) {
        path = name.substr(scheme.size());
    }
    std::error_code failed;
    if (reach == MeshReach::Anywhere && path.string().find("://") == std::string::npos &&
        fs::is_regular_file(folder / path, failed))
        return folder / path;
    // The files of a robot are often put together in one folder.
    for (fs::path rest = path; !rest.empty(); rest = dropFirst(rest))
        if (fs::path file = findInside(folder, rest); !file.empty()) return file;
    return {};
}

}  // namespace viable::detail
