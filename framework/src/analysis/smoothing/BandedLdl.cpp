#include "analysis/smoothing/BandedLdl.h"

#include <algorithm>
#include <array>
#include <cmath>

extern "C" {
#include <ldl.h>
}

namespace viable::detail {

static_assert(sizeof(SuiteSparse_long) == sizeof(long), "LDL's long integers are this program's");

BandedLdl::BandedLdl(std::size_t blocks)
    : blocks_(blocks),
      matrix_(size() * kBand),
      inverse_(),
      columns_(size() + 1),
      factorColumns_(size() + 1),
      parent_(size()),
      counts_(size()),
      flag_(size()),
      pattern_(size()),
      diagonal_(size()),
      work_(size()) {
    // Column j of the upper triangle: the block before, and its own block down to the diagonal.
    rows_.reserve(size() * kBand);
    for (std::size_t j = 0; j < size(); ++j) {
        const std::size_t block = j / kBlock;
        for (std::size_t i = block == 0 ? 0 : kBlock * (block - 1); i <= j; ++i) rows_.push_back(static_cast<long>(i));
        columns_[j + 1] = static_cast<long>(rows_.size());
    }
    values_.resize(rows_.size());
    ldl_l_symbolic(static_cast<long>(size()), columns_.data(), rows_.data(), factorColumns_.data(), parent_.data(),
                   counts_.data(), flag_.data(), nullptr, nullptr);
    factorRows_.resize(static_cast<std::size_t>(factorColumns_.back()));
    factorValues_.resize(factorRows_.size());
}

void BandedLdl::setZero() {
    std::fill(matrix_.begin(), matrix_.end(), 0.0);
}

void BandedLdl::addPair(std::size_t first, const Eigen::Matrix<double, kBand, kBand>& values) {
    const std::size_t origin = kBlock * first;
    for (std::size_t column = 0; column < kBand; ++column)
        for (std::size_t row = column; row < kBand; ++row)
            upd(origin + row, origin + column) += values(static_cast<int>(row), static_cast<int>(column));
}

bool BandedLdl::factor() {
    for (std::size_t j = 0; j < size(); ++j)
        for (long k = columns_[j]; k < columns_[j + 1]; ++k)
            values_[static_cast<std::size_t>(k)] = upd(j, static_cast<std::size_t>(rows_[static_cast<std::size_t>(k)]));
    const long done =
        ldl_l_numeric(static_cast<long>(size()), columns_.data(), rows_.data(), values_.data(), factorColumns_.data(),
                      parent_.data(), counts_.data(), factorRows_.data(), factorValues_.data(), diagonal_.data(),
                      work_.data(), pattern_.data(), flag_.data(), nullptr, nullptr);
    if (done != static_cast<long>(size())) return false;
    return std::all_of(diagonal_.begin(), diagonal_.end(), [](double d) { return d > 0.0 && std::isfinite(d); });
}

double BandedLdl::calcLogDeterminant() const {
    double sum = 0.0;
    for (const double d : diagonal_) sum += std::log(d);
    return sum;
}

void BandedLdl::solve(std::vector<double>& x) const {
    // LDL reads its arguments only, but does not say so.
    auto* columns = const_cast<long*>(factorColumns_.data());
    auto* rows = const_cast<long*>(factorRows_.data());
    auto* values = const_cast<double*>(factorValues_.data());
    const long n = static_cast<long>(size());
    ldl_l_lsolve(n, x.data(), columns, rows, values);
    ldl_l_dsolve(n, x.data(), const_cast<double*>(diagonal_.data()));
    ldl_l_ltsolve(n, x.data(), columns, rows, values);
}

void BandedLdl::calcInverseBand() {
    inverse_.assign(size() * kBand, 0.0);
    std::array<double, kBand> column{};
    for (std::size_t j = size(); j-- > 0;) {
        const std::size_t end = columnEnd(j);
        column.fill(0.0);
        for (long k = factorColumns_[j]; k < factorColumns_[j + 1]; ++k)
            column[static_cast<std::size_t>(factorRows_[static_cast<std::size_t>(k)]) - j] =
                factorValues_[static_cast<std::size_t>(k)];
        double own = 1.0 / diagonal_[j];
        for (std::size_t i = j + 1; i < end; ++i) {
            double sum = 0.0;
            for (std::size_t k = j + 1; k < end; ++k) sum -= getInverse(i, k) * column[k - j];
            inverse_[j * kBand + (i - j)] = sum;
            own -= sum * column[i - j];
        }
        inverse_[j * kBand] = own;
    }
}

}  // namespace viable::detail
