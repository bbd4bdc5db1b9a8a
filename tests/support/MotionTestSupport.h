#pragma once

#include <Eigen/Dense>
#include <random>

#include "Effort.h"
#include "viable/core/JointLimits.h"

namespace viable {

/** Acceleration limits -Ad..Au [rad/s^2] and jerk limits -Jd..Ju [rad/s^3], no others. */
inline AxisLimits makeLimits(double Ad, double Au, double Jd, double Ju) {
    return {-kInfinity, kInfinity, -kInfinity, kInfinity, -Ad, Au, -Jd, Ju};
}

inline double drawUniform(std::mt19937_64& random, double low, double high) {
    return std::uniform_real_distribution<>(low, high)(random);
}

/** Log-uniform. */
inline double drawLog(std::mt19937_64& random, double low, double high) {
    return low * std::pow(high / low, drawUniform(random, 0.0, 1.0));
}

inline AxisLimits drawLimits(std::mt19937_64& random) {
    const double Ad = drawLog(random, 0.1, 30), Au = drawLog(random, 0.1, 30);
    const double Jd = drawLog(random, 1, 300), Ju = drawLog(random, 1, 300);
    return makeLimits(Ad, Au, Jd, Ju);
}

/** A symmetric positive definite M whose condition number is `condition`, either in general
directions or, as a wrist's, mostly by the scales of the joints. */
inline JointMatrix drawMatrix(std::mt19937_64& random, int n, double condition) {
    std::normal_distribution<> normal;
    Eigen::MatrixXd draw(n, n);
    for (double& x : draw.reshaped()) x = normal(random);
    const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(draw).householderQ();
    Eigen::VectorXd eigenvalues(n);
    for (double& x : eigenvalues) x = std::pow(condition, -drawUniform(random, 0, 1));
    eigenvalues[0] = 1.0;
    if (n > 1) eigenvalues[n - 1] = 1.0 / condition;
    if (random() % 2 == 0) return Q * eigenvalues.asDiagonal() * Q.transpose();
    const Eigen::VectorXd root = eigenvalues.cwiseSqrt();
    Eigen::MatrixXd correlation = 0.4 * Q * Q.col(0).asDiagonal() * Q.transpose();
    correlation.diagonal().array() += 1.0;
    return root.asDiagonal() * correlation * root.asDiagonal();
}

}  // namespace viable
