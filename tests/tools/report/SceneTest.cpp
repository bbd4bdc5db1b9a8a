#include "report/Scene.h"

#include "RobotFolder.h"

namespace viable {
namespace {

using nlohmann::json;

/** The scene of an arm of two links, each with a mesh. */
json describe(const RobotFolder& folder) {
    detail::BinaryBlock block;
    json joints = json::array({json::object(), json::object()});
    return detail::describeScene(folder.path(), block, joints);
}

std::vector<std::string> listShapes(const json& scene, const std::string& link) {
    std::vector<std::string> types;
    for (const json& one : scene["links"])
        if (one["name"] == link)
            for (const json& shape : one["shapes"]) types.push_back(shape["type"]);
    return types;
}

TEST(Fault79, ThePageNamesEachMissingMeshAndDrawsCapsules) {
    RobotFolder folder;
    makeSimpleArm(folder);
    for (const std::string link : {"upper", "fore"})
        RobotFolder::replace(folder.urdf, "<link name='" + link + "'>",
                             "<link name='" + link + "'><visual><geometry><mesh filename='package://arm/meshes/" +
                                 link + ".obj'/></geometry></visual>");
    folder.write();
    std::filesystem::create_directory(folder.path() / "meshes");
    folder.put("meshes/fore.obj", "no mesh\n");
    folder.put("collision.yaml",
               "schema: 1\nlinks:\n  upper:\n    - {from: [0, 0, 0], to: [0.4, 0, 0], radius: 0.06}\n");
    const json lost = describe(folder);
    const std::string note = lost["note"];
    for (const char* part :
         {"link `upper`: package://arm/meshes/upper.obj was not found (its capsules of collision.yaml are drawn)",
          "link `fore`: package://arm/meshes/fore.obj holds no mesh that can be read (it has no capsules in "
          "collision.yaml either)",
          "Put each into the robot's folder"})
        EXPECT_CONTAINS(note, part);
    EXPECT_EQ(listShapes(lost, "upper"), std::vector<std::string>{"capsule"});
    EXPECT_EQ(listShapes(lost, "fore"), std::vector<std::string>{});

    for (const char* link : {"upper", "fore"})
        folder.put(std::string("meshes/") + link + ".obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    const json drawn = describe(folder);
    EXPECT_EQ(drawn["note"], "");
    EXPECT_EQ(listShapes(drawn, "upper"), std::vector<std::string>{"mesh"});
    EXPECT_EQ(listShapes(drawn, "fore"), std::vector<std::string>{"mesh"});
}

}  // namespace
}  // namespace viable
