#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "viable/analysis/Smoothing.h"

// Time of a smoothing with bands over the number of samples: one joint at 1 kHz, 18 bit, one count of noise.

namespace viable {
namespace {

void smoothing(benchmark::State& state) {
    const auto n = static_cast<std::size_t>(state.range(0));
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    const double count = 2.0 * M_PI / 262144.0;
    std::vector<double> times_s(n), readings(n);
    for (std::size_t i = 0; i < n; ++i) {
        times_s[i] = 1e-3 * static_cast<double>(i);
        const double t = times_s[i];
        const double q = std::sin(2.0 * t) + 0.2 * std::sin(9.0 * t) + 0.02 * std::sin(31.0 * t);
        readings[i] = std::round((q + count * normal(random)) / count) * count;
    }
    for (auto _ : state) {
        const SmoothedMotion motion = smoothMotion(times_s, readings, "benchmark");
        double sum = 0.0;
        for (const double t : times_s) sum += motion.evaluate(t).deviation[3];  // a band at each sample
        benchmark::DoNotOptimize(sum);
    }
    state.SetComplexityN(state.range(0));
    state.counters["us_per_sample"] = benchmark::Counter(
        static_cast<double>(n) * 1e-6, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(smoothing)
    ->RangeMultiplier(10)
    ->Range(1000, 1000000)
    ->Unit(benchmark::kMillisecond)
    ->Complexity(benchmark::oN);

}  // namespace
}  // namespace viable
