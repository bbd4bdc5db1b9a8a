#include "Balls.h"
#include "environment/ArmClearances.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <tuple>

#include "SlidingArm.h"
#include "environment/ArmSurroundings.h"
#include "robot/ArmRecursion.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

/** A ball, a table and a post. */
Environment makeRoom() {
    Environment room;
    for (const Solid::Kind kind : {Solid::Kind::Sphere, Solid::Kind::Box, Solid::Kind::Cylinder}) {
        Solid solid;
        solid.name = "thing" + std::to_string(room.solids.size());
        solid.kind = kind;
        solid.radius = 0.1;
        solid.length = 1.0;
        solid.size << 0.6, 0.6, 0.1;
        solid.pose.translation() << 0.4, 0.3 * static_cast<double>(room.solids.size()) - 0.3, 0.4;
        room.solids.push_back(solid);
    }
    return room;
}

// The gradient against difference quotients of the distances, wherever the nearest place does not jump.
TEST(ArmClearances, GradientsAreThoseOfTheDistances) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    int compared = 0, kinks = 0, ends = 0;
    for (RobotDescription robot : {loadRobot(VIABLE_SOURCE_DIR "/robots/panda"), makeSlidingArm()}) {
        const ArmGeometry geometry = loadArmGeometry(robot);
        for (JointVector* side : {&robot.limits.position.lower, &robot.limits.position.upper})
            *side = side->cwiseMax(-3.0).cwiseMin(3.0);
        const auto surroundings = makeSurroundings(makeRoom(), robot, geometry, robot.limits);
        ArmClearances clearances(robot, geometry);
        for (int k = 0; k < 200; ++k) {
            const JointVector q =
                robot.home + JointVector::NullaryExpr(robot.size(), [&] { return 0.8 * share(random); });
            const double within_m = 0.2;
            const auto items = clearances.find(q, surroundings.get(), 0.0, within_m);
            for (const auto& item : items) EXPECT_LT(item.distance, within_m);
            const double h = 1e-6;
            const JointVector way = JointVector::NullaryExpr(robot.size(), [&] { return share(random); });
            const auto find = [&](const JointVector& at) {
                std::map<std::tuple<int, int, int>, std::vector<ArmClearances::Item>> places;
                for (const auto& item : clearances.find(at, surroundings.get(), 0.0, 100.0))
                    places[{item.capsule, item.otherCapsule, item.obstacle}].push_back(item);
                return places;
            };
            const auto before = find(q - h * way), here = find(q), after = find(q + h * way);
            ASSERT_EQ(before.size(), after.size());
            for (const auto& [who, places] : here) {
                const auto &earlier = before.at(who), &later = after.at(who);
                EXPECT_TRUE(places[0].isNearest);
                for (std::size_t i = 1; i < places.size(); ++i) {
                    EXPECT_FALSE(places[i].isNearest);
                    EXPECT_GE(places[i].distance, places[0].distance - 1e-12);
                }
                if (earlier.size() != places.size() || later.size() != places.size()) {  // the nearest came to an end
                    ++kinks;
                    continue;
                }
                for (std::size_t i = 0; i < places.size(); ++i) {
                    const double forwards = (later[i].distance - places[i].distance) / h;
                    const double backwards = (places[i].distance - earlier[i].distance) / h;
                    if (std::abs(forwards - backwards) > 1e-4) {
                        ++kinks;
                        continue;
                    }
                    ++compared;
                    ends += !places[i].isNearest;
                    EXPECT_NEAR(places[i].gradient.dot(way), (forwards + backwards) / 2.0, 1e-4) << "pose " << k;
                }
            }
        }
    }
    EXPECT_GT(compared, 20 * kinks);
    EXPECT_GT(compared, 2000);
    EXPECT_GT(ends, 2000);
}

/** A beam of 0.4 m that the first joint of `robot` carries. */
ArmGeometry makeBeam() {
    ArmGeometry geometry;
    geometry.links = {"beam"};
    geometry.capsules.push_back({0, 0, {-0.2, 0.0, 0.0}, {0.2, 0.0, 0.0}, 0.05});
    return geometry;
}

Solid makeBall(const Eigen::Vector3d& at, std::size_t number) {
    return test::makeBall(at, 0.02, "ball" + std::to_string(number));
}

// One capsule between obstacles has them all, each at the nearest place and where it may come to be.
TEST(ArmClearances, EachObstacleAndBothEndsOfACapsule) {
    const RobotDescription robot = makeSlidingArm();
    const ArmGeometry geometry = makeBeam();
    ArmRecursion::Frames frames;
    ArmRecursion(robot).calcFrames(robot.home, frames);
    const auto place = [&](double x, double y) -> Eigen::Vector3d {
        return frames.origin[0] + frames.rotation[0] * Eigen::Vector3d(x, y, 0.0);
    };
    Environment room;
    for (const auto& [x, y] : {std::pair(0.0, 0.2), std::pair(-0.3, 0.0), std::pair(0.1, -5.0)})
        room.solids.push_back(makeBall(place(x, y), room.solids.size()));
    const auto surroundings = makeSurroundings(room, robot, geometry, robot.limits);
    ArmClearances clearances(robot, geometry);
    std::vector<std::tuple<int, bool, double>> found;
    for (const auto& item : clearances.find(robot.home, surroundings.get(), 0.0, 0.5))
        found.emplace_back(item.obstacle, item.isNearest, item.distance);
    ASSERT_EQ(found.size(), 5u);
    const double farEnd = std::hypot(0.2, 0.2) - 0.07;
    const std::tuple<int, bool, double> expected[] = {
        {1, true, 0.03}, {1, false, 0.43}, {0, true, 0.13}, {0, false, farEnd}, {0, false, farEnd}};
    for (std::size_t i = 0; i < found.size(); ++i) {
        EXPECT_EQ(std::get<0>(found[i]), std::get<0>(expected[i])) << i;
        EXPECT_EQ(std::get<1>(found[i]), std::get<1>(expected[i])) << i;
        EXPECT_NEAR(std::get<2>(found[i]), std::get<2>(expected[i]), 0.004) << i;  // balls cover the capsule
    }
}

// More obstacles than a query leaves out: the nearest come first, and no memory is taken. A moving ball and its way count as one.
TEST(ArmClearances, OfManyObstaclesTheNearest) {
    const RobotDescription robot = makeSlidingArm();
    const ArmGeometry geometry = makeBeam();
    ArmRecursion::Frames frames;
    ArmRecursion(robot).calcFrames(robot.home, frames);
    const Eigen::Vector3d across = frames.rotation[0] * Eigen::Vector3d::UnitY();
    Environment room;
    for (int k = 0; k < 11; ++k)
        room.solids.push_back(makeBall(frames.origin[0] + (0.5 - 0.03 * k) * across, room.solids.size()));
    const Eigen::Vector3d passing = frames.origin[0] - 0.15 * across;
    room.spheres.push_back({"passing", 0.02, {{0.0, passing - across}, {1.0, passing}}, false});
    const auto surroundings = makeSurroundings(room, robot, geometry, robot.limits);
    ArmClearances clearances(robot, geometry);
    std::vector<int> found;
    double last = 0.0;
    for (const auto& item : clearances.find(robot.home, surroundings.get(), 0.5, 10.0)) {
        if (!item.isNearest) continue;
        EXPECT_GE(item.distance, last);
        last = item.distance;
        found.push_back(item.obstacle);
    }
    EXPECT_EQ(found, (std::vector{11, 10, 9, 8, 7, 6, 5, 4, 3}));
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const testing::AllocationCounter counter;
    for (int k = 0; k < 10; ++k) clearances.find(robot.home, surroundings.get(), 0.5, 10.0);
    EXPECT_EQ(counter.count(), 0);
}

TEST(ArmClearances, AsksForPairsAloneAndSurvivesPosesThatAreNoNumbers) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/panda");
    const ArmGeometry geometry = loadArmGeometry(robot);
    ArmClearances clearances(robot, geometry);
    std::size_t pairs = 0;
    for (const auto& item : clearances.find(robot.home, nullptr, 0.0, 100.0)) pairs += item.isNearest;
    EXPECT_EQ(pairs, geometry.pairs.size());
    JointVector q = robot.home;
    q[2] = kNan;
    EXPECT_TRUE(clearances.find(q, nullptr, 0.0, 100.0).empty());
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const testing::AllocationCounter counter;
    for (int k = 0; k < 10; ++k) clearances.find(robot.home, nullptr, 0.0, 100.0);
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace viable
