#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

namespace viable::detail {

/** A symmetric positive definite matrix of 4x4 blocks, only those on and beside the diagonal, factored as L D L' row by
row; any solution, its determinant, and the entries of its inverse at the same places.

The order of the unknowns is kept: each column of L holds the rest of its block and the next one, and no other order
has less fill. Cost and memory grow with the number of blocks. The matrix, its factor and its inverse take each other's
place: what a long record needs is kBand numbers per unknown. */
class BandedLdl {
public:
    static constexpr int kBlock = 4;
    /** Entries of a column from the diagonal down: the rest of its block and the whole next one. */
    static constexpr int kBand = 2 * kBlock;

    /** @param storage  taken over: of another one that is no longer needed, as fresh memory costs as much as a factor */
    explicit BandedLdl(std::size_t blocks, std::vector<double> storage = {});

    /** Its numbers' memory, for another one; only destruction may follow. */
    std::vector<double> releaseStorage() { return std::move(band_); }

    std::size_t size() const { return kBlock * blocks_; }

    // Of the matrix, before factor().
    /** Adds to the 8x8 part that begins at block `first`, which is not the last one. */
    void addPair(std::size_t first, const Eigen::Matrix<double, kBand, kBand>& values);
    /** Entry (row, column) with row >= column, both at most kBand - 1 apart within neighbouring blocks. */
    double& upd(std::size_t row, std::size_t column) { return band_[column * kBand + (row - column)]; }

    /** In place of the matrix. False where it is not positive definite to rounding; then nothing below may be asked. */
    bool factor();
    double calcLogDeterminant() const;
    /** In place. */
    void solve(std::vector<double>& x) const;

    /** The inverse's entries in the band, by Takahashi's recursion (Takahashi, Fagan and Chin 1973), in place of the
    factor: of the rest, only getInverse() may be asked from now on. */
    void calcInverseBand();
    double getInverse(std::size_t row, std::size_t column) const {
        return row >= column ? get(row, column) : get(column, row);
    }

private:
    double get(std::size_t row, std::size_t column) const { return band_[column * kBand + (row - column)]; }
    /** Rows of column `j` in the lower triangle end before this. */
    std::size_t columnEnd(std::size_t j) const { return std::min(kBlock * (j / kBlock + 2), size()); }
    /** Columns of row `j` in the lower triangle begin here. */
    static std::size_t rowBegin(std::size_t j) { return j < kBlock ? 0 : kBlock * (j / kBlock - 1); }

    std::size_t blocks_;
    std::vector<double> band_;  // lower, by columns: of the matrix, then L with D on its diagonal, then the inverse
};

}  // namespace viable::detail
