
#include "EnvironmentSupport.h"

namespace viable {
namespace {

Environment read(const std::string& text, const std::string& file = "experiment.yaml") {
    const ConfigNode root = parseConfig("environment:\n" + text, file);
    return readEnvironment(*root.find("environment"));
}

TEST(ReadEnvironment, EveryShapeWithItsPlace) {
    test::TemporaryFolder folder;
    folder.write("building.bt", "not looked into");
    const Environment environment = read(
        "  safety_distance_m: 0.03\n"
        "  field_cell_m: 0.01\n"
        "  obstacles:\n"
        "    table: {box: [1.2, 0.8, 0.04], at: {xyz: [0.5, 0, -0.1], rpy: [0, 0, pi/2]}}\n"
        "    ball: {sphere: 0.1, at: {xyz: [1, 2, 3]}}\n"
        "    post: {cylinder: {radius: 0.05, length: 1.0}, at: {xyz: [0, 0, 0], rpy: [pi/2, 0, 0]}}\n"
        "    floor: {half_space: {normal: [0, 0, 1], offset: -0.2}}\n"
        "    visitor: {sphere: 0.08, path: [{time_s: 1, xyz: [0, 0, 0]}, {time_s: 3, xyz: [1, 0, 0]}]}\n"
        "  map: {file: building.bt, at: {xyz: [1, 0, 0]}, unknown: free, sha256: \"" +
            std::string(64, 'a') + "\"}\n",
        folder / "experiment.yaml");
    EXPECT_EQ(environment.safetyDistance_m, 0.03);
    EXPECT_EQ(environment.fieldCell_m, 0.01);
    ASSERT_EQ(environment.solids.size(), 4u);
    const Solid& table = environment.solids[0];
    EXPECT_EQ(table.name, "table");
    EXPECT_EQ(table.size, Eigen::Vector3d(1.2, 0.8, 0.04));
    EXPECT_TRUE((table.pose * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(0.5, 1.0, -0.1)));
    EXPECT_EQ(environment.solids[1].kind, Solid::Kind::Sphere);
    EXPECT_EQ(environment.solids[1].radius, 0.1);
    const Solid& post = environment.solids[2];
    EXPECT_EQ(post.length, 1.0);
    EXPECT_TRUE((post.pose * Eigen::Vector3d(0, 0, 1)).isApprox(Eigen::Vector3d(0, -1, 0)));
    const Solid& floor = environment.solids[3];
    EXPECT_EQ(floor.kind, Solid::Kind::HalfSpace);
    // normal . x <= offset is z <= -0.2
    EXPECT_TRUE((floor.pose * Eigen::Vector3d(0, 0, 1)).isApprox(Eigen::Vector3d(0, 0, 0.8)));
    ASSERT_EQ(environment.spheres.size(), 1u);
    const MovingSphere& visitor = environment.spheres[0];
    EXPECT_EQ(visitor.radius, 0.08);
    EXPECT_EQ(visitor.calcCentre(0.0).x(), 0.0);
    EXPECT_DOUBLE_EQ(visitor.calcCentre(1.5).x(), 0.25);
    EXPECT_EQ(visitor.calcCentre(9.0).x(), 1.0);
    ASSERT_TRUE(environment.map);
    EXPECT_EQ(environment.map->file, folder / "building.bt");
    EXPECT_EQ(environment.map->unknown, UnknownSpace::Free);
    EXPECT_EQ(environment.map->pose.translation().x(), 1.0);
    EXPECT_CONTAINS(environment.map->place, "environment.map");
}

TEST(ReadEnvironment, NothingSaidIsUnknownOccupied) {
    test::TemporaryFolder folder;
    folder.write("m.ot", "");
    const Environment environment = read("  map: {file: m.ot}\n", folder / "e.yaml");
    EXPECT_EQ(environment.map->unknown, UnknownSpace::Occupied);
    EXPECT_TRUE(environment.map->sha256.empty());
    EXPECT_EQ(environment.safetyDistance_m, 0.02);
}

TEST(ReadEnvironment, RepeatedPathsBeginAnew) {
    const Environment environment = read(
        "  obstacles: {v: {sphere: 0.1, repeats: true, path: [{time_s: 1, xyz: [0, 0, 0]}, "
        "{time_s: 2, xyz: [1, 0, 0]}, {time_s: 3, xyz: [0, 0, 0]}]}}\n");
    const MovingSphere& sphere = environment.spheres.at(0);
    EXPECT_EQ(sphere.calcCentre(0.3).x(), 0.0);
    EXPECT_DOUBLE_EQ(sphere.calcCentre(1.5).x(), 0.5);
    EXPECT_DOUBLE_EQ(sphere.calcCentre(1.5 + 2.0 * 7).x(), 0.5);
    EXPECT_DOUBLE_EQ(sphere.calcCentre(4.0).x(), 1.0);
}

TEST(ReadEnvironment, FaultsAreNamedWithTheirPlace) {
    const std::vector<std::pair<std::string, std::string>> wrong = {
        {"  obstacles: {a: {bax: [1, 1, 1], at: {xyz: [0, 0, 0]}}}\n", "Did you mean"},
        {"  obstacles: {a: {at: {xyz: [0, 0, 0]}}}\n", "an obstacle without a shape"},
        {"  obstacles: {a: {box: [1, 1, 1], sphere: 1, at: {xyz: [0, 0, 0]}}}\n", "2 shapes"},
        {"  obstacles: {a: {box: [1, 1, 1]}}\n", "at"},
        {"  obstacles: {a: {box: [1, 0, 1], at: {xyz: [0, 0, 0]}}}\n", "box"},
        {"  obstacles: {a: {box: [1, 1], at: {xyz: [0, 0, 0]}}}\n", "box"},
        {"  obstacles: {a: {sphere: -1, at: {xyz: [0, 0, 0]}}}\n", "sphere"},
        {"  obstacles: {a: {sphere: .nan, at: {xyz: [0, 0, 0]}}}\n", "sphere"},
        {"  obstacles: {a: {sphere: 1, at: {xyz: [0, 0, 0]}, repeats: true}}\n", "repeats"},
        {"  obstacles: {a: {sphere: 1, at: {xyz: [0, 0, 0], rpy: [0, 0]}}}\n", "rpy"},
        {"  obstacles: {a: {cylinder: {radius: 1}, at: {xyz: [0, 0, 0]}}}\n", "length"},
        {"  obstacles: {a: {half_space: {normal: [0, 0, 0], offset: 0}}}\n", "has length 0, allowed is 1"},
        {"  obstacles: {a: {half_space: {normal: [0, 3, 4], offset: 0}}}\n", "has length 5, allowed is 1"},
        {"  obstacles: {a: {half_space: {normal: [0, 0, 1], offset: 0}, at: {xyz: [0, 0, 0]}}}\n", "at"},
        {"  obstacles: {a: {sphere: 1, path: []}}\n", "a path is a list"},
        {"  obstacles: {a: {sphere: 1, at: {xyz: [0, 0, 0]}, path: [{time_s: 0, xyz: [0, 0, 0]}]}}\n",
         "a sphere with a place (`at`) and a path"},
        {"  obstacles: {a: {box: [1, 1, 1], path: [{time_s: 0, xyz: [0, 0, 0]}]}}\n", "Only spheres move"},
        {"  obstacles: {a: {sphere: 1, path: [{time_s: 0, xyz: [0, 0, 0]}, {time_s: 0, xyz: [1, 0, 0]}]}}\n",
         "the time 0 s is not after the one before (0 s)"},
        {"  obstacles: {a: {sphere: 1, repeats: true, path: [{time_s: 0, xyz: [0, 0, 0]}, {time_s: 1, xyz: [1, 0, "
         "0]}]}}\n",
         "the sphere would jump"},
        {"  obstacles: {a: {sphere: 1, repeats: true, path: [{time_s: 0, xyz: [0, 0, 0]}]}}\n",
         "a path of one place cannot repeat"},
        {"  obstacles: {map: {sphere: 1, at: {xyz: [0, 0, 0]}}}\n", "'map' is the name of the map"},
        {"  obstacles: [1]\n", "obstacles are entries with a name each"},
        {"  obstacle: {}\n", "Did you mean"},
        {"  safety_distance_m: -0.1\n", "safety_distance_m"},
        {"  field_cell_m: 0\n", "field_cell_m"},
        {"  map: {file: building.stl}\n", "is not a map that can be read"},
        {"  map: {file: none.bt}\n", "there is no file"},
        {"  map: {unknown: free}\n", "file"}};
    for (const auto& [text, part] : wrong) test::expectError({part, "experiment.yaml:2:"}, [&] { read(text); });
}

TEST(ReadEnvironment, MapsAreToldByTheirHash) {
    test::TemporaryFolder folder;
    folder.write("m.bt", "");
    for (const char* sha256 : {"abc", "\"\"", "0"})
        EXPECT_THROW(read(std::string("  map: {file: m.bt, sha256: ") + sha256 + "}\n", folder / "e.yaml"), Error);
}

}  // namespace
}  // namespace viable
