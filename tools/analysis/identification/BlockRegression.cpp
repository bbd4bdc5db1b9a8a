#include "analysis/identification/BlockRegression.h"

#include <algorithm>
#include <cmath>

#include "viable/core/Error.h"

extern "C" {
#include <amd.h>
#include <ldl.h>
}

namespace viable::detail {

SparseLdl::SparseLdl(const Eigen::MatrixXd& pattern) : n_(static_cast<int>(pattern.rows())) {
    const auto n = static_cast<std::size_t>(n_);
    std::vector<int> columns(1, 0), rows;
    for (int j = 0; j < n_; ++j) {
        for (int i = 0; i < n_; ++i)
            if (i == j || pattern(i, j) != 0.0) rows.push_back(i);
        columns.push_back(static_cast<int>(rows.size()));
    }
    order_.resize(n);
    VIABLE_CHECK(amd_order(n_, columns.data(), rows.data(), order_.data(), nullptr, nullptr) >= AMD_OK,
                 "an order of a square pattern");
    columns_.assign(1, 0);
    for (int j = 0; j < n_; ++j) {
        for (int i = 0; i <= j; ++i)
            if (i == j || pattern(order_[i], order_[j]) != 0.0) rows_.push_back(i);
        columns_.push_back(static_cast<int>(rows_.size()));
    }
    factorColumns_.resize(n + 1);
    parent_.resize(n);
    counts_.resize(n);
    std::vector<int> flag(n);
    ldl_symbolic(n_, columns_.data(), rows_.data(), factorColumns_.data(), parent_.data(), counts_.data(), flag.data(),
                 nullptr, nullptr);
    factorRows_.resize(static_cast<std::size_t>(factorColumns_.back()));
    factorValues_.resize(factorRows_.size());
    diagonal_.resize(n);
}

bool SparseLdl::factor(const Eigen::MatrixXd& matrix) {
    const auto n = static_cast<std::size_t>(n_);
    std::vector<double> values;
    for (std::size_t j = 0; j < n; ++j)
        for (int k = columns_[j]; k < columns_[j + 1]; ++k) values.push_back(matrix(order_[rows_[k]], order_[j]));
    std::vector<double> work(n);
    std::vector<int> pattern(n), flag(n);
    const int done = ldl_numeric(n_, columns_.data(), rows_.data(), values.data(), factorColumns_.data(),
                                 parent_.data(), counts_.data(), factorRows_.data(), factorValues_.data(),
                                 diagonal_.data(), work.data(), pattern.data(), flag.data(), nullptr, nullptr);
    return done == n_ && std::all_of(diagonal_.begin(), diagonal_.end(), [](double d) { return d > 0.0; });
}

Eigen::VectorXd SparseLdl::solve(const Eigen::VectorXd& right) const {
    std::vector<double> x(static_cast<std::size_t>(n_));
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = right[order_[i]];
    // LDL's arguments are not const, and it does not write them.
    auto* const columns = const_cast<int*>(factorColumns_.data());
    auto* const rows = const_cast<int*>(factorRows_.data());
    auto* const values = const_cast<double*>(factorValues_.data());
    ldl_lsolve(n_, x.data(), columns, rows, values);
    ldl_dsolve(n_, x.data(), const_cast<double*>(diagonal_.data()));
    ldl_ltsolve(n_, x.data(), columns, rows, values);
    Eigen::VectorXd result(n_);
    for (std::size_t i = 0; i < x.size(); ++i) result[order_[i]] = x[i];
    return result;
}

BlockRegression::BlockRegression(int parameters, int blocks, int extras)
    : n_(parameters),
      blocks_(blocks),
      normal_(static_cast<std::size_t>(blocks), Eigen::MatrixXd::Zero(parameters, parameters)),
      gradient_(static_cast<std::size_t>(blocks), Eigen::VectorXd::Zero(parameters)),
      extras_(static_cast<std::size_t>(extras),
              Extra{Eigen::MatrixXd::Zero(parameters, blocks), std::vector<double>(normal_.size(), 0.0),
                    std::vector<double>(normal_.size(), 0.0)}) {}

void BlockRegression::add(int block, double weight, const SparseRow& row, double residual) {
    Eigen::MatrixXd& normal = normal_[block];
    Eigen::VectorXd& gradient = gradient_[block];
    for (std::size_t a = 0; a < row.index.size(); ++a) {
        gradient[row.index[a]] += weight * row.value[a] * residual;
        for (std::size_t b = 0; b < row.index.size(); ++b)
            normal(row.index[a], row.index[b]) += weight * row.value[a] * row.value[b];
    }
}

void BlockRegression::addExtra(int extra, double value, int block, double weight, const SparseRow& row,
                               double residual) {
    Extra& e = extras_[extra];
    for (std::size_t a = 0; a < row.index.size(); ++a) e.cross(row.index[a], block) += weight * row.value[a] * value;
    e.squares[block] += weight * value * value;
    e.with[block] += weight * value * residual;
}

BlockRegression::Solution BlockRegression::solve(bool withErrors) const {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n_, n_);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(n_);
    for (std::size_t b = 0; b < normal_.size(); ++b) {
        normal += normal_[b];
        gradient += gradient_[b];
    }
    // All columns at length 1: then the least that keeps an undetermined one at rest is the same for all.
    Eigen::VectorXd scale(n_);
    for (int i = 0; i < n_; ++i) scale[i] = normal(i, i) > 0.0 ? 1.0 / std::sqrt(normal(i, i)) : 1.0;
    // Far above the rounding of sums of many rows, far below kLeastInformation.
    constexpr double kRest = 1e-9;
    const auto makeScaled = [&](const Eigen::MatrixXd& m) -> Eigen::MatrixXd {
        Eigen::MatrixXd scaled = scale.asDiagonal() * m * scale.asDiagonal();
        scaled.diagonal().array() += kRest;
        return scaled;
    };
    SparseLdl ldl(normal);
    // Positive semidefinite up to rounding, plus kRest: only nonsense in the rows lets this fail.
    VIABLE_CHECK(ldl.factor(makeScaled(normal)), "normal equations have a factor");
    const auto solve = [&](const Eigen::VectorXd& right) -> Eigen::VectorXd {
        return scale.cwiseProduct(ldl.solve(scale.cwiseProduct(right)));
    };
    Solution solution;
    solution.step = solve(gradient);
    if (!withErrors) return solution;

    solution.information.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const double own = ldl.solve(Eigen::VectorXd::Unit(n_, i))[i];
        solution.information[i] = normal(i, i) > 0.0 && own > 0.0 ? 1.0 / own : 0.0;
    }
    // An extra column beside all others: its part that they do not explain (Frisch, Waugh and Lovell).
    const auto count = extras_.size();
    solution.extraFactor.assign(count, 0.0);
    solution.extraError.assign(count, 0.0);
    solution.extraSquares.assign(count, 0.0);
    std::vector<Eigen::VectorXd> cross(count);
    std::vector<double> squares(count, 0.0), with(count, 0.0);
    const auto calcFactor = [&](const Eigen::VectorXd& z, double zz, double zr, const Eigen::VectorXd& g,
                                double& left) {
        const Eigen::VectorXd explained = solve(z);
        left = zz - z.dot(explained);
        return left > kLeastInformation * zz ? (zr - explained.dot(g)) / left : 0.0;
    };
    for (std::size_t e = 0; e < count; ++e) {
        cross[e] = extras_[e].cross.rowwise().sum();
        for (std::size_t b = 0; b < normal_.size(); ++b) {
            squares[e] += extras_[e].squares[b];
            with[e] += extras_[e].with[b];
        }
        double left = 0.0;
        solution.extraFactor[e] = calcFactor(cross[e], squares[e], with[e], gradient, left);
        solution.extraSquares[e] = std::max(0.0, left) * solution.extraFactor[e] * solution.extraFactor[e];
    }

    solution.deletions.resize(n_, blocks_);
    for (std::size_t b = 0; b < normal_.size(); ++b) {
        const int column = static_cast<int>(b);
        VIABLE_CHECK(ldl.factor(makeScaled(normal - normal_[b])), "normal equations without a block have a factor");
        const Eigen::VectorXd rest = gradient - gradient_[b];
        solution.deletions.col(column) = solve(rest) - solution.step;
        for (std::size_t e = 0; e < count; ++e) {
            double left = 0.0;
            const double without =
                calcFactor(cross[e] - extras_[e].cross.col(column), squares[e] - extras_[e].squares[b],
                           with[e] - extras_[e].with[b], rest, left);
            const double change = without - solution.extraFactor[e];
            solution.extraError[e] += change * change;
        }
    }
    for (double& error : solution.extraError) error = std::sqrt(error * (blocks_ - 1.0) / blocks_);
    return solution;
}

Eigen::MatrixXd calcJackknifeCovariance(const Eigen::MatrixXd& deletions) {
    const double blocks = static_cast<double>(deletions.cols());
    return (blocks - 1.0) / blocks * (deletions * deletions.transpose());
}

double calcNormalQuantile(double level) {
    double x = 1.0;
    for (int i = 0; i < 50; ++i) {
        const double slope = std::sqrt(2.0 / M_PI) * std::exp(-0.5 * x * x);
        const double step = (std::erfc(x / M_SQRT2) - (1.0 - level)) / slope;
        x = std::clamp(x + step, 0.5 * x, x + 1.0);
        if (std::abs(step) < 1e-12) break;
    }
    return x;
}

double calcStudentQuantile(double level, int degrees) {
    const double z = calcNormalQuantile(level), n = degrees, z2 = z * z;
    // Abramowitz and Stegun, 26.7.5.
    return z + z * (z2 + 1.0) / (4.0 * n) + z * ((5.0 * z2 + 16.0) * z2 + 3.0) / (96.0 * n * n) +
           z * (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / (384.0 * n * n * n);
}

}  // namespace viable::detail
