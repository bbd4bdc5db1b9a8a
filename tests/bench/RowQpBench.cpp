#include "qp/RowQp.h"

#include <Eigen/LU>
#include <cmath>
#include <random>

#include "ArmMatrices.h"
#include "LeastDistance.h"
#include "Quadprog.h"
#include "viable/qp/BoxQp.h"

// RowQp beside what there is otherwise: the same problem without its rows by BoxQp (what the rows
// cost), and with them by least distance programming (Lawson and Hanson 1974, on Eigen's QR; it
// takes memory) and by quadprog (Goldfarb and Idnani 1983).

namespace viable {
namespace {

constexpr int kProblems = 64;
constexpr int kRows = 16;

struct Problem {
    JointMatrix M;
    JointVector target, lower, upper;
    RowQp::Rows rows;
};

/** Jerks of an arm (37 rad/s^3) in a box around the optimum that acts at one joint, with 16 rows of
which `acting` hold with equality. Made from the optimum: pressures chosen, so that the target is
known. */
std::vector<Problem> makeProblems(int n, int acting) {
    constexpr double kJerk = 37.7;
    std::mt19937_64 random(1000 * n + acting);
    std::uniform_real_distribution<> uniform(0.1, 1.0);
    std::normal_distribution<> normal;
    std::vector<Problem> problems;
    for (const JointMatrix& M : makeArmMatrices(n, kProblems)) {
        const Eigen::MatrixXd A = M.transpose() * M;
        Problem p{M, JointVector(n), JointVector(n), JointVector(n), {}};
        JointVector x(n), gradient = JointVector::Zero(n);
        for (int i = 0; i < n; ++i) {
            x[i] = kJerk * (2.0 * uniform(random) - 1.0);
            p.lower[i] = x[i] - kJerk * uniform(random);
            p.upper[i] = x[i] + kJerk * uniform(random);
        }
        p.upper[n / 2] = x[n / 2];
        gradient[n / 2] = -uniform(random) * std::sqrt(A(n / 2, n / 2));
        for (int k = 0; k < kRows; ++k) {
            JointVector row(n);
            for (double& entry : row) entry = normal(random);
            p.rows.add(row, row.dot(x) - (k < acting ? 0.0 : kJerk * uniform(random)));
            if (k < acting) gradient += uniform(random) * row;
        }
        JointVector d = A.fullPivLu().solve(Eigen::VectorXd(gradient));
        p.target = x - d * (kJerk / d.cwiseAbs().maxCoeff());
        problems.push_back(p);
    }
    return problems;
}

void runRowQp(benchmark::State& state, int n, int acting) {
    const std::vector<Problem> problems = makeProblems(n, acting);
    RowQp qp;
    JointVector x;
    int most = 0;
    for (const Problem& p : problems) {
        if (qp.solve(p.M, p.target, p.lower, p.upper, p.rows, x) != RowQp::Status::Solved)
            return state.SkipWithError("not solved");
        most = std::max(most, qp.iterations());
    }
    timeSolver(state, n, problems, [&](const Problem& p) {
        qp.solve(p.M, p.target, p.lower, p.upper, p.rows, x);
        return x.data();
    });
    state.counters["worst_iterations"] = most;
}

void runBoxQp(benchmark::State& state, int n, int acting) {
    const std::vector<Problem> problems = makeProblems(n, acting);
    BoxQp qp;
    JointVector x;
    timeSolver(state, n, problems, [&](const Problem& p) {
        qp.solve(p.M, p.target, p.lower, p.upper, x);
        return x.data();
    });
}

JointVector solveLeastDistance(const Problem& p) {
    const int n = static_cast<int>(p.target.size());
    Eigen::MatrixXd normals(2 * n + p.rows.count, n);
    Eigen::VectorXd bounds(normals.rows());
    normals.topRows(n).setIdentity();
    normals.middleRows(n, n) = -Eigen::MatrixXd::Identity(n, n);
    bounds.head(n) = p.lower;
    bounds.segment(n, n) = -p.upper;
    for (int k = 0; k < p.rows.count; ++k) {
        normals.row(2 * n + k) = p.rows.normal[k].transpose();
        bounds[2 * n + k] = p.rows.bound[k];
    }
    const Eigen::PartialPivLU<Eigen::MatrixXd> factor(p.M);
    const Eigen::MatrixXd G = normals * factor.inverse();
    const LeastDistance<double> solution(G, bounds - normals * p.target);
    return p.target + factor.solve(solution.y);
}

void runLeastDistance(benchmark::State& state, int n, int acting) {
    const std::vector<Problem> problems = makeProblems(n, acting);
    RowQp qp;
    JointVector x;
    for (const Problem& p : problems) {
        qp.solve(p.M, p.target, p.lower, p.upper, p.rows, x);
        if (!((solveLeastDistance(p) - x).norm() < 1e-6 * x.norm()))
            return state.SkipWithError("another optimum than RowQp's");
    }
    timeSolver(state, n, problems, [&](const Problem& p) {
        x = solveLeastDistance(p);
        return x.data();
    });
}

/** By quadprog, with D = M'M and d made before the clock starts; it is given copies, as it overwrites what it gets. */
void runQuadprog(benchmark::State& state, int n, int acting) {
    const int rows = 2 * n + kRows;
    std::vector<QuadprogProblem> given;
    RowQp qp;
    JointVector expected;
    for (const Problem& p : makeProblems(n, acting)) {
        QuadprogProblem g{p.M.transpose() * p.M, Eigen::MatrixXd(n, rows), {}, Eigen::VectorXd(rows), {}};
        g.d = g.D * p.target;
        g.normals.leftCols(2 * n) << Eigen::MatrixXd::Identity(n, n), -Eigen::MatrixXd::Identity(n, n);
        g.bounds.head(2 * n) << p.lower, -p.upper;
        for (int k = 0; k < kRows; ++k) {
            g.normals.col(2 * n + k) = p.rows.normal[k];
            g.bounds[2 * n + k] = p.rows.bound[k];
        }
        qp.solve(p.M, p.target, p.lower, p.upper, p.rows, expected);
        g.expected = expected;
        given.push_back(g);
    }
    timeQuadprog(state, n, rows, given, "RowQp's");
}

bool registerAll() {
    const auto add = [](const char* name, auto* run, int n, int acting) {
        const std::string full = std::string(name) + "/n:" + std::to_string(n) + "/rows:" + std::to_string(kRows) +
                                 "/acting:" + std::to_string(acting);
        benchmark::RegisterBenchmark(full.c_str(), run, n, acting);
    };
    for (const int n : {6, 7})
        for (const int acting : {1, 3}) {
            add("row_qp", runRowQp, n, acting);
            add("box_qp_without_rows", runBoxQp, n, acting);
            add("least_distance", runLeastDistance, n, acting);
            add("quadprog_rows", runQuadprog, n, acting);
        }
    for (int n = 1; n <= kMaxJoints; ++n)
        if (n != 6 && n != 7) add("row_qp", runRowQp, n, n / 2);
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
