// collision.yaml of the robots that come with the program.
#include <algorithm>
#include <cmath>

#include "Figures.h"
#include "Paths.h"
#include "meshes/RobotShapes.h"
#include "viable/robot/ArmGeometry.h"

namespace viable {
namespace {

const char* const kCapsuleFile = VIABLE_SOURCE_DIR "/../shared/data/indy7_capsules.json";

/** Where the joints' moving frames are, from the description one by one. */
std::vector<Eigen::Isometry3d> calcPoses(const RobotDescription& robot, const JointVector& q) {
    std::vector<Eigen::Isometry3d> poses;
    for (int i = 0; i < robot.size(); ++i) {
        const JointDescription& joint = robot.joints[static_cast<std::size_t>(i)];
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        if (joint.parent >= 0) pose = poses[static_cast<std::size_t>(joint.parent)];
        pose = pose * joint.placement;
        if (joint.type == JointType::Prismatic)
            pose.translate(q[i] * joint.axis);
        else
            pose.rotate(Eigen::AngleAxisd(q[i], joint.axis));
        poses.push_back(pose);
    }
    return poses;
}

/** Smallest value of a convex function on [0, 1], by thirds. */
template <class Function>
double findLeast(const Function& f) {
    double lower = 0.0, upper = 1.0;
    for (int k = 0; k < 60; ++k) {
        const double first = lower + (upper - lower) / 3.0, second = upper - (upper - lower) / 3.0;
        (f(first) < f(second) ? upper : lower) = f(first) < f(second) ? second : first;
    }
    return f(0.5 * (lower + upper));
}

double calcGap(const LinkCapsule& a, const LinkCapsule& b, const std::vector<Eigen::Isometry3d>& poses) {
    const auto place = [&](const LinkCapsule& c, const Eigen::Vector3d& p) -> Eigen::Vector3d {
        return c.carrier < 0 ? p : poses[static_cast<std::size_t>(c.carrier)] * p;
    };
    const Eigen::Vector3d a0 = place(a, a.a), a1 = place(a, a.b), b0 = place(b, b.a), b1 = place(b, b.b);
    return findLeast([&](double s) {
               return findLeast([&](double t) { return (a0 + s * (a1 - a0) - b0 - t * (b1 - b0)).norm(); });
           }) -
           a.radius - b.radius;
}

struct CollisionFileTest : ::testing::TestWithParam<std::string> {
    RobotDescription robot_ = loadRobot(VIABLE_SOURCE_DIR "/robots/" + GetParam());
    ArmGeometry arm_ = loadArmGeometry(robot_);
};

TEST_P(CollisionFileTest, NothingIsNearAtHome) {
    const std::vector<Eigen::Isometry3d> home = calcPoses(robot_, robot_.home);
    for (const auto& [i, j] : arm_.pairs) {
        const LinkCapsule& a = arm_.capsules[static_cast<std::size_t>(i)];
        const LinkCapsule& b = arm_.capsules[static_cast<std::size_t>(j)];
        EXPECT_GE(calcGap(a, b, home), 0.02)
            << arm_.links[static_cast<std::size_t>(a.link)] << ", " << arm_.links[static_cast<std::size_t>(b.link)];
    }
}

TEST_P(CollisionFileTest, EveryJointMovesACapsule) {
    for (int i = 0; i < robot_.size(); ++i)
        EXPECT_TRUE(std::any_of(arm_.capsules.begin(), arm_.capsules.end(), [&](const LinkCapsule& c) {
            return c.carrier == i;
        })) << robot_.joints[static_cast<std::size_t>(i)].name;
}

/** Points all over the cylinders of the URDF are inside of a capsule of the same link. */
TEST_P(CollisionFileTest, TheCapsulesContainWhatIsDrawn) {
    int count = 0;
    for (const LinkShapes& link : loadShapes(robot_))
        for (const LinkShape& shape : link.shapes) {
            if (shape.kind == LinkShape::Kind::Capsule) continue;  // drawn from the file itself
            ASSERT_EQ(shape.kind, LinkShape::Kind::Cylinder);
            for (int k = 0; k < 600; ++k, ++count) {
                const double angle = k * 2.399963, z = (k % 21 - 10) / 20.0;
                const Eigen::Vector3d p =
                    link.placement * (shape.pose * Eigen::Vector3d(shape.radius * std::cos(angle),
                                                                   shape.radius * std::sin(angle), z * shape.length));
                double nearest = 1.0;
                for (const LinkCapsule& c : arm_.capsules)
                    if (arm_.links[static_cast<std::size_t>(c.link)] == link.link)
                        nearest = std::min(nearest, findLeast([&](double t) {
                                                        return (c.a + t * (c.b - c.a) - p).norm();
                                                    }) - c.radius);
                ASSERT_LE(nearest, 1e-9) << link.link;
            }
        }
    if (GetParam() == "panda" || GetParam() == "ur5e") EXPECT_GE(count, 7 * 600);
}

INSTANTIATE_TEST_SUITE_P(Robots, CollisionFileTest,
                         ::testing::Values("indy7", "panda", "ur5e", "planar_two_link", "single_joint"),
                         [](const auto& arm) { return arm.param; });

TEST(Indy7Collision, CapsulesAreTheCollectedOnes) {
    nlohmann::json figures;
    readFigures(kCapsuleFile, figures);
    if (figures.is_null()) return;
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const ArmGeometry arm = loadArmGeometry(robot);
    std::vector<std::size_t> used(arm.links.size(), 0);
    std::size_t count = 0;
    for (const LinkCapsule& c : arm.capsules) {
        const auto link = static_cast<std::size_t>(c.link);
        const nlohmann::json& collected = figures["capsules"].at(arm.links[link]).at(used[link]++);
        EXPECT_EQ(c.a, Eigen::Vector3d(toVector(collected["a"])));
        EXPECT_EQ(c.b, Eigen::Vector3d(toVector(collected["b"])));
        EXPECT_EQ(c.radius, collected["radius"].get<double>());
        // link0 is the base, link1 hangs on joint0, ...
        EXPECT_EQ("link" + std::to_string(c.carrier + 1), arm.links[link]);
    }
    for (const auto& link : figures["capsules"]) count += link.size();
    EXPECT_EQ(arm.capsules.size(), count);
    // The capsules are what the report draws: the URDF has no shapes.
    EXPECT_EQ(loadShapes(robot).size(), arm.links.size());
}

TEST(Indy7Collision, OnlyNeighboursMayTouch) {
    const ArmGeometry arm = loadArmGeometry(loadRobot(VIABLE_SOURCE_DIR "/robots/indy7"));
    const int count = static_cast<int>(arm.capsules.size());
    for (int i = 0; i < count; ++i)
        for (int j = i + 1; j < count; ++j) {
            const int apart =
                arm.capsules[static_cast<std::size_t>(j)].link - arm.capsules[static_cast<std::size_t>(i)].link;
            EXPECT_EQ(std::count(arm.pairs.begin(), arm.pairs.end(), std::pair(i, j)), apart > 1 ? 1 : 0);
        }
}

}  // namespace
}  // namespace viable
