#include "tracking/FrozenLoop.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#ifdef __x86_64__
#include <immintrin.h>
#endif

namespace viable::detail {

namespace {

using Eigen::MatrixXd;

/** Ticks, and later strides, between two doublings of the stride. */
constexpr int kStepsPerStride = 256;
constexpr int kStrideFactor = 4;
/** The response is followed until a whole round adds no more than this share to any gain; a pole whose powers are below it
is taken for died out. */
constexpr double kRemainder = 1e-6;
/** Of the largest entry of its row: an entry below it is rounding. */
constexpr double kNothing = 1e-9;
/** No pole that has not died out may turn by more than this over a stride: what oscillates within a stride would not be seen. */
constexpr double kLargestTurn_rad = 0.1;
/** Of sums of ticks. */
constexpr double kRounding = 1e-9;
/** Enough for months, and for oscillations that die out within 16,000 ticks. */
constexpr int kMaxRounds = 80;

/** The loop as x' = A x + B n with x = (e, de, e_m before, sum of e_m dt, torques on their way), n the reading error;
the tick's torque tau_a = C x + D n. */
struct StateSpace {
    MatrixXd A, B, C, D;
    MatrixXd integral;  // the part of C from the sum
    MatrixXd step;      // C (A - I): how tau_a changes to the next tick
};

class Loop {
public:
    explicit Loop(const FrozenLoop& loop)
        : loop_(loop),
          n_(static_cast<int>(loop.kp.size())),
          inverse_(MatrixXd(loop.inertia).llt().solve(MatrixXd::Identity(n_, n_))) {
        // Over a tick v' = -M^-1 D v + M^-1 tau. With M = L L^T, L^-1 D L^-T is symmetric: mode by mode the exponential,
        // its integral and that one's are exact for any damping, however stiff.
        const MatrixXd L = MatrixXd(loop.inertia).llt().matrixL();
        const auto lower = L.triangularView<Eigen::Lower>();
        const MatrixXd half = lower.solve(MatrixXd(loop.damping.asDiagonal()));
        const Eigen::SelfAdjointEigenSolver<MatrixXd> modes(MatrixXd(lower.solve(half.transpose())));
        const MatrixXd right = modes.eigenvectors().transpose() * L.transpose();
        const MatrixXd left = L.transpose().triangularView<Eigen::Upper>().solve(modes.eigenvectors());
        const Eigen::ArrayXd x = loop.tick_s * modes.eigenvalues().array().max(0.0);
        const auto assemble = [&](double (*of)(double)) -> MatrixXd {
            return left * x.unaryExpr(of).matrix().asDiagonal() * right;
        };
        decay_ = assemble([](double v) { return std::exp(-v); });
        once_ = loop.tick_s * assemble(calcOnce);
        twice_ = loop.tick_s * loop.tick_s * assemble(calcTwice);
    }

    int size() const { return n_ * (4 + loop_.delayTicks); }
    const MatrixXd& inverse() const { return inverse_; }
    /** e after a tick of torque 1: also the sum over a tick of what impulses in it leave. */
    MatrixXd pushTravel() const { return twice_ * inverse_; }
    /** The states in which the loop rests under a torque of 1: the integral carries it. */
    MatrixXd rest() const {
        MatrixXd x = MatrixXd::Zero(size(), n_);
        x.middleRows(3 * n_, n_) = krki().inverse();
        for (int k = 0; k < loop_.delayTicks; ++k) x.middleRows((4 + k) * n_, n_) = -MatrixXd::Identity(n_, n_);
        return x;
    }
    MatrixXd krki() const { return loop_.kr * loop_.ki.asDiagonal(); }

    StateSpace make() const {
        StateSpace s;
        const MatrixXd states = MatrixXd::Identity(size(), size());
        const MatrixXd none = MatrixXd::Zero(n_, size());
        s.A = tick(states, none, s.C, s.integral);
        MatrixXd ignored;
        const MatrixXd errors = MatrixXd::Identity(n_, n_);
        s.B = tick(MatrixXd::Zero(size(), n_), errors, s.D, ignored);
        s.step = s.C * s.A - s.C;
        return s;
    }

private:
    /** The integral of exp(-x s) over s from 0 to 1, and that one's. */
    static double calcOnce(double x) { return x > 0.0 ? -std::expm1(-x) / x : 1.0; }
    static double calcTwice(double x) {
        constexpr double kSmall = 1e-3;  // below it the difference would cancel; the next term is x^3 / 120
        return x > kSmall ? (1.0 - calcOnce(x)) / x : 0.5 - x / 6.0 + x * x / 24.0;
    }

    /** Columns are independent states. */
    MatrixXd tick(const MatrixXd& x, const MatrixXd& error, MatrixXd& torque, MatrixXd& integralTorque) const {
        const double h = loop_.tick_s;
        const MatrixXd e = x.middleRows(0, n_), v = x.middleRows(n_, n_);
        const MatrixXd read = e + error;
        const MatrixXd rate = (read - x.middleRows(2 * n_, n_)) / h;
        const MatrixXd sum = x.middleRows(3 * n_, n_) + h * read;
        integralTorque = -(krki() * sum);
        const MatrixXd weighted = rate + loop_.kp.asDiagonal() * read;
        torque = integralTorque - loop_.kr * weighted;
        const int d = loop_.delayTicks;
        const MatrixXd acting = d == 0 ? torque : MatrixXd(x.middleRows(4 * n_, n_));
        const MatrixXd a = inverse_ * acting;
        MatrixXd next(x.rows(), x.cols());
        next << e + once_ * v + twice_ * a, decay_ * v + once_ * a, read, sum, x.bottomRows(d > 0 ? (d - 1) * n_ : 0),
            d > 0 ? torque : MatrixXd(0, x.cols());
        return next;
    }

    const FrozenLoop& loop_;
    int n_;
    MatrixXd inverse_;
    MatrixXd decay_, once_, twice_;
};

/** Whether the next stride sees what is left of a response after so many ticks. */
bool mayLengthen(const Eigen::VectorXcd& poles, double ticks, double stride) {
    return std::all_of(poles.begin(), poles.end(), [&](const std::complex<double>& pole) {
        const bool hasDiedOut = std::pow(std::abs(pole), ticks) < kRemainder;
        return hasDiedOut || std::abs(std::arg(pole)) * stride * kStrideFactor <= kLargestTurn_rad;
    });
}

#ifdef __x86_64__
/** The product a b in registers twice as wide as those of any x86-64, which Eigen is compiled for. Without fused
multiplication and in the same order, so the result is the same. The rows of `a` are a multiple of 8, the columns of `b`
of 4. */
[[gnu::target("avx2")]] void multiplyWide(const MatrixXd& a, const MatrixXd& b, MatrixXd& product) {
    const Eigen::Index rows = a.rows(), depth = a.cols();
    for (Eigen::Index column = 0; column < b.cols(); column += 4)
        for (Eigen::Index row = 0; row < rows; row += 8) {
            __m256d upper[4] = {}, lower[4] = {};  // of 8 x 4 entries
            for (Eigen::Index k = 0; k < depth; ++k) {
                const double* entries = a.data() + k * rows + row;
                const __m256d up = _mm256_loadu_pd(entries), down = _mm256_loadu_pd(entries + 4);
#pragma GCC unroll 4
                for (int c = 0; c < 4; ++c) {
                    const __m256d factor = _mm256_broadcast_sd(b.data() + (column + c) * depth + k);
                    upper[c] = _mm256_add_pd(upper[c], _mm256_mul_pd(up, factor));
                    lower[c] = _mm256_add_pd(lower[c], _mm256_mul_pd(down, factor));
                }
            }
#pragma GCC unroll 4
            for (int c = 0; c < 4; ++c) {
                double* entries = product.data() + (column + c) * rows + row;
                _mm256_storeu_pd(entries, upper[c]);
                _mm256_storeu_pd(entries + 4, lower[c]);
            }
        }
}
#endif

void multiply(const MatrixXd& a, const MatrixXd& b, MatrixXd& product) {
#ifdef __x86_64__
    static const bool isWide = __builtin_cpu_supports("avx2");
    if (isWide) return multiplyWide(a, b, product);
#endif
    product.noalias() = a.lazyProduct(b);
}

/** Columns of states that go on by a number of ticks at a time, and what they show: one LoopOutput below the other. */
class Courses {
public:
    /** @param step  the matrix over a tick
    @param shows  what states show, other than position and velocity, which are their first rows
    @param columns  of states at the beginning */
    Courses(MatrixXd step, const MatrixXd& shows, MatrixXd columns)
        : step_(std::move(step)), shows_(shows), states_(std::move(columns)) {
        const Eigen::Index states = step_.rows(), seen = shows_.rows();
        both_.setZero((states + seen + 7) / 8 * 8, states);  // in whole registers
        moved_.resize(both_.rows(), states_.cols());
        shown_.resize(seen / 3 * kLoopOutputs, states_.cols());
        prepare();
        show(shows_ * states_);
    }

    const MatrixXd& states() const { return states_; }
    const MatrixXd& shown() const { return shown_; }

    void advance() {
        multiply(both_, states_, moved_);
        states_ = moved_.topRows(states_.rows());
        show(moved_.middleRows(states_.rows(), shows_.rows()));
    }
    void lengthenStride(int factor) {
        for (int i = 1; i < factor; i *= 2) step_ = step_ * step_;
        prepare();
    }

private:
    void prepare() { both_.topRows(step_.rows() + shows_.rows()) << step_, shows_ * step_; }
    template <class Rest>
    void show(const Rest& rest) {
        const Eigen::Index motions = shown_.rows() - shows_.rows();
        shown_.topRows(motions) = states_.topRows(motions);
        shown_.bottomRows(shows_.rows()) = rest;
    }

    MatrixXd step_, shows_, states_;
    MatrixXd both_, moved_, shown_;
};

/** Gains of all outputs, one below the other. */
using Stacked = Eigen::ArrayXXd;

LoopGains::PerOutput split(const Stacked& gains) {
    LoopGains::PerOutput out;
    const Eigen::Index n = gains.cols();
    for (int k = 0; k < kLoopOutputs; ++k) out[static_cast<std::size_t>(k)] = gains.middleRows(k * n, n);
    return out;
}

/** Whether no entry has grown by more than kRemainder of itself, but those that are nothing beside others of their row. */
bool hardlyGrows(const Stacked& before, const Stacked& after) {
    const Stacked nothing = kNothing * after.rowwise().maxCoeff().replicate(1, after.cols());
    return !((after - before) > (kRemainder * after).max(nothing)).any();
}

template <class Matrix>
auto rowsOf(Matrix& stacked, LoopOutput output) {
    const Eigen::Index n = stacked.rows() / kLoopOutputs;
    return stacked.middleRows(static_cast<Eigen::Index>(output) * n, n);
}

}  // namespace

std::complex<double> calcOutermostPole(const FrozenLoop& loop) {
    const Eigen::EigenSolver<MatrixXd> modes(Loop(loop).make().A, false);
    if (modes.info() != Eigen::Success) return kNan;  // of what is not finite
    Eigen::Index outermost = 0;
    modes.eigenvalues().cwiseAbs().maxCoeff(&outermost);
    return modes.eigenvalues()[outermost];
}

LoopGains calcGains(const FrozenLoop& loop, const std::vector<double>& ages) {
    const Loop maker(loop);
    const StateSpace s = maker.make();
    const int n = static_cast<int>(loop.kp.size()), size = maker.size();
    const double h = loop.tick_s;
    const Stacked none = Stacked::Zero(kLoopOutputs * n, n);
    MatrixXd shows(3 * n, size);
    shows << s.C, s.step, s.integral;

    // A unit impulse of torque just before a tick leaves de = M^-1; one within the tick before a state nearly affine in
    // its age, up to that a tick later: so the ticks tell all. A reading error acts at once, then through the state that it
    // leaves. The reading before the first one is as wrong as that may be, in any way: a velocity of 0 at the start says that
    // its error is the first one's.
    MatrixXd beginnings = MatrixXd::Zero(size, 4 * n);
    beginnings.block(n, 0, n, n) = maker.inverse();
    beginnings.middleCols(n, n) = s.B;
    beginnings.block(2 * n, 2 * n, n, n).setIdentity();
    beginnings.rightCols(n) = -maker.rest();
    Courses courses(s.A, shows, std::move(beginnings));

    Stacked torque = none, step = none, ramp = none, reading = none;
    rowsOf(reading, LoopOutput::Torque) = s.D.cwiseAbs();
    rowsOf(reading, LoopOutput::TorqueStep) = s.D.cwiseAbs() + (s.C * s.B - s.D).cwiseAbs();
    rowsOf(reading, LoopOutput::IntegralTorque) = h * maker.krki().cwiseAbs();
    Stacked startEffect = courses.shown().middleCols(2 * n, n).cwiseAbs();

    // Under a constant torque of 1 from the start the state differs from that at the end by one that dies out.
    Stacked goal = none;
    rowsOf(goal, LoopOutput::Torque) = rowsOf(goal, LoopOutput::IntegralTorque) = -MatrixXd::Identity(n, n);
    Stacked fromGoal = courses.shown().rightCols(n).cwiseAbs();

    // The torque's step to the next tick has been caused by what came since this tick, too: before age 0.
    const MatrixXd newest = (s.C * (s.A * courses.states().leftCols(n))).cwiseAbs();
    rowsOf(torque, LoopOutput::TorqueStep) = (s.C.leftCols(n) * maker.pushTravel()).cwiseAbs();
    rowsOf(ramp, LoopOutput::TorqueStep) = 0.5 * h * rowsOf(fromGoal, LoopOutput::TorqueStep);

    const Eigen::EigenSolver<MatrixXd> modes(s.A, false);
    const bool knowsPoles = modes.info() == Eigen::Success;  // not of what is not finite
    LoopGains gains;
    std::vector<Stacked> earlyTorque(ages.size(), none), lateStep(ages.size(), none);
    std::size_t asked = 0;  // ages that are passed
    Stacked begin, change, level = none;
    double age = 0.0, stride = 1.0;
    bool isComplete = false;
    for (int round = 0; round < kMaxRounds; ++round) {
        const Stacked torqueBefore = torque, rampBefore = ramp;
        Stacked total = none, aged = none;
        if (round == 0) {
            rowsOf(total, LoopOutput::TorqueStep) = newest;
            rowsOf(aged, LoopOutput::TorqueStep) = 0.5 * h * newest;
        }
        for (int k = 0; k < kStepsPerStride; ++k) {
            begin = courses.shown().leftCols(n);
            reading += stride * courses.shown().middleCols(n, n).array().abs();
            level = (courses.shown().rightCols(n).array() + goal).abs();
            if (stride > 1.0)
                level *= 1.0 + kLargestTurn_rad * kLargestTurn_rad / 8.0;  // a top may lie between two looks
            step = step.max(level);
            courses.advance();
            const auto end = courses.shown().leftCols(n).array();
            startEffect = startEffect.max(courses.shown().middleCols(2 * n, n).array().abs());
            change = courses.shown().rightCols(n).array().abs();
            ramp += stride * h * change.max(fromGoal);
            fromGoal = change;
            age += stride * h;
            torque += stride * h / 2.0 * (begin.abs() + end.abs());
            change = (end - begin).abs();
            total += change;
            aged += (stride > 1.0 ? age : age - 0.5 * h) * change;  // even within a tick
            std::size_t reached = asked;
            while (reached < ages.size() && age >= ages[reached] * (1.0 - kRounding)) ++reached;
            // Those from just before the oldest age that is passed: `level` is that of the stride's beginning.
            if (reached > 0) lateStep[reached - 1] = lateStep[reached - 1].max(level);
            for (; asked < reached; ++asked) earlyTorque[asked] = torque;
        }
        gains.variations.push_back({split(total), split(aged)});
        isComplete = hardlyGrows(torqueBefore, torque) && hardlyGrows(rampBefore, ramp);
        if (isComplete) break;
        if (!knowsPoles || !mayLengthen(modes.eigenvalues(), age / h, stride)) continue;
        courses.lengthenStride(kStrideFactor);
        stride *= kStrideFactor;
    }
    if (!isComplete) torque.fill(INFINITY);
    reading += startEffect;
    for (std::size_t i = asked; i < ages.size(); ++i) {
        earlyTorque[i] = torque;
        lateStep[i] = level;
    }
    for (std::size_t i = ages.size(); i-- > 1;) lateStep[i - 1] = lateStep[i - 1].max(lateStep[i]);
    gains.torque = split(torque);
    gains.step = split(step);
    gains.ramp = split(ramp);
    gains.reading = split(reading);
    for (std::size_t i = 0; i < ages.size(); ++i) {
        gains.earlyTorque.push_back(split(earlyTorque[i]));
        gains.lateStep.push_back(split(lateStep[i]));
    }
    return gains;
}

}  // namespace viable::detail
