#include "robot/RobotShapes.h"

#include "RobotFolder.h"

namespace viable {
namespace {

/** A robot of one moving link whose visual element is `geometry`. */
struct ShapedArm {
    explicit ShapedArm(const std::string& geometry) {
        makeSimpleArm(folder);
        RobotFolder::replace(folder.urdf, "<link name='upper'>",
                             "<link name='upper'><visual><origin xyz='0.1 0.2 0.3' rpy='0 0 0'/><geometry>" + geometry +
                                 "</geometry><material name='red'><color rgba='1 0 0 0.5'/></material></visual>");
    }
    std::vector<LinkShapes> load() const { return loadShapes(folder.load()); }
    RobotFolder folder;
};

LinkShape getOnly(const std::vector<LinkShapes>& all) {
    if (all.size() != 1 || all[0].shapes.size() != 1) throw std::runtime_error("not one shape");
    EXPECT_EQ(all[0].link, "upper");
    EXPECT_EQ(all[0].carrier, 0);
    EXPECT_TRUE(all[0].hasColor);
    EXPECT_EQ(all[0].color[3], 0.5);
    EXPECT_TRUE(all[0].shapes[0].pose.translation().isApprox(Eigen::Vector3d(0.1, 0.2, 0.3)));
    return all[0].shapes[0];
}

TEST(RobotShapes, UrdfSolidsAreReadWithPlaceSizeAndColour) {
    const LinkShape box = getOnly(ShapedArm("<box size='1 2 3'/>").load());
    EXPECT_EQ(box.kind, LinkShape::Kind::Box);
    EXPECT_EQ(box.size, Eigen::Vector3d(1, 2, 3));
    const LinkShape cylinder = getOnly(ShapedArm("<cylinder radius='0.1' length='0.7'/>").load());
    EXPECT_EQ(cylinder.kind, LinkShape::Kind::Cylinder);
    EXPECT_EQ(cylinder.radius, 0.1);
    EXPECT_EQ(cylinder.length, 0.7);
    const LinkShape sphere = getOnly(ShapedArm("<sphere radius='0.2'/>").load());
    EXPECT_EQ(sphere.kind, LinkShape::Kind::Sphere);
    EXPECT_EQ(sphere.radius, 0.2);
}

TEST(RobotShapes, MeshesAreFoundInTheFolderOnly) {
    const ShapedArm arm("<mesh filename='package://arm_description/meshes/upper.stl' scale='2 2 2'/>");
    EXPECT_TRUE(arm.load().empty());  // no such file: nothing to draw, and no error
    std::filesystem::create_directory(arm.folder.path() / "meshes");
    arm.folder.put("meshes/upper.stl", "solid\nendsolid\n");
    const LinkShape mesh = getOnly(loadShapes(loadRobot(arm.folder.path())));
    EXPECT_EQ(mesh.kind, LinkShape::Kind::Mesh);
    EXPECT_EQ(mesh.mesh, arm.folder.path() / "meshes/upper.stl");
    EXPECT_EQ(mesh.size, Eigen::Vector3d(2, 2, 2));
    std::ofstream(arm.folder.temporary.path() / "outside.stl") << "solid\nendsolid\n";
    EXPECT_TRUE(ShapedArm("<mesh filename='../outside.stl'/>").load().empty());
    EXPECT_TRUE(ShapedArm("<mesh filename='/etc/hostname'/>").load().empty());
}

TEST(RobotShapes, CapsulesAreDrawnWhereTheUrdfHasNothing) {
    const std::string capsules =
        "schema: 1\nlinks:\n  upper: TODO\n  fore:\n"
        "    - {from: [0, 0, 0], to: [0.1, 0, 0], radius: 0.05}\n";
    const ShapedArm lost("<mesh filename='package://arm/nowhere.stl'/>");
    lost.folder.write();
    lost.folder.put("collision.yaml", capsules);  // with a blank of `viable new robot`
    const std::vector<LinkShapes> all = loadShapes(loadRobot(lost.folder.path()));
    ASSERT_EQ(all.size(), 1u);
    EXPECT_EQ(all[0].link, "fore");
    EXPECT_EQ(all[0].carrier, 1);
    EXPECT_EQ(all[0].shapes.at(0).kind, LinkShape::Kind::Capsule);
    EXPECT_EQ(all[0].shapes.at(0).radius, 0.05);
    lost.folder.put("collision.yaml", "schema: 1\nlinks: TODO\n");
    EXPECT_TRUE(loadShapes(loadRobot(lost.folder.path())).empty());
    lost.folder.put("collision.yaml", "schema: 1\nlinks: {uper: []}\n");
    EXPECT_THROW(loadShapes(loadRobot(lost.folder.path())), Error);

    const ShapedArm drawn("<box size='1 2 3'/>");
    drawn.folder.write();
    drawn.folder.put("collision.yaml", capsules);
    EXPECT_EQ(getOnly(loadShapes(loadRobot(drawn.folder.path()))).kind, LinkShape::Kind::Box);
}

}  // namespace
}  // namespace viable
