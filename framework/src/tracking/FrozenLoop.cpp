#include "tracking/FrozenLoop.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "viable/core/Numbers.h"

namespace viable::detail {

namespace {

using Eigen::MatrixXd;

/** Ticks, and later strides, between two doublings of the stride. */
constexpr int kStepsPerStride = 256;
constexpr int kStrideFactor = 4;
/** The response is followed until a whole round adds no more than this share to any gain; a pole whose powers are below it
is taken for died out. */
constexpr double kRemainder = 1e-6;
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
    /** de and e after a tick of torque 1. */
    MatrixXd push() const { return once_ * inverse_; }
    MatrixXd pushTravel() const { return twice_ * inverse_; }
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

MatrixXd& at(LoopGains::PerOutput& values, LoopOutput output) {
    return values[static_cast<std::size_t>(output)];
}

/** What states in columns show. */
LoopGains::PerOutput show(const StateSpace& s, const MatrixXd& x, int n) {
    LoopGains::PerOutput out;
    at(out, LoopOutput::Position) = x.middleRows(0, n);
    at(out, LoopOutput::Velocity) = x.middleRows(n, n);
    at(out, LoopOutput::Torque) = s.C * x;
    at(out, LoopOutput::TorqueStep) = s.step * x;
    at(out, LoopOutput::IntegralTorque) = s.integral * x;
    return out;
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
    const int n = static_cast<int>(loop.kp.size());
    const double h = loop.tick_s;
    LoopGains gains;
    for (auto* all : {&gains.torque, &gains.step, &gains.ramp, &gains.reading}) all->fill(MatrixXd::Zero(n, n));
    gains.earlyTorque.assign(ages.size(), gains.torque);
    gains.lateStep.assign(ages.size(), gains.step);

    // A unit impulse of torque just before a tick leaves de = M^-1; one within the tick before a state nearly affine in
    // its age, up to that a tick later: so the ticks tell all.
    MatrixXd state = MatrixXd::Zero(maker.size(), n);
    state.middleRows(n, n) = maker.inverse();

    // A reading error acts at once, then through the state that it leaves.
    MatrixXd reading = s.B;
    at(gains.reading, LoopOutput::Torque) = s.D.cwiseAbs();
    at(gains.reading, LoopOutput::TorqueStep) = s.D.cwiseAbs() + (s.C * s.B - s.D).cwiseAbs();
    at(gains.reading, LoopOutput::IntegralTorque) = h * maker.krki().cwiseAbs();

    // The reading before the first one is as wrong as that may be, in any way: a velocity of 0 at the start says that its error
    // is the first one's.
    MatrixXd start = MatrixXd::Zero(maker.size(), n);
    start.middleRows(2 * n, n).setIdentity();
    LoopGains::PerOutput startEffect = show(s, start, n);
    for (MatrixXd& effect : startEffect) effect = effect.cwiseAbs();

    // Pushed by a constant torque of 1 from the start, which is part of the state.
    MatrixXd power = s.A;  // over a stride
    const int size = maker.size();
    MatrixXd push = MatrixXd::Zero(size, n);
    push.topRows(n) = maker.pushTravel();
    push.middleRows(n, n) = maker.push();
    MatrixXd pushedPower = MatrixXd::Identity(size + n, size + n);
    pushedPower.topLeftCorner(size, size) = s.A;
    pushedPower.topRightCorner(size, n) = push;
    MatrixXd pushed = MatrixXd::Zero(size + n, n);
    pushed.bottomRows(n).setIdentity();
    LoopGains::PerOutput goal;  // where that ends
    goal.fill(MatrixXd::Zero(n, n));
    at(goal, LoopOutput::Torque) = -MatrixXd::Identity(n, n);

    const Eigen::VectorXcd poles = Eigen::EigenSolver<MatrixXd>(s.A, false).eigenvalues();
    std::size_t asked = 0;  // ages that are passed
    LoopGains::PerOutput last;
    double age = 0.0, stride = 1.0;
    bool isComplete = false;
    for (int round = 0; round < kMaxRounds; ++round) {
        const LoopGains::PerOutput before = gains.torque;
        gains.variations.emplace_back();
        LoopGains::Variation& variation = gains.variations.back();
        variation.total.fill(MatrixXd::Zero(n, n));
        variation.aged.fill(MatrixXd::Zero(n, n));
        LoopGains::PerOutput begin = show(s, state, n);
        for (int step = 0; step < kStepsPerStride; ++step) {
            state = power * state;
            const LoopGains::PerOutput end = show(s, state, n);
            const LoopGains::PerOutput noise = show(s, reading, n);
            reading = power * reading;
            start = power * start;
            const LoopGains::PerOutput started = show(s, start, n);
            LoopGains::PerOutput level = show(s, pushed.topRows(size), n);
            at(level, LoopOutput::TorqueStep) += s.C * push;
            pushed = pushedPower * pushed;
            age += stride * h;
            std::size_t reached = asked;
            while (reached < ages.size() && age >= ages[reached] * (1.0 - kRounding)) ++reached;
            for (std::size_t k = 0; k < kLoopOutputs; ++k) {
                gains.torque[k] += stride * h / 2.0 * (begin[k].cwiseAbs() + end[k].cwiseAbs());
                gains.step[k] = gains.step[k].cwiseMax(level[k].cwiseAbs());
                last[k] = level[k].cwiseAbs();
                // Those from just before the oldest age that is passed: `level` is that of the stride's beginning.
                if (reached > 0) gains.lateStep[reached - 1][k] = gains.lateStep[reached - 1][k].cwiseMax(last[k]);
                for (std::size_t i = asked; i < reached; ++i) gains.earlyTorque[i][k] = gains.torque[k];
                gains.ramp[k] += stride * h * (level[k] - goal[k]).cwiseAbs();
                gains.reading[k] += stride * noise[k].cwiseAbs();
                startEffect[k] = startEffect[k].cwiseMax(started[k].cwiseAbs());
                const MatrixXd change = (end[k] - begin[k]).cwiseAbs();
                variation.total[k] += change;
                variation.aged[k] += (stride > 1.0 ? age : age - 0.5 * h) * change;  // even within a tick
            }
            asked = reached;
            begin = end;
        }
        double grown = 0.0;
        for (std::size_t k = 0; k < kLoopOutputs; ++k)
            grown = std::max(grown, 1.0 - before[k].maxCoeff() / gains.torque[k].maxCoeff());
        isComplete = grown < kRemainder;
        if (isComplete) break;
        if (!mayLengthen(poles, age / h, stride)) continue;
        for (int i = 1; i < kStrideFactor; i *= 2) {
            power = power * power;
            pushedPower = pushedPower * pushedPower;
        }
        stride *= kStrideFactor;
    }
    if (!isComplete)
        for (MatrixXd& gain : gains.torque) gain.fill(INFINITY);
    for (std::size_t k = 0; k < kLoopOutputs; ++k) {
        gains.reading[k] += startEffect[k];
        for (std::size_t i = asked; i < ages.size(); ++i) {
            gains.earlyTorque[i][k] = gains.torque[k];
            gains.lateStep[i][k] = last[k];
        }
        for (std::size_t i = ages.size(); i-- > 1;)
            gains.lateStep[i - 1][k] = gains.lateStep[i - 1][k].cwiseMax(gains.lateStep[i][k]);
    }
    return gains;
}

}  // namespace viable::detail
