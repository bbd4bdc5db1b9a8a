#include "viable/robot/Dynamics.h"

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

namespace {

/** x = M^-1 x by L D L^T; kSize is the number of joints where it is known when compiling, so that the loops unroll, else
0. False: M is not positive definite. */
template <int kSize>
bool solve(const JointMatrix& M, JointVector& x) {
    constexpr int kCapacity = kSize > 0 ? kSize : kMaxJoints;
    const int n = kSize > 0 ? kSize : static_cast<int>(x.size());
    double L[kCapacity][kCapacity], pivot[kCapacity], y[kCapacity];  // columns of L D, then of L
    for (int j = 0; j < n; ++j)
        for (int i = j; i < n; ++i) L[j][i] = M(i, j);
    for (int i = 0; i < n; ++i) y[i] = x[i];
    for (int j = 0; j < n; ++j) {
        if (!(L[j][j] > 0.0)) return false;
        pivot[j] = 1.0 / L[j][j];
        for (int i = j + 1; i < n; ++i) {
            const double share = L[j][i] * pivot[j];
            for (int k = i; k < n; ++k) L[i][k] -= share * L[j][k];
            y[i] -= share * y[j];
        }
    }
    for (int j = n - 1; j >= 0; --j) {
        double sum = y[j];
        for (int i = j + 1; i < n; ++i) sum -= L[j][i] * y[i];
        y[j] = sum * pivot[j];
    }
    for (int i = 0; i < n; ++i) x[i] = y[i];
    return true;
}

}  // namespace

bool calcForwardDynamics(const Dynamics& dynamics, const JointVector& torque, JointVector& qdd) {
    if (!torque.allFinite() || !dynamics.b.allFinite() || !dynamics.M.allFinite()) return false;
    // Cut off already here, so that the substitutions below cannot overflow.
    qdd = torque.cwiseMax(-kLargestAcceleration).cwiseMin(kLargestAcceleration) - dynamics.b;
    const bool isSolved = qdd.size() == 6   ? solve<6>(dynamics.M, qdd)
                          : qdd.size() == 7 ? solve<7>(dynamics.M, qdd)
                                            : solve<0>(dynamics.M, qdd);
    if (!isSolved) return false;
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
