#include "viable/tracking/LoopStability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

#include "core/Text.h"
#include "tracking/FrozenLoop.h"
#include "tracking/InertiaSample.h"
#include "viable/core/Numbers.h"

namespace viable {

namespace {

using Complex = std::complex<double>;
using ComplexMatrix = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxJoints, kMaxJoints>;
using Loci = std::array<Complex, kMaxJoints>;

/** Frequencies of the unit circle that are looked at, evenly in their logarithm from kLeastAngle to pi. */
constexpr int kFrequencies = 400;
constexpr double kLeastAngle = 1e-5;
/** Of a double pole. */
constexpr double kRounding = 1e-6;

/** How fast errors of the velocity decay, ascending: the eigenvalues of M^-1 K_r [1/s]. */
Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> findRates(const JointMatrix& M, const JointMatrix& gain, int options) {
    const auto L = M.llt();
    const JointMatrix half = L.matrixL().solve(gain);
    const JointMatrix scaled = L.matrixL().solve(JointMatrix(half.transpose()));
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(scaled, options);
}

/** The eigenvalue loci of the open loop at a pose. */
class OpenLoop {
public:
    OpenLoop(const JointMatrix& M, double tick_s, int delayTicks, const LinearErrorLoop& loop)
        : n_(static_cast<int>(M.rows())),
          plant_(M.llt().solve(detail::calcLoopGain(loop, M))),
          tick_s_(tick_s),
          delayTicks_(delayTicks),
          loop_(loop) {}

    /** At z = exp(j angle), in any order. */
    Loci calc(double angle) const {
        const Complex z = std::polar(1.0, angle), back = 1.0 / z;
        const Complex plant =
            tick_s_ * tick_s_ / 2.0 * (z + 1.0) / ((z - 1.0) * (z - 1.0)) * std::polar(1.0, -angle * delayTicks_);
        ComplexMatrix open = plant_.cast<Complex>();
        for (int i = 0; i < n_; ++i) {
            const Complex law = (1.0 - back) / tick_s_ + loop_.kp[i] + loop_.ki[i] * tick_s_ / (1.0 - back);
            open.col(i) *= plant * law;
        }
        Loci loci{};
        const Eigen::ComplexEigenSolver<ComplexMatrix> solver(open, false);
        for (int i = 0; i < n_; ++i) loci[static_cast<std::size_t>(i)] = solver.eigenvalues()[i];
        return loci;
    }

    /** Puts `next` into the order of `last`: each locus goes on to the nearest value that is left. */
    void follow(const Loci& last, Loci& next) const {
        for (int i = 0; i < n_; ++i) {
            const auto at = static_cast<std::size_t>(i);
            const auto nearest = std::min_element(
                next.begin() + i, next.begin() + n_,
                [&](const Complex& a, const Complex& b) { return std::norm(a - last[at]) < std::norm(b - last[at]); });
            std::iter_swap(next.begin() + i, nearest);
        }
    }

    /** Lowers both margins to what the loci leave. */
    void lower(LoopMargins& margins) const {
        Loci last = calc(kLeastAngle);
        for (int k = 1; k <= kFrequencies; ++k) {
            Loci next = calc(kLeastAngle * std::pow(kPi / kLeastAngle, static_cast<double>(k) / kFrequencies));
            follow(last, next);
            for (std::size_t i = 0; i < static_cast<std::size_t>(n_); ++i) lower(last[i], next[i], margins);
            last = next;
        }
    }

private:
    /** A piece of a locus, as straight in logarithm and angle: short pieces are. */
    static void lower(const Complex& from, const Complex& to, LoopMargins& margins) {
        if (!(std::abs(from) > 0.0 && std::abs(to) > 0.0)) return;
        // Seen from -1: angle zero on the negative real axis.
        const double begin = std::arg(-from), turn = std::arg(to / from), end = begin + turn;
        const double sizeBegin = std::log(std::abs(from)), sizeEnd = std::log(std::abs(to));
        if ((begin > 0.0) != (end > 0.0)) {
            const double size = sizeBegin + (sizeEnd - sizeBegin) * begin / (begin - end);
            margins.gain = std::min(margins.gain, std::exp(std::abs(size)));
        }
        if ((sizeBegin > 0.0) != (sizeEnd > 0.0)) {
            const double angle = begin + turn * sizeBegin / (sizeBegin - sizeEnd);
            margins.phase_rad = std::min(margins.phase_rad, std::abs(std::remainder(angle, 2.0 * kPi)));
        }
    }

    int n_;
    JointMatrix plant_;  // M^-1 K_r
    double tick_s_;
    int delayTicks_;
    const LinearErrorLoop& loop_;
};

/** K_p over the fastest velocity loop: the position loop stays well below it. */
constexpr double kPositionShare = 0.1;
/** K_i over K_p^2: what is left of an error goes slower than the position loop. */
constexpr double kIntegralOfPosition = 0.1;
/** From try to try, until the margins are enough; kTries of them leave a tenth of a percent. */
constexpr double kLess = 0.93;
constexpr int kTries = 100;

/** Gains that follow the inertia, as far as `given` has no numbers, by the rule of scaleGains().
@param rate  of the velocity loop [1/s] */
LinearErrorLoop followInertia(const LinearErrorLoop& given, const JointVector& greatest, double rate) {
    LinearErrorLoop loop = given;
    const Eigen::Index n = greatest.size();
    loop.kr.setConstant(n, detail::kStiffest);
    loop.inertiaRate = rate;
    for (JointVector* gains : {&loop.kp, &loop.ki})
        if (gains->size() == 0) gains->setConstant(n, kNan);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double most = detail::kStiffest / (1.0 + detail::kStiffest / (rate * greatest[i]));  // of K_r
        if (given.kp.size() == 0)
            loop.kp[i] = std::min({detail::kFastestPosition, detail::kStiffestPosition / most, kPositionShare * rate,
                                   most / greatest[i]});
        if (given.ki.size() == 0)
            loop.ki[i] = std::min(kIntegralOfPosition * loop.kp[i] * loop.kp[i], detail::kStiffestIntegral / most);
    }
    return loop;
}

/** @param samples  of an arm of n joints */
LoopMargins findSampleMargins(const std::vector<detail::PoseInertia>& samples, int n, double tick_s, int delayTicks,
                              const LinearErrorLoop& loop) {
    LoopMargins margins;
    if (samples.empty() || !(loop.kr.maxCoeff() > 0.0)) {
        margins.isStable = !samples.empty();  // nothing acts
        margins.gain = kInfinity;
        margins.phase_rad = kPi;
        return margins;
    }
    const detail::PoseInertia* fastest = nullptr;
    const detail::PoseInertia* slowest = nullptr;
    double fastestMode = 0.0, slowestMode = kInfinity;
    for (const detail::PoseInertia& sample : samples) {
        const auto modes = findRates(sample.M, detail::calcLoopGain(loop, sample.M), Eigen::EigenvaluesOnly);
        if (!(modes.eigenvalues()[n - 1] <= fastestMode)) {
            fastestMode = modes.eigenvalues()[n - 1];
            fastest = &sample;
        }
        if (modes.eigenvalues()[0] < slowestMode) {
            slowestMode = modes.eigenvalues()[0];
            slowest = &sample;
        }
    }
    if (!fastest) fastest = &samples.front();
    const auto modes = findRates(fastest->M, detail::calcLoopGain(loop, fastest->M), Eigen::ComputeEigenvectors);
    const JointVector mode = fastest->M.llt().matrixU().solve(JointVector(modes.eigenvectors().col(n - 1)));
    Eigen::Index joint = 0;
    mode.cwiseAbs().maxCoeff(&joint);
    margins.joint = static_cast<int>(joint);

    const bool hasZero = std::min({loop.kr.minCoeff(), loop.kp.minCoeff(), loop.ki.minCoeff()}) <= 0.0;
    margins.isStable = true;
    margins.gain = kInfinity;
    margins.phase_rad = kPi;
    for (const detail::PoseInertia* sample : {fastest, slowest}) {
        if (!sample) continue;
        const JointMatrix gain = detail::calcLoopGain(loop, sample->M);
        const detail::FrozenLoop frozen{sample->M, JointVector::Zero(n), gain, loop.kp, loop.ki, tick_s, delayTicks};
        // What a gain of zero leaves alone stays where it is: poles at 1, several of them but for rounding.
        margins.isStable &= detail::calcSpectralRadius(frozen) < (hasZero ? 1.0 + kRounding : 1.0);
        OpenLoop(sample->M, tick_s, delayTicks, loop).lower(margins);
    }
    if (!margins.isStable) {
        margins.gain = 1.0;
        margins.phase_rad = 0.0;
    }
    return margins;
}

}  // namespace

LoopMargins calcMargins(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks,
                        const LinearErrorLoop& loop) {
    const auto samples = detail::sampleInertia(robot, limits, detail::kMarginPoses);
    return findSampleMargins(samples, robot.size(), tick_s, delayTicks, loop);
}

LinearErrorLoop scaleGains(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks,
                           const LinearErrorLoop& given) {
    const int n = robot.size();
    const std::vector<detail::PoseInertia> samples = detail::sampleInertia(robot, limits, detail::kMarginPoses);
    LinearErrorLoop loop = given;
    if (samples.empty()) {
        for (JointVector* gains : {&loop.kr, &loop.kp, &loop.ki}) gains->setZero(n);
        return loop;
    }
    const JointVector greatest = detail::findInertiaRange(samples).greatest;
    if (given.kr.size() > 0) return detail::completeGains(given, greatest, tick_s);
    double rate = detail::calcLargestMode(delayTicks) / kEnoughGain / tick_s;
    double best = -1.0;  // given gains may leave less margin than there should be
    for (int i = 0; i < kTries && best < 1.0; ++i, rate *= kLess) {
        const LinearErrorLoop tried = followInertia(given, greatest, rate);
        const LoopMargins margins = findSampleMargins(samples, n, tick_s, delayTicks, tried);
        const double share =
            margins.isStable ? std::min(margins.gain / kEnoughGain, margins.phase_rad / kEnoughPhase_rad) : 0.0;
        if (share <= best) continue;
        best = share;
        loop = tried;
    }
    return loop;
}

JointVector findLargestGains(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks) {
    const std::vector<detail::PoseInertia> samples = detail::sampleInertia(robot, limits, detail::kMarginPoses);
    if (samples.empty()) return JointVector::Zero(robot.size());
    const detail::InertiaRange range = detail::findInertiaRange(samples);
    return detail::calcLargestMode(delayTicks) / tick_s / range.fastest * range.least;
}

std::string formatMargins(const LoopMargins& margins) {
    const double dB = 20.0 * std::log10(margins.gain);
    return (dB < 100.0 ? detail::format("%.1f", dB) : "more than 100") +
           detail::format(" dB and %.0f degrees", margins.phase_rad / kDegree);
}

}  // namespace viable
