#include <benchmark/benchmark.h>

#include <Eigen/Cholesky>

#include "ArmMatrices.h"

// The yardstick: factor A = M'M (given) and solve once.

namespace viable {
namespace {

constexpr int kProblems = 64;

template <class Matrix, class Vector>
void runCholesky(benchmark::State& state, int n) {
    std::vector<Matrix, Eigen::aligned_allocator<Matrix>> matrices;
    for (const JointMatrix& M : makeArmMatrices(n, kProblems)) matrices.push_back(M.transpose() * M);
    const Vector right = Vector::LinSpaced(n, 1.0, 2.0);
    size_t k = 0;
    for (auto _ : state) {
        const Eigen::LLT<Matrix> factor(matrices[k]);
        Vector x = factor.solve(right);
        benchmark::DoNotOptimize(x.data());
        benchmark::ClobberMemory();
        k = (k + 1) % matrices.size();
    }
    state.counters["n"] = n;
}

template <int N>
void registerFixed() {
    benchmark::RegisterBenchmark(("cholesky_fixed/n:" + std::to_string(N)).c_str(),
                                 runCholesky<Eigen::Matrix<double, N, N>, Eigen::Matrix<double, N, 1>>, N);
    benchmark::RegisterBenchmark(("cholesky_joint_matrix/n:" + std::to_string(N)).c_str(),
                                 runCholesky<JointMatrix, JointVector>, N);
}

template <int... kIndex>
bool registerAll(std::integer_sequence<int, kIndex...>) {
    (registerFixed<kIndex + 1>(), ...);
    return true;
}

const bool registered = registerAll(std::make_integer_sequence<int, kMaxJoints>());

}  // namespace
}  // namespace viable
