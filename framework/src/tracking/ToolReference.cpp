#include "viable/tracking/ToolReference.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

#include "robot/ArmRecursion.h"
#include "viable/braking/Braking.h"
#include "viable/core/RotationVector.h"

namespace viable {

namespace {

/** Damping that is always there, relative to the size of J'J: spare joints and exactly singular poses need some. */
constexpr double kLeastDamping = 1e-6;
/** Pull of spare joints to their rest posture, relative to the size of J'J: too weak to move the tool. */
constexpr double kRestWeight = 1e-5;
/** Weight of a step away from what is near, against the tool's: before the rest posture, and too weak to move the tool. */
constexpr double kApartWeight = 1e-3;

}  // namespace

void ToolReference::configure(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                              const JointVector& rest, const ToolReferenceOptions& options, const ArmGeometry* geometry,
                              std::shared_ptr<const ArmRecursion> recursion) {
    n_ = robot.size();
    tick_s_ = tick_s;
    options_ = options;
    recursion_ = recursion ? std::move(recursion) : std::make_shared<const ArmRecursion>(robot);
    clearances_.reset();
    if (geometry && options.apart_m > 0.0) clearances_.emplace(robot, *geometry);
    changeLimits(limits, rest);
    still_.setZero(n_);
    for (JointVector* v : {&target_, &lower_, &upper_, &step_, &gradient_}) v->setZero(n_);
    normal_.setZero(n_, n_);
    factor_.setZero(n_, n_);
    reset(rest);
}

void ToolReference::changeLimits(const JointLimits& limits, const JointVector& rest) {
    limits_ = limits;
    rest_ = rest;
    const double longest_s = calcLongestStop(limits);
    apartRate_ = longest_s > 0.0 ? 1.0 / longest_s : 1.0;
}

void ToolReference::reset(const JointVector& q) {
    q_ = q;
    isAtSpeedLimit_ = false;
    qp_.reset();
}

/** Adds |gradient dq - step|^2 for everything that is near, from no weight at apart_m on. */
void ToolReference::leadApart(const Surroundings* surroundings, double time_s) {
    const double apart = options_.apart_m;
    for (const ArmClearances::Item& item : clearances_->find(q_, surroundings, time_s, apart)) {
        const JointVector& row = item.gradient;
        const double nearness = std::min(1.0, 1.0 - item.distance / apart);
        const double weight = kApartWeight * nearness;
        normal_.noalias() += weight * row.lazyProduct(row.transpose());
        gradient_ += (weight * nearness * apart * apartRate_ * tick_s_) * row;
    }
}

void ToolReference::advance(const Pose& command, const Surroundings* surroundings, double time_s) {
    recursion_->calcDynamics(q_, still_, dynamics_);
    const ToolJacobian& J = dynamics_.J;
    const double turn = options_.rotationLength_m;
    Vector6 weights, error;
    weights << 1.0, 1.0, 1.0, turn, turn, turn;
    error.head<3>() = command.position - dynamics_.tool.position;
    error.tail<3>() = calcRotationVector(command.orientation * dynamics_.tool.orientation.conjugate());
    error = weights.cwiseProduct(error);
    const ToolJacobian weighted = weights.asDiagonal() * J;

    normal_.noalias() = weighted.transpose().lazyProduct(weighted);
    const double size = normal_.trace() / n_;
    const double damping = error.squaredNorm() + kLeastDamping * size;
    const double pull = options_.restRate > 0.0 ? kRestWeight * size : 0.0;
    gradient_.noalias() = weighted.transpose().lazyProduct(error);
    gradient_ += (pull * options_.restRate * tick_s_) * (rest_ - q_);
    normal_.diagonal().array() += damping + pull;
    if (clearances_) leadApart(surroundings, time_s);

    // |L'(dq - target)|^2 with normal = L L' is the cost.
    const Eigen::LLT<JointMatrix> factors(normal_);
    factor_ = factors.matrixU();
    target_ = gradient_;
    factors.solveInPlace(target_);
    for (int i = 0; i < n_; ++i) {
        lower_[i] = std::max(limits_.position.lower[i] - q_[i], limits_.velocity.lower[i] * tick_s_);
        upper_[i] = std::min(limits_.position.upper[i] - q_[i], limits_.velocity.upper[i] * tick_s_);
        lower_[i] = std::min(lower_[i], limits_.velocity.upper[i] * tick_s_);  // from outside: back at full speed
        upper_[i] = std::max(upper_[i], limits_.velocity.lower[i] * tick_s_);
    }
    qp_.solve(factor_, target_, lower_, upper_, step_);
    q_ += step_;
    isAtSpeedLimit_ = false;
    for (int i = 0; i < n_; ++i)
        isAtSpeedLimit_ |=
            step_[i] <= limits_.velocity.lower[i] * tick_s_ || step_[i] >= limits_.velocity.upper[i] * tick_s_;
}

}  // namespace viable
