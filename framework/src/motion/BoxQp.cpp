#include "viable/motion/BoxQp.h"

#include <algorithm>
#include <cmath>

namespace viable {

namespace {

using Square = double[kMaxJoints][kMaxJoints];

/** Solves A y = rhs for the joints in `free` (indices, count m), A symmetric positive definite with
unit diagonal, by Cholesky with one step of refinement. Returns false when a pivot is not positive.
*/
bool solveFree(const Square& A, const int* free, int m, const double* rhs, double* y) {
    Square L;
    for (int i = 0; i < m; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = A[free[i]][free[j]];
            for (int k = 0; k < j; ++k) sum -= L[i][k] * L[j][k];
            if (i == j) {
                if (!(sum > 0.0)) return false;
                L[i][i] = std::sqrt(sum);
            } else {
                L[i][j] = sum / L[j][j];
            }
        }
    }
    const auto substitute = [&](const double* in, double* out) {
        double z[kMaxJoints];
        for (int i = 0; i < m; ++i) {
            double sum = in[i];
            for (int k = 0; k < i; ++k) sum -= L[i][k] * z[k];
            z[i] = sum / L[i][i];
        }
        for (int i = m - 1; i >= 0; --i) {
            double sum = z[i];
            for (int k = i + 1; k < m; ++k) sum -= L[k][i] * out[k];
            out[i] = sum / L[i][i];
        }
    };
    substitute(rhs, y);
    double residual[kMaxJoints], correction[kMaxJoints];
    for (int i = 0; i < m; ++i) {
        long double sum = rhs[i];
        for (int k = 0; k < m; ++k)
            sum -= static_cast<long double>(A[free[i]][free[k]]) * static_cast<long double>(y[k]);
        residual[i] = static_cast<double>(sum);
    }
    substitute(residual, correction);
    for (int i = 0; i < m; ++i) y[i] += correction[i];
    return true;
}

}  // namespace

BoxQp::Status BoxQp::solve(const JointMatrix& M, const JointVector& target,
                           const JointVector& lower, const JointVector& upper, JointVector& x) {
    const int n = static_cast<int>(target.size());
    rounds_ = 0;
    x = target.cwiseMax(lower).cwiseMin(upper);
    if (x == target) {
        side_.fill(0);
        return Status::TargetInside;
    }

    // In d = (x - target) / scale: minimise d' A d / 2 with A = S M'M S of unit diagonal, lo <= d
    // <= hi.
    Square A;
    double scale[kMaxJoints], lo[kMaxJoints], hi[kMaxJoints];
    for (int i = 0; i < n; ++i) scale[i] = 1.0 / M.col(i).norm();
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j)
            A[i][j] = A[j][i] = i == j ? 1.0 : M.col(i).dot(M.col(j)) * scale[i] * scale[j];
        lo[i] = (lower[i] - target[i]) / scale[i];
        hi[i] = (upper[i] - target[i]) / scale[i];
        if (side_[i] < 0 && !std::isfinite(lo[i])) side_[i] = 0;
        if (side_[i] > 0 && !std::isfinite(hi[i])) side_[i] = 0;
    }

    double d[kMaxJoints] = {};
    int bestCount = n + 1;
    int patience = 3;  // block exchanges allowed without progress before single pivots take over
    bool solved = false;
    while (rounds_ < kMaxRounds) {
        ++rounds_;
        int free[kMaxJoints], m = 0;
        double largest = 0.0;
        for (int i = 0; i < n; ++i) {
            if (side_[i] == 0) {
                free[m++] = i;
            } else {
                d[i] = side_[i] < 0 ? lo[i] : hi[i];
                largest = std::max(largest, std::abs(d[i]));
            }
        }
        double rhs[kMaxJoints], y[kMaxJoints];
        for (int k = 0; k < m; ++k) {
            rhs[k] = 0.0;
            for (int i = 0; i < n; ++i)
                if (side_[i] != 0) rhs[k] -= A[free[k]][i] * d[i];
        }
        if (m > 0 && !solveFree(A, free, m, rhs, y)) break;
        for (int k = 0; k < m; ++k) {
            d[free[k]] = y[k];
            largest = std::max(largest, std::abs(y[k]));
        }

        // What stands on the wrong side: free joints outside the box, fixed ones that want to come
        // off.
        const double tolerance = kKktTolerance * largest;
        signed char wanted[kMaxJoints];
        int count = 0, last = -1;
        for (int i = 0; i < n; ++i) {
            wanted[i] = side_[i];
            if (side_[i] == 0) {
                if (d[i] < lo[i] - tolerance) wanted[i] = -1;
                if (d[i] > hi[i] + tolerance) wanted[i] = 1;
            } else {
                double gradient = 0.0;
                for (int k = 0; k < n; ++k) gradient += A[i][k] * d[k];
                if (side_[i] < 0 ? gradient < -tolerance : gradient > tolerance) wanted[i] = 0;
            }
            if (wanted[i] != side_[i]) {
                ++count;
                last = i;
            }
        }
        if (count == 0) {
            solved = true;
            break;
        }
        if (count < bestCount) {
            bestCount = count;
            patience = 3;
        } else {
            --patience;
        }
        if (patience >= 0) {
            std::copy(wanted, wanted + n, side_.begin());
        } else {
            side_[last] = wanted[last];  // Murty: largest index; cannot cycle on a definite matrix
        }
    }

    if (!solved) {
        // Coordinate descent from the clamped target: every step lowers the objective inside the
        // box.
        for (int i = 0; i < n; ++i) d[i] = std::min(std::max(0.0, lo[i]), hi[i]);
        for (int sweep = 0; sweep < kMaxRounds; ++sweep) {
            for (int i = 0; i < n; ++i) {
                double gradient = 0.0;
                for (int k = 0; k < n; ++k) gradient += A[i][k] * d[k];
                d[i] = std::min(std::max(d[i] - gradient, lo[i]), hi[i]);
            }
        }
    }
    for (int i = 0; i < n; ++i) {
        const double value = target[i] + d[i] * scale[i];
        x[i] = side_[i] < 0   ? lower[i]
               : side_[i] > 0 ? upper[i]
                              : std::min(std::max(value, lower[i]), upper[i]);
        if (!solved) x[i] = std::min(std::max(value, lower[i]), upper[i]);
    }
    if (!solved) reset();
    return solved ? Status::Solved : Status::RoundLimit;
}

}  // namespace viable
