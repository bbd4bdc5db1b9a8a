#pragma once

#include <random>

#include "Paths.h"
#include "RobotFolder.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** A chain of kMaxJoints joints, every third of them prismatic, with two branches: the largest tree there may be. */
inline void makeLargestTree(RobotFolder& folder) {
    folder.urdf = "<robot name='arm'>\n<link name='l0'/>\n";
    for (int i = 1; i <= kMaxJoints; ++i) {
        const std::string parent = "l" + std::to_string(i == 6 || i == 12 ? 3 : i - 1);
        const std::string child = "l" + std::to_string(i);
        folder.urdf +=
            makeJoint("j" + std::to_string(i), i % 3 == 0 ? "prismatic" : "revolute", parent, child,
                      "xyz='0.1 0.0" + std::to_string(i) + " 0.05' rpy='0." + std::to_string(i) + " -0.7 1.1'",
                      i % 4 == 0   ? "0 0 -1"
                      : i % 4 == 1 ? "0 0 1"
                                   : "1 -2 0.5") +
            makeLink(child, 1.0 + 0.1 * i, "0.03 -0.02 0.04", "0.1 0.2 0.3", kSomeInertia);
    }
    folder.urdf += "</robot>\n";
    folder.limits = std::string(kSomeLimits) + "tool_link: l16\n";
}

/** The robot of the project that is called so, or one for tests, with rotors; the base of that may hang on a wall.
@param gravity  of an arm for tests [m/s^2] */
inline RobotDescription loadSampleArm(const std::string& name, const Eigen::Vector3d& gravity = {0.0, 0.0, -9.81}) {
    const std::filesystem::path shipped = std::filesystem::path(VIABLE_SOURCE_DIR "/robots") / name;
    if (std::filesystem::exists(shipped)) return loadRobot(shipped);
    RobotFolder folder;
    if (name == "simple") makeSimpleArm(folder);
    if (name == "slanted") makeSlantedArm(folder);
    if (name == "branched") makeBranchedArm(folder);
    if (name == "largest") makeLargestTree(folder);
    RobotFolder::replace(folder.actuation, "rotor_inertia_kgm2: 0", "rotor_inertia_kgm2: 0.05");
    RobotDescription robot = folder.load();
    robot.gravity = gravity;
    return robot;
}

/** Tests of an arm in random states. */
struct SampleArmTest : ::testing::Test {
    SampleArmTest(RobotDescription robot, std::uint64_t seed, DynamicsEngine engine)
        : robot_(std::move(robot)), n_(robot_.size()), model_(robot_, engine), random_(seed) {}

    JointVector draw(double bound) {
        std::uniform_real_distribution<double> uniform(-bound, bound);
        JointVector v(n_);
        for (double& x : v) x = uniform(random_);
        return v;
    }
    /** By the engine of the suite. */
    Dynamics calc(const JointVector& q, const JointVector& qd) {
        Dynamics dynamics;
        model_.calcDynamics(q, qd, dynamics);
        return dynamics;
    }

    RobotDescription robot_;
    int n_;
    RobotModel model_;
    std::mt19937_64 random_;
};

}  // namespace viable
