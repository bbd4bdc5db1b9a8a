#include "Figures.h"
#include "Joints.h"
#include "Paths.h"

namespace viable::test {
namespace {

constexpr const char* kUr5eFigures = VIABLE_SOURCE_DIR "/../shared/data/ur5e_figures.json";

/** robots/ur5e by itself and against the vendor's documentation. */
struct Ur5eTest : ::testing::Test {
    RobotDescription robot_ = loadRobot(VIABLE_SOURCE_DIR "/robots/ur5e");
    RobotModel model_{robot_};
};

/** Universal_Robots_ROS2_Description, config/ur5e/joint_limits.yaml; acceleration and jerk are assumptions. */
TEST_F(Ur5eTest, HasThePublishedLimits) {
    const double turn = 2 * EIGEN_PI;
    EXPECT_EQ(robot_.limits.position.upper, joints(turn, turn, turn / 2, turn, turn, turn));
    EXPECT_EQ(robot_.limits.position.lower, -robot_.limits.position.upper);
    EXPECT_EQ(robot_.limits.velocity.upper, JointVector::Constant(6, EIGEN_PI));
    EXPECT_EQ(robot_.actuation.torqueLimit, joints(150, 150, 150, 28, 28, 28));
    EXPECT_EQ(robot_.toolLink, "wrist_3");
}

/** The vendor's article on DH parameters for calculations of kinematics and dynamics (standard table), flange in the
vendor's base frame. */
TEST_F(Ur5eTest, ToolPoseFollowsTheDenavitHartenbergTable) {
    const double quarter = EIGEN_PI / 2;
    const DhRow table[] = {{0, 0.1625, quarter}, {-0.425, 0, 0},        {-0.3922, 0, 0},
                           {0, 0.1333, quarter}, {0, 0.0997, -quarter}, {0, 0.0996, 0}};
    expectToolOfTable(robot_, model_, table, false);
}

/** The vendor publishes centres of mass also in the frames of its Denavit-Hartenberg table (the article above); there the
shoulder's and the wrists' axes lie differently, so this shows that the tensors were turned along. */
TEST_F(Ur5eTest, TensorsAreTurnedWithTheCentresOfMass) {
    struct Published {
        int joint;
        Eigen::Vector3d com;      // [m], model axes
        Eigen::Vector3d moments;  // Ixx, Iyy, Izz [kg m^2], model axes
        double roll;              // model axes seen from the link
    };
    const double quarter = EIGEN_PI / 2;
    const Published published[] = {
        {0, {0, -0.02561, 0.00193}, {0.0070021, 0.00648091, 0.00657286}, quarter},
        {3, {0, -0.0018, 0.01634}, {0.00165491, 0.00135962, 0.00126279}, quarter},
        {4, {0, 0.0018, 0.01634}, {0.00135617, 0.00127827, 0.00096614}, -quarter},
    };
    for (const Published& link : published) {
        const BodyInertia& body = robot_.joints[static_cast<std::size_t>(link.joint)].body;
        const Eigen::Matrix3d R = Eigen::AngleAxisd(link.roll, Eigen::Vector3d::UnitX()).toRotationMatrix();
        EXPECT_LT((R * link.com - body.com).norm(), 1e-16) << link.joint;
        const Eigen::Matrix3d inModel = R.transpose() * body.inertia * R;
        EXPECT_LT((inModel.diagonal() - link.moments).norm(), 1e-16) << link.joint;
    }
}

/** Against the collected figures, where they are. */
struct Ur5eFiguresTest : Ur5eTest {
    void SetUp() override { readFigures(kUr5eFigures, figures_); }
    nlohmann::json figures_;
};

/** Not the tensors: the collected ones are an older revision's. */
TEST_F(Ur5eFiguresTest, UrdfHoldsThePublishedFigures) {
    for (int i = 0; i < 6; ++i) {
        const nlohmann::json& joint = figures_["joints"][i];
        const nlohmann::json& link = figures_["links"][i + 1];
        EXPECT_EQ(robot_.joints[i].name, joint["name"]);
        EXPECT_EQ(robot_.joints[i].childLink, link["name"]);
        EXPECT_NEAR(robot_.limits.position.lower[i], joint["lower"].get<double>(), 1e-9);
        EXPECT_NEAR(robot_.limits.position.upper[i], joint["upper"].get<double>(), 1e-9);
        EXPECT_NEAR(robot_.limits.velocity.upper[i], joint["velocity"].get<double>(), 1e-9);
        EXPECT_EQ(robot_.actuation.torqueLimit[i], joint["effort"].get<double>());
        EXPECT_EQ(robot_.joints[i].body.mass, link["mass"].get<double>());
        EXPECT_EQ(JointVector(robot_.joints[i].body.com), toVector(link["com"]));
    }
}

TEST_F(Ur5eFiguresTest, ToolPosesAreTheCollectedOnes) {
    expectCollectedToolPoses(figures_, model_);
}

}  // namespace
}  // namespace viable::test
