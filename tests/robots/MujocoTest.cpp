#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "MujocoModel.h"
#include "Paths.h"
#include "RandomStates.h"
#include "viable/robot/RobotModel.h"

// Every robot of the project against MuJoCo: M(q), b(q, qd) and the tool's pose at random states. Rotor inertia is left out
// on both sides: it is a constant on M's diagonal (RobotModelTest), and no URDF holds it.

namespace viable {
namespace {

constexpr int kStates = 1000;
constexpr std::uint64_t kSeed = 20250402;
/** Largest relative differences accepted: with the tensors as MuJoCo turns them, and with exact ones. The latter is the
rounding of sums about the base, some kg m^2, in the entry of a wrist of 2e-4 kg m^2. */
constexpr double kReadTolerance = 1e-6;
constexpr double kTolerance = 5e-12;

RobotDescription loadLinks(const std::filesystem::path& folder) {
    RobotDescription robot = loadRobot(folder);
    robot.actuation.rotorInertia.setZero();
    return robot;
}

/** Largest differences over all states, relative as said at each. */
struct Difference {
    double inertia = 0.0;      ///< |M_ij - M'_ij| / sqrt(M_ii M_jj)
    double bias = 0.0;         ///< |b_i - b'_i| / largest |b'_i| of all states
    double gravity = 0.0;      ///< the same of gravity's part
    double position = 0.0;     ///< [m] / farthest tool of all states [m]
    double orientation = 0.0;  ///< [rad]

    double largest() const { return std::max({inertia, bias, gravity, position, orientation}); }
};

/** 0 / 0 is no difference: a joint that neither side gives a torque. */
double divide(double difference, double scale) {
    return difference == 0.0 ? 0.0 : difference / scale;
}

Difference compare(const RobotDescription& robot, MujocoModel& other) {
    RobotModel model(robot);
    RandomStates states(robot, kSeed);
    const int n = robot.size();
    const JointVector none = JointVector::Zero(n);
    JointVector bias = none, gravity = none, largestBias = none, largestGravity = none;
    double position = 0.0, farthest = 0.0;
    Difference worst;
    Dynamics ours;
    for (int k = 0; k < kStates; ++k) {
        const JointState state = states.draw();
        const Dynamics theirs = other.calc(state.q, state.qd, robot.toolLink);
        model.calcDynamics(state.q, state.qd, ours);
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < n; ++j)
                worst.inertia = std::max(worst.inertia, std::abs(ours.M(i, j) - theirs.M(i, j)) /
                                                            std::sqrt(theirs.M(i, i) * theirs.M(j, j)));
        bias = bias.cwiseMax((ours.b - theirs.b).cwiseAbs());
        gravity = gravity.cwiseMax((ours.gravity - theirs.gravity).cwiseAbs());
        largestBias = largestBias.cwiseMax(theirs.b.cwiseAbs());
        largestGravity = largestGravity.cwiseMax(theirs.gravity.cwiseAbs());
        position = std::max(position, (ours.tool.position - theirs.tool.position).norm());
        farthest = std::max(farthest, theirs.tool.position.norm());
        // By matrices: q and -q are one orientation.
        worst.orientation =
            std::max(worst.orientation,
                     (ours.tool.orientation.toRotationMatrix() - theirs.tool.orientation.toRotationMatrix()).norm() /
                         std::sqrt(2.0));
    }
    for (int i = 0; i < n; ++i) {
        worst.bias = std::max(worst.bias, divide(bias[i], largestBias[i]));
        // A joint with a vertical axis: what is left of gravity there is rounding of the joint's whole torque.
        worst.gravity = std::max(worst.gravity, divide(gravity[i], std::max(largestGravity[i], largestBias[i])));
    }
    worst.position = divide(position, farthest);
    return worst;
}

void print(const RobotDescription& robot, const char* what, const Difference& d) {
    std::printf("  %s, %s, %d states, seed %llu: M %.1e, b %.1e, gravity %.1e, position %.1e, orientation %.1e\n",
                robot.name.c_str(), what, kStates, static_cast<unsigned long long>(kSeed), d.inertia, d.bias, d.gravity,
                d.position, d.orientation);
}

/** Whether a wrong description differs from MuJoCo's, or is not even accepted (a product of inertia with the wrong sign may
belong to no body). */
bool isNoticed(const RobotDescription& wrong, MujocoModel& other) {
    try {
        return compare(wrong, other).largest() > kTolerance;
    } catch (const std::exception&) {
        return true;
    }
}

class Mujoco : public ::testing::TestWithParam<std::filesystem::path> {};

TEST_P(Mujoco, AgreesOnInertiaTorqueAndToolPose) {
    const RobotDescription robot = loadLinks(GetParam());
    MujocoModel other(findUrdf(robot));
    ASSERT_EQ(other.size(), robot.size());
    for (int i = 0; i < robot.size(); ++i)
        ASSERT_EQ(other.jointName(i), robot.jointNames()[static_cast<std::size_t>(i)]);
    const Difference read = compare(robot, other);
    print(robot, "as read", read);
    EXPECT_LE(read.largest(), kReadTolerance);
    other.sharpenInertia();
    const Difference exact = compare(robot, other);
    print(robot, "exact tensors", exact);
    EXPECT_LE(exact.largest(), kTolerance);
}

/** The comparison sees what it is for: a figure of one joint that is a little off, one product of inertia with the wrong
sign. */
TEST_P(Mujoco, NoticesAWrongFigure) {
    const RobotDescription robot = loadLinks(GetParam());
    MujocoModel other(findUrdf(robot));
    other.sharpenInertia();
    for (std::size_t i = 0; i < robot.joints.size(); ++i) {
        const std::string& name = robot.joints[i].name;
        RobotDescription wrong = robot;
        wrong.joints[i].body.inertia *= 1.0 + 1e-4;
        EXPECT_TRUE(isNoticed(wrong, other)) << name << ": inertia";
        wrong = robot;
        wrong.joints[i].body.com.x() += 1e-4;
        EXPECT_TRUE(isNoticed(wrong, other)) << name << ": centre of mass";
        wrong = robot;
        wrong.joints[i].placement.rotate(Eigen::AngleAxisd(1e-6, Eigen::Vector3d::Ones().normalized()));
        EXPECT_TRUE(isNoticed(wrong, other)) << name << ": placement";
        if (i == 0) continue;  // the first body turns about one axis only: most of its products play no role
        for (int row = 0; row < 3; ++row)
            for (int column = row + 1; column < 3; ++column) {
                wrong = robot;
                double& product = wrong.joints[i].body.inertia(row, column);
                if (std::abs(product) < 1e-12) continue;  // none, but for the rounding of a turned frame
                product = -product;
                wrong.joints[i].body.inertia(column, row) = product;
                EXPECT_TRUE(isNoticed(wrong, other)) << name << ": product " << row << column;
            }
    }
}

std::string getName(const ::testing::TestParamInfo<std::filesystem::path>& info) {
    return info.param.filename().string();
}

INSTANTIATE_TEST_SUITE_P(Robots, Mujoco, ::testing::ValuesIn(listRobots({VIABLE_SOURCE_DIR "/robots"})), getName);

}  // namespace
}  // namespace viable
