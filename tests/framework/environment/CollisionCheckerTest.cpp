#include "Paths.h"
#include "environment/CollisionChecker.h"

#include <chrono>
#include <cmath>

#include "EnvironmentSupport.h"
#include "viable/robot/RobotModel.h"

namespace viable::test {
namespace {

/** An arm of the project with a capsule from each joint to the next. */
struct Arm {
    explicit Arm(const std::string& name)
        : robot(loadRobot(std::filesystem::path(VIABLE_SOURCE_DIR) / "robots" / name)) {
        const auto add = [this](int carrier, const Eigen::Vector3d& to, double radius) {
            LinkCapsule capsule;
            capsule.link = static_cast<int>(geometry.links.size());
            capsule.carrier = carrier;
            capsule.b = to;
            capsule.radius = radius;
            geometry.links.push_back("link" + std::to_string(capsule.link));
            geometry.capsules.push_back(capsule);
        };
        add(-1, {0, 0, 0.1}, 0.1);
        for (int j = 0; j + 1 < robot.size(); ++j)
            add(j, robot.joints[static_cast<std::size_t>(j) + 1].placement.translation(), 0.06);
        add(robot.toolParent, robot.toolPlacement.translation(), 0.04);
        const int count = static_cast<int>(geometry.capsules.size());
        for (int i = 0; i < count; ++i)
            for (int j = i + 2; j < count; ++j) geometry.pairs.emplace_back(i, j);
    }
    JointVector draw(std::mt19937& random) const {
        JointVector q(robot.size());
        for (int i = 0; i < robot.size(); ++i)
            q[i] = std::uniform_real_distribution<double>(std::max(robot.limits.position.lower[i], -3.0),
                                                          std::min(robot.limits.position.upper[i], 3.0))(random);
        return q;
    }
    RobotDescription robot;
    ArmGeometry geometry;
};

/** The least of a convex function on [0, 1] by golden section. */
double findLeast(const std::function<double(double)>& f) {
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 120; ++i) {
        const double a = high - 0.6180339887498949 * (high - low), b = low + 0.6180339887498949 * (high - low);
        (f(a) < f(b) ? high : low) = f(a) < f(b) ? b : a;
    }
    return std::min({f(0.0), f(1.0), f(0.5 * (low + high))});
}

/** A one-joint arm whose joint moves one capsule with the given ends. */
struct Stick {
    Stick(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius) {
        JointDescription joint;
        joint.name = "joint";
        joint.placement = Eigen::Isometry3d::Identity();
        joint.axis = Eigen::Vector3d::UnitZ();
        robot.joints.push_back(joint);
        robot.limits = JointLimits::unlimited(1);
        geometry.links = {"stick"};
        LinkCapsule capsule;
        capsule.carrier = 0;
        capsule.a = a;
        capsule.b = b;
        capsule.radius = radius;
        geometry.capsules = {capsule};
    }
    CollisionChecker::Contact check(const Environment& environment, double horizon = 1.0, double t = 0.0) const {
        return CollisionChecker(robot, geometry, environment).findContact(JointVector::Zero(1), t, horizon);
    }
    RobotDescription robot;
    ArmGeometry geometry;
};

double calcPointDistance(const Solid& solid, const Eigen::Vector3d& p) {
    const Eigen::Vector3d local = solid.pose.inverse() * p;
    if (solid.kind == Solid::Kind::Box) return calcBoxDistance(local, 0.5 * solid.size);
    if (solid.kind == Solid::Kind::Sphere) return std::max(0.0, local.norm() - solid.radius);
    if (solid.kind == Solid::Kind::HalfSpace) return std::max(0.0, local.z());
    return std::hypot(std::max(0.0, local.head<2>().norm() - solid.radius),
                      std::max(0.0, std::abs(local.z()) - 0.5 * solid.length));
}

TEST(CollisionChecker, DistancesFromSolidsAreExact) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> place(-0.6, 0.6), size(0.02, 0.5);
    const auto draw = [&] { return Eigen::Vector3d(place(random), place(random), place(random)); };
    for (const Solid::Kind kind :
         {Solid::Kind::Box, Solid::Kind::Sphere, Solid::Kind::Cylinder, Solid::Kind::HalfSpace}) {
        int apart = 0, deep = 0;
        for (int trial = 0; trial < 2000; ++trial) {
            Environment environment;
            environment.solids.resize(1);
            Solid& solid = environment.solids[0];
            solid.kind = kind;
            solid.size << size(random), size(random), size(random);
            solid.radius = 0.5 * size(random);
            solid.length = size(random);
            if (trial % 4 != 0)  // else edges are parallel
                solid.pose.linear() = Eigen::AngleAxisd(place(random) * 5, draw().normalized()).toRotationMatrix();
            solid.pose.translation() = draw();
            const Eigen::Vector3d a = draw();
            const Eigen::Vector3d b =
                trial % 8 == 0 ? Eigen::Vector3d(a + 0.3 * Eigen::Vector3d::Unit(trial / 8 % 3)) : draw();
            const double radius = 0.05;
            const double truth = findLeast([&](double s) { return calcPointDistance(solid, a + s * (b - a)); });
            const CollisionChecker::Contact found = Stick(a, b, radius).check(environment);
            if (truth - radius >= 1.0) {
                EXPECT_EQ(found.link, -1);
                EXPECT_EQ(found.distance, 1.0);
            } else if (truth > 1e-7) {
                ++apart;
                ASSERT_NEAR(found.distance, truth - radius, 2e-9) << static_cast<int>(kind);
                ASSERT_EQ(found.obstacle, 0);
                ASSERT_EQ(found.link, 0);
            } else {
                ++deep;
                ASSERT_LE(found.distance, -radius + 1e-7) << static_cast<int>(kind);
            }
        }
        EXPECT_GT(apart, 500);
        EXPECT_GT(deep, 50);
    }
}

TEST(CollisionChecker, PairsOfCapsulesAreExact) {
    std::mt19937 random(2);
    std::uniform_real_distribution<double> place(-0.5, 0.5);
    const auto draw = [&] { return Eigen::Vector3d(place(random), place(random), place(random)); };
    for (int trial = 0; trial < 500; ++trial) {
        Stick stick(draw(), draw(), 0.03);
        LinkCapsule other = stick.geometry.capsules[0];
        other.carrier = -1;
        other.link = 1;
        other.a = draw();
        other.b = draw();
        const Eigen::Vector3d along = stick.geometry.capsules[0].b - stick.geometry.capsules[0].a;
        if (trial % 5 == 0) other.b = other.a;                          // a sphere
        if (trial % 5 == 1) other.b = other.a + 0.7 * along;            // parallel
        if (trial % 5 == 2) other.b = other.a + along + 1e-9 * draw();  // nearly so
        stick.geometry.links.push_back("other");
        stick.geometry.capsules.push_back(other);
        stick.geometry.pairs = {{0, 1}};
        const LinkCapsule& first = stick.geometry.capsules[0];
        const double truth = findLeast([&](double s) {
            const Eigen::Vector3d p = first.a + s * along;
            return findLeast([&](double t) { return (p - other.a - t * (other.b - other.a)).norm(); });
        });
        const CollisionChecker::Contact found = stick.check({});
        ASSERT_NEAR(found.distance, std::min(1.0, truth - 0.06), 1e-8) << trial;
        ASSERT_EQ(found.obstacle, -1);
        ASSERT_EQ(found.link, truth - 0.06 < 1.0 ? 0 : -1);
        ASSERT_EQ(found.otherLink, truth - 0.06 < 1.0 ? 1 : -1);
    }
}

TEST(CollisionChecker, LinksStandWhereTheModelHasThem) {
    for (const char* name : {"indy7", "ur5e"}) {
        Arm arm(name);
        arm.geometry.pairs.clear();
        RobotModel model(arm.robot);
        Dynamics dynamics;
        std::mt19937 random(3);
        for (int trial = 0; trial < 50; ++trial) {
            const JointVector q = arm.draw(random);
            model.calcDynamics(q, JointVector::Zero(q.size()), dynamics);
            const Pose& tool = dynamics.tool;
            // A capsule of no length at the tool's origin, and a ball beside it.
            ArmGeometry point = arm.geometry;
            point.capsules = {arm.geometry.capsules.back()};
            point.capsules[0].a = point.capsules[0].b;
            Environment environment;
            environment.solids.resize(1);
            environment.solids[0].kind = Solid::Kind::Sphere;
            environment.solids[0].radius = 0.1;
            environment.solids[0].pose.translation() =
                tool.position + tool.orientation * Eigen::Vector3d(0.3, 0.0, 0.0);
            EXPECT_NEAR(CollisionChecker(arm.robot, point, environment).findContact(q, 0.0, 1.0).distance,
                        0.3 - 0.1 - 0.04, 1e-9)
                << name;
        }
    }
}

TEST(CollisionChecker, PrismaticJointsShift) {
    Stick stick({0, 0, 0}, {0, 0, 0.1}, 0.02);
    stick.robot.joints[0].type = JointType::Prismatic;
    Environment environment;
    environment.solids.resize(1);
    environment.solids[0].kind = Solid::Kind::HalfSpace;
    const CollisionChecker checker(stick.robot, stick.geometry, environment);
    EXPECT_NEAR(checker.findContact(JointVector::Constant(1, 0.5), 0.0, 1.0).distance, 0.48, 1e-12);
}

TEST(CollisionChecker, WhatTheBaseCarriesHitsNoObstacle) {
    Stick stick({0, 0, 0}, {0, 0, 0.1}, 0.02);
    stick.geometry.capsules[0].carrier = -1;
    Environment environment;
    environment.solids.resize(1);
    environment.solids[0].kind = Solid::Kind::HalfSpace;
    EXPECT_EQ(stick.check(environment).link, -1);
}

// What is too far to count changes nothing, not even by rounding: neither the distance nor who is nearest.
TEST(CollisionChecker, WhatIsFarIsNeverTheNearest) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const ArmGeometry geometry = loadArmGeometry(robot);
    const CollisionChecker alone(robot, geometry, Environment{});
    Environment environment;
    for (const Solid::Kind kind :
         {Solid::Kind::Box, Solid::Kind::Sphere, Solid::Kind::Cylinder, Solid::Kind::HalfSpace}) {
        Solid solid;
        solid.kind = kind;
        solid.size.setConstant(0.1);
        solid.radius = 0.05;
        solid.length = 0.1;
        solid.pose.translation() << 0.0, 0.0, -9.0;
        environment.solids.push_back(solid);
    }
    const CollisionChecker checker(robot, geometry, environment);
    std::mt19937 random(4);
    std::uniform_real_distribution<double> angle(-2.0, 2.0);
    for (int trial = 0; trial < 500; ++trial) {
        JointVector q(robot.size());
        for (double& x : q) x = angle(random);
        const CollisionChecker::Contact with = checker.findContact(q, 0.0, 0.5),
                                        without = alone.findContact(q, 0.0, 0.5);
        ASSERT_EQ(with.distance, without.distance);
        ASSERT_EQ(with.obstacle, without.obstacle);
        ASSERT_EQ(with.otherLink, without.otherLink);
    }
}

TEST(CollisionChecker, MovingSpheresCountWhereTheyAre) {
    Environment environment;
    MovingSphere sphere;
    sphere.radius = 0.1;
    sphere.waypoints = {{0.0, {1, 0, 0}}, {2.0, {-1, 0, 0}}};
    environment.spheres = {sphere};
    const Stick stick({0, -0.1, 0}, {0, 0.1, 0}, 0.05);
    EXPECT_NEAR(stick.check(environment, 1.0, 0.5).distance, 0.35, 1e-12);
    EXPECT_NEAR(stick.check(environment, 1.0, 1.0).distance, -0.15, 1e-12);
    EXPECT_NEAR(stick.check(environment, 1.0, 1.5).distance, 0.35, 1e-12);
    EXPECT_EQ(stick.check(environment, 0.3, 0.5).link, -1);
    EXPECT_EQ(stick.check(environment, 0.3, 0.5).distance, 0.3);
}

TEST(CollisionChecker, NoNumberIsNoPose) {
    const Stick stick({0, 0, 0}, {0, 0, 0.1}, 0.02);
    const CollisionChecker checker(stick.robot, stick.geometry, {});
    EXPECT_EQ(checker.findContact(JointVector::Constant(1, std::nan("")), 0.0, 1.0).distance, -kInfinity);
}

struct MappedScene {
    explicit MappedScene(UnknownSpace unknown) {
        octomap::OcTree tree(0.04);
        std::mt19937 random(12);
        std::uniform_real_distribution<double> place(-1.4, 1.4);
        for (double x = -0.7; x < 0.7; x += 0.04)  // known and free around the middle
            for (double y = -0.7; y < 0.7; y += 0.04)
                for (double z = -0.7; z < 0.7; z += 0.04) tree.updateNode(x, y, z, false, true);
        for (int i = 0; i < 300; ++i) {
            const Eigen::Vector3d p(place(random), place(random), place(random));
            if (p.norm() > 0.25) tree.setNodeValue(p.x(), p.y(), p.z(), 3.0F, true);
        }
        tree.updateInnerOccupancy();
        tree.prune();
        store(folder / "map.bt", writeBinary(tree));
        environment.map = chooseMap(folder / "map.bt");
        environment.map->pose = makeOddPose();
        environment.map->unknown = unknown;
    }
    TemporaryFolder folder;
    Environment environment;
};

TEST(CollisionChecker, Fault58_CellsOfTheMapAreExactAndUnknownOnesCountWhenAsked) {
    for (const UnknownSpace unknown : {UnknownSpace::Free, UnknownSpace::Occupied}) {
        const MappedScene scene(unknown);
        const OccupancyMap map(*scene.environment.map);
        std::vector<Solid> cells;
        map.forEachSolidCell({-3, -3, -3}, {3, 3, 3}, unknown == UnknownSpace::Occupied,
                             [&](const OccupancyMap::Cell& cell) {
                                 Solid solid;
                                 solid.pose = scene.environment.map->pose * Eigen::Translation3d(cell.centre);
                                 solid.size.setConstant(cell.edge);
                                 cells.push_back(solid);
                             });
        std::mt19937 random(13);
        std::uniform_real_distribution<double> place(-0.5, 0.5);
        const auto draw = [&] { return Eigen::Vector3d(place(random), place(random), place(random)); };
        int apart = 0;
        for (int trial = 0; trial < 60; ++trial) {
            const Eigen::Vector3d a = draw(), b = a + 0.5 * draw();
            double truth = 2.0;
            for (const Solid& cell : cells) {
                if (calcPointDistance(cell, a) - (b - a).norm() > truth) continue;
                truth = std::min(truth, findLeast([&](double s) { return calcPointDistance(cell, a + s * (b - a)); }));
            }
            const CollisionChecker::Contact found = Stick(a, b, 0.03).check(scene.environment);
            EXPECT_EQ(found.obstacle, 0);
            if (truth > 1e-7) {
                ++apart;
                EXPECT_NEAR(found.distance, truth - 0.03, 2e-9);
            } else {
                EXPECT_LE(found.distance, -0.03 + 1e-7);
            }
        }
        EXPECT_GT(apart, 10);
    }
}

TEST(CollisionChecker, CellsFarFromTheBaseAreFoundAsWell) {
    // A prismatic joint without limits, farther out than the cells that are kept at hand.
    const MappedScene scene(UnknownSpace::Free);
    Stick near({0, 0, 0}, {0, 0, 0.2}, 0.03);
    Stick far = near;
    far.robot.joints[0].type = JointType::Prismatic;
    Environment moved = scene.environment;
    moved.map->pose.translation().z() += 100.0;
    const CollisionChecker checker(far.robot, far.geometry, moved);
    EXPECT_NEAR(checker.findContact(JointVector::Constant(1, 100.0), 0.0, 0.5).distance,
                near.check(scene.environment, 0.5).distance, 1e-9);
}

TEST(CollisionChecker, IsFastEnoughForEveryTickOfARun) {
    Arm arm("indy7");
    const MappedScene scene(UnknownSpace::Free);
    Environment environment = scene.environment;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> place(-1.0, 1.0);
    for (int i = 0; i < 10; ++i) {
        Solid solid;
        solid.kind = i % 2 ? Solid::Kind::Box : Solid::Kind::Cylinder;
        solid.pose = makeOddPose();
        solid.pose.translation() += Eigen::Vector3d(place(random), place(random), place(random));
        solid.size << 0.3, 0.2, 0.1;
        solid.radius = 0.1;
        solid.length = 0.4;
        environment.solids.push_back(solid);
    }
    for (const bool withMap : {false, true}) {
        if (!withMap)
            environment.map.reset();
        else
            environment.map = scene.environment.map;
        const CollisionChecker checker(arm.robot, arm.geometry, environment);
        constexpr int kPoses = 2000;
        double sum = 0.0;
        const auto begin = std::chrono::steady_clock::now();
        for (int i = 0; i < kPoses; ++i) sum += checker.findContact(arm.draw(random), 0.0, 0.1).distance;
        const double each_us =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() * 1e6 / kPoses;
        std::printf("%.1f us for a pose, ten solids%s\n", each_us, withMap ? " and a map" : "");
        EXPECT_LT(each_us, 2000.0);  // sanitizers and other load; about 10 us alone
        EXPECT_TRUE(std::isfinite(sum));
    }
}

}  // namespace
}  // namespace viable::test
