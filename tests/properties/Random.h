#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>

namespace viable {

/** Numbers that follow from a seed and the number of an arm alone, so that any arm can be repeated without those before
it. */
class Random {
public:
    Random(std::uint64_t seed, std::int64_t arm) {
        const auto high = [](std::uint64_t x) { return static_cast<std::uint32_t>(x >> 32); };
        const auto low = [](std::uint64_t x) { return static_cast<std::uint32_t>(x); };
        const auto number = static_cast<std::uint64_t>(arm);
        std::seed_seq words{low(seed), high(seed), low(number), high(number)};
        engine_.seed(words);
    }
    double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }
    double logUniform(double a, double b) { return std::exp(uniform(std::log(a), std::log(b))); }
    int integer(int a, int b) { return std::uniform_int_distribution<int>(a, b)(engine_); }
    /** Of length 1. */
    Eigen::Vector3d direction() {
        Eigen::Vector3d v;
        do {
            for (double& x : v) x = uniform(-1.0, 1.0);
        } while (!(v.norm() >= 0.1 && v.norm() <= 1.0));
        return v.normalized();
    }
    bool chance(double p) { return uniform(0.0, 1.0) < p; }

private:
    std::mt19937_64 engine_;
};

}  // namespace viable
