#include "realtime/LatencyHistogram.h"

#include <nlohmann/json.hpp>

namespace viable {

void LatencyHistogram::merge(const LatencyHistogram& other) {
    if (other.count_ == 0) return;
    for (std::size_t i = 0; i < kBuckets; ++i) counts_[i] += other.counts_[i];
    sum_ns_ += other.sum_ns_;
    if (count_ == 0 || other.smallest_ns_ < smallest_ns_) smallest_ns_ = other.smallest_ns_;
    if (count_ == 0 || other.worst_ns_ > worst_ns_) {
        worst_ns_ = other.worst_ns_;
        worstTick_ = other.worstTick_;
    }
    count_ += other.count_;
}

double LatencyHistogram::calcQuantile_ns(double share) const {
    if (count_ == 0) return 0.0;
    const double wanted = std::ceil(std::clamp(share, 0.0, 1.0) * static_cast<double>(count_));
    const auto rank = std::clamp<std::int64_t>(static_cast<std::int64_t>(wanted), 1, count_);
    std::int64_t passed = 0;
    std::size_t i = 0;
    while ((passed += counts_[i]) < rank) ++i;
    const std::int64_t width = getLower_ns(i + 1) - getLower_ns(i);
    const double middle = static_cast<double>(getLower_ns(i)) + 0.5 * static_cast<double>(width - 1);
    const double longest = static_cast<double>(worst_ns_);
    if (i == kBuckets - 1) return longest;  // of this one only the worst is known
    return std::clamp(middle, static_cast<double>(smallest_ns_), longest);
}

nlohmann::json LatencyHistogram::toJson() const {
    nlohmann::json json = {{"count", count_}};
    if (count_ == 0) return json;
    json["mean_us"] = 1e-3 * calcMean_ns();
    json["p50_us"] = 1e-3 * calcQuantile_ns(0.5);
    json["p99_us"] = 1e-3 * calcQuantile_ns(0.99);
    json["p999_us"] = 1e-3 * calcQuantile_ns(0.999);
    json["worst_us"] = 1e-3 * static_cast<double>(worst_ns_);
    json["worst_tick"] = worstTick_ == kNoTick ? nlohmann::json(nullptr) : nlohmann::json(worstTick_);
    nlohmann::json& buckets = json["buckets_us"] = nlohmann::json::array();
    visitBuckets([&](std::int64_t lower_ns, std::int64_t upper_ns, std::int64_t count) {
        buckets.push_back({1e-3 * static_cast<double>(lower_ns), 1e-3 * static_cast<double>(upper_ns), count});
    });
    return json;
}

}  // namespace viable
