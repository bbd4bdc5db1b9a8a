#include "qp/RowQp.h"

#include <gtest/gtest.h>

#include <chrono>
#include <iostream>

#include "LeastDistance.h"
#include "MotionTestSupport.h"
#include "viable/qp/BoxQp.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

using LongVector = NonNegativeLeastSquares<long double>::Vector;
using LongMatrix = NonNegativeLeastSquares<long double>::Matrix;

struct Problem {
    JointMatrix M;
    JointVector target, lower, upper;
    RowQp::Rows rows;

    int size() const { return static_cast<int>(target.size()); }
};

RowQp::Status solve(RowQp& qp, const Problem& p, JointVector& x) {
    return qp.solve(p.M, p.target, p.lower, p.upper, p.rows, x);
}

/** Solves a problem with a new solver and with one that solved others before: the steps of neither exceed their bounds, and
where that one comes to no optimum it gives to the bit what the new one does.
@param check  called with the solver, the status and x of each, first the new one */
template <class Check>
void solveColdAndWarm(RowQp& warm, const Problem& p, const Check& check) {
    RowQp cold;
    JointVector x, again;
    const RowQp::Status status = solve(cold, p, x);
    const RowQp::Status warmStatus = solve(warm, p, again);
    ASSERT_LE(cold.iterations(), RowQp::kMaxColdIterations);
    ASSERT_LE(warm.iterations(), cold.iterations() + RowQp::kMaxWarmIterations);
    if (warmStatus != RowQp::Status::Solved) {
        ASSERT_EQ(warmStatus, status);
        ASSERT_EQ(again, x);
    }
    check(cold, status, x);
    if (!::testing::Test::HasFatalFailure()) check(warm, warmStatus, again);
}

/** The conditions as G y >= h of the torques y = M (x - target), in long double; no rows for bounds
that are infinite. */
struct TorqueSpace {
    LongMatrix G, inverse;
    LongVector h;

    explicit TorqueSpace(const Problem& p) {
        const int n = p.size();
        std::vector<LongVector> normals;
        std::vector<long double> bounds;
        const LongVector target = p.target.cast<long double>();
        const auto add = [&](const LongVector& normal, double bound) {
            if (!std::isfinite(bound) || normal.isZero(0)) return;
            normals.push_back(normal);
            bounds.push_back(bound - normal.dot(target));
        };
        for (int i = 0; i < n; ++i) {
            add(LongVector::Unit(n, i), p.lower[i]);
            add(-LongVector::Unit(n, i), -p.upper[i]);
        }
        for (int k = 0; k < p.rows.count; ++k) add(p.rows.normal[k].cast<long double>(), p.rows.bound[k]);
        inverse = p.M.cast<long double>().fullPivLu().inverse();
        G.resize(normals.size(), n);
        h.resize(normals.size());
        for (size_t k = 0; k < normals.size(); ++k) {
            G.row(k) = normals[k].transpose() * inverse;
            h[k] = bounds[k] / G.row(k).norm();
            G.row(k).normalize();
        }
    }
};

/** The optimum by trying all sets of at most n <= 4 planes: the shortest y that keeps all planes,
of those that are shortest on the planes of a set. Shares nothing with the solver. */
class Enumeration {
public:
    explicit Enumeration(const Problem& p) : space_(p), best_(LongVector::Zero(p.size())) { trySets(0); }

    bool isFeasible() const { return std::isfinite(least_); }
    const LongVector& y() const { return best_; }

private:
    void trySets(int first) {
        trySet();
        if (count_ == space_.G.cols()) return;
        for (int k = first; k < space_.G.rows(); ++k) {
            set_[count_++] = k;
            trySets(k + 1);
            --count_;
        }
    }

    void trySet() {
        const int n = static_cast<int>(space_.G.cols());
        LongVector y = LongVector::Zero(n);
        if (count_ > 0) {
            LongMatrix N(n, count_);
            LongVector h(count_);
            for (int j = 0; j < count_; ++j) {
                N.col(j) = space_.G.row(set_[j]).transpose();
                h[j] = space_.h[set_[j]];
            }
            Eigen::ColPivHouseholderQR<LongMatrix> qr(N);
            qr.setThreshold(1e-15L);
            if (qr.rank() < count_) return;
            const LongVector a = qr.matrixR()
                                     .topLeftCorner(count_, count_)
                                     .triangularView<Eigen::Upper>()
                                     .transpose()
                                     .solve(qr.colsPermutation().transpose() * h);
            y.head(count_) = a;
            y.applyOnTheLeft(qr.householderQ());
        }
        const long double norm = y.norm();
        if (norm >= least_) return;
        for (int k = 0; k < space_.G.rows(); ++k)
            if (space_.h[k] - space_.G.row(k).dot(y) > 1e-13L * (norm + std::abs(space_.h[k]))) return;
        least_ = norm;
        best_ = y;
    }

    const TorqueSpace space_;
    LongVector best_;
    long double least_ = std::numeric_limits<long double>::infinity();
    int set_[4] = {}, count_ = 0;
};

/** Violation of the optimality conditions at x. */
struct Residuals {
    /** Distance of the gradient from the cone of the pressing normals, each joint over |column of
    M| |M (x - target)|, beyond what the last bits of x and target make of it. */
    double stationarity;
    double rows;  // excess, over sum |row_i| (|x_i| + |target_i|)
    bool inBox;

    Residuals(const Problem& p, const JointVector& x) : stationarity(0.0), rows(0.0), inBox(true) {
        const int n = p.size();
        const LongMatrix M = p.M.cast<long double>();
        const LongVector y = M * (x.cast<long double>() - p.target.cast<long double>());
        const LongVector scale = M.colwise().norm() * std::max(y.norm(), 1e-300L);
        std::vector<LongVector> pressing;
        for (int i = 0; i < n; ++i) {
            inBox &= x[i] >= std::min(p.lower[i], p.upper[i]) && x[i] <= p.upper[i];
            if (x[i] <= p.lower[i]) pressing.push_back(LongVector::Unit(n, i));
            if (x[i] >= p.upper[i]) pressing.push_back(-LongVector::Unit(n, i));
        }
        for (int k = 0; k < p.rows.count; ++k) {
            const LongVector row = p.rows.normal[k].cast<long double>();
            const long double size = row.cwiseAbs().dot((x.cwiseAbs() + p.target.cwiseAbs()).cast<long double>());
            const long double miss = p.rows.bound[k] - row.dot(x.cast<long double>());
            if (miss > 0) rows = std::max(rows, static_cast<double>(miss / size));
            if (miss >= -1e-9L * size && size > 0) pressing.push_back(row);
        }
        LongMatrix N(n, pressing.size());
        for (size_t k = 0; k < pressing.size(); ++k) N.col(k) = pressing[k].cwiseQuotient(scale).normalized();
        const LongVector gradient = (M.transpose() * y).cwiseQuotient(scale);
        const auto distance = [&](auto scalar) {
            return pressing.empty() ? static_cast<double>(gradient.cwiseAbs().maxCoeff())
                                    : calcDistance<decltype(scalar)>(N, gradient);
        };
        stationarity = distance(1.0);
        if (stationarity > 1e-11) stationarity = distance(1.0L);
        const LongVector bits = (p.target.cwiseAbs() + x.cwiseAbs()).cast<long double>();
        const long double rounding = 4e-16L * M.colwise().norm().dot(bits) / y.norm();
        stationarity = std::max(0.0, stationarity - static_cast<double>(rounding));
    }

private:
    /** Of the gradient from the cone of the normals. */
    template <class Scalar>
    static double calcDistance(const LongMatrix& N, const LongVector& gradient) {
        const NonNegativeLeastSquares<Scalar> pressures(N.cast<Scalar>(), gradient.cast<Scalar>());
        return static_cast<double>(pressures.residual().cwiseAbs().maxCoeff());
    }
};

struct Worst {
    double stationarity = 0.0, rows = 0.0, error = 0.0;
    int iterations = 0, solved = 0, infeasible = 0;

    void add(const Residuals& r, int iterationsUsed) {
        stationarity = std::max(stationarity, r.stationarity);
        rows = std::max(rows, r.rows);
        iterations = std::max(iterations, iterationsUsed);
        ++solved;
    }
    /** An answer against a reference that has the optimum `y` of the torques where there is one. */
    void compare(const Problem& p, const RowQp& solver, RowQp::Status status, const JointVector& x, bool isFeasible,
                 const LongVector& y) {
        ASSERT_EQ(status == RowQp::Status::Infeasible, !isFeasible);
        infeasible += !isFeasible;
        if (!isFeasible) return;
        add(Residuals(p, x), solver.iterations());
        const LongVector expected = p.target.cast<long double>() + TorqueSpace(p).inverse * y;
        error = std::max(error, static_cast<double>((x.cast<long double>() - expected).cwiseAbs().maxCoeff()));
        ASSERT_LT(error, 1e-7);
    }
    void print(const std::string& title) const {
        std::cout << title << ": " << solved << " solved, " << infeasible << " infeasible; worst gradient "
                  << stationarity << ", row " << rows << ", error of x " << error << ", most iterations " << iterations
                  << " of " << RowQp::kMaxIterations << "\n";
        ::testing::Test::RecordProperty("worst_stationarity", std::to_string(stationarity));
        ::testing::Test::RecordProperty("worst_row", std::to_string(rows));
        ::testing::Test::RecordProperty("worst_iterations", iterations);
    }
};

JointVector drawVector(std::mt19937_64& random, int n, double size) {
    std::normal_distribution<> normal(0.0, size);
    JointVector v(n);
    for (double& x : v) x = normal(random);
    return v;
}

/** Targets about 40 rad/s^3; a box around a point `inside`, partly open, partly of width zero. */
Problem drawBox(std::mt19937_64& random, int n, double condition, JointVector& inside) {
    Problem p;
    p.M = drawMatrix(random, n, condition);
    p.target = drawVector(random, n, 40.0);
    inside = drawVector(random, n, 20.0);
    p.lower = inside - drawVector(random, n, 30.0).cwiseAbs();
    p.upper = inside + drawVector(random, n, 30.0).cwiseAbs();
    for (int i = 0; i < n; ++i) {
        const auto kind = random() % 12;
        if (kind == 0) p.lower[i] = -kInfinity;
        if (kind == 1) p.upper[i] = kInfinity;
        if (kind == 2) p.lower[i] = p.upper[i] = inside[i];
        if (kind == 3) inside[i] = p.lower[i];
    }
    return p;
}

/** Rows that `inside` keeps, sizes 1e-6 to 1e6. With `nearness` > 0 also duplicates, nearly
parallel ones (to the angle `nearness`), slabs of no thickness, sums of others, repeated bounds,
zeros, and many through one point. */
void addRows(std::mt19937_64& random, Problem& p, const JointVector& inside, int count, double nearness = 0.0) {
    const int n = p.size();
    for (int k = 0; k < count; ++k) {
        JointVector row = drawVector(random, n, 1.0);
        double slack = std::abs(drawVector(random, 1, 20.0)[0]) * (random() % 4 ? 1.0 : 0.0);
        const JointVector other = k > 0 ? p.rows.normal[random() % k] : row;
        const auto kind = nearness > 0.0 ? random() % 10 : 10;
        if (kind == 0) row = other;
        if (kind == 1) row = -other;
        if (kind == 2) row = other + drawLog(random, nearness, 1e-2) * other.norm() * row;
        if (kind == 3) row = -other + drawLog(random, nearness, 1e-2) * other.norm() * row;
        if (kind == 4 && k > 1)  // of rows of one size, else it would be nearly parallel to one
            row = other.normalized() + 2.0 * p.rows.normal[random() % k].normalized();
        if (kind == 5) row = JointVector::Unit(n, random() % n) * (random() % 2 ? 1.0 : -1.0);
        if (kind == 6) row.setZero();
        if (kind == 1 || kind == 3 || kind == 5 || kind == 7) slack = 0.0;
        row *= drawLog(random, 1e-6, 1e6) / std::max(row.norm(), 1e-300);
        ASSERT_TRUE(p.rows.add(row, row.dot(inside) - slack * row.norm()));
    }
}

TEST(RowQp, AgreesWithEnumerationOfAllActiveSets) {
    std::mt19937_64 random(51);
    RowQp qp;
    Worst worst;
    for (int k = 0; k < countOf(4000); ++k) {
        const int n = 1 + k % 4;
        JointVector inside;
        Problem p = drawBox(random, n, std::pow(10.0, drawUniform(random, 0, 4)), inside);
        addRows(random, p, inside, random() % 6);
        if (k % 5 == 0)  // anywhere: often infeasible
            addRows(random, p, drawVector(random, n, 80.0), 1 + random() % 2);
        const Enumeration reference(p);
        solveColdAndWarm(qp, p, [&](const RowQp& solver, RowQp::Status status, const JointVector& x) {
            if (status != RowQp::Status::Infeasible)
                ASSERT_EQ(status == RowQp::Status::TargetInside, reference.y().isZero(0));
            worst.compare(p, solver, status, x, reference.isFeasible(), reference.y());
        });
        ASSERT_FALSE(HasFatalFailure()) << "problem " << k;
    }
    worst.print("enumeration");
    EXPECT_GT(worst.solved, 2 * countOf(2000));
    EXPECT_GT(worst.infeasible, 2 * countOf(100));
    EXPECT_LT(worst.rows, RowQp::kRowTolerance);
}

/** Verdict and optimum against Lawson and Hanson's method, which solves the dual as non-negative
least squares. */
TEST(RowQp, AgreesWithLeastDistanceProgramming) {
    std::mt19937_64 random(52);
    RowQp qp;
    Worst worst;
    int undecided = 0;
    for (int k = 0; k < countOf(1500); ++k) {
        const int n = 2 + k % (kMaxJoints - 1);
        JointVector inside;
        Problem p = drawBox(random, n, std::pow(10.0, drawUniform(random, 0, 3)), inside);
        addRows(random, p, inside, random() % 25);
        if (k % 3 == 0) addRows(random, p, drawVector(random, n, 60.0), random() % 12);
        const TorqueSpace space(p);
        const LeastDistance<long double> reference(space.G, space.h);
        if (reference.isFeasible && (space.h - space.G * reference.y).maxCoeff() > 1e-9L) {
            ++undecided;  // the reference itself has not come to an end
            JointVector x;
            solve(qp, p, x);
            continue;
        }
        if (!reference.isFeasible) {
            // A combination u >= 0 of all conditions that nothing can keep.
            EXPECT_LT((space.G.transpose() * reference.u).norm(), 1e-12L) << "problem " << k;
            EXPECT_NEAR(static_cast<double>(space.h.dot(reference.u)), 1.0, 1e-6);
        }
        solveColdAndWarm(qp, p, [&](const RowQp& solver, RowQp::Status status, const JointVector& x) {
            worst.compare(p, solver, status, x, reference.isFeasible, reference.y);
        });
        ASSERT_FALSE(HasFatalFailure()) << "problem " << k;
    }
    worst.print("least distance");
    EXPECT_LE(undecided, 5);
    EXPECT_GT(worst.infeasible, 2 * countOf(50));
    EXPECT_LT(worst.stationarity, 1e-9);
    EXPECT_LT(worst.rows, RowQp::kRowTolerance);
}

/** Problems that a known point keeps; VIABLE_SEED is for another series. */
void checkResiduals(const char* title, int count, long seed, double greatestCondition, double nearness) {
    count = countOf(count);
    seed = getSeed(seed);
    std::mt19937_64 random(seed);
    RowQp qp;
    Worst worst;
    for (int k = 0; k < count; ++k) {
        SCOPED_TRACE(::testing::Message() << "seed " << seed << ", problem " << k);
        const int n = 1 + k % kMaxJoints;
        JointVector inside;
        Problem p = drawBox(random, n, drawLog(random, 1, greatestCondition), inside);
        addRows(random, p, inside, random() % (RowQp::kMaxRows + 1), nearness);
        solveColdAndWarm(qp, p, [&](const RowQp& solver, RowQp::Status status, const JointVector& x) {
            if (status == RowQp::Status::TargetInside) return;
            ASSERT_EQ(status, RowQp::Status::Solved) << solver.iterations() << " iterations";
            const Residuals r(p, x);
            ASSERT_TRUE(r.inBox);
            ASSERT_LT(r.stationarity, 1e-9);
            ASSERT_LT(r.rows, RowQp::kRowTolerance);
            worst.add(r, solver.iterations());
        });
        ASSERT_FALSE(::testing::Test::HasFatalFailure());
    }
    worst.print(title);
    EXPECT_GT(worst.solved, 2 * (count / 2));
    EXPECT_LE(4 * worst.iterations, RowQp::kMaxColdIterations);
}

TEST(Fault36, OptimalityConditionsOfRandomProblems) {
    checkResiduals("random", 50000, 53, 1e4, 0.0);
}
TEST(Fault36, OptimalityConditionsOfIllConditionedProblems) {
    checkResiduals("condition to 1e7", 25000, 54, 1e7, 0.0);
}
TEST(Fault36, OptimalityConditionsOfDegenerateProblems) {
    checkResiduals("degenerate", 25000, 55, 1e4, 1e-4);
}

// As many steps as it may ever take, each as long as those of the longest solve, take less than the 10 ms of the fault.
TEST(Fault36, AtItsBoundARowProblemIsStillInTime) {
    std::mt19937_64 random(57);
    RowQp qp;
    Problem slowest, last;
    int most = 0, mostBefore = 0;
    const int count = countOf(300);
    for (int k = 0; k < count; ++k) {
        JointVector inside, x;
        Problem p = drawBox(random, kMaxJoints, drawLog(random, 1, 1e12), inside);
        addRows(random, p, inside, RowQp::kMaxRows, k % 2 ? 1e-16 : 1e-4);
        qp.reset();
        const RowQp::Status status = solve(qp, p, x);
        ASSERT_LE(qp.iterations(), RowQp::kMaxColdIterations);
        ASSERT_TRUE(((x - p.lower).array() >= 0.0).all() && ((p.upper - x).array() >= 0.0).all()) << "problem " << k;
        if (qp.iterations() > most) {
            most = qp.iterations();
            slowest = p;
        }
        // A predecessor must leave planes to begin with.
        if (status == RowQp::Status::Solved && qp.iterations() > mostBefore) {
            mostBefore = qp.iterations();
            last = p;
        }
    }
    ASSERT_GT(most, 0);
    ASSERT_GT(mostBefore, 0);
    // Planes of another problem, which as a rule lead nowhere: those steps come on top of all of a cold search.
    int steps[2] = {};
    for (const bool isWarm : {false, true}) {
        double least_s = kInfinity;  // of several: the machine may be busy
        for (int k = 0; k < 20; ++k) {
            JointVector x;
            qp.reset();
            if (isWarm) solve(qp, last, x);
            const auto begin = std::chrono::steady_clock::now();
            solve(qp, slowest, x);
            const auto end = std::chrono::steady_clock::now();
            least_s = std::min(least_s, std::chrono::duration<double>(end - begin).count());
        }
        steps[isWarm] = qp.iterations();
        const double bound_s = least_s / steps[isWarm] * RowQp::kMaxIterations;
        std::cout << (isWarm ? "warm: " : "cold: ") << steps[isWarm] << " steps in " << 1e6 * least_s
                  << " us; at the bound " << 1e6 * bound_s << " us\n";
        EXPECT_LT(bound_s, 0.01);
    }
    EXPECT_EQ(steps[false], most);
    EXPECT_GT(steps[true], steps[false]) << "the planes leave nothing to search in vain";
}

/** Where rows are parallel but for rounding, and M ill-conditioned as well, the pressures may be as
large as 1e15 and no residual of theirs means anything. What is left: a point comes out that keeps
box and rows and is hardly worse than the one known to; in a few of a hundred such problems (which
have ten such pairs each, half of them slabs of no thickness) none is found, and that is told. */
TEST(RowQp, RowsParallelButForRounding) {
    std::mt19937_64 random(56);
    RowQp qp;
    Worst worst;
    int failed = 0, refused = 0, count = countOf(20000);
    for (int k = 0; k < count; ++k) {
        const int n = 1 + k % kMaxJoints;
        JointVector inside;
        Problem p = drawBox(random, n, drawLog(random, 1, 1e7), inside);
        addRows(random, p, inside, random() % (RowQp::kMaxRows + 1), 1e-16);
        solveColdAndWarm(qp, p, [&](const RowQp& solver, RowQp::Status status, const JointVector& x) {
            if (status == RowQp::Status::TargetInside) return;
            ++worst.solved;
            worst.iterations = std::max(worst.iterations, solver.iterations());
            failed += status == RowQp::Status::Failed;
            refused += status == RowQp::Status::Infeasible;
            for (int i = 0; i < n; ++i) ASSERT_TRUE(x[i] >= p.lower[i] && x[i] <= p.upper[i]);
            if (status != RowQp::Status::Solved) return;
            for (int j = 0; j < p.rows.count; ++j) {
                const JointVector& row = p.rows.normal[j];
                const double size = row.cwiseAbs().dot(x.cwiseAbs() + p.target.cwiseAbs());
                worst.rows = std::max(worst.rows, (p.rows.bound[j] - row.dot(x)) / size);
            }
            const double reached = (p.M * (x - p.target)).norm(), known = (p.M * (inside - p.target)).norm();
            worst.error = std::max(worst.error, reached / known - 1.0);
        });
        ASSERT_FALSE(HasFatalFailure()) << "problem " << k;
    }
    worst.print("parallel but for rounding");
    std::cout << failed << " failed, " << refused << " called infeasible\n";
    EXPECT_LT(worst.rows, RowQp::kRowTolerance);
    EXPECT_LT(worst.error, 1e-3);
    EXPECT_LT(failed + refused, 2 * (count / 50));
}

/** Without rows it is BoxQp's problem. */
TEST(RowQp, AgreesWithBoxQpWithoutRows) {
    std::mt19937_64 random(57);
    RowQp qp;
    double worst = 0.0;
    for (int k = 0; k < countOf(20000); ++k) {
        const int n = 1 + k % kMaxJoints;
        JointVector inside, expected;
        const Problem p = drawBox(random, n, drawLog(random, 1, 1e4), inside);
        BoxQp box;
        const BoxQp::Status status = box.solve(p.M, p.target, p.lower, p.upper, expected);
        ASSERT_NE(status, BoxQp::Status::Clamped);
        solveColdAndWarm(qp, p, [&](const RowQp&, RowQp::Status own, const JointVector& x) {
            ASSERT_EQ(own == RowQp::Status::TargetInside, status == BoxQp::Status::TargetInside);
            for (int i = 0; i < n; ++i)
                if (expected[i] == p.lower[i] || expected[i] == p.upper[i])
                    ASSERT_EQ(x[i], expected[i]) << "joint " << i;
            worst = std::max(worst, (x - expected).norm() / (x - p.target).norm());
            ASSERT_LT(worst, 1e-8);
        });
        ASSERT_FALSE(HasFatalFailure()) << "problem " << k;
    }
    std::cout << "worst difference from BoxQp, relative: " << worst << "\n";
}

TEST(RowQp, AnAdmissibleTargetComesBackBitForBit) {
    std::mt19937_64 random(58);
    RowQp qp;
    for (int k = 0; k < 1000; ++k) {
        JointVector inside, x;
        Problem p = drawBox(random, 6, 100.0, inside);
        p.target = inside;
        addRows(random, p, inside, 16);
        for (int j = 0; j < 16; ++j) p.rows.bound[j] -= 1e-12 * p.rows.normal[j].norm();
        ASSERT_EQ(solve(qp, p, x), RowQp::Status::TargetInside);
        ASSERT_EQ(x, p.target);
        ASSERT_EQ(qp.iterations(), 0);
    }
}

/** A row added to others that contradicts a non-negative combination of them: sum of all
u_k row_k = 0 while sum u_k bound_k > 0. */
TEST(RowQp, ContradictoryRowsAreToldAsSuch) {
    std::mt19937_64 random(59);
    RowQp qp;
    int most = 0;
    for (int k = 0; k < countOf(20000); ++k) {
        const int n = 1 + k % kMaxJoints;
        JointVector inside, ofOther;
        Problem p = drawBox(random, n, drawLog(random, 1, 1e7), inside);
        addRows(random, p, inside, 1 + random() % 40);
        JointVector sum = JointVector::Zero(n);
        double bound = 0.0, size = 0.0;
        for (int count = 1 + random() % n; count > 0; --count) {
            const int other = random() % p.rows.count;
            const double u = drawUniform(random, 0.1, 1.0) / p.rows.normal[other].norm();
            sum += u * p.rows.normal[other];
            bound += u * p.rows.bound[other];
            size += u * p.rows.normal[other].norm();
        }
        const double gap = drawLog(random, 1e-3, 1e2) * size;
        p.rows.add(-sum, gap - bound);
        // A contradiction leaves no planes to begin with, so another problem comes between.
        Problem other = drawBox(random, n, 100.0, inside);
        addRows(random, other, inside, p.rows.count);
        solve(qp, other, ofOther);
        solveColdAndWarm(qp, p, [&](const RowQp& solver, RowQp::Status status, const JointVector& x) {
            ASSERT_EQ(status, RowQp::Status::Infeasible);
            ASSERT_TRUE(Residuals(p, x).inBox);
            most = std::max(most, solver.iterations());
        });
        ASSERT_FALSE(HasFatalFailure()) << "problem " << k;
    }
    std::cout << "contradictory rows: most iterations " << most << "\n";
    EXPECT_LE(4 * most, RowQp::kMaxIterations);
}

/** A row that no point of the box keeps. */
TEST(RowQp, RowsBeyondTheBoxAreToldAsSuch) {
    std::mt19937_64 random(60);
    RowQp qp;
    for (int k = 0; k < countOf(20000); ++k) {
        const int n = 1 + k % kMaxJoints;
        JointVector inside, ofOther;
        Problem p = drawBox(random, n, drawLog(random, 1, 1e7), inside);
        p.lower = p.lower.cwiseMax(-100.0);
        p.upper = p.upper.cwiseMin(100.0);
        addRows(random, p, inside, random() % 20);
        const JointVector row = drawVector(random, n, drawLog(random, 1e-6, 1e6));
        const double greatest = row.cwiseProduct(p.lower).cwiseMax(row.cwiseProduct(p.upper)).sum();
        p.rows.add(row, greatest + drawLog(random, 1e-3, 1e2) * row.norm());
        // A problem without a solution leaves no planes to begin with, so another one comes between.
        Problem other = drawBox(random, n, 100.0, inside);
        addRows(random, other, inside, p.rows.count);
        solve(qp, other, ofOther);
        solveColdAndWarm(qp, p, [&](const RowQp&, RowQp::Status status, const JointVector& x) {
            ASSERT_EQ(status, RowQp::Status::Infeasible);
            ASSERT_TRUE(Residuals(p, x).inBox);
        });
        ASSERT_FALSE(HasFatalFailure()) << "problem " << k;
    }
}

/** Three joints whose target is beyond their box. */
Problem makeTargetOutside() {
    return {
        JointMatrix::Identity(3, 3), JointVector::Constant(3, 5.0), -JointVector::Ones(3), JointVector::Ones(3), {}};
}

TEST(RowQp, RowsOfZeros) {
    RowQp qp;
    Problem p = makeTargetOutside();
    JointVector x;
    p.rows.add(JointVector::Zero(3), 0.0);
    p.rows.add(JointVector::Zero(3), -1.0);
    EXPECT_EQ(solve(qp, p, x), RowQp::Status::Solved);
    EXPECT_EQ(x, JointVector::Ones(3));
    p.rows.add(JointVector::Zero(3), 1e-300);
    EXPECT_EQ(solve(qp, p, x), RowQp::Status::Infeasible);
    EXPECT_EQ(x, JointVector::Ones(3));
}

TEST(RowQp, RowsHaveRoomForSoMany) {
    RowQp::Rows rows;
    for (int k = 0; k < RowQp::kMaxRows; ++k) ASSERT_TRUE(rows.add(JointVector::Ones(2), k));
    EXPECT_FALSE(rows.add(JointVector::Ones(2), 0.0));
    EXPECT_EQ(rows.count, RowQp::kMaxRows);
    rows.clear();
    EXPECT_TRUE(rows.add(JointVector::Ones(2), 7.0));
    EXPECT_EQ(rows.bound[0], 7.0);
}

/** The corner of a cube cut by 48 planes through it, the target beyond: all hold there at once. */
TEST(RowQp, ManyPlanesThroughTheOptimum) {
    std::mt19937_64 random(61);
    RowQp qp;
    Worst worst;
    for (int k = 0; k < countOf(2000); ++k) {
        const int n = 2 + k % (kMaxJoints - 1);
        JointVector corner = drawVector(random, n, 10.0), x;
        Problem p{drawMatrix(random, n, 100.0), corner, corner.array() - 50.0, corner, {}};
        const Eigen::MatrixXd A = p.M.transpose() * p.M;
        JointVector gradient = JointVector::Zero(n);
        for (int j = 0; j < RowQp::kMaxRows; ++j) {
            const JointVector row = drawVector(random, n, 1.0);
            p.rows.add(row, row.dot(corner));
            gradient += row;
        }
        p.target = corner - JointVector(A.ldlt().solve(Eigen::VectorXd(gradient)));
        ASSERT_EQ(solve(qp, p, x), RowQp::Status::Solved) << "problem " << k;
        worst.error = std::max(worst.error, (x - corner).cwiseAbs().maxCoeff());
        worst.add(Residuals(p, x), qp.iterations());
    }
    worst.print("planes through the optimum");
    EXPECT_LT(worst.error, 1e-10);
    EXPECT_LT(worst.stationarity, 1e-9);
}

/** Velocities towards a target behind the walls of a moving corner, kept by discrete barriers: the
point reaches both walls, slides along them and never crosses. */
TEST(RowQp, AClosedLoopSlidesAlongWalls) {
    constexpr int kJoints = 3;
    constexpr double kTick_s = 1e-3, kRate = 20.0;
    std::mt19937_64 random(62);
    const JointMatrix from = drawMatrix(random, kJoints, 50.0), to = drawMatrix(random, kJoints, 50.0);
    const JointVector walls[] = {JointVector{{1.0, 0.3, 0.1}}, JointVector{{-0.2, 1.0, 0.4}}};
    JointVector q{{1.0, 1.0, 0.0}};
    Problem p{from, q, JointVector::Constant(kJoints, -2.0), JointVector::Constant(kJoints, 2.0), {}};
    RowQp qp;
    double least = kInfinity, path = 0.0;
    int touching = 0, most = 0;
    for (int tick = 0; tick < 20000; ++tick) {
        const double t = tick * kTick_s;
        p.M = from + 0.5 * (1.0 + std::sin(t)) * (to - from);
        p.target = 5.0 * (JointVector{{-1.0, -1.0, 2.0 * std::sin(0.5 * t)}} - q);
        p.rows.clear();
        for (const JointVector& wall : walls)
            for (int copy = 0; copy < 2; ++copy)  // two points of one link near the same wall
                p.rows.add(wall, -kRate * wall.dot(q));
        JointVector x;
        const RowQp::Status status = solve(qp, p, x);
        ASSERT_TRUE(status == RowQp::Status::Solved || status == RowQp::Status::TargetInside) << t;
        most = std::max(most, qp.iterations());
        q += kTick_s * x;
        path += kTick_s * x.norm();
        for (const JointVector& wall : walls) least = std::min(least, wall.dot(q));
        touching += walls[0].dot(q) < 1e-6 || walls[1].dot(q) < 1e-6;
    }
    EXPECT_GE(least, -1e-12);
    EXPECT_GT(touching, 10000);
    EXPECT_GT(path, 5.0);
    EXPECT_LE(most, 8);
}

/** Sequences of problems that change a little from one to the next, rows that come, go and change places, some degenerate, some
without a solution: the one solver has the set of the last problem to begin with, the other never. */
TEST(RowQp, WithTheLastSetItComesToTheSameOptimum) {
    const int count = countOf(400);
    const long seed = getSeed(67);
    std::mt19937_64 random(seed);
    RowQp warm;
    double worst = 0.0;
    int solved = 0, infeasible = 0, warmSteps = 0, coldSteps = 0;
    for (int sequence = 0; sequence < count; ++sequence) {
        const int n = 1 + sequence % kMaxJoints;
        const bool isDegenerate = sequence % 4 == 0;
        JointVector inside;
        Problem p = drawBox(random, n, drawLog(random, 1, 1e4), inside);
        addRows(random, p, inside, random() % 24, isDegenerate ? 1e-3 : 0.0);
        warm.reset();
        for (int tick = 0; tick < 50; ++tick) {
            SCOPED_TRACE(::testing::Message() << "seed " << seed << ", sequence " << sequence << ", tick " << tick);
            const double size = p.M.cwiseAbs().maxCoeff();
            for (double& entry : p.M.reshaped()) entry += 1e-4 * size * drawUniform(random, -1, 1);
            p.target += drawVector(random, n, 1.0);
            if (!isDegenerate)
                for (int k = 0; k < p.rows.count; ++k)
                    p.rows.bound[k] += 0.5 * drawUniform(random, -1, 1) * p.rows.normal[k].norm();
            if (tick % 10 == 9 && p.rows.count > 1) {
                const int a = random() % p.rows.count, b = random() % p.rows.count;
                std::swap(p.rows.normal[a], p.rows.normal[b]);
                std::swap(p.rows.bound[a], p.rows.bound[b]);
                if (random() % 2) --p.rows.count;
            }
            Problem now = p;
            if (tick % 13 == 12)  // beyond any box, for this tick
                now.rows.add(-now.rows.normal[0], 1e4 * now.rows.normal[0].norm() - now.rows.bound[0]);
            RowQp cold;
            JointVector x, expected;
            const RowQp::Status status = solve(cold, now, expected);
            ASSERT_EQ(solve(warm, now, x), status);
            ASSERT_LE(warm.iterations(), RowQp::kMaxIterations);
            infeasible += status == RowQp::Status::Infeasible;
            if (status != RowQp::Status::Solved) {
                ASSERT_EQ(x, expected);
                continue;
            }
            ++solved;
            warmSteps += warm.iterations();
            coldSteps += cold.iterations();
            worst = std::max(worst, (x - expected).norm() / (x.norm() + now.target.norm()));
            ASSERT_LT(worst, 1e-9);
        }
    }
    std::cout << solved << " solved, " << infeasible << " infeasible; worst difference, relative: " << worst << "; "
              << warmSteps << " steps, without the last set " << coldSteps << "\n";
    EXPECT_GT(solved, 25 * count);
    EXPECT_GT(infeasible, count);
    EXPECT_LT(2 * warmSteps, coldSteps);
}

/** What comes first does not count: after reset() a solver is as new. */
TEST(RowQp, ResetForgetsTheLastSet) {
    std::mt19937_64 random(68);
    RowQp qp;
    for (int k = 0; k < countOf(500); ++k) {
        JointVector inside, x, expected;
        Problem p = drawBox(random, 1 + k % kMaxJoints, 100.0, inside);
        addRows(random, p, inside, 16);
        qp.reset();
        const RowQp::Status status = solve(qp, p, x);
        RowQp fresh;
        ASSERT_EQ(solve(fresh, p, expected), status);
        ASSERT_EQ(x, expected);
        ASSERT_EQ(qp.iterations(), fresh.iterations());
    }
}

TEST(RowQp, TakesNoMemory) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    std::mt19937_64 random(63);
    RowQp qp;
    for (int k = 0; k < 200; ++k) {
        JointVector inside, x;
        Problem p = drawBox(random, 1 + k % kMaxJoints, 100.0, inside);
        addRows(random, p, inside, RowQp::kMaxRows - 1, 1e-16);
        if (k % 3 == 0) p.rows.add(p.rows.normal[0], 1e9 * p.rows.normal[0].norm());
        if (k % 5 == 0) p.target[0] = kNan;
        const testing::AllocationCounter counter;
        solve(qp, p, x);
        ASSERT_EQ(counter.count(), 0);
    }
}

TEST(Fault33, BoxAndRowsCrossedByRounding) {
    std::mt19937_64 random(64);
    RowQp qp;
    for (int k = 0; k < countOf(20000); ++k) {
        const int n = 2 + k % (kMaxJoints - 1), joint = k % n;
        JointVector inside, x;
        Problem p = drawBox(random, n, 1e3, inside);
        p.upper[joint] = inside[joint];
        p.lower[joint] = inside[joint] + 1e-12 * drawUniform(random, 0, 1) + 1e-300;
        addRows(random, p, inside, 1 + random() % 10);
        const JointVector& row = p.rows.normal[0];
        p.rows.bound[0] = row.dot(inside);  // a slab whose sides have changed places
        p.rows.add(-row, -p.rows.bound[0] + 1e-13 * row.norm() * inside.norm());
        ASSERT_EQ(solve(qp, p, x), RowQp::Status::Solved) << "problem " << k;
        ASSERT_EQ(x[joint], p.upper[joint]) << "problem " << k;
        const Residuals r(p, x);
        ASSERT_TRUE(r.inBox) << "problem " << k;
        ASSERT_LT(r.rows, RowQp::kRowTolerance) << "problem " << k;
    }
}

/** One input after the other made a number that is none. */
TEST(Fault34, InputsThatAreNotFiniteGiveTheTargetCutOff) {
    const auto check = [](const Problem& p, const char* what) {
        RowQp qp;
        JointVector x;
        EXPECT_EQ(solve(qp, p, x), RowQp::Status::Failed) << what;
        for (int i = 0; i < p.size(); ++i) {
            const double t = std::isfinite(p.target[i]) ? p.target[i] : 0.0;
            EXPECT_EQ(x[i], std::min(std::max(t, -3.0), 2.0)) << what << ", joint " << i;
        }
    };
    Problem good{JointMatrix::Identity(6, 6),
                 JointVector{{10.0, 1.0, -7.0, 2.5, 0.0, -1.0}},
                 JointVector::Constant(6, -3.0),
                 JointVector::Constant(6, 2.0),
                 {}};
    good.rows.add(JointVector::Ones(6), 1.0);
    good.rows.add(JointVector::Unit(6, 2), -2.5);
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
        Problem p = good;
        p.M(1, 5) = bad;
        check(p, "M");
        p = good;
        p.target[4] = bad;
        check(p, "target");
        p = good;
        p.rows.normal[1][3] = bad;
        check(p, "row");
        p = good;
        p.rows.bound[1] = bad;
        check(p, "bound of a row");
    }
    Problem p = good;
    p.lower[5] = kNan;
    check(p, "lower");
    p = good;
    p.upper[5] = kNan;
    check(p, "upper");
    for (int defect = 0; defect < 4; ++defect) {
        p = good;
        if (defect == 0) p.M.setZero();
        if (defect == 1) p.M.setOnes();
        if (defect == 2) p.M.col(3).setZero();
        if (defect == 3) p.M.col(2) = p.M.col(4);
        check(p, "singular M");
    }
}

TEST(Fault34, AbsurdNumbersStayInTheBox) {
    std::mt19937_64 random(65);
    RowQp qp;
    for (int k = 0; k < countOf(30000); ++k) {
        const int n = 1 + k % kMaxJoints;
        JointVector inside, x;
        Problem p = drawBox(random, n, 100.0, inside);
        addRows(random, p, inside, random() % 10, 1e-16);
        const double scales[] = {1e300, 1e150, 1.0, 1e-150, 5e-324};
        for (int i = 0; i < n; ++i) {
            p.target[i] *= scales[random() % 5];
            p.lower[i] = std::max(p.lower[i], -1e3);
            p.upper[i] = std::max(p.lower[i], std::min(p.upper[i], 1e3));
        }
        for (int j = 0; j < p.rows.count; ++j) {
            p.rows.normal[j] *= scales[1 + random() % 4];
            p.rows.bound[j] *= scales[1 + random() % 4];
        }
        if (k % 3 == 0) p.M *= scales[1 + random() % 4];
        solve(qp, p, x);
        for (int i = 0; i < n; ++i) ASSERT_TRUE(x[i] >= p.lower[i] && x[i] <= p.upper[i]) << "problem " << k;
        ASSERT_LE(qp.iterations(), RowQp::kMaxIterations);
    }
}

TEST(Fault34, SizesThatDoNotFitAreRefused) {
    Problem p = makeTargetOutside();
    p.rows.add(JointVector::Ones(2), 1.0);
    RowQp qp;
    JointVector x;
    EXPECT_EQ(solve(qp, p, x), RowQp::Status::Failed);
    EXPECT_EQ(x, JointVector::Ones(3));
    p.rows.clear();
    p.M = JointMatrix::Identity(2, 2);
    EXPECT_EQ(solve(qp, p, x), RowQp::Status::Failed);
    EXPECT_EQ(x, JointVector::Ones(3));
}

TEST(Fault35, AfterAFailureTheNextSolveIsThatOfAFreshSolver) {
    std::mt19937_64 random(66);
    RowQp qp;
    for (int k = 0; k < 200; ++k) {
        JointVector inside, x, expected;
        Problem p = drawBox(random, 6, 100.0, inside), bad = p;
        addRows(random, p, inside, 16);
        if (k % 2) bad.M.setZero();
        bad.rows.add(JointVector::Ones(6), kInfinity);
        ASSERT_EQ(solve(qp, bad, x), RowQp::Status::Failed);
        const RowQp::Status status = solve(qp, p, x);
        RowQp fresh;
        ASSERT_EQ(solve(fresh, p, expected), status);
        ASSERT_EQ(x, expected);
        ASSERT_EQ(qp.iterations(), fresh.iterations());
    }
}

}  // namespace
}  // namespace viable::test
