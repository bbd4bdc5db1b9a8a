#include "viable/robot/RobotShapes.h"

#include "robot/UrdfReader.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

Eigen::Vector3d toVector(const ConfigNode& node) {
    const std::vector<double> x = toNumbers(node, 3, 3);
    return {x[0], x[1], x[2]};
}

LinkShape readCapsule(const ConfigNode& node) {
    ConfigMap map(node);
    LinkShape shape;
    shape.kind = LinkShape::Kind::Capsule;
    shape.from = toVector(map.require("from"));
    shape.to = toVector(map.require("to"));
    NumberRange positive;
    positive.min = 0.0;
    positive.minIsOpen = true;
    shape.radius = toNumber(map.require("radius"), positive);
    map.finish();
    return shape;
}

std::vector<LinkShapes> readShapes(const fs::path& file, const detail::UrdfRobot& urdf) {
    const ConfigNode root = readConfigFile(file);
    std::vector<LinkShapes> all;
    std::vector<std::string> names;
    for (const auto& link : urdf.links) names.push_back(link.first);
    for (const auto& [name, node] : root.entries) {
        if (name == "schema") {
            toInteger(node, 1, 1);
            continue;
        }
        const auto place = urdf.links.find(name);
        if (place == urdf.links.end()) {
            const std::string closest = findClosestName(name, names);
            throw badInput(
                node.place(), "the robot has no link '" + name + "'",
                closest.empty() ? "Name a link of the URDF." : "Did you mean '" + closest + "'?");
        }
        if (node.kind != ConfigNode::Kind::List)
            throw badInput(node.place(), "the shapes of a link are a list",
                           "Write a list of {from, to, radius}.");
        LinkShapes link;
        link.link = name;
        link.carrier = place->second.carrier;
        link.placement = place->second.placement;
        for (const ConfigNode& item : node.items) link.shapes.push_back(readCapsule(item));
        all.push_back(std::move(link));
    }
    return all;
}

/** The mesh file that a URDF names, looked for in and below the robot's folder; empty when there is none. */
fs::path findMesh(const std::string& name, const fs::path& folder) {
    std::string path = name;
    for (const char* scheme : {"package://", "file://"})
        if (path.rfind(scheme, 0) == 0) path = path.substr(std::string(scheme).size());
    std::error_code failed;
    for (fs::path rest = path; !rest.empty();) {
        const fs::path file = folder / rest.relative_path();
        const fs::path inside = fs::weakly_canonical(file, failed)
                                    .lexically_relative(fs::weakly_canonical(folder, failed));
        if (!inside.empty() && *inside.begin() != ".." && fs::is_regular_file(file, failed))
            return file;
        // package://NAME/meshes/x.stl: the package's own name is no folder here
        fs::path shorter;
        for (auto part = ++rest.begin(); part != rest.end(); ++part) shorter /= *part;
        rest = shorter;
    }
    return {};
}

}  // namespace

std::vector<LinkShapes> loadShapes(const RobotDescription& robot) {
    const fs::path folder = robot.folder;
    const detail::UrdfRobot urdf =
        detail::readUrdf(folder / (folder.filename().string() + ".urdf"));
    const fs::path file = folder / "shapes.yaml";
    std::error_code failed;
    if (fs::exists(file, failed)) return readShapes(file, urdf);
    std::vector<LinkShapes> all;
    for (const auto& [name, link] : urdf.shapes) {
        LinkShapes found = link;
        found.shapes.clear();
        for (LinkShape shape : link.shapes) {
            if (shape.kind == LinkShape::Kind::Mesh) {
                shape.mesh = findMesh(shape.mesh, folder).string();
                if (shape.mesh.empty()) continue;
            }
            found.shapes.push_back(std::move(shape));
        }
        if (!found.shapes.empty()) all.push_back(std::move(found));
    }
    return all;
}

}  // namespace viable
