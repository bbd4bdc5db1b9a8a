#include <cmath>

#include "Figures.h"
#include "Paths.h"

namespace viable {
namespace {

constexpr double kDegree = EIGEN_PI / 180.0;
constexpr const char* kIndy7Figures = VIABLE_SOURCE_DIR "/../shared/data/indy7_figures.json";

/** robots/indy7 against published and logged figures. */
struct Indy7Test : ::testing::Test {
    void SetUp() override { readFigures(kIndy7Figures, figures_); }
    Dynamics calc(const JointVector& q) {
        Dynamics dynamics;
        model_.calcDynamics(q, JointVector::Zero(6), dynamics);
        return dynamics;
    }
    const nlohmann::json& variant() const { return figures_["variants"]["indy7"]; }
    /** What the controller reported through the vendor's SDK. */
    const nlohmann::json& log() const { return figures_["fk_checks"][0]; }

    RobotDescription robot_ = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    RobotModel model_{robot_};
    nlohmann::json figures_;
};

TEST_F(Indy7Test, ToolPoseIsTheOneThatTheControllerLogged) {
    const Pose tool = calc(toVector(log()["q_deg"], kDegree)).tool;
    const JointVector expected_mm = toVector(log()["tcp_xyz_mm"]);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(1e3 * tool.position[i], expected_mm[i], 0.05) << i;
    const Eigen::Quaterniond expected = toOrientation(toVector(log()["tcp_uvw_deg"], kDegree));
    EXPECT_LT(tool.orientation.angularDistance(expected), 1e-5);
}

TEST_F(Indy7Test, ToolPoseFollowsTheDenavitHartenbergTable) {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> uniform(-3.0, 3.0);
    for (int sample = 0; sample < 200; ++sample) {
        JointVector q(6);
        Eigen::Isometry3d chain = Eigen::Isometry3d::Identity();
        for (int i = 0; i < 6; ++i) {
            q[i] = uniform(random);
            const nlohmann::json& row = figures_["dh_modified_craig"]["rows"][i];
            const auto figure = [&](const char* key) { return row[key].get<double>(); };
            chain.rotate(Eigen::AngleAxisd(figure("alpha_deg") * kDegree, Eigen::Vector3d::UnitX()));
            chain.translate(Eigen::Vector3d(figure("a"), 0.0, 0.0));
            chain.rotate(Eigen::AngleAxisd(figure("theta0_deg") * kDegree + q[i], Eigen::Vector3d::UnitZ()));
            chain.translate(Eigen::Vector3d(0.0, 0.0, figure("d")));
        }
        const Pose tool = calc(q).tool;
        ASSERT_LT((tool.position - chain.translation()).norm(), 1e-9);
        ASSERT_LT((tool.orientation.toRotationMatrix() - chain.linear()).norm(), 1e-9);
    }
}

TEST_F(Indy7Test, GravityTorqueIsTheHoldingTorqueThatTheControllerLogged) {
    const JointVector gravity = calc(toVector(log()["q_deg"], kDegree)).gravity;
    const JointVector logged = toVector(log()["holding_torque_logged_nm"]);
    for (int i = 1; i <= 3; ++i) EXPECT_NEAR(gravity[i], logged[i], std::max(0.3, 0.04 * std::abs(logged[i]))) << i;
}

TEST_F(Indy7Test, InertiaAndGravityAreThoseOfTheCorrectedTensors) {
    RobotDescription links = robot_;
    links.actuation.rotorInertia.setZero();
    model_ = RobotModel(links);
    const double printed = 0.5e-6;  // half of the last digit
    // The tensors in the URDF are rounded to 1e-8; six of them at most enter an entry.
    const double rounding = 0.1e-6;
    ASSERT_EQ(figures_["dynamics_checks_computed_here"].size(), 2u);
    for (const nlohmann::json& check : figures_["dynamics_checks_computed_here"]) {
        const Dynamics d = calc(toVector(check["q_rad"]));
        const JointVector gravity = toVector(check["gravity_torque_nm_g9.81"]);
        for (int i = 0; i < 6; ++i) {
            EXPECT_NEAR(d.gravity[i], gravity[i], printed + rounding) << i;
            const JointVector row = toVector(check["mass_matrix_corrected_tensors"][i]);
            for (int j = 0; j < 6; ++j) EXPECT_NEAR(d.M(i, j), row[j], printed + rounding) << i << " " << j;
        }
    }
}

TEST_F(Indy7Test, UrdfHoldsThePublishedFigures) {
    for (int i = 0; i < 6; ++i) {
        expectPublishedJoint(robot_, variant(), i);
        EXPECT_EQ(robot_.limits.velocity.lower[i], -robot_.limits.velocity.upper[i]);
    }
}

TEST_F(Indy7Test, ActuationHoldsThePublishedFigures) {
    const nlohmann::json& friction = figures_["friction"];
    EXPECT_EQ(robot_.actuation.friction.coulomb, toVector(friction["Fc"]));
    EXPECT_EQ(robot_.actuation.friction.viscous, toVector(friction["Fv1"]));
    EXPECT_EQ(robot_.actuation.friction.viscousVelocity, toVector(friction["Fv2"]));
    const nlohmann::json& actuators = figures_["actuators"];
    EXPECT_EQ(robot_.actuation.gearRatio, toVector(actuators["gear_ratio"]));
    EXPECT_EQ(robot_.actuation.torqueLimit, toVector(actuators["max_torque_nm"]));
    const JointVector counts =
        toVector(actuators["gear_ratio"], actuators["encoder_counts_per_motor_rev"].get<double>());
    EXPECT_EQ(robot_.actuation.encoderCounts, counts);
}

TEST(Indy7, HasThePapersLimitsAndHome) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    EXPECT_EQ(robot.name, "indy7");
    EXPECT_EQ(robot.toolLink, "tcp");
    JointVector home(6);
    home << 0.0, -EIGEN_PI / 12, -EIGEN_PI / 2, 0.0, -5 * EIGEN_PI / 12, 0.0;
    EXPECT_LT((robot.home - home).norm(), 1e-15);
    EXPECT_NEAR(robot.limits.acceleration.upper.minCoeff(), 4 * EIGEN_PI, 1e-14);
    EXPECT_NEAR(robot.limits.jerk.lower.maxCoeff(), -12 * EIGEN_PI, 1e-14);
    EXPECT_NEAR(robot.actuation.rotorInertia[0], 1.5e-4 * 121 * 121, 1e-12);
}

TEST(SingleJoint, IsAUnitInertiaWithoutGravity) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/single_joint");
    ASSERT_EQ(robot.size(), 1);
    RobotModel model(robot);
    Dynamics d;
    for (const double angle : {-3.0, 0.0, 0.1, 2.0, 50.0}) {
        model.calcDynamics(JointVector::Constant(1, angle), JointVector::Constant(1, 4.0), d);
        EXPECT_EQ(d.M(0, 0), 1.0);
        EXPECT_EQ(d.b[0], 0.0);
        EXPECT_EQ(d.gravity[0], 0.0);
        EXPECT_NEAR(d.tool.position.x(), std::cos(angle), 1e-15);
    }
    const AxisLimits limits = robot.limits.axis(0);
    EXPECT_NEAR(limits.positionUpper, EIGEN_PI, 1e-15);
    EXPECT_NEAR(limits.velocityUpper, 2 * EIGEN_PI, 1e-15);
    EXPECT_NEAR(limits.accelerationLower, -3 * EIGEN_PI, 1e-14);
    EXPECT_NEAR(limits.jerkUpper, 4 * EIGEN_PI, 1e-14);
    EXPECT_TRUE(std::isinf(robot.actuation.torqueLimit[0]));
    EXPECT_EQ(robot.actuation.friction.coulomb[0], 0.0);
}

/** Every robot of the project can be run: its limits pass the check that precedes a run. */
TEST(Robots, AllLoadWithUsableLimits) {
    const auto folders = listRobots({VIABLE_SOURCE_DIR "/robots"});
    ASSERT_GE(folders.size(), 5u);
    for (const auto& folder : folders) {
        const RobotDescription robot = loadRobot(folder);
        EXPECT_NO_THROW(checkLimits(robot.limits, 0.001, robot.allowLargeAngles, folder.string(), robot.jointNames()));
        EXPECT_TRUE(std::filesystem::exists(folder / "README.md")) << folder;
    }
}

}  // namespace
}  // namespace viable
