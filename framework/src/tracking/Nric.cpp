#include "viable/tracking/Nric.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/Text.h"
#include "robot/InertiaModes.h"
#include "robot/PoseSampling.h"
#include "viable/core/Error.h"
#include "viable/robot/RobotModel.h"

namespace viable {

namespace {

/** The numbers of `n` joints. */
JointVector expand(const PerJoint& values, const std::string& place, const char* what, int n) {
    if (!values.fits(n))
        throw badInput(place,
                       std::to_string(values.count()) + " " + what + "; the robot has " + std::to_string(n) + " joints",
                       "Give one number for all joints, or one each.");
    return values.expand(n);
}

/** The gains of `n` joints, checked. */
JointVector takeGains(const PerJoint& gains, const char* name, int n) {
    const std::string place = std::string("NricOptions::") + name;
    const JointVector values = expand(gains, place, "gains", n);
    for (int i = 0; i < n; ++i)
        if (!(values[i] >= 0.0) || std::isinf(values[i]))
            throw badInput(place,
                           "the gain of joint " + std::to_string(i) + " is " + detail::formatNumber(values[i]) +
                               "; allowed is [0, inf)",
                           "Without the robust loop: leave it out.");
    return values;
}

/** The bounds of `n` joints, checked. */
JointVector takeBounds(const PerJoint& bounds, const char* name, int n) {
    const std::string place = std::string("NricOptions::") + name;
    const JointVector values = expand(bounds, place, "bounds", n);
    for (int i = 0; i < n; ++i)
        if (!(values[i] > 0.0))
            throw badInput(place,
                           "the bound of joint " + std::to_string(i) + " is " + detail::formatNumber(values[i]) +
                               "; allowed is above 0, or infinity",
                           "Without this bound: infinity.");
    return values;
}

/** Poses that scaleNric() looks at. */
constexpr int kPoses = 1000;
/** Largest eigenvalue of M^-1 K_r dt there; the sampled loop swings up from 2 on. */
constexpr double kLargestMode = 1.0;
/** However heavy the arm: what the paper's gains come to on a real Indy7, K_r, K_r K_p and K_r K_i
[Nms/rad, Nm/rad, Nm/(rad s)]. Real arms have flexible joints. */
constexpr double kStiffest = 600.0, kStiffestPosition = 600.0 * 20.0, kStiffestIntegral = 600.0 * 8.0;
/** However light: those of experiments/panda_asymmetric_limits.yaml [1/s, 1/s^2]. */
constexpr double kLargestKp = 100.0, kLargestKi = 100.0;
/** K_p dt: the sampled position loop stays well below 1. */
constexpr double kLargestKpTick = 0.1;
/** K_i in terms of K_p x the slowest velocity loop, from where on the loop would be unstable. */
constexpr double kIntegralShare = 0.25;

std::vector<JointMatrix> sampleInertia(const RobotDescription& robot, const JointLimits& limits) {
    RobotModel model(robot);
    Dynamics dynamics;
    std::vector<JointMatrix> samples;
    samples.reserve(kPoses);
    for (const JointVector& q : detail::samplePoses(limits, kPoses)) {
        model.calcDynamics(q, JointVector::Zero(robot.size()), dynamics);
        if (dynamics.M.allFinite() && dynamics.M.llt().info() == Eigen::Success) samples.push_back(dynamics.M);
    }
    return samples;
}

}  // namespace

NricOptions scaleNric(const RobotDescription& robot, const JointLimits& limits, double tick_s) {
    const int n = robot.size();
    const std::vector<JointMatrix> samples = sampleInertia(robot, limits);
    if (samples.empty()) return {0.0, 0.0, 0.0};
    JointVector least = samples.front().diagonal(), greatest = least;
    for (const JointMatrix& M : samples) {
        const JointMatrix inverse = M.llt().solve(JointMatrix(JointMatrix::Identity(n, n)));
        least = least.cwiseMin(inverse.diagonal().cwiseInverse());
        greatest = greatest.cwiseMax(M.diagonal());
    }
    double largest = 0.0;
    for (const JointMatrix& M : samples) largest = std::max(largest, detail::findModes(M, least).eigenvalues()[n - 1]);
    JointVector kr = kLargestMode / tick_s / largest * least, kp(n), ki(n);
    for (int i = 0; i < n; ++i) {
        kr[i] = std::min(kr[i], kStiffest);
        kp[i] = std::min({kLargestKp, kStiffestPosition / kr[i], kLargestKpTick / tick_s});
        ki[i] = std::min({kLargestKi, kStiffestIntegral / kr[i], kIntegralShare * kp[i] * kr[i] / greatest[i]});
    }
    return {kr, kp, ki};
}

void Nric::configure(const RunSetup& setup, const Parameters& parameters) {
    configure(setup, NricOptions{parameters.jointNumbers("k_r"), parameters.jointNumbers("k_p"),
                                 parameters.jointNumbers("k_i"), parameters.jointNumbers("integral_limit_Nm"),
                                 parameters.jointNumbers("torque_rate_Nmps")});
}

void Nric::configure(const RunSetup& setup, const NricOptions& options) {
    n_ = setup.size();
    tick_s_ = setup.tick_s;
    loop_ = {takeGains(options.kr, "kr", n_), takeGains(options.kp, "kp", n_), takeGains(options.ki, "ki", n_),
             takeBounds(options.integralLimit, "integralLimit", n_), takeBounds(options.torqueRate, "torqueRate", n_)};
    torqueLimit_ = setup.robot.actuation.torqueLimit;
    const JointVector integralTorque = loop_.integralLimit.cwiseMin(torqueLimit_);
    largestStep_ = loop_.torqueRate * tick_s_;
    largestIntegral_.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const double gain = loop_.kr[i] * loop_.ki[i];
        largestIntegral_[i] = gain > 0.0 ? integralTorque[i] / gain : std::numeric_limits<double>::infinity();
    }
    clear();
}

void Nric::clear() {
    integral_.setZero(n_);
    lastTorque_.setZero(n_);
    isIntegralHeld_ = false;
}

void Nric::reset(const MotionState&) {
    clear();
}

TickStatus Nric::compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                         JointVector& torque) {
    if (!isFinite(real, n_) || !isFinite(nominal, n_) || !isFinite(filterTorque, n_)) return TickStatus::InvalidInput;
    torque.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const double kr = loop_.kr[i], kp = loop_.kp[i], ki = loop_.ki[i];
        const double e = real.q[i] - nominal.q[i];
        const double de = real.qd[i] - nominal.qd[i];
        const auto calcTorque = [&](double integral) { return -kr * (de + kp * e + ki * integral); };
        const auto clampTotal = [&](double robust) {
            // Unchanged to the last bit where the limit does not act: a rounded
            // difference would look like saturation.
            const double total = filterTorque[i] + robust;
            if (total > torqueLimit_[i]) return torqueLimit_[i] - filterTorque[i];
            if (total < -torqueLimit_[i]) return -torqueLimit_[i] - filterTorque[i];
            return robust;
        };
        const auto clampStep = [&](double robust) {
            return std::clamp(robust, lastTorque_[i] - largestStep_[i], lastTorque_[i] + largestStep_[i]);
        };
        const auto cut = [&](double robust) { return clampTotal(clampStep(robust)); };
        const double grown = isIntegralHeld_
                                 ? integral_[i]
                                 : std::clamp(integral_[i] + e * tick_s_, -largestIntegral_[i], largestIntegral_[i]);
        const double wanted = calcTorque(grown);
        const double possible = cut(wanted);
        const bool isCut = possible != wanted;
        // Growing e pushes the torque towards -e: into what cuts it, or away from it.
        const bool pushesFurther = isCut && ((wanted < possible) == (e > 0.0));
        if (pushesFurther) {
            torque[i] = cut(calcTorque(integral_[i]));
        } else {
            integral_[i] = grown;
            torque[i] = possible;
        }
    }
    lastTorque_ = torque;
    return TickStatus::Ok;
}

}  // namespace viable
