#include "viable/qp/BoxQp.h"

#include <Eigen/LU>
#include <random>

#include "ArmMatrices.h"
#include "Quadprog.h"

namespace viable {
namespace {

constexpr int kProblems = 64;

struct Problem {
    JointMatrix M;
    JointVector target, lower, upper;
};

/** Problems as ticks of a closed loop give them: jerks of an arm (37 rad/s^3), whose optimum has the
first `held` joints of a fixed shuffle on a bound. Made from the optimum: gradient chosen, so that d
is known, then bounds around it. */
std::vector<Problem> makeProblems(int n, int held) {
    constexpr double kJerk = 37.7;
    std::mt19937_64 random(100 * n + held);
    std::uniform_real_distribution<> uniform(0.1, 1.0);
    std::vector<Problem> problems;
    for (const JointMatrix& M : makeArmMatrices(n, kProblems)) {
        JointVector gradient = JointVector::Zero(n), side = JointVector::Zero(n);
        const Eigen::MatrixXd A = M.transpose() * M;
        for (int k = 0; k < held; ++k) {
            const int joint = (5 * k + n / 2) % n;
            side[joint] = k % 2 == 0 ? 1.0 : -1.0;
            gradient[joint] = -side[joint] * uniform(random) * A(joint, joint);
        }
        JointVector d = A.fullPivLu().solve(Eigen::VectorXd(gradient));
        if (held > 0) d *= kJerk * uniform(random) / d.cwiseAbs().maxCoeff();
        Problem p{M, JointVector(n), JointVector(n), JointVector(n)};
        for (int i = 0; i < n; ++i) {
            p.target[i] = kJerk * (2.0 * uniform(random) - 1.0);
            const double x = p.target[i] + d[i];
            p.lower[i] = side[i] < 0 ? x : x - kJerk * uniform(random);
            p.upper[i] = side[i] > 0 ? x : x + kJerk * uniform(random);
        }
        problems.push_back(p);
    }
    return problems;
}

enum class Start { Warm, Cold };

void runBoxQp(benchmark::State& state, int n, int held, Start start) {
    const std::vector<Problem> problems = makeProblems(n, held);
    BoxQp qp;
    JointVector x;
    double rounds = 0.0;
    for (const Problem& p : problems) {  // the last one leaves the set to start from
        if (start == Start::Cold) qp.reset();
        qp.solve(p.M, p.target, p.lower, p.upper, x);
        rounds = std::max<double>(rounds, qp.rounds());
    }
    timeSolver(state, n, problems, [&](const Problem& p) {
        if (start == Start::Cold) qp.reset();
        qp.solve(p.M, p.target, p.lower, p.upper, x);
        return x.data();
    });
    state.counters["worst_rounds"] = rounds;
}

/** The same problems by quadprog, with D = M'M and d made before the clock starts; it is given copies, as it overwrites
what it gets. Both sides of the box are rows. */
void runQuadprog(benchmark::State& state, int n, int held) {
    std::vector<QuadprogProblem> given;
    BoxQp qp;
    JointVector expected;
    for (const Problem& p : makeProblems(n, held)) {
        QuadprogProblem g{p.M.transpose() * p.M, Eigen::MatrixXd(n, 2 * n), {}, Eigen::VectorXd(2 * n), {}};
        g.d = g.D * p.target;
        g.normals << Eigen::MatrixXd::Identity(n, n), -Eigen::MatrixXd::Identity(n, n);
        g.bounds << p.lower, -p.upper;
        qp.solve(p.M, p.target, p.lower, p.upper, expected);
        g.expected = expected;
        given.push_back(g);
    }
    timeQuadprog(state, n, 2 * n, given, "BoxQp's");
}

bool registerAll() {
    const auto add = [](int n, int held, Start start) {
        const std::string name = std::string("box_qp_") + (start == Start::Warm ? "warm" : "cold") +
                                 "/n:" + std::to_string(n) + "/held:" + std::to_string(held);
        benchmark::RegisterBenchmark(name.c_str(), runBoxQp, n, held, start);
    };
    for (int n : {6, 7}) {
        for (int held : {0, 1, 3, n}) add(n, held, Start::Warm);
        for (int held : {1, 3, n}) add(n, held, Start::Cold);
    }
    for (int n = 1; n <= kMaxJoints; ++n)
        if (n != 6 && n != 7) add(n, (n + 1) / 2, Start::Warm);
    for (const int n : {6, 7})
        for (const int held : {0, 1, 3, n})
            benchmark::RegisterBenchmark(
                ("quadprog_box/n:" + std::to_string(n) + "/held:" + std::to_string(held)).c_str(), runQuadprog, n,
                held);
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
