#include <cmath>

#include "Figures.h"
#include "Joints.h"
#include "Paths.h"

namespace viable::test {
namespace {

constexpr const char* kPandaFigures = VIABLE_SOURCE_DIR "/../shared/data/panda_figures.json";

/** robots/panda by itself and against the vendor's documentation. */
struct PandaTest : ::testing::Test {
    RobotDescription robot_ = loadRobot(VIABLE_SOURCE_DIR "/robots/panda");
    RobotModel model_{robot_};
};

/** frankaemika/docs, source/control-parameters-joint-panda.csv */
TEST_F(PandaTest, HasTheDocumentedLimits) {
    const JointLimits& limits = robot_.limits;
    EXPECT_EQ(limits.position.lower, joints(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973));
    EXPECT_EQ(limits.position.upper, joints(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973));
    EXPECT_EQ(limits.velocity.upper, joints(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61));
    EXPECT_EQ(limits.acceleration.upper, joints(15, 7.5, 10, 12.5, 15, 20, 20));
    EXPECT_EQ(limits.jerk.upper, joints(7500, 3750, 5000, 6250, 7500, 10000, 10000));
    EXPECT_EQ(limits.velocity.lower, -limits.velocity.upper);
    EXPECT_EQ(limits.acceleration.lower, -limits.acceleration.upper);
    EXPECT_EQ(limits.jerk.lower, -limits.jerk.upper);
    EXPECT_EQ(robot_.actuation.torqueLimit, joints(87, 87, 87, 87, 12, 12, 12));
}

TEST_F(PandaTest, StartsAtTheVendorsReadyPoseWithinItsLimits) {
    EXPECT_LT((robot_.home - joints(0, -EIGEN_PI / 4, 0, -3 * EIGEN_PI / 4, 0, EIGEN_PI / 2, EIGEN_PI / 4)).norm(),
              1e-15);
    EXPECT_TRUE((robot_.home.array() > robot_.limits.position.lower.array()).all());
    EXPECT_TRUE((robot_.home.array() < robot_.limits.position.upper.array()).all());
    EXPECT_EQ(robot_.toolLink, "link8");
}

/** frankaemika/docs, source/dh-parameters.csv (modified, after Craig), flange. */
TEST_F(PandaTest, ToolPoseFollowsTheDenavitHartenbergTable) {
    const double quarter = EIGEN_PI / 2;
    const DhRow table[] = {
        {0, 0.333, 0},   {0, 0, -quarter},    {0, 0.316, quarter}, {0.0825, 0, quarter}, {-0.0825, 0.384, -quarter},
        {0, 0, quarter}, {0.088, 0, quarter}, {0, 0.107, 0}};
    expectToolOfTable(robot_, model_, table, true);
}

/** Gaz et al., RA-L 4(4), 2019: FI1 / (1 + exp(-FI2 (qd + FI3))) - FI1 / (1 + exp(-FI2 FI3)), FI3 the offset of the law's
middle from zero velocity. */
TEST_F(PandaTest, FrictionIsTheOddPartOfThePublishedLaw) {
    const JointVector FI1 = joints(0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489);
    const JointVector FI2 = joints(5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336);
    const JointVector FI3 = joints(0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526);
    const JointFriction& friction = robot_.actuation.friction;
    EXPECT_EQ(friction.coulomb, JointVector::Zero(7));
    for (int i = 0; i < 7; ++i) {
        const auto published = [&](double qd) {
            return FI1[i] / (1 + std::exp(-FI2[i] * (qd + FI3[i]))) - FI1[i] / (1 + std::exp(-FI2[i] * FI3[i]));
        };
        const auto ours = [&](double qd) {
            return friction.viscous[i] * (1 - std::exp(-qd / friction.viscousVelocity[i]));
        };
        for (const double qd : {0.01, 0.03, 0.1, 0.3, 1.0, 2.0}) {
            const double odd = (published(qd) - published(-qd)) / 2;
            // tanh and 1 - exp of the same slope and height differ by 0.14 of the height at most; FI3 adds to that.
            EXPECT_NEAR(ours(qd), odd, 0.2 * FI1[i] / 2) << i << " at " << qd;
        }
        EXPECT_NEAR(ours(2.0), (published(2.0) - published(-2.0)) / 2, 0.01 * FI1[i] / 2) << i;
        EXPECT_NEAR(friction.viscous[i] / friction.viscousVelocity[i], FI1[i] * FI2[i] / 4, 1e-3 * FI1[i] * FI2[i])
            << i;
    }
}

/** Against the collected figures, where they are. */
struct PandaFiguresTest : PandaTest {
    void SetUp() override { readFigures(kPandaFigures, figures_); }
    const nlohmann::json& variant() const { return figures_["variants"]["fer"]; }
    nlohmann::json figures_;
};

TEST_F(PandaFiguresTest, UrdfHoldsThePublishedFiguresWithTheProductsOfInertiaTurned) {
    for (int i = 0; i < 7; ++i) {
        const nlohmann::json& joint = variant()["joints"][i];
        const nlohmann::json& link = expectPublishedJoint(robot_, variant(), i);
        EXPECT_EQ(robot_.limits.acceleration.upper[i], joint["acceleration"].get<double>());
        EXPECT_EQ(robot_.limits.jerk.upper[i], joint["jerk"].get<double>());
        Eigen::Matrix3d published = toTensor(link["inertia_published"]);
        published = 2.0 * Eigen::Matrix3d(published.diagonal().asDiagonal()) - published;
        EXPECT_EQ(robot_.joints[i].body.inertia, published) << link["name"];
    }
}

TEST_F(PandaFiguresTest, ToolPosesAreTheCollectedOnes) {
    expectCollectedToolPoses(figures_, model_);
}

}  // namespace
}  // namespace viable::test
