#include "analysis/smoothing/BandedLdl.h"

#include <array>
#include <cmath>

namespace viable::detail {

BandedLdl::BandedLdl(std::size_t blocks, std::vector<double> storage) : blocks_(blocks), band_(std::move(storage)) {
    if (band_.capacity() < size() * kBand) band_ = {};  // never both at once
    band_.clear();
    band_.resize(size() * kBand);  // zeros, many at a time
}

void BandedLdl::addPair(std::size_t first, const Eigen::Matrix<double, kBand, kBand>& values) {
    const std::size_t origin = kBlock * first;
    for (std::size_t column = 0; column < kBand; ++column)
        for (std::size_t row = column; row < kBand; ++row)
            upd(origin + row, origin + column) += values(static_cast<int>(row), static_cast<int>(column));
}

bool BandedLdl::factor() {
    std::array<double, kBand> row{};
    for (std::size_t j = 0; j < size(); ++j) {
        const std::size_t begin = rowBegin(j);
        for (std::size_t i = begin; i < j; ++i) row[i - begin] = get(j, i);
        double own = get(j, j);
        for (std::size_t i = begin; i < j; ++i) {
            const double y = row[i - begin];
            for (std::size_t k = i + 1; k < j; ++k) row[k - begin] -= get(k, i) * y;
            const double share = y / get(i, i);
            own -= share * y;
            upd(j, i) = share;
        }
        upd(j, j) = own;
        if (!(own > 0.0 && std::isfinite(own))) return false;
    }
    return true;
}

double BandedLdl::calcLogDeterminant() const {
    double sum = 0.0;
    for (std::size_t j = 0; j < size(); ++j) sum += std::log(get(j, j));
    return sum;
}

void BandedLdl::solve(std::vector<double>& x) const {
    for (std::size_t j = 0; j < size(); ++j) {
        const double own = x[j];
        for (std::size_t i = j + 1, end = columnEnd(j); i < end; ++i) x[i] -= get(i, j) * own;
    }
    for (std::size_t j = 0; j < size(); ++j) x[j] /= get(j, j);
    for (std::size_t j = size(); j-- > 0;) {
        double own = x[j];  // in a register: through memory each term would wait for the one before
        for (std::size_t i = j + 1, end = columnEnd(j); i < end; ++i) own -= get(i, j) * x[i];
        x[j] = own;
    }
}

void BandedLdl::calcInverseBand() {
    std::array<double, kBand> column{};
    for (std::size_t j = size(); j-- > 0;) {
        const std::size_t end = columnEnd(j);
        for (std::size_t i = j; i < end; ++i) column[i - j] = get(i, j);
        double own = 1.0 / column[0];
        for (std::size_t i = j + 1; i < end; ++i) {
            double sum = 0.0;
            for (std::size_t k = j + 1; k < end; ++k) sum -= getInverse(i, k) * column[k - j];
            upd(i, j) = sum;
            own -= sum * column[i - j];
        }
        upd(j, j) = own;
    }
}

}  // namespace viable::detail
