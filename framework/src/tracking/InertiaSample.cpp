#include "tracking/InertiaSample.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "core/Text.h"
#include "robot/InertiaModes.h"
#include "tracking/FrozenLoop.h"

namespace viable::detail {

InertiaRange findInertiaRange(const std::vector<PoseInertia>& samples) {
    const Eigen::Index n = samples.front().M.rows();
    InertiaRange range{samples.front().M.diagonal(), samples.front().M.diagonal(), 0.0};
    for (const PoseInertia& sample : samples) {
        const JointMatrix inverse = sample.M.llt().solve(JointMatrix(JointMatrix::Identity(n, n)));
        range.least = range.least.cwiseMin(inverse.diagonal().cwiseInverse());
        range.greatest = range.greatest.cwiseMax(sample.M.diagonal());
    }
    for (const PoseInertia& sample : samples)
        range.fastest = std::max(range.fastest, findModes(sample.M, range.least).eigenvalues()[n - 1]);
    return range;
}

JointMatrix calcLoopGain(const LinearErrorLoop& loop, const JointMatrix& M) {
    if (std::isinf(loop.inertiaRate)) return loop.kr.asDiagonal();
    // c M (diag(k_r) + c M)^-1 diag(k_r)
    const JointMatrix carried = loop.inertiaRate * M;
    JointMatrix sum = carried;
    sum.diagonal() += loop.kr;
    JointMatrix share = loop.kr.asDiagonal();
    Eigen::LLT<JointMatrix>(sum).solveInPlace(share);
    return carried.lazyProduct(share);
}

std::string formatGains(const LinearErrorLoop& loop) {
    return "k_r: " + formatList(loop.kr) + ", k_p: " + formatList(loop.kp) + ", k_i: " + formatList(loop.ki);
}

double limitRadius(const LinearErrorLoop& loop) {
    /** Of a double pole. */
    constexpr double kRounding = 1e-6;
    return std::min({loop.kr.minCoeff(), loop.kp.minCoeff(), loop.ki.minCoeff()}) <= 0.0 ? 1.0 + kRounding : 1.0;
}

std::complex<double> calcOutermostPole(const LinearErrorLoop& loop, const PoseInertia& pose, double tick_s,
                                       int delayTicks) {
    return calcOutermostPole(
        {pose.M, JointVector::Zero(pose.M.rows()), calcLoopGain(loop, pose.M), loop.kp, loop.ki, tick_s, delayTicks});
}

std::vector<const PoseInertia*> findCriticalPoses(const std::vector<PoseInertia>& samples, const LinearErrorLoop& loop,
                                                  double tick_s, int delayTicks, bool looksEverywhere) {
    constexpr std::size_t kOutermost = 3;
    using Ranked = std::pair<double, const PoseInertia*>;
    Ranked fastest{0.0, &samples.front()}, slowest{std::numeric_limits<double>::infinity(), &samples.front()};
    std::vector<Ranked> radii;
    for (const PoseInertia& sample : samples) {
        const JointMatrix L = sample.M.llt().matrixL();
        const auto lower = L.triangularView<Eigen::Lower>();
        const JointMatrix half = lower.solve(calcLoopGain(loop, sample.M));
        const JointMatrix scaled = lower.solve(JointMatrix(half.transpose()));
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> rates(scaled, Eigen::EigenvaluesOnly);
        fastest = std::max(fastest, Ranked{rates.eigenvalues()[scaled.rows() - 1], &sample});
        slowest = std::min(slowest, Ranked{rates.eigenvalues()[0], &sample});
        if (looksEverywhere)
            radii.emplace_back(std::abs(calcOutermostPole(loop, sample, tick_s * (1.0 + delayTicks), 0)), &sample);
    }
    std::vector<const PoseInertia*> poses{fastest.second};
    const auto add = [&](const Ranked& ranked) {
        if (std::find(poses.begin(), poses.end(), ranked.second) == poses.end()) poses.push_back(ranked.second);
    };
    add(slowest);
    const std::size_t count = std::min(kOutermost, radii.size());
    std::partial_sort(radii.begin(), radii.begin() + static_cast<std::ptrdiff_t>(count), radii.end(), std::greater<>());
    for (std::size_t k = 0; k < count; ++k) add(radii[k]);
    return poses;
}

double calcLargestMode(int delayTicks) {
    return 2.0 * std::tan(kPi / (4.0 * (1.0 + delayTicks)));
}

}  // namespace viable::detail
