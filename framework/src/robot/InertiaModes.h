#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "viable/core/JointTypes.h"

namespace viable::detail {

/** The modes of K x = lambda M x for an inertia matrix M > 0 and K = diag(weight) >= 0, lambda ascending: for joint
dampings the rates [1/s] at which speeds die away, for joint stiffnesses the squared frequencies [(rad/s)^2].
Found as those of S^T S with S = L^-1 sqrt(K), M = L L^T; the vectors are sqrt(K) x.
@param options  Eigen::ComputeEigenvectors, or without the vectors */
inline Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> findModes(const JointMatrix& M, const JointVector& weight,
                                                                int options = Eigen::EigenvaluesOnly) {
    const JointVector root = weight.cwiseSqrt();
    const JointMatrix scaled = M.llt().matrixL().solve(JointMatrix(root.asDiagonal()));
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(scaled.transpose() * scaled, options);
}

}  // namespace viable::detail
