#include "viable/robot/ArmGeometry.h"

#include <algorithm>

#include "robot/CollisionFile.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

bool mayTouch(const detail::CollisionFile& file, const std::string& a, const std::string& b) {
    return std::any_of(file.mayTouch.begin(), file.mayTouch.end(), [&](const auto& pair) {
        return (pair.first == a && pair.second == b) || (pair.first == b && pair.second == a);
    });
}

}  // namespace

ArmGeometry loadArmGeometry(const RobotDescription& robot) {
    const std::string urdfName = robot.name + ".urdf";
    const fs::path file = robot.folder / detail::kCollisionFile;
    std::error_code failed;
    if (!fs::exists(file, failed))
        throw badInput(
            robot.folder.string(),
            "the robot has no " + std::string(detail::kCollisionFile) +
                ": it is not known what of it can hit something",
            "`viable new robot NAME --urdf " + (robot.folder / urdfName).string() +
                "` drafts one from the shapes of the URDF; copy it from there, or write it as robots/README.md says.");
    const detail::CollisionFile read = detail::readCollisionFile(
        file, detail::readUrdf(robot.folder / urdfName, robot.hasDynamics()), detail::Blanks::Refuse);

    ArmGeometry geometry;
    for (const LinkShapes& link : read.links) {
        const int index = static_cast<int>(geometry.links.size());
        geometry.links.push_back(link.link);
        for (const LinkShape& shape : link.shapes)
            geometry.capsules.push_back(
                {index, link.carrier, link.placement * shape.from, link.placement * shape.to, shape.radius});
    }
    const int count = static_cast<int>(geometry.capsules.size());
    for (int i = 0; i < count; ++i) {
        for (int j = i + 1; j < count; ++j) {
            const LinkCapsule& a = geometry.capsules[i];
            const LinkCapsule& b = geometry.capsules[j];
            if (a.carrier == b.carrier) continue;  // no joint moves one against the other
            if (!mayTouch(read, geometry.links[a.link], geometry.links[b.link])) geometry.pairs.emplace_back(i, j);
        }
    }
    return geometry;
}

}  // namespace viable
