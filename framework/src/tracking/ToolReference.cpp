#include "viable/tracking/ToolReference.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "clearance/Bisection.h"
#include "qp/RowQp.h"
#include "robot/ArmRecursion.h"
#include "viable/braking/Braking.h"
#include "viable/core/RotationVector.h"
#include "viable/environment/ArmClearances.h"

namespace viable {

namespace {

/** Damping that is always there, relative to the size of J'J: spare joints and exactly singular poses need some. */
constexpr double kLeastDamping = 1e-6;
/** Pull of spare joints to their rest posture, relative to the size of J'J: too weak to move the tool. */
constexpr double kRestWeight = 1e-5;
/** Weight of a step away from what is near, against the tool's: before the rest posture, and too weak to move the tool. */
constexpr double kApartWeight = 1e-3;
/** The filter aims at so much more than the safety distance, and to first order is not to the last millimetre [m]. */
constexpr double kMargin_m = detail::bisection::kGuard_m + 0.002;
/** Farther away than the margin by this nothing is looked at: no tick leads so far [m]. */
constexpr double kFar_m = 0.05;

}  // namespace

/** What of the arm is near, and the rows that keep it from coming nearer. */
struct ToolReference::Clear {
    Clear(const RobotDescription& robot, const ArmGeometry& geometry) : clearances(robot, geometry) {}

    /** Of the arm at `q`. */
    void find(const JointVector& q, const Surroundings* surroundings, double time_s, double apart_m) {
        least_m = kMargin_m + (surroundings ? surroundings->environment().safetyDistance_m : 0.0);
        items = &clearances.find(q, surroundings, time_s, std::max(apart_m, least_m + kFar_m));
    }
    /** The rows that a step within a box can come to. */
    void findRows(const JointVector& lower, const JointVector& upper) {
        rows.clear();
        for (const ArmClearances::Item& item : *items) {
            const double bound = -std::max(0.0, item.distance - least_m);
            const JointVector& row = item.gradient;
            const double farthest = row.cwiseProduct(lower).cwiseMin(row.cwiseProduct(upper)).sum();
            if (!(farthest >= bound)) rows.add(row, bound);  // not a number: of a joint as fast as it likes
        }
    }
    bool admits(const JointVector& step) const {
        for (int k = 0; k < rows.count; ++k)
            if (rows.normal[static_cast<std::size_t>(k)].dot(step) < rows.bound[static_cast<std::size_t>(k)])
                return false;
        return true;
    }

    ArmClearances clearances;
    const std::vector<ArmClearances::Item>* items = nullptr;
    double least_m = 0.0;
    RowQp::Rows rows;
    RowQp qp;
};

ToolReference::ToolReference() = default;
ToolReference::~ToolReference() = default;
ToolReference::ToolReference(ToolReference&&) noexcept = default;
ToolReference& ToolReference::operator=(ToolReference&&) noexcept = default;

void ToolReference::configure(const RobotDescription& robot, const JointLimits& limits, double tick_s,
                              const JointVector& rest, const ToolReferenceOptions& options, const ArmGeometry* geometry,
                              std::shared_ptr<const ArmRecursion> recursion) {
    n_ = robot.size();
    tick_s_ = tick_s;
    options_ = options;
    recursion_ = recursion ? std::move(recursion) : std::make_shared<const ArmRecursion>(robot);
    clear_ = geometry ? std::make_unique<Clear>(robot, *geometry) : nullptr;
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
    isHeldBack_ = false;
    qp_.reset();
    if (clear_) clear_->qp.reset();
}

/** Adds |gradient dq - step|^2 for everything that is near, from no weight at apart_m on. */
void ToolReference::leadApart() {
    const double apart = options_.apart_m;
    for (const ArmClearances::Item& item : *clear_->items) {
        if (!(item.distance < apart)) continue;
        const JointVector& row = item.gradient;
        const double nearness = std::min(1.0, 1.0 - item.distance / apart);
        const double weight = kApartWeight * nearness;
        normal_.noalias() += weight * row.lazyProduct(row.transpose());
        gradient_ += (weight * nearness * apart * apartRate_ * tick_s_) * row;
    }
}

/** Within what bounds the step of this tick is. */
void ToolReference::findBox(const JointBounds* around) {
    for (int i = 0; i < n_; ++i) {
        const double slowest = limits_.velocity.lower[i] * tick_s_, fastest = limits_.velocity.upper[i] * tick_s_;
        lower_[i] = std::max(limits_.position.lower[i] - q_[i], slowest);
        upper_[i] = std::min(limits_.position.upper[i] - q_[i], fastest);
        if (around) {
            lower_[i] = std::max(lower_[i], around->lower[i] - q_[i]);
            upper_[i] = std::min(upper_[i], around->upper[i] - q_[i]);
        }
        lower_[i] = std::min(lower_[i], fastest);  // from outside: back at full speed
        upper_[i] = std::max(upper_[i], slowest);
    }
}

/** |L'(dq - target)|^2 with normal_ = L L' is the cost. */
void ToolReference::takeStep() {
    const Eigen::LLT<JointMatrix> factors(normal_);
    factor_ = factors.matrixU();
    target_ = gradient_;
    factors.solveInPlace(target_);
    qp_.solve(factor_, target_, lower_, upper_, step_);
    if (!clear_) return;
    clear_->findRows(lower_, upper_);
    if (clear_->admits(step_)) return;
    const RowQp::Status found = clear_->qp.solve(factor_, target_, lower_, upper_, clear_->rows, step_);
    // A step of nothing keeps all rows: none is found only where the box asks for one.
    if (found == RowQp::Status::Infeasible || found == RowQp::Status::Failed)
        step_ = JointVector::Zero(n_).cwiseMax(lower_).cwiseMin(upper_);
}

void ToolReference::advance(const Pose& command, const Surroundings* surroundings, double time_s,
                            const JointBounds* around) {
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
    // As much as the curvature of the error can be that is left out: a column of J changes with a joint by no more than the
    // longer one of both. With less, the reference swings in stretched poses.
    const double damping = error.norm() * std::sqrt(normal_.trace()) + kLeastDamping * size;
    const double pull = options_.restRate > 0.0 ? kRestWeight * size : 0.0;
    gradient_.noalias() = weighted.transpose().lazyProduct(error);
    gradient_ += (pull * options_.restRate * tick_s_) * (rest_ - q_);
    normal_.diagonal().array() += damping + pull;
    if (clear_) {
        clear_->find(q_, surroundings, time_s, options_.apart_m);
        leadApart();
    }
    findBox(around);
    takeStep();
    q_ += step_;
    isHeldBack_ = false;
    for (int i = 0; i < n_; ++i) {
        isHeldBack_ |=
            step_[i] <= limits_.velocity.lower[i] * tick_s_ || step_[i] >= limits_.velocity.upper[i] * tick_s_;
        if (around) isHeldBack_ |= q_[i] <= around->lower[i] || q_[i] >= around->upper[i];
    }
}

}  // namespace viable
