#include <octomap/OcTree.h>

#include "CaseSupport.h"
#include "ReportSupport.h"
#include "environment/OccupancyMap.h"
#include "report/RunReport.h"
#include "robot/ArmReach.h"

namespace viable::test {
namespace {

using nlohmann::json;

/** A log of ten rows of an Indy7 among these surroundings; row k has a clearance of k mm, but of row 3 nobody knows it
and in row 4 nothing is near. */
void writeLog(const std::filesystem::path& file, const std::string& environment, const std::string& mapSha256 = "",
              bool looks = true) {
    LogOpening opening;
    for (int i = 0; i < 6; ++i) opening.layout.jointNames.push_back("joint" + std::to_string(i));
    opening.layout.limits.set(LimitKind::Clearance, !environment.empty());
    opening.metadata = {{"robot", VIABLE_SOURCE_DIR "/robots/indy7"},
                        {"links", R"(["foot", "shoulder", "elbow"])"},
                        {"obstacles", R"(["table", "rod"])"}};
    if (!mapSha256.empty()) opening.metadata["map_sha256"] = mapSha256;
    opening.attachments.push_back(
        {"experiment.yaml", "application/yaml", "schema: 1\n" + environment + "cases:\n  A: {}\n"});
    LogWriter log(file, opening);
    TickRecord row;
    row.nominal.q = row.nominal.qd = JointVector::Zero(6);
    for (int k = 0; k < 10; ++k) {
        row.time_s = 1e-3 * k;
        for (int i = 0; i < 6; ++i) row.stops[static_cast<std::size_t>(i)] = {0.1, 0.01 * (k + i), 0.5 * i + k};
        LimitReport& nearest = row.reports[LimitKind::Clearance];
        nearest = {};
        nearest.isKnown = looks && k != 3;
        if (k != 4) nearest.margin = 1e-3 * k;
        if (k != 4) nearest.link = 2;
        nearest.other = 1;
        nearest.onArm = {0.1 * k, 1.0, 2.0};
        nearest.onOther = {0.1 * k, 1.5, 2.0};
        log.append(row);
    }
    log.finish();
}

ReadReport reportOf(const TemporaryFolder& folder) {
    return ReadReport(writeReport(folder.path(), folder.write("page.html", kPage)).at(0));
}

json reportWithMap(const TemporaryFolder& folder, const std::string& map, const std::string& sha256 = "") {
    const std::string ball = "{ball: {sphere: 0.1, at: {xyz: [1, 0, 0]}}}";
    writeLog(folder / "A.mcap", "environment: {obstacles: " + ball + ", map: " + map + "}\n", sha256);
    return reportOf(folder).data["environments"].at(0);
}

TEST(SurroundingsReport, EveryObstacleIsDescribedWhereItStands) {
    const TemporaryFolder folder;
    writeLog(folder / "A.mcap", R"(environment:
  safety_distance_m: 0.03
  obstacles:
    table: {box: [0.5, 0.6, 0.04], at: {xyz: [0.4, 0, 0.1], rpy: [0, 0, pi/2]}}
    rod: {cylinder: {radius: 0.05, length: 0.9}, at: {xyz: [0, 1, 0]}}
    lamp: {sphere: 0.1, at: {xyz: [0, 0, 2]}}
    floor: {half_space: {normal: [0, 0, 1], offset: -0.01}}
    hand: {sphere: 0.2, repeats: true,
           path: [{time_s: 0, xyz: [1, 0, 0]}, {time_s: 2, xyz: [1, 1, 0]}, {time_s: 3, xyz: [1, 0, 0]}]}
)");
    const json data = reportOf(folder).data;
    ASSERT_EQ(data["environments"].size(), 1u);
    const json& environment = data["environments"][0];
    EXPECT_EQ(environment["safety_distance_m"], 0.03);
    EXPECT_EQ(environment["note"], "");
    std::map<std::string, json> byName;
    for (const json& one : environment["obstacles"]) byName[one["name"]] = one;
    ASSERT_EQ(byName.size(), 5u);
    EXPECT_EQ(byName["table"]["type"], "box");
    EXPECT_EQ(byName["table"]["size"], json({0.5, 0.6, 0.04}));
    EXPECT_EQ(byName["table"]["pose"]["xyz"], json({0.4, 0.0, 0.1}));
    EXPECT_NEAR(byName["table"]["pose"]["quat"][0], std::sqrt(0.5), 1e-12);
    EXPECT_NEAR(byName["table"]["pose"]["quat"][3], std::sqrt(0.5), 1e-12);
    EXPECT_EQ(byName["rod"]["type"], "cylinder");
    EXPECT_EQ(byName["rod"]["length"], 0.9);
    EXPECT_EQ(byName["lamp"]["radius"], 0.1);
    EXPECT_EQ(byName["floor"]["type"], "half_space");
    EXPECT_NEAR(byName["floor"]["pose"]["xyz"][2], -0.01, 1e-12);
    EXPECT_EQ(byName["hand"]["type"], "moving_sphere");
    EXPECT_EQ(byName["hand"]["waypoints"][1], json({2.0, 1.0, 1.0, 0.0}));
    EXPECT_EQ(byName["hand"]["repeats"], true);
    EXPECT_EQ(environment["obstacles"].back()["name"], "hand");  // moving spheres after solids, as in Surroundings
}

TEST(SurroundingsReport, ClearanceAndStopAreThoseOfTheLog) {
    const TemporaryFolder folder;
    writeLog(folder / "A.mcap", "environment: {}\n");
    const ReadReport report = reportOf(folder);
    const json& one = report.data["cases"][0];
    EXPECT_EQ(one["clearance"]["environment"], 0);
    EXPECT_EQ(one["clearance"]["links"], json({"foot", "shoulder", "elbow"}));
    EXPECT_EQ(one["clearance"]["obstacles"], json({"table", "rod"}));
    const std::vector<float> distance = report.numbers(one["clearance"]["distance"]),
                             rest = report.numbers(one["replay"]["rest"]),
                             nearest = report.numbers(one["replay"]["nearest"]);
    ASSERT_EQ(distance.size(), 10u);
    ASSERT_EQ(rest.size(), 60u);
    ASSERT_EQ(nearest.size(), 110u);
    for (std::size_t k = 0; k < 10; ++k) {
        const double expected = k == 3 ? kNan : k == 4 ? kInfinity : 1e-3 * static_cast<double>(k);
        const float* row = &nearest[11 * k];
        if (std::isfinite(expected)) {
            EXPECT_EQ(distance[k], static_cast<float>(expected));
            EXPECT_EQ(row[0], static_cast<float>(expected));
        } else {
            EXPECT_TRUE(std::isnan(distance[k]));  // a gap in the plot
            EXPECT_TRUE(std::isnan(expected) ? std::isnan(row[0]) : std::isinf(row[0]));
        }
        EXPECT_EQ(row[1], k == 4 ? -1.0f : 2.0f);
        EXPECT_EQ(row[2], 1.0f);
        EXPECT_EQ(row[3], -1.0f);
        EXPECT_EQ(row[4], static_cast<float>(0.1 * static_cast<double>(k)));
        EXPECT_EQ(row[8], 1.5f);
        EXPECT_EQ(row[10], static_cast<float>(0.01 * static_cast<double>(k + 5)));  // the longest
        for (std::size_t i = 0; i < 6; ++i)
            EXPECT_EQ(rest[6 * k + i], static_cast<float>(0.5 * static_cast<double>(i) + static_cast<double>(k)));
    }
}

TEST(SurroundingsReport, WithoutSurroundingsThePageHasNothingOfThem) {
    const TemporaryFolder folder;
    writeLog(folder / "A.mcap", "");
    const json data = reportOf(folder).data;
    EXPECT_FALSE(data.contains("environments"));
    EXPECT_FALSE(data["cases"][0].contains("clearance"));
    EXPECT_FALSE(data["cases"][0]["replay"].contains("rest"));
    EXPECT_FALSE(data["cases"][0]["replay"].contains("nearest"));
}

TEST(SurroundingsReport, EqualSurroundingsOfSeveralCasesAreThereOnce) {
    const TemporaryFolder folder;
    writeLog(folder / "A.mcap", "environment: {safety_distance_m: 0.1}\n");
    writeLog(folder / "B.mcap", "environment: {safety_distance_m: 0.2}\n");
    writeLog(folder / "C.mcap", "environment: {safety_distance_m: 0.1}\n", "", false);
    const json data = reportOf(folder).data;
    ASSERT_EQ(data["environments"].size(), 2u);
    for (const auto& [i, expected] : {std::pair{0, 0}, {1, 1}, {2, 0}})
        EXPECT_EQ(data["cases"][static_cast<std::size_t>(i)]["clearance"]["environment"], expected);
    EXPECT_TRUE(data["cases"][2]["clearance"]["distance"].is_null());  // no filter looked
}

TEST(SurroundingsReport, SurroundingsOfAnotherVersionAreLeftOut) {
    const TemporaryFolder folder;
    writeLog(folder / "A.mcap", "environment: {what_comes_later: 1}\n");
    const json data = reportOf(folder).data;
    EXPECT_FALSE(data.contains("environments"));
    EXPECT_TRUE(data["cases"][0]["clearance"]["environment"].is_null());
    EXPECT_FALSE(data["cases"][0]["clearance"]["distance"].is_null());
}

/** The ball around what the Indy7 reaches. */
struct Reach {
    Reach() {
        const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
        const Eigen::AlignedBox3d box = calcReach(robot, loadArmGeometry(robot), robot.limits);
        centre = box.center();
        radius = 0.5 * box.sizes().maxCoeff();
    }
    Eigen::Vector3d centre;
    double radius;
};

using Cells = std::set<std::array<int, 3>>;

/** The cubes of a report's map by their index. */
Cells readCells(const ReadReport& report, const json& map) {
    const std::vector<float> centres = report.numbers(map["centres"]);
    const double edge = map["edge_m"];
    Cells cells;
    for (std::size_t i = 0; i < centres.size(); i += 3) {
        std::array<int, 3> cell;
        for (std::size_t k = 0; k < 3; ++k) {
            const double index = centres[i + k] / edge - 0.5;
            EXPECT_NEAR(index, std::round(index), 1e-3);  // on the octree's grid
            cell[k] = static_cast<int>(std::lround(index));
        }
        EXPECT_TRUE(cells.insert(cell).second) << "a cube that is there twice";
    }
    return cells;
}

TEST(SurroundingsReport, OfAMapTheCellsAreDrawnThatCanBeSeenAndReached) {
    constexpr double kEdge = 0.05;
    const TemporaryFolder folder;
    octomap::OcTree tree(kEdge);
    std::mt19937 random(5);
    std::uniform_real_distribution<double> place(-3.0, 3.0);
    for (int i = 0; i < 20'000; ++i) tree.updateNode(place(random), place(random), place(random), i % 3 > 0);
    for (double x = 0.025; x < 0.8; x += kEdge)  // a block, which pruning makes one cell
        for (double y = 0.025; y < 0.8; y += kEdge)
            for (double z = 0.025; z < 0.8; z += kEdge) tree.updateNode(x, y, z, true);
    tree.prune();
    ASSERT_TRUE(tree.writeBinary((folder / "map.bt").string()));
    const Eigen::Vector3d shift(0.31, -0.2, 0.1);
    const std::string map = "{file: " + (folder / "map.bt").string() + ", at: {xyz: [0.31, -0.2, 0.1]}}";
    writeLog(folder / "A.mcap", "environment: {map: " + map + "}\n");
    const ReadReport report = reportOf(folder);
    const json& described = report.data["environments"][0]["obstacles"][0];
    EXPECT_EQ(described["edge_m"], kEdge);
    EXPECT_EQ(described["pose"]["xyz"], json({0.31, -0.2, 0.1}));

    const Reach reach;
    const auto isSolid = [&](int x, int y, int z) {
        const Eigen::Vector3d centre = kEdge * Eigen::Vector3d(x + 0.5, y + 0.5, z + 0.5);
        if ((centre + shift - reach.centre).norm() > reach.radius) return false;
        const octomap::OcTreeNode* node = tree.search(centre.x(), centre.y(), centre.z());
        return node && tree.isNodeOccupied(node);
    };
    Cells expected;
    int buried = 0;
    const int reachCells = static_cast<int>((reach.radius + reach.centre.norm() + shift.norm()) / kEdge) + 2;
    for (int x = -reachCells; x <= reachCells; ++x)
        for (int y = -reachCells; y <= reachCells; ++y)
            for (int z = -reachCells; z <= reachCells; ++z) {
                if (!isSolid(x, y, z)) continue;
                const bool isBuried = isSolid(x - 1, y, z) && isSolid(x + 1, y, z) && isSolid(x, y - 1, z) &&
                                      isSolid(x, y + 1, z) && isSolid(x, y, z - 1) && isSolid(x, y, z + 1);
                buried += isBuried;
                if (!isBuried) expected.insert({x, y, z});
            }
    EXPECT_GT(buried, 1000) << "nothing was hidden: nothing was tested";
    EXPECT_GT(expected.size(), 1000u);
    EXPECT_EQ(readCells(report, described), expected);
}

TEST(SurroundingsReport, OfAFineMapCoarserCubesAreDrawnAndNoCellIsLost) {
    constexpr double kEdge = 0.02;
    const TemporaryFolder folder;
    octomap::OcTree tree(kEdge);
    std::mt19937 random(6);
    std::vector<std::array<int, 3>> cells;
    for (int x = -24; x < 24; ++x)
        for (int y = -24; y < 24; ++y)
            for (int z = 0; z < 48; ++z) {
                if (random() % 2 == 0) continue;
                cells.push_back({x, y, z});
                tree.updateNode(kEdge * (x + 0.5), kEdge * (y + 0.5), kEdge * (z + 0.5), true, true);
            }
    tree.updateInnerOccupancy();
    ASSERT_GT(cells.size(), 50'000u);
    ASSERT_TRUE(tree.writeBinary((folder / "map.bt").string()));
    writeLog(folder / "A.mcap", "environment: {map: {file: " + (folder / "map.bt").string() + "}}\n");
    const ReadReport report = reportOf(folder);
    const json& map = report.data["environments"][0]["obstacles"][0];
    EXPECT_DOUBLE_EQ(map["edge_m"], 2 * kEdge);
    const Cells drawn = readCells(report, map);
    EXPECT_LE(drawn.size(), 40'000u);
    // What is on the outside of the block is drawn: one cube deep no cell is buried.
    for (const auto& [x, y, z] : cells) {
        if (x > -24 && x < 23 && y > -24 && y < 23 && z > 0 && z < 47) continue;
        const auto half = [](int i) { return (i - (i < 0)) / 2; };
        EXPECT_TRUE(drawn.count({half(x), half(y), half(z)})) << x << " " << y << " " << z;
    }
}

TEST(SurroundingsReport, AMapThatIsLostOrAnotherOneByNowIsNotDrawnAndThePageSaysSo) {
    const TemporaryFolder folder;
    const std::string file = (folder / "map.bt").string();
    const json lost = reportWithMap(folder, "{file: " + file + "}");
    expectContains(lost["note"].get<std::string>(), {"The map is not drawn: ", "there is no file " + file});
    ASSERT_EQ(lost["obstacles"].size(), 1u);
    EXPECT_EQ(lost["obstacles"][0]["name"], "ball");

    octomap::OcTree tree(0.1);
    tree.updateNode(0.5f, 0.5f, 0.5f, true);
    ASSERT_TRUE(tree.writeBinary(file));
    std::filesystem::remove(folder / "A.mcap");
    const json found = reportWithMap(folder, "{file: " + file + "}");
    EXPECT_EQ(found["note"], "Space that the map does not know counts as solid and is not drawn.");
    ASSERT_EQ(found["obstacles"].size(), 2u);
    EXPECT_EQ(found["obstacles"][1]["centres"]["n"], 3);

    std::filesystem::remove(folder / "A.mcap");
    EXPECT_EQ(reportWithMap(folder, "{file: " + file + ", unknown: free}")["note"], "");

    std::filesystem::remove(folder / "A.mcap");
    const json other = reportWithMap(folder, "{file: " + file + "}", std::string(64, 'a'));
    EXPECT_CONTAINS(other["note"].get<std::string>(), "The map is not drawn: ");
    EXPECT_EQ(other["obstacles"].size(), 1u);
}

}  // namespace
}  // namespace viable::test
