#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <numeric>

namespace viable {

/** Counts times of a loop (lateness of its wake-ups, computing, round trips) in fixed memory.
Method: buckets of 1 ns below 64 ns; above, 32 of equal width per power of two, up to 2^40 ns (18 minutes; longer times
are counted in the last bucket). A quantile is the middle of its bucket: at most 1.6 % from the sample of that rank.
Count, mean, smallest and worst are exact.
Real time: add() allocates, locks and throws nothing, and takes a few ns. Thread: one caller at a time. */
class LatencyHistogram {
public:
    static constexpr std::int64_t kNoTick = -1;

    /** @param time_ns  below 0 it counts as 0 @param tick  number of the tick it was in; told of the worst */
    void add(std::int64_t time_ns, std::int64_t tick = kNoTick) {
        if (time_ns < 0) time_ns = 0;
        ++counts_[getBucket(time_ns)];
        sum_ns_ += static_cast<double>(time_ns);
        if (count_ == 0 || time_ns < smallest_ns_) smallest_ns_ = time_ns;
        if (count_ == 0 || time_ns > worst_ns_) {
            worst_ns_ = time_ns;
            worstTick_ = tick;
        }
        ++count_;
    }
    /** The same for a time as logs have it; NaN counts as 0. */
    void add_us(double time_us) {
        add(time_us > 0.0 ? static_cast<std::int64_t>(std::llround(1e3 * std::min(time_us, 1e12))) : 0);
    }
    /** Adds all that another one has counted. Of two equally bad worst times this one's tick stays. */
    void merge(const LatencyHistogram& other);

    std::int64_t count() const { return count_; }
    // All below are 0 (worstTick(): kNoTick) while nothing has been counted.
    double calcMean_ns() const { return count_ > 0 ? sum_ns_ / static_cast<double>(count_) : 0.0; }
    std::int64_t smallest_ns() const { return smallest_ns_; }
    std::int64_t worst_ns() const { return worst_ns_; }
    /** The tick of the worst time, the first one where several were as bad. */
    std::int64_t worstTick() const { return worstTick_; }
    /** The sample with rank ceil(share * count), so that at least this share is no longer. @param share  0 to 1: 0.5 is
    the median, 0.999 p99.9 @return [ns] within 1.6 %, never above worst_ns() or below smallest_ns() */
    double calcQuantile_ns(double share) const;
    double calcQuantile_us(double share) const { return 1e-3 * calcQuantile_ns(share); }
    double worst_us() const { return static_cast<double>(worst_ns_) / 1e3; }

    /** Calls visit(lower_ns, upper_ns, count) for every bucket that is not empty, upwards; a time t is in it where
    lower_ns <= t < upper_ns (the last one has no upper end). */
    template <class Visit>
    void visitBuckets(Visit&& visit) const {
        for (std::size_t i = 0; i < kBuckets; ++i)
            if (counts_[i] > 0) visit(getLower_ns(i), getLower_ns(i + 1), counts_[i]);
    }
    /** The same for four buckets per power of two, all from the first to the last that is not empty. */
    template <class Visit>
    void visitCoarseBuckets(Visit&& visit) const {
        if (count_ == 0) return;
        const std::size_t last = getBucket(worst_ns_) / kCoarse;
        for (std::size_t i = getBucket(smallest_ns_) / kCoarse; i <= last; ++i) {
            const auto begin = counts_.begin() + static_cast<std::ptrdiff_t>(i * kCoarse);
            visit(getLower_ns(i * kCoarse), getLower_ns((i + 1) * kCoarse),
                  std::accumulate(begin, begin + kCoarse, std::int64_t{0}));
        }
    }
    /** {"count", "mean_us", "p50_us", "p99_us", "p999_us", "worst_us", "worst_tick", "buckets_us": [[lower, upper, count],
    ...]}; times in microseconds, worst_tick null where no tick was told. Nothing counted: {"count": 0}. */
    nlohmann::json toJson() const;

private:
    static constexpr int kFineBits = 5;                                 // 32 buckets per power of two
    static constexpr std::size_t kCoarse = 8;                           // of them are one coarse bucket
    static constexpr std::size_t kExact = std::size_t{2} << kFineBits;  // 64 buckets of 1 ns
    static constexpr int kLastBit = 40;                                 // longest time told apart: 2^40 ns
    static constexpr std::size_t kBuckets = kExact + (std::size_t{kLastBit - kFineBits - 1} << kFineBits);

    static std::size_t getBucket(std::int64_t time_ns) {
        const auto time = static_cast<std::uint64_t>(time_ns);
        if (time < kExact) return static_cast<std::size_t>(time);
        const int shift =
            63 - __builtin_clzll(time) - kFineBits;  // what is left of `time` has 6 bits, the first one set
        const std::size_t bucket =
            (static_cast<std::size_t>(shift) << kFineBits) + static_cast<std::size_t>(time >> shift);
        return bucket < kBuckets ? bucket : kBuckets - 1;
    }
    static std::int64_t getLower_ns(std::size_t bucket) {
        if (bucket < kExact) return static_cast<std::int64_t>(bucket);
        const std::size_t shift = (bucket >> kFineBits) - 1;
        return static_cast<std::int64_t>((bucket - (shift << kFineBits)) << shift);
    }

    std::array<std::int64_t, kBuckets> counts_{};
    std::int64_t count_ = 0, smallest_ns_ = 0, worst_ns_ = 0, worstTick_ = kNoTick;
    double sum_ns_ = 0.0;
};

}  // namespace viable
