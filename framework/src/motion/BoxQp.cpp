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

/** The state of the dual active-set method: joints on a bound (`side` -1 or +1), the others free,
`d` the optimum for that set, every joint on a bound pressing against it. */
struct ActiveSet {
    const Square& A;
    const double* lo;
    const double* hi;
    int n;
    signed char* side;
    double d[kMaxJoints] = {};

    double calcGradient(int i, const double* v) const {
        double sum = 0.0;
        for (int k = 0; k < n; ++k) sum += A[i][k] * v[k];
        return sum;
    }

    /** d for the present set. False when the free block is not positive definite. */
    bool solve() {
        int free[kMaxJoints], m = 0;
        for (int i = 0; i < n; ++i) {
            if (side[i] == 0)
                free[m++] = i;
            else
                d[i] = side[i] < 0 ? lo[i] : hi[i];
        }
        double rhs[kMaxJoints], y[kMaxJoints];
        for (int k = 0; k < m; ++k) {
            rhs[k] = 0.0;
            for (int i = 0; i < n; ++i)
                if (side[i] != 0) rhs[k] -= A[free[k]][i] * d[i];
        }
        if (m > 0 && !solveFree(A, free, m, rhs, y)) return false;
        for (int k = 0; k < m; ++k) d[free[k]] = y[k];
        return true;
    }

    double calcTolerance() const {
        double largest = 0.0;
        for (int i = 0; i < n; ++i) largest = std::max(largest, std::abs(d[i]));
        return BoxQp::kKktTolerance * largest;
    }

    /** Frees the joints that pull away from their bound; true when there were any. */
    bool dropReleased() {
        bool dropped = false;
        for (int i = 0; i < n; ++i) {
            if (side[i] != 0 && side[i] * calcGradient(i, d) > 0.0) {
                side[i] = 0;
                dropped = true;
            }
        }
        return dropped;
    }

    /** The free joint farthest outside its box, or -1. */
    int findWorst() const {
        int worst = -1;
        double excess = calcTolerance();
        for (int i = 0; i < n; ++i) {
            if (side[i] != 0) continue;
            const double e = std::max(lo[i] - d[i], d[i] - hi[i]);
            if (e > excess) {
                excess = e;
                worst = i;
            }
        }
        return worst;
    }

    /** Moves free joint `joint` towards the bound that it violates, the joints on a bound held.
    Either it arrives (`added`), or another joint lets go of its bound first and is freed. */
    bool stepTowards(int joint, bool& added) {
        const bool below = d[joint] < lo[joint];
        const double s = below ? 1.0 : -1.0;
        int free[kMaxJoints], m = 0;
        double rhs[kMaxJoints], y[kMaxJoints], z[kMaxJoints] = {};
        for (int i = 0; i < n; ++i)
            if (side[i] == 0) {
                rhs[m] = i == joint ? s : 0.0;
                free[m++] = i;
            }
        if (!solveFree(A, free, m, rhs, y)) return false;
        for (int k = 0; k < m; ++k) z[free[k]] = y[k];

        const double missing = below ? lo[joint] - d[joint] : d[joint] - hi[joint];
        double length = missing / (s * z[joint]);
        int released = -1;
        for (int i = 0; i < n; ++i) {
            if (side[i] == 0) continue;
            const double pressure = -side[i] * calcGradient(i, d);  // >= 0
            const double rate = -side[i] * calcGradient(i, z);
            if (rate < 0.0 && std::max(pressure, 0.0) < -rate * length) {
                length = std::max(pressure, 0.0) / -rate;
                released = i;
            }
        }
        for (int i = 0; i < n; ++i) d[i] += length * z[i];
        if (released >= 0)
            side[released] = 0;
        else
            side[joint] = below ? -1 : 1;
        added = released < 0;
        return true;
    }

    /** Coordinate descent from the clamped target: every step lowers the objective inside the box.
     */
    void descend() {
        for (int i = 0; i < n; ++i) d[i] = std::min(std::max(0.0, lo[i]), hi[i]);
        for (int sweep = 0; sweep < BoxQp::kMaxRounds; ++sweep)
            for (int i = 0; i < n; ++i)
                d[i] = std::min(std::max(d[i] - calcGradient(i, d), lo[i]), hi[i]);
    }
};

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
    for (int i = 0; i < n; ++i) {
        scale[i] = 1.0 / M.col(i).norm();
        if (!(scale[i] > 0.0) || !std::isfinite(scale[i])) {  // M is singular or beyond arithmetic
            reset();
            return Status::RoundLimit;
        }
    }
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j)
            A[i][j] = A[j][i] = i == j ? 1.0 : M.col(i).dot(M.col(j)) * scale[i] * scale[j];
        lo[i] = (lower[i] - target[i]) / scale[i];
        hi[i] = (upper[i] - target[i]) / scale[i];
        if (side_[i] < 0 && !std::isfinite(lo[i])) side_[i] = 0;
        if (side_[i] > 0 && !std::isfinite(hi[i])) side_[i] = 0;
    }
    ActiveSet set{A, lo, hi, n, side_.data()};

    // First guess: the joints that stood on a bound last time, as far as they still press against
    // it.
    bool solvable = true;
    do {
        ++rounds_;
        solvable = set.solve();
    } while (solvable && rounds_ < kMaxRounds && set.dropReleased());

    // Then one violated bound after the other: the dual objective grows with every step, so no set
    // recurs.
    bool solved = false;
    while (solvable && rounds_ < kMaxRounds) {
        const int joint = set.findWorst();
        if (joint < 0) {
            solved = true;
            break;
        }
        bool added = false;
        while (solvable && !added && rounds_ < kMaxRounds) {
            ++rounds_;
            solvable = set.stepTowards(joint, added);
        }
        if (solvable && added) {
            ++rounds_;
            solvable = set.solve();  // anew, so that errors of the steps do not add up
        }
    }

    if (!solved) {
        reset();
        set.descend();
    }
    for (int i = 0; i < n; ++i) {
        double value = target[i] + set.d[i] * scale[i];
        if (std::isnan(value)) value = x[i];  // the clamped target
        x[i] = side_[i] < 0   ? lower[i]
               : side_[i] > 0 ? upper[i]
                              : std::min(std::max(value, lower[i]), upper[i]);
    }
    return solved ? Status::Solved : Status::RoundLimit;
}

}  // namespace viable
