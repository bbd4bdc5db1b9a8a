#include "meshes/RobotShapes.h"

#include <algorithm>

#include "robot/CollisionFile.h"

namespace viable {

namespace fs = std::filesystem;

std::vector<LinkShapes> loadShapes(const RobotDescription& robot) {
    const fs::path folder = robot.folder;
    const detail::UrdfRobot urdf = detail::readUrdf(folder / (robot.name + ".urdf"), robot.hasDynamics());
    std::vector<LinkShapes> all;
    bool isAnyDrawn = false, isAnyLost = false;
    for (const auto& [name, link] : urdf.shapes) {
        LinkShapes& found = all.emplace_back(link);
        found.shapes.clear();
        for (LinkShape shape : link.shapes) {
            if (shape.kind == LinkShape::Kind::Mesh) {
                const fs::path file = detail::findMesh(shape.mesh, folder, detail::MeshReach::Package);
                if (!file.empty()) shape.triangles = detail::readMesh(file.string(), shape.size);
                if (shape.triangles.indices.empty()) {
                    found.lostMeshes.push_back({shape.mesh, !file.empty()});
                    continue;
                }
            }
            found.shapes.push_back(std::move(shape));
        }
        isAnyDrawn |= !found.shapes.empty();
        isAnyLost |= !found.lostMeshes.empty();
    }
    const fs::path file = folder / detail::kCollisionFile;
    std::error_code failed;
    if ((isAnyDrawn && !isAnyLost) || !fs::exists(file, failed)) return all;
    for (const LinkShapes& capsules : detail::readCollisionFile(file, urdf, detail::Blanks::LeaveOut).links) {
        const auto link =
            std::find_if(all.begin(), all.end(), [&](const LinkShapes& l) { return l.link == capsules.link; });
        if (link == all.end()) {
            if (!isAnyDrawn) all.push_back(capsules);
        } else if (!link->lostMeshes.empty()) {
            link->shapes.insert(link->shapes.end(), capsules.shapes.begin(), capsules.shapes.end());
        }
    }
    return all;
}

}  // namespace viable
