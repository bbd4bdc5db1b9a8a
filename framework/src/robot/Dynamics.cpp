#include "viable/robot/Dynamics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace viable {

bool isFinite(const Dynamics& d, int n) {
    return d.M.rows() == n && d.M.cols() == n && d.J.cols() == n && isFinite(d.b, n) && isFinite(d.gravity, n) &&
           d.M.allFinite() && d.J.allFinite() && d.tool.position.allFinite() && d.tool.orientation.coeffs().allFinite();
}

double calcLeverArm(const ToolJacobian& J) {
    const double turning = J.bottomRows<3>().norm(), moving = J.topRows<3>().norm();
    return turning > 0.0 && moving > 1e-9 * turning ? moving / turning : 1.0;
}

bool calcForwardDynamics(const Dynamics& dynamics, const JointVector& torque, JointVector& qdd) {
    if (!torque.allFinite() || !dynamics.b.allFinite() || !dynamics.M.allFinite()) return false;
    const Eigen::LLT<JointMatrix> factor(dynamics.M);
    if (factor.info() != Eigen::Success) return false;
    // Cut off already here, so that the substitutions below cannot overflow.
    qdd = torque.cwiseMax(-kLargestAcceleration).cwiseMin(kLargestAcceleration) - dynamics.b;
    factor.solveInPlace(qdd);
    for (double& x : qdd) {
        if (std::isnan(x)) return false;
        x = std::min(std::max(x, -kLargestAcceleration), kLargestAcceleration);
    }
    return true;
}

void calcInverseDynamics(const Dynamics& dynamics, const JointVector& qdd, JointVector& torque) {
    torque = dynamics.b;
    torque.noalias() += dynamics.M.lazyProduct(qdd);
}

}  // namespace viable
