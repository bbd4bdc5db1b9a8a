#include "viable/tracking/LoopStability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "tracking/FrozenLoop.h"
#include "tracking/InertiaSample.h"

namespace viable {

namespace {

using Complex = std::complex<double>;
using ComplexMatrix = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxJoints, kMaxJoints>;
using Loci = std::array<Complex, kMaxJoints>;

/** Frequencies of the unit circle that are looked at, evenly in their logarithm from kLeastAngle to pi. */
constexpr int kFrequencies = 400;
constexpr double kLeastAngle = 1e-5;
/** Where a locus comes nearest to -1. */
struct NearestPoint {
    double distance = kInfinity;
    Complex z = -1.0, value;
};

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
        Loci loci{};
        const Eigen::ComplexEigenSolver<ComplexMatrix> solver(calcOpen(std::polar(1.0, angle)), false);
        for (int i = 0; i < n_; ++i) loci[static_cast<std::size_t>(i)] = solver.eigenvalues()[i];
        return loci;
    }

    /** The joint that takes most part in a locus at z where it is near `value`, by its participation factor, which knows
    no units. */
    int findJoint(const Complex& z, const Complex& value) const {
        const Eigen::ComplexEigenSolver<ComplexMatrix> solver(calcOpen(z), true);
        Eigen::Index locus = 0, joint = 0;
        (solver.eigenvalues().array() - value).abs().minCoeff(&locus);
        const ComplexMatrix vectors = solver.eigenvectors();
        const ComplexMatrix inverse = vectors.fullPivLu().inverse();
        vectors.col(locus).cwiseProduct(inverse.row(locus).transpose()).cwiseAbs().maxCoeff(&joint);
        return static_cast<int>(joint);
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
    NearestPoint lower(LoopMargins& margins) const {
        NearestPoint nearest;
        Loci last = calc(kLeastAngle);
        for (int k = 1; k <= kFrequencies; ++k) {
            const double angle = kLeastAngle * std::pow(kPi / kLeastAngle, static_cast<double>(k) / kFrequencies);
            Loci next = calc(angle);
            follow(last, next);
            for (std::size_t i = 0; i < static_cast<std::size_t>(n_); ++i) {
                lower(last[i], next[i], margins);
                const double distance = std::abs(1.0 + next[i]);
                if (distance < nearest.distance) nearest = {distance, std::polar(1.0, angle), next[i]};
            }
            last = next;
        }
        return nearest;
    }

private:
    ComplexMatrix calcOpen(const Complex& z) const {
        const Complex back = 1.0 / z;
        const Complex plant =
            tick_s_ * tick_s_ / 2.0 * (z + 1.0) / ((z - 1.0) * (z - 1.0)) * std::pow(back, delayTicks_);
        ComplexMatrix open = plant_.cast<Complex>();
        for (int i = 0; i < n_; ++i) {
            const Complex law = (1.0 - back) / tick_s_ + loop_.kp[i] + loop_.ki[i] * tick_s_ / (1.0 - back);
            open.col(i) *= plant * law;
        }
        return open;
    }

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

/** K_p and K_i for a constant K_r, as far as `given` has no numbers, by the rule of scaleNric().
@param rate   of the velocity loop at most [1/s]
@param share  of K_p, and squared of K_i */
LinearErrorLoop completeGains(const LinearErrorLoop& given, const JointVector& greatest, double rate, double share) {
    constexpr double kLargestKi = 100.0;
    /** K_i in terms of K_p x the slowest velocity loop, from where on the loop would be unstable. */
    constexpr double kIntegralShare = 0.25;
    LinearErrorLoop loop = given;
    const Eigen::Index n = greatest.size();
    for (JointVector* gains : {&loop.kp, &loop.ki})
        if (gains->size() == 0) gains->setZero(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double kr = loop.kr[i];
        if (given.kp.size() == 0)
            loop.kp[i] =
                share * std::min({detail::kFastestPosition, detail::kStiffestPosition / kr, kPositionShare * rate});
        if (given.ki.size() == 0)
            loop.ki[i] = std::min({share * share * kLargestKi, share * share * detail::kStiffestIntegral / kr,
                                   kIntegralShare * loop.kp[i] * kr / greatest[i]});
    }
    return loop;
}

/** @param samples  of an arm of n joints */
LoopMargins findSampleMargins(const std::vector<detail::PoseInertia>& samples, double tick_s, int delayTicks,
                              const LinearErrorLoop& loop, bool looksEverywhere) {
    LoopMargins margins;
    margins.gain = kInfinity;
    margins.phase_rad = kPi;
    margins.isStable = !samples.empty();
    if (samples.empty() || !(loop.kr.maxCoeff() > 0.0)) return margins;  // nothing acts
    double outermost = 0.0;
    NearestPoint nearest;
    for (const detail::PoseInertia* pose :
         detail::findCriticalPoses(samples, loop, tick_s, delayTicks, looksEverywhere)) {
        const OpenLoop open(pose->M, tick_s, delayTicks, loop);
        const Complex pole = detail::calcOutermostPole(loop, *pose, tick_s, delayTicks);
        const NearestPoint here = open.lower(margins);
        const double radius = std::abs(pole);
        if (!(radius < detail::limitRadius(loop))) {
            if (radius > outermost) margins.joint = open.findJoint(pole, -1.0);
            outermost = std::max(outermost, radius);
            margins.isStable = false;
        } else if (margins.isStable && here.distance < nearest.distance) {
            nearest = here;
            margins.joint = open.findJoint(here.z, here.value);
        }
    }
    if (!margins.isStable) {
        margins.gain = 1.0;
        margins.phase_rad = 0.0;
    }
    return margins;
}

/** How near to enough, 0 for an unstable loop, 1 and more for enough. */
double calcShare(const LoopMargins& margins) {
    return margins.isStable ? std::min(margins.gain / kEnoughGain, margins.phase_rad / kEnoughPhase_rad) : 0.0;
}

/** The first of the loops make(1), make(kLess), ... that has enough margin, else the one with the most. */
template <class Make>
LinearErrorLoop lowerUntilEnough(const std::vector<detail::PoseInertia>& samples, double tick_s, int delayTicks,
                                 const Make& make) {
    LinearErrorLoop loop;
    double best = -1.0, share = 1.0;  // given gains may leave less margin than there should be
    for (int i = 0; i < kTries && best < 1.0; ++i, share *= kLess) {
        const LinearErrorLoop tried = make(share);
        double found = calcShare(findSampleMargins(samples, tick_s, delayTicks, tried, false));
        if (found >= 1.0) found = calcShare(findSampleMargins(samples, tick_s, delayTicks, tried, true));
        if (found <= best) continue;
        best = found;
        loop = tried;
    }
    return loop;
}

/** The velocity loop, half of what makes it unstable [1/s]. */
double calcLargestRate(double tick_s, int delayTicks) {
    return detail::calcLargestMode(delayTicks) / kEnoughGain / tick_s;
}

/** Of an arm without a usable inertia matrix. */
LinearErrorLoop fillWithZero(LinearErrorLoop loop, int n) {
    for (JointVector* gains : {&loop.kr, &loop.kp, &loop.ki})
        if (gains->size() == 0) gains->setZero(n);
    return loop;
}

}  // namespace

LoopMargins calcMargins(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks,
                        const LinearErrorLoop& loop) {
    const auto samples = detail::sampleInertia(robot, limits, detail::kMarginPoses);
    return findSampleMargins(samples, tick_s, delayTicks, loop, true);
}

LinearErrorLoop scaleGains(const RobotDescription& robot, const JointLimits& limits, double tick_s, int delayTicks,
                           const LinearErrorLoop& given) {
    const std::vector<detail::PoseInertia> samples = detail::sampleInertia(robot, limits, detail::kMarginPoses);
    if (samples.empty()) return fillWithZero(given, robot.size());
    const JointVector greatest = detail::findInertiaRange(samples).greatest;
    const double rate = calcLargestRate(tick_s, delayTicks);
    return lowerUntilEnough(samples, tick_s, delayTicks, [&](double share) {
        return given.kr.size() > 0 ? completeGains(given, greatest, rate, share)
                                   : followInertia(given, greatest, share * rate);
    });
}

LinearErrorLoop detail::scaleConstantGains(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                                           int delayTicks) {
    constexpr int kManyPoses = 1000;
    /** Lowered to less, such gains hold no arm that is much heavier in other poses: those with less margin do. */
    constexpr double kLeastShare = 0.5;
    const std::vector<PoseInertia> samples = sampleInertia(robot, limits, kManyPoses);
    if (samples.empty()) return fillWithZero({}, robot.size());
    const InertiaRange range = findInertiaRange(samples);
    const double rate = calcLargestRate(tick_s, delayTicks);
    const auto make = [&](double share) {
        LinearErrorLoop loop;
        loop.kr = (share * rate / range.fastest * range.least).cwiseMin(kStiffest);
        return completeGains(loop, range.greatest, rate, share);
    };
    const auto isEnough = [&](const LinearErrorLoop& loop, bool looksEverywhere) {
        return findSampleMargins(samples, tick_s, delayTicks, loop, looksEverywhere).isEnough();
    };
    for (double share = 1.0; share > kLeastShare; share *= kLess) {
        const LinearErrorLoop loop = make(share);
        if (isEnough(loop, false) && isEnough(loop, true)) return loop;
    }
    return make(1.0);
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
