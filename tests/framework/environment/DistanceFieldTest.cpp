#include "Paths.h"
#include "environment/DistanceField.h"

#include <chrono>
#include <cmath>

#include "EnvironmentSupport.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

/** A map in memory by way of a file. */
OccupancyMap makeMap(octomap::OcTree tree) {
    TemporaryFolder folder;
    store(folder / "map.bt", writeBinary(tree));
    return OccupancyMap(chooseMap(folder / "map.bt"));
}

std::vector<OccupancyMap::Cell> listCells(const OccupancyMap& map, bool withUnknown, const Eigen::Vector3d& middle,
                                          double reach) {
    std::vector<OccupancyMap::Cell> cells;
    map.forEachSolidCell(middle.array() - reach, middle.array() + reach, withUnknown,
                         [&](const OccupancyMap::Cell& cell) { cells.push_back(cell); });
    return cells;
}

double calcTrueDistance(const std::vector<OccupancyMap::Cell>& cells, const Eigen::Vector3d& p) {
    double least = kInfinity;
    for (const OccupancyMap::Cell& cell : cells)
        least = std::min(least, calcBoxDistance(p - cell.centre, Eigen::Vector3d::Constant(0.5 * cell.edge)));
    return least;
}

/** The field's guarantee [cells]. */
const double kMostShort = std::sqrt(3.0);

/** Most that the field is above and below the truth at random points, half of them close to corners and faces of
solid cells [m]. */
struct FieldError {
    double above = -kInfinity, below = 0.0, mean = 0.0;
};
FieldError measure(const DistanceField& field, const std::vector<OccupancyMap::Cell>& cells,
                   const Eigen::Isometry3d& pose, const Eigen::Vector3d& lower, const Eigen::Vector3d& upper,
                   double reach, int points, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    const auto draw = [&] { return Eigen::Vector3d(unit(random), unit(random), unit(random)); };
    FieldError error;
    int counted = 0;
    while (counted < points) {
        Eigen::Vector3d p = lower + (upper - lower).cwiseProduct(draw());
        if (counted % 2 == 1) {
            const OccupancyMap::Cell& cell = cells[random() % cells.size()];
            Eigen::Vector3d corner;
            for (int k = 0; k < 3; ++k) corner[k] = random() % 2 ? 0.5 : -0.5;
            p = pose *
                Eigen::Vector3d(cell.centre + cell.edge * corner + 0.05 * (draw() - Eigen::Vector3d::Constant(0.5)));
            if (((p - lower).array() < 0.0).any() || ((upper - p).array() < 0.0).any()) continue;
        }
        const double truth = calcTrueDistance(cells, pose.inverse() * p), found = field.calcDistance(p);
        ++counted;
        error.above = std::max(error.above, found - truth);
        error.below = std::max(error.below, std::min(truth, reach) - found);
        error.mean += (std::min(truth, reach) - found) / points;
    }
    return error;
}

TEST(DistanceField, NeverAboveTheTruthAndNotFarBelow) {
    const Eigen::Vector3d lower(-0.45, -0.5, -0.4), upper(0.5, 0.45, 0.43);
    for (const Eigen::Isometry3d& pose : {Eigen::Isometry3d::Identity(), makeOddPose()})
        for (const double cell : {0.01, 0.02, 0.05}) {
            const OccupancyMap map = makeMap(makeRandomTree(0.04, 60, 0.5, 21));
            const double reach = 0.3;
            const DistanceField field(map, UnknownSpace::Free, pose, lower, upper, cell, reach, "here");
            const auto cells = listCells(map, false, Eigen::Vector3d::Zero(), 2.0);
            const FieldError error = measure(field, cells, pose, lower, upper, reach, 20000, 4);
            EXPECT_LE(error.above, 1e-12) << cell;
            EXPECT_LE(error.below, kMostShort * cell) << cell;
            EXPECT_LE(error.mean, 0.25 * cell) << cell;
            std::printf("cell %.3f m: short by %.2f cells at most, %.2f on average\n", cell, error.below / cell,
                        error.mean / cell);
        }
}

TEST(DistanceField, OneCellIsSeenFromEverywhere) {
    // One solid corner that points at the query is where the bound has least to spare.
    octomap::OcTree tree(0.05);
    tree.updateNode(0.01, 0.01, 0.01, true);
    const OccupancyMap map = makeMap(tree);
    const Eigen::Vector3d lower(-0.4, -0.4, -0.4), upper(0.4, 0.4, 0.4);
    std::mt19937 random(2);
    std::uniform_real_distribution<double> shift(-0.05, 0.05);
    for (int trial = 0; trial < 20; ++trial) {
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        pose.translation() << shift(random), shift(random), shift(random);
        const DistanceField field(map, UnknownSpace::Free, pose, lower, upper, 0.05, 0.5, "here");
        const auto cells = listCells(map, false, Eigen::Vector3d::Zero(), 1.0);
        ASSERT_EQ(cells.size(), 1u);
        EXPECT_LE(measure(field, cells, pose, lower, upper, 0.5, 4000, static_cast<unsigned>(trial)).above, 1e-12);
    }
}

TEST(DistanceField, WhatIsSolidBeyondTheBoxCounts) {
    octomap::OcTree tree(0.05);
    tree.updateNode(0.375, 0.025, 0.025, true);  // [0.35, 0.4]
    const OccupancyMap map = makeMap(tree);
    const Eigen::Vector3d corner(0.1, 0.1, 0.1);
    const DistanceField field(map, UnknownSpace::Free, Eigen::Isometry3d::Identity(), -corner, corner, 0.01, 0.4,
                              "here");
    const double found = field.calcDistance({0.1, 0.025, 0.025});
    EXPECT_LE(found, 0.25);
    EXPECT_GE(found, 0.249);
    EXPECT_EQ(field.calcDistance({-0.1, 0.025, 0.025}), 0.4);  // 0.45: beyond the reach
}

TEST(DistanceField, Fault58_UnknownSpaceIsSolidUnlessSaidOtherwise) {
    octomap::OcTree tree(0.05);
    for (double x = -0.475; x < 0.5; x += 0.05)
        for (double y = -0.475; y < 0.5; y += 0.05)
            for (double z = -0.475; z < 0.5; z += 0.05)
                if (Eigen::Vector3d(x - 0.2, y, z).norm() > 0.12) tree.updateNode(x, y, z, false);
    tree.prune();
    const OccupancyMap map = makeMap(tree);
    const Eigen::Vector3d lower(-0.3, -0.3, -0.3), upper(0.3, 0.3, 0.3);
    const Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    const DistanceField asSolid(map, UnknownSpace::Occupied, pose, lower, upper, 0.02, 0.5, "here");
    const DistanceField asFree(map, UnknownSpace::Free, pose, lower, upper, 0.02, 0.5, "here");
    EXPECT_EQ(asSolid.calcDistance({0.2, 0.0, 0.0}), 0.0);
    EXPECT_EQ(asFree.calcDistance({0.2, 0.0, 0.0}), 0.5);
    const auto cells = listCells(map, true, Eigen::Vector3d::Zero(), 1.5);
    const FieldError error = measure(asSolid, cells, pose, lower, upper, 0.5, 4000, 8);
    EXPECT_LE(error.above, 1e-12);
    EXPECT_LE(error.below, kMostShort * 0.02);
}

TEST(DistanceField, Fault59_NoNumberAndFarPlacesAreNeverFree) {
    octomap::OcTree tree(0.1);
    const OccupancyMap map = makeMap(tree);
    const Eigen::Vector3d corner(0.5, 0.5, 0.5);
    const DistanceField field(map, UnknownSpace::Free, Eigen::Isometry3d::Identity(), -corner, corner, 0.05, 0.2,
                              "here");
    EXPECT_EQ(field.calcDistance(corner), 0.2);
    EXPECT_EQ(field.calcDistance(-corner), 0.2);
    const double infinity = kInfinity;
    for (const double far : {std::nan(""), 0.5001, -0.5001, 1e300, -1e300, infinity, -infinity})
        for (int k = 0; k < 3; ++k) {
            Eigen::Vector3d p = Eigen::Vector3d::Zero(), gradient(1, 2, 3);
            p[k] = far;
            EXPECT_EQ(field.calcDistance(p), -infinity);
            EXPECT_EQ(field.calcDistance(p, gradient), -infinity);
            EXPECT_EQ(gradient, Eigen::Vector3d::Zero());
        }
}

TEST(DistanceField, GradientIsTheDirectionOfTheDistance) {
    const OccupancyMap map = makeMap(makeRandomTree(0.04, 30, 0.5, 22));
    const Eigen::Vector3d lower(-0.4, -0.4, -0.4), upper(0.4, 0.4, 0.4);
    const DistanceField field(map, UnknownSpace::Free, makeOddPose(), lower, upper, 0.02, 0.5, "here");
    std::mt19937 random(6);
    std::uniform_real_distribution<double> place(-0.39, 0.39);
    int compared = 0;
    for (int i = 0; i < 5000; ++i) {
        const Eigen::Vector3d p(place(random), place(random), place(random));
        Eigen::Vector3d gradient;
        const double distance = field.calcDistance(p, gradient);
        ASSERT_EQ(distance, field.calcDistance(p));
        Eigen::Vector3d difference;
        constexpr double kStep = 1e-7;
        bool isSmooth = true;
        for (int k = 0; k < 3; ++k) {
            const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
            const double before = field.calcDistance(p - step), after = field.calcDistance(p + step);
            difference[k] = (after - before) / (2.0 * kStep);
            isSmooth &= std::abs(after - 2.0 * distance + before) < 1e-11;
        }
        if (distance <= 0.0 || !isSmooth || difference.norm() < 0.1) continue;
        ++compared;
        EXPECT_NEAR(gradient.norm(), 1.0, 1e-9);
        EXPECT_LE((gradient - difference.normalized()).norm(), 1e-4);
    }
    EXPECT_GT(compared, 3000);
}

TEST(DistanceField, IsContinuousAcrossTheGrid) {
    const OccupancyMap map = makeMap(makeRandomTree(0.04, 30, 0.5, 23));
    const Eigen::Vector3d corner(0.4, 0.4, 0.4);
    const DistanceField field(map, UnknownSpace::Free, makeOddPose(), -corner, corner, 0.02, 0.5, "here");
    std::mt19937 random(7);
    std::uniform_real_distribution<double> place(-0.39, 0.39);
    for (int i = 0; i < 300; ++i) {
        const Eigen::Vector3d from(place(random), place(random), place(random));
        const Eigen::Vector3d step = 1e-5 * Eigen::Vector3d(place(random), place(random), place(random)).normalized();
        double last = field.calcDistance(from);
        for (int k = 1; k < 1000; ++k) {
            const Eigen::Vector3d p = from + k * step;
            if ((p.array().abs() > 0.4).any()) break;
            const double now = field.calcDistance(p);
            // Near the surface a square root begins: steps of sqrt(slope of Q * step).
            ASSERT_LE(std::abs(now - last), 1e-3) << p.transpose();
            last = now;
        }
    }
}

TEST(DistanceField, TooManyCellsAreRefusedWithTheirPlace) {
    octomap::OcTree tree(0.1);
    const OccupancyMap map = makeMap(tree);
    const Eigen::Vector3d corner(5, 5, 5);
    const std::string place = "e.yaml:3:4: environment.map";
    const auto pose = Eigen::Isometry3d::Identity();
    expectError({place, "field_cell_m"},
                [&] { DistanceField(map, UnknownSpace::Free, pose, -corner, corner, 0.01, 0.5, place); });
}

TEST(DistanceField, AQueryAllocatesNothing) {
    using testing::AllocationCounter;
    if (!AllocationCounter::isAvailable()) GTEST_SKIP() << AllocationCounter::whyNot();
    const OccupancyMap map = makeMap(makeRandomTree(0.04, 30, 0.5, 22));
    const Eigen::Vector3d corner(0.4, 0.4, 0.4);
    const DistanceField field(map, UnknownSpace::Free, makeOddPose(), -corner, corner, 0.02, 0.5, "here");
    Eigen::Vector3d gradient;
    double sum = 0.0;
    AllocationCounter counter;
    for (int i = 0; i < 1000; ++i) sum += field.calcDistance({0.0007 * i - 0.35, 0.1, -0.2}, gradient);
    EXPECT_EQ(counter.count(), 0);
    EXPECT_TRUE(std::isfinite(sum));
}

TEST(DistanceField, RealBuilding) {
    const std::filesystem::path file = std::filesystem::path(VIABLE_SOURCE_DIR) / "../shared/data/geb079.bt";
    if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
    auto begin = std::chrono::steady_clock::now();
    const auto took = [&] {
        const auto now = std::chrono::steady_clock::now();
        const double seconds = std::chrono::duration<double>(now - begin).count();
        begin = now;
        return seconds;
    };
    const OccupancyMap map(chooseMap(file));
    const double loading = took();
    EXPECT_EQ(map.resolution(), 0.08);
    const auto all = listCells(map, false, Eigen::Vector3d::Zero(), 200.0);
    EXPECT_GT(all.size(), 10000u);
    // A free place beside something: the arm's base.
    std::mt19937 random(1);
    Eigen::Vector3d base;
    do {
        const OccupancyMap::Cell& cell = all[random() % all.size()];
        base = cell.centre + Eigen::Vector3d(0.5, 0.0, 0.2);
    } while (map.getOccupancy(base) != OccupancyMap::Occupancy::Free);
    Eigen::Isometry3d pose = makeOddPose();
    pose.translation() = -(pose.linear() * base);
    const Eigen::Vector3d corner(1.0, 1.0, 1.0);
    for (const UnknownSpace unknown : {UnknownSpace::Free, UnknownSpace::Occupied}) {
        took();
        const DistanceField field(map, unknown, pose, -corner, corner, 0.02, 0.5, "here");
        const double building = took();
        EXPECT_LT(building, 20.0);  // about half a second by itself
        const auto cells = listCells(map, unknown == UnknownSpace::Occupied, base, 2.5);
        const FieldError error = measure(field, cells, pose, -corner, corner, 0.5, 1500, 3);
        EXPECT_LE(error.above, 1e-12);
        EXPECT_LE(error.below, kMostShort * 0.02);
        std::printf("loaded in %.3f s; %lld nodes in %.3f s; short by %.2f cells at most\n", loading,
                    static_cast<long long>(field.nodes()), building, error.below / 0.02);
    }
}

}  // namespace
}  // namespace viable::test
