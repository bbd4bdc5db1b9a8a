#include "meshes/RobotShapes.h"

#include "RobotFolder.h"
#include "draft/RobotDraft.h"

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

const char* const kTriangle =
    "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    "endsolid t\n";

LinkShape getOnly(const std::vector<LinkShapes>& all) {
    if (all.size() != 1 || all[0].shapes.size() != 1) throw std::runtime_error("not one shape");
    EXPECT_EQ(all[0].link, "upper");
    EXPECT_EQ(all[0].carrier, 0);
    EXPECT_TRUE(all[0].hasColor);
    EXPECT_EQ(all[0].color[3], 0.5);
    EXPECT_TRUE(all[0].shapes[0].pose.translation().isApprox(Eigen::Vector3d(0.1, 0.2, 0.3)));
    return all[0].shapes[0];
}

/** Nothing is drawn, and one mesh of link `upper` is named. */
void expectLost(const std::vector<LinkShapes>& all, const std::string& mesh, bool isThere) {
    ASSERT_EQ(all.size(), 1u);
    EXPECT_EQ(all[0].link, "upper");
    EXPECT_TRUE(all[0].shapes.empty());
    ASSERT_EQ(all[0].lostMeshes.size(), 1u);
    EXPECT_EQ(all[0].lostMeshes[0].name, mesh);
    EXPECT_EQ(all[0].lostMeshes[0].isThere, isThere);
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
    const std::string name = "package://arm_description/meshes/upper.stl";
    const ShapedArm arm("<mesh filename='" + name + "' scale='2 2 2'/>");
    expectLost(arm.load(), name, false);
    std::filesystem::create_directory(arm.folder.path() / "meshes");
    arm.folder.put("meshes/upper.stl", "none\n");
    expectLost(loadShapes(loadRobot(arm.folder.path())), name, true);
    arm.folder.put("meshes/upper.stl", kTriangle);
    const LinkShape mesh = getOnly(loadShapes(loadRobot(arm.folder.path())));
    EXPECT_EQ(mesh.kind, LinkShape::Kind::Mesh);
    EXPECT_EQ(mesh.triangles.positions, (std::vector<float>{0, 0, 0, 2, 0, 0, 0, 2, 0}));
    EXPECT_EQ(mesh.triangles.indices, (std::vector<std::uint32_t>{0, 1, 2}));
    std::ofstream(arm.folder.temporary.path() / "outside.stl") << kTriangle;
    for (const std::string outside : {"../outside.stl", "/etc/hostname"})
        expectLost(ShapedArm("<mesh filename='" + outside + "'/>").load(), outside, false);
}

/** In a package `arm_description` in a folder of another name: a robot's folder, and a mesh beside it. */
struct PackagedArm {
    explicit PackagedArm(const std::string& mesh) {
        RobotFolder folder;
        makeSimpleArm(folder);
        RobotFolder::replace(
            folder.urdf, "<link name='upper'>",
            "<link name='upper'><visual><geometry><mesh filename='" + mesh + "'/></geometry></visual>");
        folder.write();
        std::filesystem::create_directories(package / "robots");
        std::filesystem::create_directories(package / "meshes");
        std::filesystem::copy(folder.path(), robot);
        put("package.xml",
            "<?xml version='1.0'?>\n<!-- <name>other</name> -->\n<package format='3'>\n  <name> arm_description\n  "
            "</name>\n  <author>A <name>x</name></author>\n</package>\n");
        put("meshes/upper.stl", kTriangle);
        std::ofstream(temporary.path() / "outside.stl") << kTriangle;
    }
    void put(const std::string& file, const std::string& text) const {
        std::ofstream(package / file, std::ios::binary) << text;
    }
    bool isFound() const {
        const std::vector<LinkShapes> all = loadShapes(loadRobot(robot));
        const bool isDrawn = all.at(0).lostMeshes.empty();
        const DraftLink drafted = readRobotDraft(robot / "arm.urdf").links.at(1);
        EXPECT_EQ(drafted.lostMeshes.empty(), isDrawn);
        return isDrawn;
    }
    TemporaryFolder temporary;
    std::filesystem::path package = temporary.path() / "checkout-main", robot = package / "robots/arm";
};

TEST(Fault79, APackageIsFoundByItsFile) {
    const PackagedArm arm("package://arm_description/meshes/upper.stl");
    EXPECT_TRUE(arm.isFound());
    // A package inside, of another name, does not hide it; one of the same name is nearer.
    arm.put("robots/package.xml", "<package><name>robots</name></package>");
    EXPECT_TRUE(arm.isFound());
    std::filesystem::create_directories(arm.package / "robots/meshes");
    arm.put("robots/package.xml", "<package><name>arm_description</name></package>");
    arm.put("robots/meshes/upper.stl", "none\n");
    EXPECT_FALSE(arm.isFound());
    std::filesystem::remove(arm.package / "robots/package.xml");
    for (const char* text : {"", "<package/>", "</name><name>arm_description", "<package><name>arm</name></package>",
                             "<!-- <name>arm_description</name>"}) {
        arm.put("package.xml", text);
        EXPECT_FALSE(arm.isFound()) << text;
    }
    arm.put("package.xml", "<package><name>arm_description</name>" + std::string(2u << 20, ' ') + "</package>");
    EXPECT_FALSE(arm.isFound());  // no such file is so large
    std::filesystem::remove(arm.package / "package.xml");
    EXPECT_FALSE(arm.isFound());
}

TEST(Fault79, AMeshOutsideOfItsPackageIsNotRead) {
    EXPECT_FALSE(PackagedArm("package://arm_description/../outside.stl").isFound());
    EXPECT_FALSE(PackagedArm("package://arm_description").isFound());
    EXPECT_FALSE(PackagedArm("package://").isFound());
}

TEST(RobotShapes, CapsulesAreDrawnWhereTheUrdfHasNothing) {
    const std::string capsules =
        "schema: 1\nlinks:\n  upper: TODO\n  fore:\n"
        "    - {from: [0, 0, 0], to: [0.1, 0, 0], radius: 0.05}\n";
    const ShapedArm lost("<mesh filename='package://arm/nowhere.stl'/>");
    lost.folder.write();
    lost.folder.put("collision.yaml", capsules);  // with a blank of `viable new robot`
    const std::vector<LinkShapes> all = loadShapes(loadRobot(lost.folder.path()));
    ASSERT_EQ(all.size(), 2u);
    EXPECT_EQ(all[0].lostMeshes.size(), 1u);
    EXPECT_TRUE(all[0].shapes.empty());  // a blank has no capsules
    EXPECT_EQ(all[1].link, "fore");
    EXPECT_EQ(all[1].carrier, 1);
    EXPECT_EQ(all[1].shapes.at(0).kind, LinkShape::Kind::Capsule);
    EXPECT_EQ(all[1].shapes.at(0).radius, 0.05);
    lost.folder.put("collision.yaml", "schema: 1\nlinks: TODO\n");
    expectLost(loadShapes(loadRobot(lost.folder.path())), "package://arm/nowhere.stl", false);
    lost.folder.put("collision.yaml", "schema: 1\nlinks: {uper: []}\n");
    EXPECT_THROW(loadShapes(loadRobot(lost.folder.path())), Error);

    const ShapedArm drawn("<box size='1 2 3'/>");
    drawn.folder.write();
    drawn.folder.put("collision.yaml", capsules);
    EXPECT_EQ(getOnly(loadShapes(loadRobot(drawn.folder.path()))).kind, LinkShape::Kind::Box);
}

TEST(Fault79, CapsulesStandInForALinksLostMesh) {
    const ShapedArm arm("<mesh filename='package://arm/nowhere.stl'/>");
    std::string urdf = arm.folder.urdf;
    RobotFolder::replace(urdf, "<link name='fore'>",
                         "<link name='fore'><visual><geometry><box size='1 2 3'/></geometry></visual>");
    arm.folder.write();
    arm.folder.put("arm.urdf", urdf);
    const auto load = [&] { return loadShapes(loadRobot(arm.folder.path())); };
    const auto find = [](const std::vector<LinkShapes>& all, const std::string& name) {
        for (const LinkShapes& link : all)
            if (link.link == name) return link;
        throw std::runtime_error("no link " + name);
    };
    ASSERT_EQ(load().size(), 2u);
    EXPECT_TRUE(find(load(), "upper").shapes.empty());
    arm.folder.put("collision.yaml",
                   "schema: 1\nlinks:\n  upper:\n    - {from: [0, 0, 0], to: [0.4, 0, 0], radius: 0.06}\n"
                   "  fore:\n    - {from: [0, 0, 0], to: [0.1, 0, 0], radius: 0.05}\n");
    const LinkShapes upper = find(load(), "upper"), fore = find(load(), "fore");
    ASSERT_EQ(upper.shapes.size(), 1u);
    EXPECT_EQ(upper.shapes[0].kind, LinkShape::Kind::Capsule);
    EXPECT_EQ(upper.shapes[0].radius, 0.06);
    EXPECT_EQ(upper.carrier, 0);
    EXPECT_EQ(upper.lostMeshes.at(0).name, "package://arm/nowhere.stl");
    ASSERT_EQ(fore.shapes.size(), 1u);  // it has lost nothing
    EXPECT_EQ(fore.shapes[0].kind, LinkShape::Kind::Box);
    EXPECT_TRUE(fore.lostMeshes.empty());
}

}  // namespace
}  // namespace viable
