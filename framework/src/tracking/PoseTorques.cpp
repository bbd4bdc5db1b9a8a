#include "tracking/PoseTorques.h"

#include <cstdint>

namespace viable::detail {

namespace {

using Eigen::MatrixXd;

/** Corners of the velocities are tried one by one for arms up to so many joints, for others signs count as free. */
constexpr int kMostSigned = 8;

/** Sum over k of |T_k| v_k times x. */
JointVector contractSizes(const Tensor& tensor, const JointVector& v, const JointVector& x) {
    JointVector sum = JointVector::Zero(v.size());
    for (std::size_t k = 0; k < tensor.size(); ++k) sum += v[static_cast<Eigen::Index>(k)] * (tensor[k].cwiseAbs() * x);
    return sum;
}

/** For each i the largest sum over j of |sum over k of T_ijk v_k| x_j over all signs of v. */
JointVector contract(const Tensor& tensor, const JointVector& v, const JointVector& x) {
    const auto n = static_cast<int>(tensor.size());
    if (n > kMostSigned) return contractSizes(tensor, v, x);
    MatrixXd sum = MatrixXd::Zero(n, n);
    for (int k = 0; k < n; ++k) sum += v[k] * tensor[static_cast<std::size_t>(k)];
    JointVector largest = sum.cwiseAbs() * x;
    // One sign at a time (Gray code); the sign of the last joint is free.
    std::uint32_t signs = 0;
    for (std::uint32_t step = 1; step < (1U << (n - 1)); ++step) {
        int k = 0;
        while ((step >> k & 1U) == 0) ++k;
        signs ^= 1U << k;
        sum += ((signs >> k & 1U) != 0 ? -2.0 : 2.0) * v[k] * tensor[static_cast<std::size_t>(k)];
        const JointVector here = sum.cwiseAbs() * x;
        largest = largest.binaryExpr(here, &largerOrNan).eval();
    }
    return largest;
}

/** C' - C. */
Tensor calcSkew(const Tensor& coriolis) {
    Tensor skew;
    for (const MatrixXd& C : coriolis) skew.emplace_back(C.transpose() - C);
    return skew;
}

Tensor calcSkewSize(const Tensor& coriolis) {
    Tensor size;
    for (const MatrixXd& C : coriolis) size.emplace_back(C.cwiseAbs().transpose() + C.cwiseAbs());
    return size;
}

/** The largest of each joint over the samples. `calc` is given a way to contract: where even sizes come to no more than what
other samples have, signs need not be tried. */
template <class Samples, class Calc>
JointVector findLargest(const Samples& samples, Eigen::Index n, const Calc& calc) {
    JointVector largest = JointVector::Zero(n);
    for (const auto& sample : samples) {
        if ((calc(sample, contractSizes).array() <= largest.array()).all()) continue;
        const JointVector here = calc(sample, contract);
        largest = largest.binaryExpr(here, &largerOrNan).eval();
    }
    return largest;
}

}  // namespace

void PoseTorques::add(const PoseSample& sample) {
    samples_.push_back({sample.given.gradient, sample.given.coriolis, calcSkew(sample.given.coriolis),
                        sample.given.stiffness + sample.error.stiffness, sample.error.gradient, sample.error.coriolis,
                        calcSkewSize(sample.error.coriolis)});
}

JointVector PoseTorques::calcErrorTorque(const JointVector& fastest, const JointVector& e,
                                         const JointVector& de) const {
    return findLargest(samples_, de.size(), [&](const Sample& s, const auto& calc) -> JointVector {
        return s.stiffness * e + calc(s.gyroscopic, fastest, de) + calc(s.coriolis, de, de) +
               contractSizes(s.gyroscopicError, fastest, de) + contractSizes(s.coriolisError, de, de);
    });
}

JointVector PoseTorques::calcInertiaRate(const JointVector& fastest, const JointVector& de) const {
    return findLargest(samples_, de.size(), [&](const Sample& s, const auto& calc) -> JointVector {
        return calc(s.gradient, fastest, de) + contractSizes(s.gradientError, fastest, de);
    });
}

JointVector PoseTorques::calcTorqueRate(const JointVector& v, const JointVector& a) const {
    return findLargest(samples_, v.size(), [&](const Sample& s, const auto& calc) -> JointVector {
        return s.stiffness * v + 2.0 * (calc(s.coriolis, v, a) + contractSizes(s.coriolisError, v, a));
    });
}

}  // namespace viable::detail
