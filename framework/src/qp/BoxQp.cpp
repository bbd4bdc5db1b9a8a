#include "viable/qp/BoxQp.h"

#include <algorithm>
#include <utility>

#include "core/FixedSize.h"
#include "qp/QpBounds.h"

namespace viable {

namespace {

/** A correction shrinks the error by about eps cond(M'M): one does for every arm. More than this
many mean that M is singular to working precision. */
constexpr int kMaxCorrections = 8;
/** A correction below this, relative to the solution, is the last one; the tolerance grows from one
correction to the next, as where M is near singular the rounding of the residuals keeps them up. */
constexpr double kCorrectionTolerance = 1e-10;
constexpr double kToleranceGrowth = 8.0;
/** Rounds without a new least number of wrong joints after which they are exchanged one by one. */
constexpr int kMaxIdleRounds = 3;

/** What BoxQp::solve is asked for. `side` is the start and is left at the optimum's. */
struct Task {
    const JointMatrix& M;
    const JointVector& target;
    const JointVector& lower;
    const JointVector& upper;
    signed char* side;
    int& rounds;
    JointVector& x;

    /** Counts one more round; false when there is none left. */
    bool countRound() const {
        if (rounds >= BoxQp::kMaxRoundsPerJoint * target.size()) return false;
        ++rounds;
        return true;
    }
};

/** The problem in d = x - target: minimise d' A d / 2 with A = M'M, lo <= d <= hi; `side` says which
joints stand on a bound. kSize is the number of joints where it is known when compiling, so that all
loops unroll, else 0. */
template <int kSize>
class BoxProblem {
public:
    explicit BoxProblem(const Task& task) : joints_(static_cast<int>(task.target.size())), side_(task.side) {
        const double* column = task.M.data();
        for (int i = 0; i < n(); ++i, column += n()) {
            for (int r = 0; r < n(); ++r) rows_[r][i] = column[r];
            hi_[i] = task.upper[i] - task.target[i];
            lo_[i] = std::min(task.lower[i] - task.target[i], hi_[i]);
            if (side_[i] != 0 && !std::isfinite(side_[i] < 0 ? lo_[i] : hi_[i])) side_[i] = 0;
        }
        for (int j = 0; j < n(); ++j) {
            double sum[kCapacity] = {};
            for (int r = 0; r < n(); ++r)
                for (int i = 0; i < n(); ++i) sum[i] += rows_[r][j] * rows_[r][i];
            for (int i = 0; i < n(); ++i) A_[j][i] = sum[i];
        }
    }

    double d(int i) const { return d_[i]; }

    /** The optimum while the joints with side != 0 are held. False when it cannot be computed. */
    bool solveHeld() {
        for (int i = 0; i < n(); ++i) d_[i] = side_[i] == 0 ? 0.0 : side_[i] < 0 ? lo_[i] : hi_[i];
        double z[kCapacity];
        multiplyA(d_, gradient_);
        if (!factor()) return false;
        solveFree(gradient_, z);
        for (int i = 0; i < n(); ++i) d_[i] -= z[i];
        double tolerance = kCorrectionTolerance;
        for (int k = 0; k < kMaxCorrections; ++k, tolerance *= kToleranceGrowth) {
            calcGradient();
            solveFree(gradient_, z);
            double step = 0.0;
            size_ = 0.0;
            for (int i = 0; i < n(); ++i) {
                d_[i] -= z[i];
                step += detail::square(z[i]) * A_[i][i];
                size_ += detail::square(d_[i]) * A_[i][i];
            }
            double change[kCapacity];
            multiplyA(z, change);
            for (int i = 0; i < n(); ++i) gradient_[i] -= change[i];
            if (!std::isfinite(size_)) return false;
            if (step <= detail::square(tolerance) * size_) return true;
        }
        return false;
    }

    /** The side of joint `i` that the last solution asks for, beyond rounding: a held joint that pulls
    away from its bound is to be free, a free one that is outside its bounds is to be held. */
    signed char findSide(int i) const {
        if (side_[i] != 0) {
            const bool pullsAway =
                side_[i] * gradient_[i] > 0.0 &&
                detail::square(gradient_[i]) > detail::square(BoxQp::kGradientTolerance) * A_[i][i] * size_;
            return pullsAway ? 0 : side_[i];
        }
        const double excess = calcExcess(i);
        if (!(excess > 0.0) || !(detail::square(excess) * A_[i][i] > detail::square(BoxQp::kBoundTolerance) * size_))
            return 0;
        return d_[i] < lo_[i] ? -1 : 1;
    }

    /** How far joint `i` is outside, as torque: squared, times A_ii. */
    double calcWeightedExcess(int i) const { return detail::square(calcExcess(i)) * A_[i][i]; }

    /** Moves free joint `joint` towards the bound that it violates, the held ones pressing on; the
    factors must be those of the present set. The joint arrives and is held (true), or another one's
    pressure ends first and it is freed. */
    bool stepTowards(int joint) {
        const double s = d_[joint] < lo_[joint] ? 1.0 : -1.0;
        double z[kCapacity] = {}, rate[kCapacity];
        z[joint] = s;
        solveFree(z, z);
        multiplyA(z, rate);
        double length = calcExcess(joint) / (s * z[joint]);
        int released = -1;
        for (int i = 0; i < n(); ++i) {
            const double pressure = std::max(0.0, -side_[i] * gradient_[i]);
            const double loss = side_[i] * rate[i];
            if (loss > 0.0 && pressure < loss * length) {
                length = pressure / loss;
                released = i;
            }
        }
        for (int i = 0; i < n(); ++i) {
            d_[i] += length * z[i];
            gradient_[i] += length * rate[i];
        }
        if (released >= 0)
            side_[released] = 0;
        else
            side_[joint] = s > 0.0 ? -1 : 1;
        return released < 0;
    }

    /** Factors the present set: A = L D L' with the rows and columns of held joints replaced by the
    identity's. False when a pivot is not positive. */
    bool factor() {
        double R[kCapacity][kCapacity];  // what is left to factor; symmetric, upper part used
        for (int i = 0; i < n(); ++i) free_[i] = side_[i] == 0 ? 1.0 : 0.0;
        for (int j = 0; j < n(); ++j) {
            for (int i = 0; i < n(); ++i) R[j][i] = A_[j][i] * (free_[i] * free_[j]);
            R[j][j] += 1.0 - free_[j];
        }
        bool positive = true;
        forJoints([&](auto j) {
            positive &= R[j][j] > 0.0;
            inverse_[j] = 1.0 / R[j][j];
            for (int i = j + 1; i < n(); ++i) L_[j][i] = R[j][i] * inverse_[j];
            forJoints([&](auto k) {
                if (k > j)
                    for (int i = k; i < n(); ++i) R[k][i] -= L_[j][k] * R[j][i];
            });
        });
        return positive;
    }

private:
    static constexpr int kCapacity = kSize > 0 ? kSize : kMaxJoints;

    int n() const { return kSize > 0 ? kSize : joints_; }

    double calcExcess(int i) const { return std::max(lo_[i] - d_[i], d_[i] - hi_[i]); }

    void multiplyA(const double* v, double* out) const {
        double sum[kCapacity] = {};
        for (int j = 0; j < n(); ++j)
            for (int i = 0; i < n(); ++i) sum[i] += A_[j][i] * v[j];
        for (int i = 0; i < n(); ++i) out[i] = sum[i];
    }

    /** M'(M d), more exact than A d. */
    void calcGradient() {
        double sum[kCapacity] = {};
        for (int r = 0; r < n(); ++r) {
            double y = 0.0;
            for (int i = 0; i < n(); ++i) y += rows_[r][i] * d_[i];
            for (int i = 0; i < n(); ++i) sum[i] += rows_[r][i] * y;
        }
        for (int i = 0; i < n(); ++i) gradient_[i] = sum[i];
    }

    /** Calls body(i) for every joint i in order, with i known when compiling where kSize is. */
    template <class Body>
    void forJoints(Body body) const {
        if constexpr (kSize > 0)
            forIndices(body, std::make_integer_sequence<int, kSize>());
        else
            for (int i = 0; i < n(); ++i) body(i);
    }
    template <class Body, int... kIndex>
    static void forIndices(Body& body, std::integer_sequence<int, kIndex...>) {
        (body(std::integral_constant<int, kIndex>()), ...);
    }

    /** Solves A z = rhs for the free joints; z of the others is 0. */
    void solveFree(const double* rhs, double* z) const {
        double s[kCapacity];
        for (int i = 0; i < n(); ++i) s[i] = rhs[i] * free_[i];
        forJoints([&](auto j) {
            for (int i = j + 1; i < n(); ++i) s[i] -= L_[j][i] * s[j];
        });
        for (int i = 0; i < n(); ++i) s[i] *= inverse_[i];
        forJoints([&](auto k) {
            const int i = n() - 1 - k;
            for (int j = 0; j < i; ++j) s[j] -= L_[j][i] * s[i];
        });
        for (int i = 0; i < n(); ++i) z[i] = s[i];
    }

    const int joints_;
    signed char* side_;
    double rows_[kCapacity][kCapacity];  // of M
    double A_[kCapacity][kCapacity];
    double L_[kCapacity][kCapacity];  // column by column, unit diagonal
    double lo_[kCapacity], hi_[kCapacity], d_[kCapacity], gradient_[kCapacity];
    double free_[kCapacity], inverse_[kCapacity];
    double size_ = 0.0;  // sum of A_ii d_i^2
};

enum class Outcome { Optimal, Open, Failed };

template <int kSize>
void writeSolution(const BoxProblem<kSize>& problem, const Task& task) {
    const int n = static_cast<int>(task.target.size());
    for (int i = 0; i < n; ++i) {
        const double lower = task.lower[i], upper = task.upper[i];
        const double value = task.side[i] < 0 ? lower : task.side[i] > 0 ? upper : task.target[i] + problem.d(i);
        task.x[i] = detail::clampTarget(value, lower, upper);
    }
}

/** Exchanges all wrong joints at once, round by round, while that lessens their number. Open: it did
not lead to the optimum. */
template <int kSize>
Outcome exchangeAll(const Task& task) {
    const int n = static_cast<int>(task.target.size());
    BoxProblem<kSize> problem(task);
    int fewest = n + 1, idleRounds = kMaxIdleRounds;
    while (idleRounds > 0 && task.countRound()) {
        if (!problem.solveHeld()) return Outcome::Failed;
        int wrong = 0;
        for (int i = 0; i < n; ++i) {
            const signed char right = problem.findSide(i);
            wrong += right != task.side[i];
            task.side[i] = right;
        }
        if (wrong == 0) {
            writeSolution(problem, task);
            return Outcome::Optimal;
        }
        idleRounds = wrong < fewest ? kMaxIdleRounds : idleRounds - 1;
        fewest = std::min(fewest, wrong);
    }
    return Outcome::Open;
}

/** Frees the joints that pull away from their bound; true when there were any. */
bool releaseAll(const BoxProblem<0>& problem, const Task& task) {
    bool released = false;
    for (int i = 0; i < task.target.size(); ++i) {
        if (task.side[i] == 0 || problem.findSide(i) != 0) continue;
        task.side[i] = 0;
        released = true;
    }
    return released;
}

/** The free joint farthest outside its bounds, or -1. */
int findWorst(const BoxProblem<0>& problem, const Task& task) {
    int worst = -1;
    for (int i = 0; i < task.target.size(); ++i)
        if (task.side[i] == 0 && problem.findSide(i) != 0 &&
            (worst < 0 || problem.calcWeightedExcess(i) > problem.calcWeightedExcess(worst)))
            worst = i;
    return worst;
}

/** Dual active set: from a set in which every held joint presses against its bound, one violated
bound after the other. The dual objective grows with every step, so no set recurs. */
Outcome addOneByOne(const Task& task) {
    BoxProblem<0> problem(task);
    while (task.countRound()) {
        if (!problem.solveHeld()) return Outcome::Failed;
        if (releaseAll(problem, task)) continue;
        const int joint = findWorst(problem, task);
        if (joint < 0) {
            writeSolution(problem, task);
            return Outcome::Optimal;
        }
        while (!problem.stepTowards(joint))
            if (!task.countRound() || !problem.factor()) return Outcome::Failed;
    }
    return Outcome::Failed;
}

}  // namespace

BoxQp::Status BoxQp::solve(const JointMatrix& M, const JointVector& target, const JointVector& lower,
                           const JointVector& upper, JointVector& x) {
    const int n = static_cast<int>(target.size());
    rounds_ = 0;
    x.resize(n);
    bool inside = true, finite = true;
    for (int i = 0; i < n; ++i) {
        x[i] = detail::clampTarget(target[i], lower[i], upper[i]);
        inside &= x[i] == target[i];
        finite &= std::isfinite(target[i]);
    }
    if (inside) {
        reset();
        return Status::TargetInside;
    }
    if (finite) {
        const Task task{M, target, lower, upper, side_.data(), rounds_, x};
        Outcome outcome = detail::withFixedSize(n, [&](auto size) { return exchangeAll<decltype(size)::value>(task); });
        if (outcome == Outcome::Open) outcome = addOneByOne(task);
        if (outcome == Outcome::Optimal) return Status::Solved;
    }
    reset();
    return Status::Clamped;
}

}  // namespace viable
