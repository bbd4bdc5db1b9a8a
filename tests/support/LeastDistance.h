#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <vector>

namespace viable {

/** Non-negative least squares: u >= 0 that minimises |E u - f| (Lawson and Hanson 1974, algorithm
23.10). A route to the optimum that shares nothing with the dual active set. */
template <class Scalar>
class NonNegativeLeastSquares {
public:
    using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
    using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

    NonNegativeLeastSquares(const Matrix& E, const Vector& f) : E_(E), f_(f) {
        u_ = Vector::Zero(E.cols());
        const Scalar least = 64 * std::numeric_limits<Scalar>::epsilon() * f.norm();
        std::vector<int> refused;  // by rounding, since u moved last
        for (int steps = 0; steps < 10 * (E.cols() + 1); ++steps) {
            const Vector gain = E_.transpose() * (f_ - E_ * u_);
            int best = -1;
            for (int k = 0; k < E_.cols(); ++k)
                if (!contains(passive_, k) && !contains(refused, k) && gain[k] > least * E_.col(k).norm() &&
                    (best < 0 || gain[k] > gain[best]))
                    best = k;
            if (best < 0) return;
            if (admit(best))
                refused.clear();
            else
                refused.push_back(best);
        }
    }

    const Vector& u() const { return u_; }
    Vector residual() const { return E_ * u_ - f_; }

private:
    static bool contains(const std::vector<int>& list, int k) {
        return std::find(list.begin(), list.end(), k) != list.end();
    }

    Eigen::ColPivHouseholderQR<Matrix> factorPassive() const {
        Matrix columns(E_.rows(), passive_.size());
        for (size_t j = 0; j < passive_.size(); ++j) columns.col(j) = E_.col(passive_[j]).normalized();
        Eigen::ColPivHouseholderQR<Matrix> qr(columns);
        qr.setThreshold(1e3 * std::numeric_limits<Scalar>::epsilon());
        return qr;
    }
    /** The least squares of the passive columns. */
    Vector solvePassive(const Eigen::ColPivHouseholderQR<Matrix>& qr) const {
        Vector s = qr.solve(f_);
        for (size_t j = 0; j < passive_.size(); ++j) s[j] /= E_.col(passive_[j]).norm();
        return s;
    }

    /** Lets column `k` take part and goes to the optimum of all that do; those that would turn
    negative on the way leave. False: its gain was rounding, as it depends on the passive ones or
    its u would be negative at once. */
    bool admit(int k) {
        passive_.push_back(k);
        const auto qr = factorPassive();
        Vector s = solvePassive(qr);
        if (qr.rank() < static_cast<int>(passive_.size()) || !(s[s.size() - 1] > 0)) {
            passive_.pop_back();
            return false;
        }
        while (!(s.array() > 0).all()) {
            Scalar step = 1;
            int leaving = 0;
            for (int j = 0; j < s.size(); ++j) {
                const Scalar u = u_[passive_[j]];
                if (s[j] <= 0 && (s[leaving] > 0 || u < step * (u - s[j]))) {
                    step = u > 0 ? u / (u - s[j]) : 0;
                    leaving = j;
                }
            }
            for (int j = 0; j < s.size(); ++j)
                u_[passive_[j]] = std::max<Scalar>(0, u_[passive_[j]] + step * (s[j] - u_[passive_[j]]));
            u_[passive_[leaving]] = 0;
            passive_.erase(passive_.begin() + leaving);
            if (passive_.empty()) return true;
            s = solvePassive(factorPassive());
        }
        for (int j = 0; j < s.size(); ++j) u_[passive_[j]] = s[j];
        return true;
    }

    const Matrix E_;
    const Vector f_;
    Vector u_;
    std::vector<int> passive_;
};

/** Least distance: y that minimises |y| subject to G y >= h (Lawson and Hanson 1974, algorithm
23.27). `isFeasible` false: no y keeps them, and u >= 0 with G'u = 0, h'u = 1 proves it. */
template <class Scalar>
struct LeastDistance {
    using Least = NonNegativeLeastSquares<Scalar>;
    typename Least::Vector y, u;
    bool isFeasible = true;

    LeastDistance(typename Least::Matrix G, typename Least::Vector h) {
        const int n = static_cast<int>(G.cols()), m = static_cast<int>(G.rows());
        y = Least::Vector::Zero(n);
        if (m == 0) return;
        const typename Least::Vector length = G.rowwise().norm();
        for (int k = 0; k < m; ++k) {
            G.row(k) /= length[k];
            h[k] /= length[k];
        }
        const Scalar size = h.cwiseAbs().maxCoeff();
        if (!(size > 0)) return;
        typename Least::Matrix E(n + 1, m);
        E << G.transpose(), h.transpose() / size;
        const Least least(E, Least::Vector::Unit(n + 1, n));
        const typename Least::Vector r = least.residual();
        u = least.u().cwiseQuotient(length) / size;
        isFeasible = r.norm() > 1e4 * std::numeric_limits<Scalar>::epsilon();
        if (isFeasible) y = size * r.head(n) / -r[n];
    }
};

}  // namespace viable
