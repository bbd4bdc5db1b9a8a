#include "ArmMatrices.h"
#include "Paths.h"

#include <Eigen/QR>
#include <cmath>
#include <random>

#include "viable/robot/RobotModel.h"

namespace viable {

namespace {

std::vector<JointMatrix> makeIndy7Matrices(int count) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    RobotModel model(robot);
    std::mt19937_64 random(1);
    std::uniform_real_distribution<> angle(-EIGEN_PI, EIGEN_PI);
    std::vector<JointMatrix> matrices;
    const JointVector qd = JointVector::Zero(robot.size());
    for (int k = 0; k < count; ++k) {
        JointVector q(robot.size());
        for (double& x : q) x = angle(random);
        Dynamics dynamics;
        model.calcDynamics(q, qd, dynamics);
        matrices.push_back(dynamics.M);
    }
    return matrices;
}

}  // namespace

std::vector<JointMatrix> makeArmMatrices(int n, int count) {
    if (n == 6) return makeIndy7Matrices(count);
    std::mt19937_64 random(n);
    std::normal_distribution<> normal;
    std::vector<JointMatrix> matrices;
    for (int k = 0; k < count; ++k) {
        Eigen::MatrixXd draw(n, n);
        for (double& x : draw.reshaped()) x = normal(random);
        const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(draw).householderQ();
        // Eigenvalues from 10 kg m^2 (first joint) down to 0.01 kg m^2 (last).
        Eigen::VectorXd eigenvalues(n);
        for (int i = 0; i < n; ++i) eigenvalues[i] = 10.0 * std::pow(1e-3, n > 1 ? i / (n - 1.0) : 0);
        matrices.push_back(Q * eigenvalues.asDiagonal() * Q.transpose());
    }
    return matrices;
}

}  // namespace viable
