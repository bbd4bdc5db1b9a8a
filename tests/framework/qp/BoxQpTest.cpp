#include "Paths.h"
#include "viable/qp/BoxQp.h"

#include <gtest/gtest.h>

#include <chrono>
#include <iostream>

#include "MotionTestSupport.h"
#include "viable/braking/Braking.h"
#include "viable/robot/RobotModel.h"

namespace viable::test {
namespace {

struct Problem {
    JointMatrix M;
    JointVector target, lower, upper;

    int size() const { return static_cast<int>(target.size()); }
};

/** The optimum in long double by trying all 3^n active sets, n <= 6: the set that violates the
optimality conditions least. Shares nothing with the solver. */
class Enumeration {
public:
    explicit Enumeration(const Problem& p) : n_(p.size()) {
        for (int i = 0; i < n_; ++i) {
            lower_[i] = static_cast<long double>(p.lower[i]) - p.target[i];
            upper_[i] = static_cast<long double>(p.upper[i]) - p.target[i];
            for (int j = 0; j < n_; ++j) {
                H_[i][j] = 0.0L;
                for (int r = 0; r < n_; ++r) H_[i][j] += static_cast<long double>(p.M(r, i)) * p.M(r, j);
            }
        }
        for (int i = 0; i < n_; ++i) norm_[i] = std::sqrt(H_[i][i]);
        for (int set = 0; set < 1 << n_; ++set) tryFreeSet(set);
    }

    /** Optimal x - target, and the scaled violation of the set it belongs to. */
    const long double* d() const { return best_; }
    long double violation() const { return leastViolation_; }

    /** Largest violation of the optimality conditions at `d`: gradients over D s_i, excesses over
    D / s_i, with s_i = |M_i| and D = max s_i |d_i|. */
    long double calcViolation(const long double* d) const {
        long double D = 0.0L, worst = 0.0L;
        for (int i = 0; i < n_; ++i) D = std::max(D, norm_[i] * std::abs(d[i]));
        for (int i = 0; i < n_; ++i) {
            long double g = 0.0L;
            for (int j = 0; j < n_; ++j) g += H_[i][j] * d[j];
            g /= norm_[i] * D;
            const long double excess = std::max(lower_[i] - d[i], d[i] - upper_[i]);
            worst = std::max(worst, excess * norm_[i] / D);
            if (!(d[i] >= upper_[i])) worst = std::max(worst, -g);
            if (!(d[i] <= lower_[i])) worst = std::max(worst, g);
        }
        return worst;
    }

private:
    static constexpr int kMax = 6;

    /** Factors the free block once, then tries every choice of sides for the others. */
    void tryFreeSet(int set) {
        int free[kMax], held[kMax], m = 0, h = 0;
        for (int i = 0; i < n_; ++i) (set >> i & 1 ? free[m++] : held[h++]) = i;
        long double L[kMax][kMax];
        for (int i = 0; i < m; ++i)
            for (int j = 0; j <= i; ++j) {
                long double sum = H_[free[i]][free[j]];
                for (int k = 0; k < j; ++k) sum -= L[i][k] * L[j][k];
                L[i][j] = i == j ? std::sqrt(sum) : sum / L[j][j];
            }
        for (int sides = 0; sides < 1 << h; ++sides) {
            long double d[kMax] = {}, z[kMax];
            bool finite = true;
            for (int k = 0; k < h; ++k) {
                d[held[k]] = sides >> k & 1 ? upper_[held[k]] : lower_[held[k]];
                finite &= std::isfinite(d[held[k]]);
            }
            if (!finite) continue;
            for (int i = 0; i < m; ++i) {
                z[i] = 0.0L;
                for (int k = 0; k < h; ++k) z[i] -= H_[free[i]][held[k]] * d[held[k]];
                for (int k = 0; k < i; ++k) z[i] -= L[i][k] * z[k];
                z[i] /= L[i][i];
            }
            for (int i = m - 1; i >= 0; --i) {
                for (int k = i + 1; k < m; ++k) z[i] -= L[k][i] * z[k];
                z[i] /= L[i][i];
                d[free[i]] = z[i];
            }
            const long double violation = calcViolation(d);
            if (violation < leastViolation_) {
                leastViolation_ = violation;
                std::copy(d, d + n_, best_);
            }
        }
    }

    int n_;
    long double H_[kMax][kMax], norm_[kMax], lower_[kMax], upper_[kMax], best_[kMax] = {};
    long double leastViolation_ = std::numeric_limits<long double>::infinity();
};

/** Targets about 40 rad/s^3; boxes around the target, touching it, far off, of width zero, open on
one side or on both. */
Problem drawProblem(std::mt19937_64& random, int n, double condition) {
    std::normal_distribution<> normal;
    Problem p{drawMatrix(random, n, condition), JointVector(n), JointVector(n), JointVector(n)};
    for (int i = 0; i < n; ++i) {
        const double t = 40.0 * normal(random);
        const double a = std::abs(40.0 * normal(random)), b = std::abs(40.0 * normal(random));
        double lower = t - a, upper = t + b;
        const auto kind = random() % 9;  // 0: around the target
        if (kind == 1) upper = t;
        if (kind == 2) lower = t;
        if (kind == 3) upper = t - a, lower = t - a - b;
        if (kind == 4) lower = t + a, upper = t + a + b;
        if (kind == 5) lower = upper = t + 40.0 * normal(random);
        if (kind == 6) lower = -kInfinity, upper = t - a;
        if (kind == 7) lower = -kInfinity, upper = kInfinity;
        if (kind == 8) lower = t + a, upper = kInfinity;
        p.target[i] = t;
        p.lower[i] = lower;
        p.upper[i] = upper;
    }
    return p;
}

::testing::AssertionResult isInBox(const Problem& p, const JointVector& x) {
    for (int i = 0; i < p.size(); ++i)
        if (!(x[i] >= p.lower[i] && x[i] <= p.upper[i] && std::isfinite(x[i])))
            return ::testing::AssertionFailure()
                   << "joint " << i << ": " << x[i] << " not in [" << p.lower[i] << ", " << p.upper[i] << "]";
    return ::testing::AssertionSuccess();
}

/** Worst figures of a series of solves against the enumeration. */
struct Worst {
    double error = 0.0;      // of any joint [rad/s^3]
    double violation = 0.0;  // of the optimality conditions, scaled
    int rounds = 0;

    void add(const Problem& p, const JointVector& x, int roundsUsed) {
        const Enumeration reference(p);
        ASSERT_LT(reference.violation(), 1e-15L);
        long double d[6];
        for (int i = 0; i < p.size(); ++i) {
            d[i] = static_cast<long double>(x[i]) - p.target[i];
            error = std::max(error, std::abs(static_cast<double>(d[i] - reference.d()[i])));
        }
        violation = std::max(violation, static_cast<double>(reference.calcViolation(d)));
        rounds = std::max(rounds, roundsUsed);
    }
    void print(const std::string& title) const {
        std::cout << title << ": worst error " << error << " rad/s^3, worst KKT residual " << violation
                  << ", most rounds " << rounds << "\n";
        ::testing::Test::RecordProperty("worst_error_radps3", std::to_string(error));
        ::testing::Test::RecordProperty("worst_kkt_residual", std::to_string(violation));
        ::testing::Test::RecordProperty("worst_rounds", rounds);
    }
};

/** 1e5 problems of six joints; VIABLE_SEED is for another series. */
TEST(BoxQp, AgreesWithEnumerationOfAllActiveSets) {
    const int count = countOf(100000);
    const long seed = getSeed(11);
    std::mt19937_64 random(seed);
    BoxQp qp;  // warm: every problem starts from the set of the one before
    Worst worst;
    for (int k = 0; k < count; ++k) {
        const double condition = std::pow(10.0, drawUniform(random, 0, 4));  // M'M: to 1e8
        const Problem p = drawProblem(random, 6, condition);
        JointVector x;
        SCOPED_TRACE(::testing::Message() << "seed " << seed << ", problem " << k);
        if (qp.solve(p.M, p.target, p.lower, p.upper, x) == BoxQp::Status::TargetInside) continue;
        ASSERT_TRUE(isInBox(p, x));
        worst.add(p, x, qp.rounds());
        if (HasFatalFailure()) return;
        ASSERT_LT(worst.violation, 1e-9);
        ASSERT_LT(worst.error, 1e-6);
    }
    worst.print(std::to_string(count) + " random problems");
}

TEST(BoxQp, AgreesWithEnumerationForFewerJoints) {
    std::mt19937_64 random(12);
    BoxQp qp;
    Worst worst;
    for (int k = 0; k < countOf(20000); ++k) {
        const Problem p = drawProblem(random, 1 + k % 5, std::pow(10.0, k % 5));
        JointVector x;
        if (qp.solve(p.M, p.target, p.lower, p.upper, x) == BoxQp::Status::TargetInside) continue;
        ASSERT_TRUE(isInBox(p, x)) << "problem " << k;
        worst.add(p, x, qp.rounds());
        if (HasFatalFailure()) return;
        ASSERT_LT(worst.error, 1e-6) << "problem " << k;
    }
    worst.print("one to five joints");
}

/** The jerks that keep a joint's stop inside its position range, law of the paper's eq. 21, and its
acceleration and jerk limits. */
void calcJerkBounds(const AxisState& s, const AxisLimits& l, double dt, double& lower, double& upper) {
    constexpr double kAlpha = 5.0;
    const StationaryStop stop = calcStationaryStop(s.v, s.a, l);
    const double end = s.p + stop.displacement, rate = std::max(stop.gradientA, 1e-6);
    lower = std::max(l.jerkLower, (l.accelerationLower - s.a) / dt);
    upper = std::min(l.jerkUpper, (l.accelerationUpper - s.a) / dt);
    if (stop.side == LimitSide::Upper)
        upper = std::min(upper, l.jerkLower + kAlpha * std::max(0.0, l.positionUpper - end) / rate);
    else
        lower = std::max(lower, l.jerkUpper - kAlpha * std::max(0.0, end - l.positionLower) / rate);
    if (lower > upper) lower = upper = stop.jerk;
}

TEST(BoxQp, ErrorInAClosedLoopStaysBelowOneMillionth) {
    constexpr double kTick_s = 1e-3;
    constexpr double A = 4.0 * kPi, J = 12.0 * kPi;
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    RobotModel model(robot);
    const int n = robot.size();
    const JointVector range{{kPi / 6, kPi / 12, kPi / 6, kPi / 12, kPi / 6, kPi / 3}};
    JointVector q = robot.home, zero = JointVector::Zero(n), v = zero, a = zero;
    Problem p{JointMatrix(n, n), zero, zero, zero};
    BoxQp qp;
    Dynamics dynamics;
    Worst worst;
    int solved = 0, sameSet = 0;
    for (int tick = 0; tick < countOf(20000); ++tick) {
        model.calcDynamics(q, zero, dynamics);
        p.M = dynamics.M;
        for (int i = 0; i < n; ++i) {
            const double wish = robot.home[i] + 2.0 * range[i] * std::sin((1.0 + 0.3 * i) * tick * kTick_s);
            p.target[i] = 100.0 * (25.0 * (wish - q[i]) - 10.0 * v[i] - a[i]);
            p.target[i] = std::min(std::max(p.target[i], -3.0 * J), 3.0 * J);
            const AxisLimits l{robot.home[i] - range[i], robot.home[i] + range[i], -kInfinity, kInfinity, -A, A, -J, J};
            calcJerkBounds({q[i], v[i], a[i]}, l, kTick_s, p.lower[i], p.upper[i]);
        }
        JointVector x;
        const BoxQp::Status status = qp.solve(p.M, p.target, p.lower, p.upper, x);
        ASSERT_NE(status, BoxQp::Status::Clamped);
        if (status == BoxQp::Status::Solved) {
            ++solved;
            sameSet += qp.rounds() == 1;
            ASSERT_TRUE(isInBox(p, x));
            worst.add(p, x, qp.rounds());
            if (HasFatalFailure()) return;
        }
        for (int i = 0; i < n; ++i) {
            const AxisState next = advance({q[i], v[i], a[i]}, x[i], kTick_s);
            q[i] = next.p, v[i] = next.v, a[i] = next.a;
        }
    }
    worst.print("closed loop of " + std::to_string(solved) + " problems, " + std::to_string(sameSet) +
                " with the set of the tick before");
    EXPECT_GT(solved, countOf(2000));
    EXPECT_LT(worst.error, 1e-6);
    EXPECT_LT(worst.violation, 1e-9);
}

TEST(BoxQp, TargetInsideComesBackBitForBit) {
    std::mt19937_64 random(13);
    BoxQp qp;
    for (int k = 0; k < 1000; ++k) {
        Problem p = drawProblem(random, 6, 100);
        p.lower = p.lower.cwiseMin(p.target);
        p.upper = p.upper.cwiseMax(p.target);
        JointVector x;
        ASSERT_EQ(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::TargetInside);
        ASSERT_EQ(x, p.target);
        ASSERT_EQ(qp.rounds(), 0);
    }
}

TEST(BoxQp, IllConditionedUpToItsWord) {
    std::mt19937_64 random(14);
    for (int k = 0; k < countOf(20000); ++k) {
        const Problem p = drawProblem(random, 6, std::pow(10.0, drawUniform(random, 4, 7)));
        BoxQp qp;
        JointVector x;
        const BoxQp::Status status = qp.solve(p.M, p.target, p.lower, p.upper, x);
        if (status == BoxQp::Status::TargetInside) continue;
        ASSERT_EQ(status, BoxQp::Status::Solved) << "problem " << k;
        ASSERT_TRUE(isInBox(p, x));
        Worst worst;
        worst.add(p, x, qp.rounds());
        if (HasFatalFailure()) return;
        ASSERT_LT(worst.violation, 1e-9) << "problem " << k;
    }
}

TEST(Fault33, BoundsCrossedByRoundingGiveANumberBetweenThem) {
    std::mt19937_64 random(33);
    BoxQp qp;
    for (int k = 0; k < 20000; ++k) {
        Problem p = drawProblem(random, 6, 1000);
        const int joint = k % 6;
        if (!std::isfinite(p.upper[joint])) p.upper[joint] = p.target[joint] - 1.0;
        p.lower[joint] = p.upper[joint] + 1e-12 * drawUniform(random, 0, 1) + 1e-300;
        JointVector x;
        ASSERT_NE(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::Clamped) << k;
        ASSERT_EQ(x[joint], p.upper[joint]) << "problem " << k;
        std::swap(p.lower[joint], p.upper[joint]);
        ASSERT_TRUE(isInBox(p, x)) << "problem " << k;
    }
}

/** What a defective M may look like. */
std::vector<JointMatrix> makeDefectiveMatrices() {
    std::vector<JointMatrix> all(9, JointMatrix::Identity(6, 6));
    all[0].setZero();
    all[1].setOnes();
    all[2].col(3).setZero();
    all[3].col(2) = all[3].col(4);
    all[4](1, 5) = kNan;
    all[5](2, 2) = kInfinity;
    all[6] *= 1e200;
    all[7] *= 1e-200;
    all[8].fill(kNan);
    return all;
}

TEST(Fault34, WithoutASolutionTheTargetIsCutOffAtTheBounds) {
    std::mt19937_64 random(34);
    for (const JointMatrix& M : makeDefectiveMatrices()) {
        Problem p = drawProblem(random, 6, 10);
        p.M = M;
        p.lower.setConstant(-3.0);
        p.upper.setConstant(2.0);
        p.target << 10.0, 1.0, -7.0, 2.5, 0.0, -1.0;
        BoxQp qp;
        JointVector x;
        ASSERT_EQ(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::Clamped) << M;
        EXPECT_EQ(x, (JointVector{{2.0, 1.0, -3.0, 2.0, 0.0, -1.0}}));
    }
}

TEST(Fault34, TargetsThatAreNotFiniteNeverComeOut) {
    for (double bad : {kNan, kInfinity, -kInfinity}) {
        Problem p{JointMatrix::Identity(6, 6), JointVector::Zero(6), JointVector::Constant(6, -3.0),
                  JointVector::Constant(6, 2.0)};
        p.M(0, 1) = p.M(1, 0) = 0.5;
        p.target[0] = 5.0;
        p.target[4] = bad;
        BoxQp qp;
        JointVector x;
        ASSERT_EQ(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::Clamped);
        EXPECT_EQ(x, (JointVector{{2.0, 0.0, 0.0, 0.0, 0.0, 0.0}}));
    }
}

TEST(Fault34, AbsurdNumbersStayInTheBox) {
    std::mt19937_64 random(35);
    BoxQp qp;
    for (int k = 0; k < countOf(50000); ++k) {
        Problem p = drawProblem(random, 1 + k % kMaxJoints, 100);
        const double scales[] = {1e300, 1e150, 1.0, 1e-150, 5e-324};
        const double scale = scales[random() % 5];
        for (int i = 0; i < p.size(); ++i) {
            p.target[i] *= random() % 2 ? scale : 1.0;
            p.lower[i] = std::max(p.lower[i], -1e3);
            p.upper[i] = std::max(p.lower[i], std::min(p.upper[i], 1e3));
        }
        if (k % 3 == 0) p.M *= scales[random() % 5];
        JointVector x;
        qp.solve(p.M, p.target, p.lower, p.upper, x);
        ASSERT_TRUE(isInBox(p, x)) << "problem " << k;
    }
}

TEST(Fault35, AfterAFailureTheNextSolveIsThatOfAFreshSolver) {
    std::mt19937_64 random(36);
    BoxQp qp;
    int failures = 0;
    for (const JointMatrix& M : makeDefectiveMatrices()) {
        const Problem before = drawProblem(random, 6, 100), after = drawProblem(random, 6, 100);
        JointVector x, expected;
        qp.solve(before.M, before.target, before.lower, before.upper, x);
        const JointVector far = JointVector::Constant(6, 9.0), one = JointVector::Ones(6);
        if (qp.solve(M, far, -one, one, x) != BoxQp::Status::Clamped)
            continue;  // the joints left free can be solved for
        ++failures;
        const BoxQp::Status status = qp.solve(after.M, after.target, after.lower, after.upper, x);
        BoxQp fresh;
        ASSERT_EQ(fresh.solve(after.M, after.target, after.lower, after.upper, expected), status);
        EXPECT_EQ(x, expected);
        EXPECT_EQ(qp.rounds(), fresh.rounds());
    }
    EXPECT_GE(failures, 4);
}

/** Chains of coupled joints with boxes beside the target: what makes active-set methods slow. */
Problem drawHardProblem(std::mt19937_64& random, int n) {
    Problem p = drawProblem(random, n, std::pow(10.0, drawUniform(random, 0, 7)));
    if (random() % 3 == 0) {  // Murty's example: lower triangular, twos below the diagonal
        p.M = JointMatrix::Identity(n, n);
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < i; ++j) p.M(i, j) = 2.0 * (random() % 2 ? 1.0 : -1.0);
    }
    if (random() % 2 == 0)
        for (int i = 0; i < n; ++i) {
            p.lower[i] = p.target[i] + 1.0 + 0.1 * drawUniform(random, -1, 1);
            p.upper[i] = random() % 2 ? kInfinity : p.lower[i] + drawUniform(random, 0, 1);
        }
    return p;
}

TEST(Fault36, RoundsStayFarBelowTheirBound) {
    std::mt19937_64 random(37);
    BoxQp qp;
    int most[kMaxJoints + 1] = {};
    for (int k = 0; k < countOf(400000); ++k) {
        const int n = 1 + k % kMaxJoints;
        const Problem p = drawHardProblem(random, n);
        JointVector x;
        if (k % 7 == 0) qp.reset();
        ASSERT_NE(qp.solve(p.M, p.target, p.lower, p.upper, x), BoxQp::Status::Clamped)
            << "problem " << k << ", " << n << " joints, rounds " << qp.rounds();
        ASSERT_TRUE(isInBox(p, x)) << "problem " << k;
        most[n] = std::max(most[n], qp.rounds());
    }
    std::cout << "most rounds for n = 1, 2, ...:";
    for (int n = 1; n <= kMaxJoints; ++n) {
        std::cout << ' ' << most[n];
        EXPECT_LE(2 * most[n], BoxQp::kMaxRoundsPerJoint * n) << n << " joints";
    }
    std::cout << "\n";
    RecordProperty("worst_rounds_of_16_joints", most[kMaxJoints]);
}

// Conditions up to 1e19, far beyond what is assumed: it comes to an end, with an answer within the box, and as many rounds
// as it may ever take, each as long as those of the longest solve, are still far from the 10 ms of the fault.
TEST(Fault36, WhereItCannotSolveItStopsInTime) {
    std::mt19937_64 random(38);
    Problem slowest;
    int most = 0, clamped = 0;
    const int count = countOf(600);
    for (int k = 0; k < count; ++k) {
        Problem p = drawHardProblem(random, kMaxJoints);
        if (k % 2 == 0) p.M = drawProblem(random, kMaxJoints, std::pow(10.0, drawUniform(random, 7, 19))).M;
        BoxQp qp;
        JointVector x;
        clamped += qp.solve(p.M, p.target, p.lower, p.upper, x) == BoxQp::Status::Clamped;
        ASSERT_TRUE(isInBox(p, x)) << "problem " << k;
        ASSERT_LE(qp.rounds(), BoxQp::kMaxRoundsPerJoint * kMaxJoints);
        if (qp.rounds() <= most) continue;
        most = qp.rounds();
        slowest = p;
    }
    EXPECT_GT(clamped, count / 20) << "they are all easy";
    double least_s = kInfinity;  // of several: the machine may be busy
    for (int k = 0; k < 20; ++k) {
        BoxQp qp;
        JointVector x;
        const auto begin = std::chrono::steady_clock::now();
        qp.solve(slowest.M, slowest.target, slowest.lower, slowest.upper, x);
        least_s = std::min(least_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    }
    const double bound_s = least_s / most * BoxQp::kMaxRoundsPerJoint * kMaxJoints;
    std::cout << most << " rounds in " << 1e6 * least_s << " us; at the bound " << 1e6 * bound_s << " us\n";
    EXPECT_LT(bound_s, 0.01);
}

}  // namespace
}  // namespace viable::test
