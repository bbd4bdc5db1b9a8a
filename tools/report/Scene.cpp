#include "report/Scene.h"

#include <algorithm>

#include "core/Text.h"
#include "meshes/RobotShapes.h"
#include "report/PoseJson.h"

namespace viable::detail {

using nlohmann::json;

static json describeShape(const LinkShape& shape, BinaryBlock& block) {
    switch (shape.kind) {
        case LinkShape::Kind::Capsule:
            return {
                {"type", "capsule"}, {"from", toJson(shape.from)}, {"to", toJson(shape.to)}, {"radius", shape.radius}};
        case LinkShape::Kind::Sphere:
            return {{"type", "sphere"}, {"radius", shape.radius}, {"pose", toJson(shape.pose)}};
        case LinkShape::Kind::Box:
            return {{"type", "box"}, {"size", toJson(shape.size)}, {"pose", toJson(shape.pose)}};
        case LinkShape::Kind::Cylinder:
            return {
                {"type", "cylinder"}, {"radius", shape.radius}, {"length", shape.length}, {"pose", toJson(shape.pose)}};
        case LinkShape::Kind::Mesh:
            return {{"type", "mesh"},
                    {"positions", block.add(shape.triangles.positions)},
                    {"indices", block.add(shape.triangles.indices)},
                    {"pose", toJson(shape.pose)}};
    }
    return nullptr;
}

static json makeLink(const std::string& name, int parent, int joint, const Eigen::Isometry3d& origin,
                     const Eigen::Vector3d& axis) {
    return {{"name", name},         {"parent", parent},        {"joint", joint},  {"origin", toJson(origin)},
            {"axis", toJson(axis)}, {"shapes", json::array()}, {"color", nullptr}};
}

/** Which meshes are not drawn, for the reader of the page; empty when all are. */
static std::string describeLostMeshes(const std::vector<LinkShapes>& links) {
    std::string text;
    for (const LinkShapes& link : links) {
        if (link.lostMeshes.empty()) continue;
        text += (text.empty() ? "" : "; ") + ("link `" + link.link + "`: ");
        for (std::size_t i = 0; i < link.lostMeshes.size(); ++i)
            text += (i ? ", " : "") + link.lostMeshes[i].name +
                    (link.lostMeshes[i].isThere ? " holds no mesh that can be read" : " was not found");
        const bool hasCapsules = std::any_of(link.shapes.begin(), link.shapes.end(), [](const LinkShape& shape) {
            return shape.kind == LinkShape::Kind::Capsule;
        });
        text += hasCapsules ? " (its capsules of collision.yaml are drawn)"
                            : " (it has no capsules in collision.yaml either)";
    }
    if (text.empty()) return text;
    return "Meshes are missing: " + text +
           ". Put each into the robot's folder under the path by which the URDF names it, or the end of that path, as "
           "STL, OBJ, PLY, DAE or glTF.";
}

json describeScene(const std::filesystem::path& robotFolder, BinaryBlock& block, json& joints) {
    RobotDescription robot;
    std::vector<LinkShapes> shapes;
    try {
        robot = loadRobot(robotFolder);
        shapes = loadShapes(robot);
    } catch (const Error&) {
        return nullptr;  // a report of old logs must not need the robot
    }
    if (robot.size() != static_cast<int>(joints.size())) return nullptr;  // another robot by now
    for (int i = 0; i < robot.size(); ++i)
        joints[i]["kind"] =
            enumName<JointType::Prismatic>(robot.joints[i].type, {"revolute", "continuous", "prismatic"}, "");
    const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
    json links = json::array();
    // The base, then the moving frame of joint i as link i + 1, then what has shapes.
    links.push_back(makeLink("base", -1, -1, Eigen::Isometry3d::Identity(), z));
    for (int i = 0; i < robot.size(); ++i) {
        const JointDescription& joint = robot.joints[i];
        links.push_back(makeLink(joint.childLink, joint.parent + 1, i, joint.placement, joint.axis));
    }
    const std::size_t tool = links.size();
    links.push_back(makeLink(robot.toolLink, robot.toolParent + 1, -1, robot.toolPlacement, z));
    for (const LinkShapes& link : shapes) {
        json described = makeLink(link.link, link.carrier + 1, -1, link.placement, z);
        for (const LinkShape& shape : link.shapes) described["shapes"].push_back(describeShape(shape, block));
        if (link.hasColor) described["color"] = link.color;
        links.push_back(std::move(described));
    }
    return {{"tool", tool}, {"links", links}, {"note", describeLostMeshes(shapes)}};
}

}  // namespace viable::detail
