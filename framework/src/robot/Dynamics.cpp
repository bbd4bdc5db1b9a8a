#include "viable/robot/Dynamics.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace viable {

bool isFinite(const Dynamics& d, int n) {
    return d.M.rows() == n && d.M.cols() == n && d.J.cols() == n && isFinite(d.b, n) &&
           isFinite(d.gravity, n) && d.M.allFinite() && d.J.allFinite() &&
           d.tool.position.allFinite() && d.tool.orientation.coeffs().allFinite();
}

bool calcForwardDynamics(const Dynamics& dynamics, const JointVector& torque, JointVector& qdd) {
    const Eigen::LLT<JointMatrix> factor(dynamics.M);
    if (factor.info() != Eigen::Success) return false;
    qdd = torque - dynamics.b;
    factor.solveInPlace(qdd);
    for (double& x : qdd)  // written so that NaN, from infinities of both signs, is cut off too
        x = x < kLargestAcceleration ? std::max(x, -kLargestAcceleration) : kLargestAcceleration;
    return true;
}

void calcInverseDynamics(const Dynamics& dynamics, const JointVector& qdd, JointVector& torque) {
    torque = dynamics.b;
    torque.noalias() += dynamics.M.lazyProduct(qdd);
}

}  // namespace viable
