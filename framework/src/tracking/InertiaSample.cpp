#include "tracking/InertiaSample.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/Text.h"
#include "robot/InertiaModes.h"
#include "robot/PoseSampling.h"
#include "viable/robot/RobotModel.h"

namespace viable::detail {

std::vector<PoseInertia> sampleInertia(const RobotDescription& robot, const JointLimits& limits, int count) {
    RobotModel model(robot);
    Dynamics dynamics;
    std::vector<PoseInertia> samples;
    samples.reserve(static_cast<std::size_t>(count));
    for (const JointVector& q : samplePoses(limits, count)) {
        model.calcDynamics(q, JointVector::Zero(robot.size()), dynamics);
        if (dynamics.M.allFinite() && dynamics.M.llt().info() == Eigen::Success) samples.push_back({q, dynamics.M});
    }
    return samples;
}

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

LinearErrorLoop completeGains(LinearErrorLoop loop, const JointVector& greatest, double tick_s) {
    /** K_p dt: the sampled position loop stays well below 1. */
    constexpr double kLargestKpTick = 0.1;
    constexpr double kLargestKi = 100.0;
    /** K_i in terms of K_p x the slowest velocity loop, from where on the loop would be unstable. */
    constexpr double kIntegralShare = 0.25;
    const Eigen::Index n = greatest.size();
    const bool hasKp = loop.kp.size() > 0, hasKi = loop.ki.size() > 0;
    if (!hasKp) loop.kp.setZero(n);
    if (!hasKi) loop.ki.setZero(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double kr = loop.kr[i];
        if (!hasKp) loop.kp[i] = std::min({kFastestPosition, kStiffestPosition / kr, kLargestKpTick / tick_s});
        if (!hasKi)
            loop.ki[i] = std::min({kLargestKi, kStiffestIntegral / kr, kIntegralShare * loop.kp[i] * kr / greatest[i]});
    }
    return loop;
}

LinearErrorLoop scaleConstantGains(const RobotDescription& robot, const JointLimits& limits, double tick_s) {
    constexpr int kPoses = 1000;
    /** Largest eigenvalue of M^-1 K_r dt there; the sampled loop becomes unstable from 2 on. */
    constexpr double kLargestMode = 1.0;
    LinearErrorLoop loop;
    const std::vector<PoseInertia> samples = sampleInertia(robot, limits, kPoses);
    if (samples.empty()) {
        for (JointVector* gains : {&loop.kr, &loop.kp, &loop.ki}) gains->setZero(robot.size());
        return loop;
    }
    const InertiaRange range = findInertiaRange(samples);
    loop.kr = (kLargestMode / tick_s / range.fastest * range.least).cwiseMin(kStiffest);
    return completeGains(loop, range.greatest, tick_s);
}

double calcLargestMode(int delayTicks) {
    return 2.0 * std::tan(kPi / (4.0 * (1.0 + delayTicks)));
}

}  // namespace viable::detail
