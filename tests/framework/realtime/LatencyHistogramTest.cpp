#include "realtime/LatencyHistogram.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>
#include <vector>

#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

/** The sample of rank ceil(share * count). */
double findQuantile(std::vector<std::int64_t> samples, double share) {
    std::sort(samples.begin(), samples.end());
    const double rank = std::max(1.0, std::ceil(share * static_cast<double>(samples.size())));
    return static_cast<double>(samples[static_cast<std::size_t>(rank) - 1]);
}

TEST(LatencyHistogram, QuantilesAreWithinTheStatedErrorOfTheSorted) {
    std::mt19937_64 random(1);
    for (const double largest_ns : {50.0, 1e3, 1e6, 1e9, 1e12}) {
        std::vector<std::int64_t> samples;
        LatencyHistogram histogram;
        double sum = 0.0;
        for (int k = 0; k < 20001; ++k) {  // as many of every size
            const double exponent = std::uniform_real_distribution<>(0.0, std::log(largest_ns))(random);
            samples.push_back(static_cast<std::int64_t>(std::exp(exponent)));
            histogram.add(samples.back(), k);
            sum += static_cast<double>(samples.back());
        }
        for (const double share : {0.0, 0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
            const double exact = findQuantile(samples, share);
            EXPECT_NEAR(histogram.calcQuantile_ns(share), exact, 0.016 * exact) << share << " of " << largest_ns;
        }
        const auto worst = std::max_element(samples.begin(), samples.end());
        EXPECT_EQ(histogram.worst_ns(), *worst);
        EXPECT_EQ(histogram.worstTick(), worst - samples.begin());
        EXPECT_EQ(histogram.smallest_ns(), *std::min_element(samples.begin(), samples.end()));
        EXPECT_EQ(histogram.count(), 20001);
        EXPECT_NEAR(histogram.calcMean_ns(), sum / 20001.0, 1e-12 * sum);
    }
}

TEST(LatencyHistogram, EveryTimeIsInItsBucketAndBucketsLieSideBySide) {
    std::int64_t last = 0;
    for (std::int64_t time = 0; time < (std::int64_t{1} << 40); time += 1 + time / 100) {
        LatencyHistogram histogram;
        histogram.add(time);
        histogram.visitBuckets([&](std::int64_t lower, std::int64_t upper, std::int64_t count) {
            EXPECT_EQ(count, 1);
            EXPECT_LE(lower, time);
            EXPECT_LT(time, upper);
            EXPECT_LE(upper - lower, std::max<std::int64_t>(1, lower / 32)) << "width at " << time;
            EXPECT_GE(lower, last);
            last = lower;
        });
    }
}

TEST(LatencyHistogram, TimesWithoutEndAndBeforeTheirStartAreCounted) {
    LatencyHistogram histogram;
    histogram.add(INT64_MAX, 7);
    histogram.add(-5, 8);
    EXPECT_EQ(histogram.worst_ns(), INT64_MAX);
    EXPECT_EQ(histogram.worstTick(), 7);
    EXPECT_EQ(histogram.smallest_ns(), 0);
    EXPECT_DOUBLE_EQ(histogram.calcQuantile_ns(1.0), static_cast<double>(INT64_MAX));
    EXPECT_EQ(histogram.calcQuantile_ns(0.5), 0.0);
}

TEST(LatencyHistogram, CoarseBucketsLieSideBySideAndHoldWhatTheFineOnesHold) {
    LatencyHistogram histogram;
    histogram.visitCoarseBuckets([](std::int64_t, std::int64_t, std::int64_t) { FAIL(); });
    for (const double time_us : {0.2, 0.25, 3.0, 3.1, 900.0}) histogram.add_us(time_us);
    histogram.add_us(std::nan(""));
    std::int64_t end = 0, count = 0;
    histogram.visitCoarseBuckets([&](std::int64_t lower_ns, std::int64_t upper_ns, std::int64_t inIt) {
        EXPECT_EQ(lower_ns, end);
        EXPECT_LE(upper_ns, std::max<std::int64_t>(lower_ns * 5 / 4, lower_ns + 8));
        std::int64_t fine = 0;
        histogram.visitBuckets([&](std::int64_t lower, std::int64_t upper, std::int64_t n) {
            if (lower >= lower_ns && upper <= upper_ns) fine += n;
        });
        EXPECT_EQ(inIt, fine);
        end = upper_ns;
        count += inIt;
    });
    EXPECT_EQ(count, 6);
    EXPECT_GT(end, 900'000);
    EXPECT_LT(end, 1'300'000);
    EXPECT_DOUBLE_EQ(histogram.worst_us(), 900.0);
}

TEST(LatencyHistogram, MergedIsAsCountedByOne) {
    std::mt19937_64 random(2);
    LatencyHistogram all, parts[3], merged;
    for (int k = 0; k < 3000; ++k) {
        const auto time = static_cast<std::int64_t>(random() % 1000000);
        all.add(time, k);
        parts[k / 1000].add(time, k);
    }
    merged.merge(LatencyHistogram());
    for (const LatencyHistogram& part : parts) merged.merge(part);
    merged.merge(LatencyHistogram());
    EXPECT_EQ(merged.toJson(), all.toJson());
}

TEST(LatencyHistogram, SaysInJsonWhatItHolds) {
    LatencyHistogram histogram;
    EXPECT_EQ(histogram.toJson(), nlohmann::json({{"count", 0}}));
    EXPECT_EQ(histogram.worstTick(), LatencyHistogram::kNoTick);
    histogram.add(10);
    EXPECT_TRUE(histogram.toJson()["worst_tick"].is_null());
    for (int k = 0; k < 99; ++k) histogram.add(100000, k);
    const nlohmann::json json = histogram.toJson();
    EXPECT_EQ(json["count"], 100);
    EXPECT_EQ(json["worst_us"], 100.0);
    EXPECT_EQ(json["worst_tick"], 0);
    EXPECT_NEAR(json["mean_us"].get<double>(), 99.0001, 1e-9);
    EXPECT_NEAR(json["p50_us"].get<double>(), 100.0, 1.6);
    std::int64_t count = 0;
    for (const auto& bucket : json["buckets_us"]) count += bucket[2].get<std::int64_t>();
    EXPECT_EQ(count, 100);
    EXPECT_EQ(json["buckets_us"].size(), 2u);
}

TEST(LatencyHistogram, AddingTakesNoMemory) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    LatencyHistogram histogram;
    testing::AllocationCounter counter;
    for (int k = 0; k < 1000; ++k) histogram.add(std::int64_t{1} << (k % 63), k);
    EXPECT_GT(histogram.calcQuantile_ns(0.5), 0.0);
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace viable
