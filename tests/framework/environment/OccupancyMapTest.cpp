#include <chrono>
#include <cmath>

#include "EnvironmentSupport.h"

namespace viable::test {
namespace {

/** A map of both file kinds, and its bytes. */
struct MapFiles {
    MapFiles() : tree(makeRandomTree(0.05, 400, 0.6, 11)) {
        binary = writeBinary(tree);
        full = writeFull(tree);
    }
    const std::string& bytes(const std::string& extension) const { return extension == ".bt" ? binary : full; }
    std::string findFault(const std::string& extension, const std::string& content,
                          const std::string& sha256 = "") const {
        const std::filesystem::path file = folder / ("map" + extension);
        store(file, content);
        MapChoice choice = chooseMap(file);
        choice.sha256 = sha256;
        return findMapFault(choice);
    }
    octomap::OcTree tree;
    std::string binary, full;
    TemporaryFolder folder;
};

TEST(OccupancyMap, SaysOfEveryPlaceWhatOctoMapSays) {
    MapFiles files;
    for (const std::string extension : {".bt", ".ot"}) {
        ASSERT_EQ(files.findFault(extension, files.bytes(extension)), "");
        const OccupancyMap map(chooseMap(files.folder / ("map" + extension)));
        EXPECT_EQ(map.resolution(), 0.05);
        std::mt19937 random(5);
        std::uniform_real_distribution<double> place(-0.9, 0.9);
        int solid = 0, free = 0, unknown = 0;
        for (int i = 0; i < 20000; ++i) {
            const Eigen::Vector3d p(place(random), place(random), place(random));
            const octomap::OcTreeNode* node = files.tree.search(p.x(), p.y(), p.z());
            const auto occupancy = map.getOccupancy(p);
            ASSERT_EQ(occupancy, !node                             ? OccupancyMap::Occupancy::Unknown
                                 : files.tree.isNodeOccupied(node) ? OccupancyMap::Occupancy::Occupied
                                                                   : OccupancyMap::Occupancy::Free);
            ++(!node ? unknown : occupancy == OccupancyMap::Occupancy::Occupied ? solid : free);
        }
        EXPECT_GT(solid, 100);
        EXPECT_GT(free, 100);
        EXPECT_GT(unknown, 100);
    }
}

TEST(OccupancyMap, EmptyMapKnowsNothing) {
    MapFiles files;
    octomap::OcTree nothing(0.1);
    for (const std::string extension : {".bt", ".ot"}) {
        ASSERT_EQ(files.findFault(extension, extension == ".bt" ? writeBinary(nothing) : writeFull(nothing)), "");
        const OccupancyMap map(chooseMap(files.folder / ("map" + extension)));
        EXPECT_EQ(map.getOccupancy({0, 0, 0}), OccupancyMap::Occupancy::Unknown);
    }
}

TEST(OccupancyMap, Fault53_54_CutAnywhereIsRefused) {
    MapFiles files;
    for (const std::string extension : {".bt", ".ot"}) {
        const std::string& bytes = files.bytes(extension);
        const std::size_t step = std::max<std::size_t>(1, bytes.size() / 400);
        int refused = 0, tried = 0;
        for (std::size_t cut = 0; cut < bytes.size(); cut += cut < 200 ? 1 : step, ++tried)
            refused += !files.findFault(extension, bytes.substr(0, cut)).empty();
        EXPECT_EQ(refused, tried) << extension;
        EXPECT_GT(tried, 400);
        expectContains(files.findFault(extension, bytes.substr(0, bytes.size() - 1)), {"it is cut off"});
        EXPECT_CONTAINS(files.findFault(extension, bytes + "x"), "1 bytes more");
    }
}

TEST(OccupancyMap, Fault55_FlippedBytesAreRefusedByTheHash) {
    MapFiles files;
    for (const std::string extension : {".bt", ".ot"}) {
        const std::string& bytes = files.bytes(extension);
        ASSERT_EQ(files.findFault(extension, bytes), "");
        const std::string sha256 = OccupancyMap(chooseMap(files.folder / ("map" + extension))).sha256();
        ASSERT_EQ(files.findFault(extension, bytes, sha256), "");
        std::mt19937 random(9);
        int withHash = 0, without = 0;
        for (int trial = 0; trial < 200; ++trial) {
            std::string changed = bytes;
            const int flips = 1 + static_cast<int>(random() % 16);
            for (int i = 0; i < flips; ++i) {
                char& byte = changed[random() % changed.size()];
                byte = static_cast<char>(byte ^ static_cast<char>(1 + random() % 255));
            }
            without += !files.findFault(extension, changed).empty();
            const std::string fault = files.findFault(extension, changed, sha256);
            withHash +=
                fault.find("experiment.yaml:7:3") != std::string::npos && fault.find(sha256) != std::string::npos;
        }
        EXPECT_EQ(withHash, 200) << extension;
        RecordProperty("refused_without_hash" + extension, without);
    }
}

TEST(OccupancyMap, Fault56_RecursionBombIsRefusedAtOnce) {
    MapFiles files;
    std::string bomb;
    for (int i = 0; i < 100000; ++i) bomb += std::string("\x03\x00", 2);
    const auto begin = std::chrono::steady_clock::now();
    const std::string fault =
        files.findFault(".bt", "# Octomap OcTree binary file\nid OcTree\nsize 100001\nres 0.1\ndata\n" + bomb);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    EXPECT_CONTAINS(fault, "deeper than 16 levels");
    EXPECT_LT(took.count(), 1.0);
    std::string deep;
    for (int i = 0; i < 40000; ++i) deep += std::string("\0\0\0\0\x01", 5);
    expectContains(files.findFault(".ot", "# Octomap OcTree file\nid OcTree\nsize 40001\nres 0.1\ndata\n" + deep),
                   {"deeper than 16 levels"});
}

TEST(OccupancyMap, Fault57_ResolutionAndHeaderAreChecked) {
    MapFiles files;
    const std::string body = files.binary.substr(files.binary.find("\ndata\n") + 6);
    const std::string size = std::to_string(files.tree.size());
    const auto make = [&](const std::string& lines) {
        return "# Octomap OcTree binary file\n" + lines + "data\n" + body;
    };
    const std::string good = "id OcTree\nsize " + size + "\nres 0.05\n";
    ASSERT_EQ(files.findFault(".bt", make(good)), "");
    ASSERT_EQ(files.findFault(".bt", make("# a comment\n" + good)), "");
    for (const std::string res : {"nan", "0", "-0.1", "1e-300", "inf", "1e300", "0.05x", "", "11", "0.0009"})
        expectContains(files.findFault(".bt", make("id OcTree\nsize " + size + "\nres " + res + "\n")),
                       {"the map's resolution is `" + res + "` m, allowed: 0.001 to 10"});
    const std::vector<std::pair<std::string, std::string>> wrong = {
        {"id ColorOcTree\nsize " + size + "\nres 0.05\n", "a map of the kind `ColorOcTree`"},
        {"id OcTree\nsize -1\nres 0.05\n", "number of nodes is `-1`"},
        {"id OcTree\nsize 99999999999\nres 0.05\n", "number of nodes is `99999999999`"},
        {"id OcTree\nsize 3\nres 0.05\n", "more nodes than the 3 of its header"},
        {"id OcTree\nsize 90000\nres 0.05\n", "its header says 90000 nodes, it has " + size},
        {good + "res 0.06\n", "a header line that no map has there: `res 0.06`"},
        {good + "colour red\n", "a header line that no map has there: `colour red`"},
        {"id OcTree\nres 0.05\n", "lacks one of id, size and res"}};
    for (const auto& [lines, part] : wrong) EXPECT_CONTAINS(files.findFault(".bt", make(lines)), part);
    EXPECT_CONTAINS(files.findFault(".bt", "solid mesh\n"), "is not an OctoMap file");
    EXPECT_CONTAINS(files.findFault(".ot", files.binary), "different kinds");
    EXPECT_CONTAINS(findMapFault(chooseMap(files.folder / "none.bt")), "cannot be read");
    EXPECT_CONTAINS(findMapFault(chooseMap("/dev/zero")), "cannot be read");
}

TEST(OccupancyMap, LogOddsThatAreNoNumberAreRefused) {
    MapFiles files;
    std::string bytes = files.full;
    const float nan = std::numeric_limits<float>::quiet_NaN();
    bytes.replace(bytes.find("\ndata\n") + 6, sizeof nan, std::string(reinterpret_cast<const char*>(&nan), sizeof nan));
    EXPECT_CONTAINS(files.findFault(".ot", bytes), "log odds");
}

TEST(OccupancyMap, Fault58_UnknownSpaceCountsWhereAskedFor) {
    MapFiles files;
    store(files.folder / "map.bt", files.binary);
    const OccupancyMap map(chooseMap(files.folder / "map.bt"));
    const Eigen::Vector3d lower(-0.72, -0.51, -0.33), upper(0.47, 0.71, 0.68);
    for (const bool withUnknown : {false, true}) {
        std::vector<OccupancyMap::Cell> cells;
        map.forEachSolidCell(lower, upper, withUnknown, [&](const OccupancyMap::Cell& cell) { cells.push_back(cell); });
        std::mt19937 random(3);
        std::uniform_real_distribution<double> place(0.0, 1.0);
        for (int i = 0; i < 3000; ++i) {
            const Eigen::Vector3d p =
                lower + (upper - lower).cwiseProduct(Eigen::Vector3d(place(random), place(random), place(random)));
            int within = 0;
            for (const OccupancyMap::Cell& cell : cells)
                within += ((p - cell.centre).cwiseAbs().array() <= 0.5 * cell.edge).all();
            const auto occupancy = map.getOccupancy(p);
            const bool solid = occupancy == OccupancyMap::Occupancy::Occupied ||
                               (withUnknown && occupancy == OccupancyMap::Occupancy::Unknown);
            ASSERT_EQ(within, solid ? 1 : 0) << p.transpose();  // and no place twice
        }
    }
}

TEST(OccupancyMap, Fault58_SpaceBeyondTheTreeIsUnknown) {
    MapFiles files;
    store(files.folder / "map.bt", files.binary);
    const OccupancyMap map(chooseMap(files.folder / "map.bt"));
    const double edge = 65536 * 0.05;
    for (const Eigen::Vector3d& middle : {Eigen::Vector3d(0.5 * edge, 0.0, 0.0), Eigen::Vector3d(1e6, 1e6, -1e6)}) {
        double volume = 0.0;
        const Eigen::Vector3d lower = middle.array() - 1.0, upper = middle.array() + 1.0;
        map.forEachSolidCell(lower, upper, true, [&](const OccupancyMap::Cell& cell) {
            const Eigen::Vector3d overlap = upper.cwiseMin(Eigen::Vector3d(cell.centre.array() + 0.5 * cell.edge)) -
                                            lower.cwiseMax(Eigen::Vector3d(cell.centre.array() - 0.5 * cell.edge));
            volume += overlap.cwiseMax(0.0).prod();
        });
        EXPECT_NEAR(volume, 8.0, 1e-6);
    }
}

TEST(OccupancyMap, Fault59_NoNumberAndFarPlacesAreUnknown) {
    MapFiles files;
    store(files.folder / "map.bt", files.binary);
    const OccupancyMap map(chooseMap(files.folder / "map.bt"));
    for (const double far : {std::nan(""), 1e300, -1e300, HUGE_VAL, 32768 * 0.05 + 0.001, -1638.401})
        for (int k = 0; k < 3; ++k) {
            Eigen::Vector3d p = Eigen::Vector3d::Zero();
            p[k] = far;
            EXPECT_EQ(map.getOccupancy(p), OccupancyMap::Occupancy::Unknown) << far;
        }
}

}  // namespace
}  // namespace viable::test
