#pragma once

#include <benchmark/benchmark.h>
#include <dlfcn.h>

#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

namespace viable {

/** The dual active set method of Goldfarb and Idnani (Mathematical Programming 27, 1983) as B. Turlach wrote it: the
Fortran routine of R's package `quadprog` (Debian: r-cran-quadprog), called without R. Dense, double precision, cold. */
class Quadprog {
public:
    /** @param n  unknowns @param rows  inequalities. Throws std::runtime_error when the library is not there. */
    Quadprog(int n, int rows)
        : n_(n),
          rows_(rows),
          solve_(findRoutine()),
          multipliers_(static_cast<std::size_t>(rows)),
          work_(static_cast<std::size_t>(2 * n + std::min(n, rows) * (std::min(n, rows) + 5) / 2 + 2 * rows + 1)),
          active_(static_cast<std::size_t>(rows)) {}

    /** min 1/2 x'Dx - d'x subject to normals' x >= bounds. D and d are overwritten. False: no solution found. */
    bool solve(Eigen::MatrixXd& D, Eigen::VectorXd& d, Eigen::MatrixXd& normals, Eigen::VectorXd& bounds,
               Eigen::VectorXd& x) {
        int equalities = 0, activeCount = 0, iterations[2] = {0, 0}, error = 0;
        double value = 0.0;
        x.resize(n_);
        solve_(D.data(), d.data(), &n_, &n_, x.data(), multipliers_.data(), &value, normals.data(), bounds.data(), &n_,
               &rows_, &equalities, active_.data(), &activeCount, iterations, work_.data(), &error);
        return error == 0;
    }

private:
    using Routine = void (*)(double*, double*, int*, int*, double*, double*, double*, double*, double*, int*, int*,
                             int*, int*, int*, int*, double*, int*);
    static Routine findRoutine() {
        static void* const library =
            ::dlopen("/usr/lib/R/site-library/quadprog/libs/quadprog.so", RTLD_NOW | RTLD_LOCAL);
        void* const routine = library == nullptr ? nullptr : ::dlsym(library, "qpgen2_");
        if (routine == nullptr)
            throw std::runtime_error("quadprog is not installed (Debian: apt-get install r-cran-quadprog)");
        return reinterpret_cast<Routine>(routine);
    }

    int n_, rows_;
    Routine solve_;
    std::vector<double> multipliers_, work_;
    std::vector<int> active_;
};

/** Times `solve`, which gives an optimum of `n` joints, over the problems. */
template <class Problem, class Solve>
void timeSolver(benchmark::State& state, int n, const std::vector<Problem>& problems, const Solve& solve) {
    std::size_t k = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(solve(problems[k]));
        benchmark::ClobberMemory();
        k = (k + 1) % problems.size();
    }
    state.counters["n"] = n;
}

/** A problem for Quadprog, whose solve() overwrites it, and the optimum that ours found. */
struct QuadprogProblem {
    Eigen::MatrixXd D, normals;
    Eigen::VectorXd d, bounds, expected;
};

/** Times it over the problems, whose optima must be the same; `ours` names the other solver. */
inline void timeQuadprog(benchmark::State& state, int n, int rows, const std::vector<QuadprogProblem>& problems,
                         const char* ours) try {
    Quadprog quadprog(n, rows);
    Eigen::VectorXd x;
    QuadprogProblem g;
    for (const QuadprogProblem& problem : problems) {
        g = problem;
        if (!quadprog.solve(g.D, g.d, g.normals, g.bounds, x) || !((x - g.expected).norm() < 1e-6 * g.expected.norm()))
            return state.SkipWithError((std::string("another optimum than ") + ours).c_str());
    }
    timeSolver(state, n, problems, [&](const QuadprogProblem& problem) {
        g = problem;
        quadprog.solve(g.D, g.d, g.normals, g.bounds, x);
        return x.data();
    });
} catch (const std::runtime_error& missing) {
    state.SkipWithError(missing.what());
}

}  // namespace viable
