#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace viable::detail {

/** A symmetric positive definite matrix of 4x4 blocks, only those on and beside the diagonal, factored as L D L' by
SuiteSparse's LDL; any solution, its determinant, and the entries of its inverse at the same places.

The order of the unknowns is kept: each column of L holds the rest of its block and the next one, and no other order
has less fill. Cost and memory grow with the number of blocks. */
class BandedLdl {
public:
    static constexpr int kBlock = 4;
    /** Entries of a column from the diagonal down: the rest of its block and the whole next one. */
    static constexpr int kBand = 2 * kBlock;

    explicit BandedLdl(std::size_t blocks);

    std::size_t size() const { return kBlock * blocks_; }

    void setZero();
    /** Adds to the 8x8 part that begins at block `first`, which is not the last one. */
    void addPair(std::size_t first, const Eigen::Matrix<double, kBand, kBand>& values);
    /** Entry (row, column) with row >= column, both at most kBand - 1 apart within neighbouring blocks. */
    double& upd(std::size_t row, std::size_t column) { return matrix_[column * kBand + (row - column)]; }

    /** False where the matrix is not positive definite to rounding; then nothing below may be asked. */
    bool factor();
    double calcLogDeterminant() const;
    /** In place. */
    void solve(std::vector<double>& x) const;
    /** The inverse's entries in the band, by Takahashi's recursion (Takahashi, Fagan and Chin 1973). */
    void calcInverseBand();
    double getInverse(std::size_t row, std::size_t column) const {
        return row >= column ? inverse_[column * kBand + (row - column)] : inverse_[row * kBand + (column - row)];
    }

private:
    /** Rows of column `j` in the lower triangle end before this. */
    std::size_t columnEnd(std::size_t j) const {
        const std::size_t end = kBlock * (j / kBlock + 2);
        return end < size() ? end : size();
    }

    std::size_t blocks_;
    std::vector<double> matrix_;        // lower band, by columns
    std::vector<double> inverse_;       // likewise
    std::vector<long> columns_, rows_;  // the upper triangle's pattern, by columns: what LDL reads
    std::vector<double> values_;
    std::vector<long> factorColumns_, factorRows_, parent_, counts_, flag_, pattern_;
    std::vector<double> factorValues_, diagonal_, work_;
};

}  // namespace viable::detail
