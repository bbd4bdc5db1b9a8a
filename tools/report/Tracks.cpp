#include "report/Tracks.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace viable::detail {

namespace {

template <class T, class Join>
void halve(std::vector<T>& values, Join join) {
    for (std::size_t i = 0; 2 * i + 1 < values.size(); ++i) values[i] = join(values[2 * i], values[2 * i + 1]);
    values.resize(values.size() / 2);
}

}  // namespace

void Tracks::add(const std::vector<double>& values) {
    const bool begins = rowsInLast_ == 0;
    if (begins && buckets() == most_) {
        // fmin and fmax take the number where the other is none.
        for (auto& track : least_) halve(track, [](float a, float b) { return std::fmin(a, b); });
        for (auto& track : largest_) halve(track, [](float a, float b) { return std::fmax(a, b); });
        rowsPerBucket_ *= 2;
    }
    for (std::size_t i = 0; i < least_.size(); ++i) {
        const bool fits = std::abs(values[i]) <= std::numeric_limits<float>::max();  // false for NaN
        const float x = fits ? static_cast<float>(values[i]) : std::nanf("");
        if (begins) {
            least_[i].push_back(x);
            largest_[i].push_back(x);
        } else {
            least_[i].back() = std::fmin(least_[i].back(), x);
            largest_[i].back() = std::fmax(largest_[i].back(), x);
        }
    }
    rowsInLast_ = (rowsInLast_ + 1) % rowsPerBucket_;
}

void CodeTracks::add(const std::vector<std::uint16_t>& values) {
    const auto join = [this](std::uint16_t a, std::uint16_t b) {
        return join_ == Join::Union ? static_cast<std::uint16_t>(a | b) : std::max(a, b);
    };
    const bool begins = rowsInLast_ == 0;
    if (begins && !codes_.empty() && codes_.front().size() == most_) {
        for (auto& codes : codes_) halve(codes, join);
        rowsPerBucket_ *= 2;
    }
    for (std::size_t i = 0; i < codes_.size(); ++i) {
        if (begins)
            codes_[i].push_back(values[i]);
        else
            codes_[i].back() = join(codes_[i].back(), values[i]);
    }
    rowsInLast_ = (rowsInLast_ + 1) % rowsPerBucket_;
}

void Samples::add(const std::vector<double>& values) {
    const auto at = [this](std::size_t k) { return data_.begin() + static_cast<std::ptrdiff_t>(k * width_); };
    const bool keepsLargest = keep_ == Keep::Largest;
    if (row_++ % stride_ != 0) {
        if (!keepsLargest || !(static_cast<float>(values[0]) > *at(count() - 1))) return;
        data_.resize(data_.size() - width_);
    } else if (count() == kMaxSamples) {  // even: the row begins a sample of the doubled distance, too
        for (std::size_t k = 0; 2 * k < kMaxSamples; ++k)
            std::copy_n(at(2 * k + (keepsLargest && *at(2 * k + 1) > *at(2 * k) ? 1 : 0)), width_, at(k));
        data_.resize(data_.size() / 2);
        stride_ *= 2;
    }
    for (std::size_t i = 0; i < width_; ++i) data_.push_back(static_cast<float>(values[i]));
}

}  // namespace viable::detail
