#include "robot/RobotShapes.h"

#include "robot/CollisionFile.h"
#include "robot/MeshFile.h"

namespace viable {

namespace fs = std::filesystem;

std::vector<LinkShapes> loadShapes(const RobotDescription& robot) {
    const fs::path folder = robot.folder;
    const detail::UrdfRobot urdf = detail::readUrdf(folder / (robot.name + ".urdf"));
    std::vector<LinkShapes> all;
    for (const auto& [name, link] : urdf.shapes) {
        LinkShapes found = link;
        found.shapes.clear();
        for (LinkShape shape : link.shapes) {
            if (shape.kind == LinkShape::Kind::Mesh) {
                shape.mesh = detail::findMesh(shape.mesh, folder).string();
                if (shape.mesh.empty()) continue;
            }
            found.shapes.push_back(std::move(shape));
        }
        if (!found.shapes.empty()) all.push_back(std::move(found));
    }
    const fs::path capsules = folder / detail::kCollisionFile;
    std::error_code failed;
    if (all.empty() && fs::exists(capsules, failed))
        all = detail::readCollisionFile(capsules, urdf, detail::Blanks::LeaveOut).links;
    return all;
}

}  // namespace viable
