#pragma once

#include <Eigen/Core>
#include <vector>

namespace viable::detail {

/** A symmetric positive definite matrix with many zeros, factored as L D L' by SuiteSparse's LDL in AMD's order. */
class SparseLdl {
public:
    /** Takes the places of the entries of `pattern` that are not zero. */
    explicit SparseLdl(const Eigen::MatrixXd& pattern);
    /** False where `matrix`, of that pattern, is not positive definite to rounding. */
    bool factor(const Eigen::MatrixXd& matrix);
    /** After factor(). */
    Eigen::VectorXd solve(const Eigen::VectorXd& right) const;

private:
    int n_;
    std::vector<int> order_, columns_, rows_;  // of the permuted upper triangle
    std::vector<int> factorColumns_, parent_, counts_, factorRows_;
    std::vector<double> factorValues_, diagonal_;
};

/** One equation: the coefficients that are not zero, ascending by index. */
struct SparseRow {
    std::vector<int> index;
    std::vector<double> value;
    void add(int i, double v) {
        index.push_back(i);
        value.push_back(v);
    }
};

/** Weighted least squares of equations that come in blocks, and how the solution changes without each block. */
class BlockRegression {
public:
    /** A column that the data determine less than this, with all columns at length 1, is not determined. */
    static constexpr double kLeastInformation = 1e-7;

    /** @param extras  further columns, each looked at as if it alone were added */
    BlockRegression(int parameters, int blocks, int extras = 0);

    void add(int block, double weight, const SparseRow& row, double residual);
    /** An equation's entry in an extra column; with the same arguments as add(). */
    void addExtra(int extra, double value, int block, double weight, const SparseRow& row, double residual);

    struct Solution {
        Eigen::VectorXd step;              ///< of the parameters
        Eigen::MatrixXd deletions;         ///< column b: change of the parameters without block b
        Eigen::VectorXd information;       ///< of each parameter beside all others, 0 to 1
        std::vector<double> extraFactor;   ///< of each extra column
        std::vector<double> extraError;    ///< its standard error
        std::vector<double> extraSquares;  ///< weighted sum of squares that it would explain
    };
    /** @param withErrors  not the step alone */
    Solution solve(bool withErrors) const;

private:
    struct Extra {
        Eigen::MatrixXd cross;              // column b: X'z of block b
        std::vector<double> squares, with;  // z'z and z'r of each block
    };
    int n_, blocks_;
    std::vector<Eigen::MatrixXd> normal_;    // X'X of each block
    std::vector<Eigen::VectorXd> gradient_;  // X'r of each block
    std::vector<Extra> extras_;
};

/** (B - 1) / B times the sum of squares of a jackknife's changes. */
Eigen::MatrixXd calcJackknifeCovariance(const Eigen::MatrixXd& deletions);

/** Two-sided quantiles: P(|x| <= quantile) = level. */
double calcNormalQuantile(double level);
/** Of Student's t (Cornish-Fisher series, 1 % for 4 degrees of freedom, better for more). */
double calcStudentQuantile(double level, int degrees);

}  // namespace viable::detail
