#include "viable/environment/ArmClearances.h"

#include <gtest/gtest.h>

#include <random>

#include "Paths.h"
#include "SlidingArm.h"
#include "environment/ArmSurroundings.h"
#include "viable/core/Numbers.h"
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
    int compared = 0, kinks = 0;
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
            // All are asked for, so that they come in the same order.
            const auto before = clearances.find(q - h * way, surroundings.get(), 0.0, 100.0);
            const auto here = clearances.find(q, surroundings.get(), 0.0, 100.0);
            const auto after = clearances.find(q + h * way, surroundings.get(), 0.0, 100.0);
            ASSERT_EQ(before.size(), after.size());
            for (std::size_t i = 0; i < here.size(); ++i) {
                const double forwards = (after[i].distance - here[i].distance) / h;
                const double backwards = (here[i].distance - before[i].distance) / h;
                if (std::abs(forwards - backwards) > 1e-4) {
                    ++kinks;
                    continue;
                }
                ++compared;
                EXPECT_NEAR(here[i].gradient.dot(way), (forwards + backwards) / 2.0, 1e-4) << "pose " << k;
            }
        }
    }
    EXPECT_GT(compared, 20 * kinks);
    EXPECT_GT(compared, 2000);
}

TEST(ArmClearances, AsksForPairsAloneAndSurvivesPosesThatAreNoNumbers) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/panda");
    const ArmGeometry geometry = loadArmGeometry(robot);
    ArmClearances clearances(robot, geometry);
    EXPECT_EQ(clearances.find(robot.home, nullptr, 0.0, 100.0).size(), geometry.pairs.size());
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
