#include "viable/motion/BoxQp.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <random>

namespace viable {
namespace {

using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
using LongVector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

/** The optimum by trying all 3^n active sets in long double; independent of the solver. */
JointVector solveByEnumeration(const JointMatrix& M, const JointVector& target,
                               const JointVector& lower, const JointVector& upper) {
    const int n = static_cast<int>(target.size());
    const LongMatrix H = M.cast<long double>().transpose() * M.cast<long double>();
    long double best = std::numeric_limits<long double>::infinity();
    LongVector bestX = LongVector::Zero(n);
    int sets = 1;
    for (int i = 0; i < n; ++i) sets *= 3;
    for (int set = 0; set < sets; ++set) {
        std::vector<int> free;
        LongVector d = LongVector::Zero(n);
        for (int i = 0, rest = set; i < n; ++i, rest /= 3) {
            if (rest % 3 == 0) free.push_back(i);
            if (rest % 3 == 1) d[i] = static_cast<long double>(lower[i]) - target[i];
            if (rest % 3 == 2) d[i] = static_cast<long double>(upper[i]) - target[i];
        }
        const int m = static_cast<int>(free.size());
        if (m > 0) {
            LongMatrix A(m, m);
            LongVector b(m);
            const LongVector g = H * d;
            for (int r = 0; r < m; ++r) {
                b[r] = -g[free[r]];
                for (int c = 0; c < m; ++c) A(r, c) = H(free[r], free[c]);
            }
            const LongVector y = A.ldlt().solve(b);
            for (int r = 0; r < m; ++r) d[free[r]] = y[r];
        }
        bool inside = true;
        for (int i = 0; i < n; ++i) {
            const long double x = d[i] + target[i];
            inside &= x >= lower[i] - 1e-12L && x <= upper[i] + 1e-12L;
        }
        const long double value = d.dot(H * d);
        if (inside && value < best) {
            best = value;
            bestX = d + target.cast<long double>();
        }
    }
    return bestX.cast<double>();
}

struct Problem {
    JointMatrix M;
    JointVector target, lower, upper;
};

/** M symmetric positive definite with condition number up to `condition`; boxes around and beside
 * the target. */
Problem drawProblem(std::mt19937_64& random, int n, double condition) {
    std::normal_distribution<> normal;
    std::uniform_real_distribution<> uniform;
    Problem p;
    p.M.resize(n, n);
    for (int i = 0; i < n * n; ++i) p.M(i) = normal(random);
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(Eigen::MatrixXd(p.M));
    const Eigen::MatrixXd Q = qr.householderQ();
    Eigen::VectorXd eigen(n);
    for (int i = 0; i < n; ++i) eigen[i] = std::pow(condition, -uniform(random));
    p.M = Q * eigen.asDiagonal() * Q.transpose();
    p.target.resize(n);
    p.lower.resize(n);
    p.upper.resize(n);
    for (int i = 0; i < n; ++i) {
        p.target[i] = 40 * normal(random);
        const double a = 40 * normal(random), b = 40 * normal(random);
        p.lower[i] = std::min(a, b);
        p.upper[i] = std::max(a, b);
    }
    return p;
}

TEST(BoxQp, AgreesWithEnumerationOfAllActiveSets) {
    std::mt19937_64 random(11);
    BoxQp qp;
    int worstRounds = 0;
    double worst = 0.0;
    for (int k = 0; k < 3000; ++k) {
        const int n = 1 + k % 6;
        const double condition = std::pow(10.0, k % 5);  // of M; of M'M up to 1e8
        const Problem p = drawProblem(random, n, condition);
        JointVector x;
        const BoxQp::Status status = qp.solve(p.M, p.target, p.lower, p.upper, x);
        ASSERT_NE(status, BoxQp::Status::RoundLimit);
        worstRounds = std::max(worstRounds, qp.rounds());
        const JointVector reference = solveByEnumeration(p.M, p.target, p.lower, p.upper);
        ASSERT_TRUE((x.array() >= p.lower.array()).all() && (x.array() <= p.upper.array()).all());
        worst = std::max(worst, (x - reference).cwiseAbs().maxCoeff());
        ASSERT_LT((x - reference).cwiseAbs().maxCoeff(), 1e-6) << "problem " << k << ", n " << n;
    }
    RecordProperty("worst_difference", std::to_string(worst));
    RecordProperty("worst_rounds", worstRounds);
}

TEST(BoxQp, TargetInsideComesBackBitForBit) {
    std::mt19937_64 random(12);
    BoxQp qp;
    for (int k = 0; k < 1000; ++k) {
        Problem p = drawProblem(random, 6, 100);
        p.lower = p.lower.cwiseMin(p.target);
        p.upper = p.upper.cwiseMax(p.target);
        JointVector x;
        ASSERT_EQ(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::TargetInside);
        ASSERT_EQ(x, p.target);
    }
}

TEST(BoxQp, FixedJointsAndOpenBoundsWork) {
    std::mt19937_64 random(13);
    BoxQp qp;
    for (int k = 0; k < 1000; ++k) {
        Problem p = drawProblem(random, 6, 1000);
        p.lower[2] = p.upper[2];  // an empty interval replaced by one point
        p.lower[4] = -std::numeric_limits<double>::infinity();
        p.upper[5] = std::numeric_limits<double>::infinity();
        JointVector x;
        ASSERT_NE(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::RoundLimit);
        ASSERT_EQ(x[2], p.upper[2]);
        // Optimality, checked by the definition: no small step inside the box lowers the objective.
        const double value = (p.M * (x - p.target)).norm();
        for (int i = 0; i < 6; ++i) {
            for (double step : {-1e-3, 1e-3}) {
                JointVector y = x;
                y[i] = std::min(std::max(y[i] + step, p.lower[i]), p.upper[i]);
                ASSERT_GE((p.M * (y - p.target)).norm(), value - 1e-10);
            }
        }
    }
}

TEST(BoxQp, SixteenJointsStayWithinTheRoundBound) {
    std::mt19937_64 random(14);
    BoxQp qp;
    int worst = 0;
    for (int k = 0; k < 20000; ++k) {
        const Problem p = drawProblem(random, 16, 1e4);
        JointVector x;
        ASSERT_NE(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::RoundLimit);
        worst = std::max(worst, qp.rounds());
    }
    RecordProperty("worst_rounds", worst);
    EXPECT_LE(worst, BoxQp::kMaxRounds);
}

}  // namespace
}  // namespace viable
