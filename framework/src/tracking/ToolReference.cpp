#include "tracking/ToolReference.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include "clearance/Bisection.h"
#include "core/RotationVector.h"
#include "core/Text.h"
#include "environment/ArmClearances.h"
#include "qp/RowQp.h"
#include "robot/ArmRecursion.h"
#include "robot/PoseSampling.h"
#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** Damping that is always there, relative to the size of J'J: spare joints and exactly singular poses need some. */
constexpr double kLeastDamping = 1e-6;
/** Pull of spare joints to their rest posture, relative to the size of J'J: too weak to move the tool. */
constexpr double kRestWeight = 1e-5;
/** Weight of a step away from what is near, against the tool's, with as much as the damping up to the second: before the rest
posture, and too weak to lead the tool. */
constexpr double kApartWeight = 1e-3, kLargestApartWeight = 0.1;
/** The filter aims at so much more than the safety distance, and to first order is not to the last millimetre [m]. */
constexpr double kMargin_m = detail::bisection::kGuard_m + 0.002;
/** Things that are no farther than this from the margin count, and so much more as a tick can lead there [m]; at most kFarthest_m. */
constexpr double kNear_m = 0.02, kFarthest_m = 1.0;
/** A step that would lead on where the arm is nearer than the margin leads away by this share of its way. */
constexpr double kBack = 0.1;
/** It leaps to where the error is less than this share of its own, and not for one below that [m]: spare joints are then on
their way. */
constexpr double kLeap = 0.5, kLeapFrom_m = 1e-3;
/** A tool command that is no farther from the one that stands is the same: a client's rounding, of float, too [m, half a rad]. */
constexpr double kSameCommand = 1e-6;
/** A motion leads nowhere that comes less than this share of its way, and rests until the distances change by more [m]. */
constexpr double kNowhere = 0.1, kOtherwise_m = 1e-6, kLeastWay = 1e-9;
/** Joints that go one by one come so much nearer, less than kMargin_m leaves [m]: balls that cover the capsules are bumps on their
way. */
constexpr double kEase_m = 0.0015;

/** Poses in which a tool's directions are counted, and the least share of the best one. */
constexpr int kFreedomPoses = 60;
constexpr double kLeastDirection = 0.01;
/** Weight of turns that come after the position; the pull of spare joints is weaker still. */
constexpr double kTurnsLast = 0.02;

}  // namespace

ToolFreedom::ToolFreedom(const RobotDescription& robot, const JointLimits& limits) {
    const ArmRecursion recursion(robot);
    Dynamics dynamics;
    const auto count = [](const Eigen::MatrixXd& J) {
        const Eigen::VectorXd sizes = Eigen::JacobiSVD<Eigen::MatrixXd>(J).singularValues();
        return static_cast<int>((sizes.array() > kLeastDirection * sizes[0]).count());
    };
    Eigen::Matrix3d moves = Eigen::Matrix3d::Zero();
    for (const JointVector& q : detail::samplePoses(limits, kFreedomPoses)) {
        recursion.calcDynamics(q, JointVector::Zero(robot.size()), dynamics);
        Eigen::MatrixXd J = dynamics.J;
        J.bottomRows(3) *= calcLeverArm(dynamics.J);
        ways = std::max(ways, count(J.topRows(3)));
        all = std::max(all, count(J));
        moves += J.topRows(3) * J.topRows(3).transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(moves);
    for (int i = 0; i < 3; ++i)
        if (!(axes.eigenvalues()[i] > kLeastDirection * kLeastDirection * axes.eigenvalues()[2]))
            place -= axes.eigenvectors().col(i) * axes.eigenvectors().col(i).transpose();
}

double ToolFreedom::calcRotationLength(const ToolJacobian& J) const {
    return (all < 6 ? kTurnsLast : 1.0) * calcLeverArm(J);
}

std::string ToolFreedom::describe() const {
    if (all == 6) return {};
    return detail::format("its joints move it in %d of 6 directions, %d of 3 without turning: ", all, ways) +
           "the position comes first, and it turns as far as joints are left";
}

void Tremble::reset(const JointVector& q) {
    from_ = last_ = q;
    way_ = 0.0;
    left_ = ticks_;
}

bool Tremble::find(const JointVector& q, bool countsStill) {
    way_ += (q - last_).norm();
    last_ = q;
    if (--left_ > 0) return false;
    const bool isNowhere = (way_ > kLeastWay || countsStill) && (q - from_).norm() <= kNowhere * way_;
    reset(q);
    return isNowhere;
}

/** What of the arm is near, and the rows that keep it from coming nearer. */
struct ToolReference::Clear {
    Clear(const RobotDescription& robot, const ArmGeometry& geometry) : clearances(robot, geometry) {}

    /** Of the arm at `q`. @param reach_m  about how far a tick can lead */
    void find(const JointVector& q, const Surroundings* surroundings, double time_s, double apart_m, double reach_m) {
        least_m = kMargin_m + (surroundings ? surroundings->environment().safetyDistance_m : 0.0);
        const double far_m = least_m + std::min(kNear_m + reach_m, kFarthest_m);
        items = &clearances.find(q, surroundings, time_s, std::max(apart_m, far_m));
    }
    /** `step` leads nothing nearer than the arm may be, nor what is nearer still nearer; of one that does, the rows for one that
    does not, as far as a step within the box can come to them. */
    bool admits(const JointVector& step, const JointVector& lower, const JointVector& upper) {
        rows.clear();
        const auto bound = [&](const ArmClearances::Item& item) { return findBound(item, step); };
        const auto keeps = [&](const ArmClearances::Item& item) { return item.gradient.dot(step) >= bound(item); };
        for (const ArmClearances::Item& item : *items)
            if (!keeps(item)) rows.add(item.gradient, bound(item));
        if (rows.count == 0) return true;
        for (const bool isNearest : {true, false})  // where there is no room for all of these, ends come last
            for (const ArmClearances::Item& item : *items) {
                if (item.isNearest != isNearest) continue;
                const JointVector& row = item.gradient;
                const double farthest = row.cwiseProduct(lower).cwiseMin(row.cwiseProduct(upper)).sum();
                // Not a number: of a joint as fast as it likes.
                if (keeps(item) && !(farthest >= bound(item))) rows.add(row, bound(item));
            }
        return false;
    }

    bool admits(const JointVector& step, double ease_m) const {
        return std::all_of(items->begin(), items->end(), [&](const ArmClearances::Item& item) {
            return item.gradient.dot(step) >= findBound(item, step, ease_m);
        });
    }
    double findBound(const ArmClearances::Item& item, const JointVector& step, double ease_m = 0.0) const {
        const double spare = item.distance - least_m + ease_m;
        return spare >= 0.0 ? -spare : std::min(-spare, std::max(0.0, -kBack * item.gradient.dot(step)));
    }

    /** The nearest step to `target` that keeps the rows; false: none was found. */
    bool solve(const JointMatrix& factor, const JointVector& target, const JointVector& lower, const JointVector& upper,
               JointVector& step) {
        const RowQp::Status found = qp.solve(factor, target, lower, upper, rows, step);
        return found == RowQp::Status::Solved || found == RowQp::Status::TargetInside;
    }
    /** Where not all that is too near can be led away, nothing is. */
    void stay() {
        for (int k = 0; k < rows.count; ++k) {
            double& bound = rows.bound[static_cast<std::size_t>(k)];
            bound = std::min(0.0, bound);
        }
    }

    ArmClearances clearances;
    const std::vector<ArmClearances::Item>* items = nullptr;
    double least_m = 0.0;
    RowQp::Rows rows;  // those beyond its capacity are left to the filter
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
    for (JointVector* v : {&target_, &slowest_, &fastest_, &lower_, &upper_, &step_, &gradient_}) v->setZero(n_);
    normal_.setZero(n_, n_);
    factor_.setZero(n_, n_);
    reset(rest);
}

void ToolReference::changeLimits(const JointLimits& limits, const JointVector& rest) {
    limits_ = limits;
    rest_ = rest;
    rests_ = false;
    const double longest_s = calcLongestStop(limits);
    apartRate_ = longest_s > 0.0 ? 1.0 / longest_s : 1.0;
    tremble_.configure(calcLongestStopTicks(limits, tick_s_));
}

void ToolReference::reset(const JointVector& q) {
    q_ = q;
    isHeldBack_ = rests_ = false;
    tremble_.reset(q);
    qp_.reset();
    if (clear_) clear_->qp.reset();
}

/** Adds |gradient dq - step|^2 for all parts that are near something, from no weight at apart_m on. */
void ToolReference::leadApart(double weightNear) {
    const double apart = options_.apart_m;
    if (apart == 0.0) return;
    int last = -1;
    for (const ArmClearances::Item& item : *clear_->items) {
        if (!item.isNearest || !(item.distance < apart)) continue;
        // Of a part only the nearest obstacle, its first: in a room of many pieces it is not pulled the harder.
        if (item.otherCapsule < 0 && std::exchange(last, item.capsule) == item.capsule) continue;
        const JointVector& row = item.gradient;
        const double nearness = std::min(1.0, 1.0 - item.distance / apart);
        const double weight = weightNear * nearness;
        normal_.noalias() += weight * row.lazyProduct(row.transpose());
        gradient_ += (weight * nearness * apart * apartRate_ * tick_s_) * row;
    }
}

/** Within what bounds the step of this tick is; those of `around` come before the position limits. */
void ToolReference::findBox(const JointBounds* around) {
    for (int i = 0; i < n_; ++i) {
        const double slow = limits_.velocity.lower[i] * tick_s_, fast = limits_.velocity.upper[i] * tick_s_;
        lower_[i] = limits_.position.lower[i] - q_[i];
        upper_[i] = limits_.position.upper[i] - q_[i];
        slowest_[i] = slow;
        fastest_[i] = fast;
        if (around) {
            const double least = around->lower[i] - q_[i], most = around->upper[i] - q_[i];
            lower_[i] = std::clamp(lower_[i], least, most);
            upper_[i] = std::clamp(upper_[i], least, most);
            slowest_[i] = std::clamp(least, slow, fast);
            fastest_[i] = std::clamp(most, slow, fast);
        }
        lower_[i] = std::clamp(lower_[i], slow, fast);  // from outside: back at full speed
        upper_[i] = std::clamp(upper_[i], slow, fast);
    }
}

/** |L'(dq - target)|^2 with normal_ = L L' is the cost. */
void ToolReference::applyStep() {
    const Eigen::LLT<JointMatrix> factors(normal_);
    factor_ = factors.matrixU();
    target_ = gradient_;
    factors.solveInPlace(target_);
    qp_.solve(factor_, target_, lower_, upper_, step_);
    isHeldBack_ = (step_.array() <= slowest_.array() || step_.array() >= fastest_.array()).any();
    isBarred_ = clear_ && !clear_->admits(step_, lower_, upper_);
    if (!isBarred_) return;
    isHeldBack_ = true;
    if (clear_->solve(factor_, target_, lower_, upper_, step_)) return;
    clear_->stay();
    // A step of nothing keeps these rows: none is found only where the box asks for more than they admit.
    if (!clear_->solve(factor_, target_, lower_, upper_, step_))
        step_ = JointVector::Zero(n_).cwiseMax(lower_).cwiseMin(upper_);
}

Vector6 ToolReference::findError(const JointVector& q, const Pose& command) {
    recursion_->calcDynamics(q, still_, dynamics_);
    Vector6 error;
    error.head<3>() = command.position - dynamics_.tool.position;
    error.tail<3>() =
        options_.rotationLength_m * calcRotationVector(command.orientation * dynamics_.tool.orientation.conjugate());
    return error;
}

void ToolReference::leapTo(const JointVector& q, const Pose& command) {
    const double error = findError(q_, command).norm();
    if (error > kLeapFrom_m && q.allFinite() && findError(q, command).norm() < kLeap * error) reset(q);
}

void ToolReference::leapTo(const JointVector& q, const JointVector& goal) {
    if (q.allFinite() && (goal - q).norm() < kLeap * (goal - q_).norm()) reset(q);
}

/** What is near q_, whose dynamics are known. */
void ToolReference::findNear(const Surroundings* surroundings, double time_s, double apart_m) {
    const JointVector fastest = limits_.velocity.upper.cwiseMax(-limits_.velocity.lower);
    const double reach_m = tick_s_ * dynamics_.J.topRows<3>().colwise().norm().dot(fastest);
    clear_->find(q_, surroundings, time_s, apart_m, std::isnan(reach_m) ? kFarthest_m : reach_m);
}

void ToolReference::advance(const JointVector& goal, const Surroundings* surroundings, double time_s,
                            const JointBounds* around) {
    normal_.setIdentity();
    gradient_ = goal - q_;
    if (clear_) {
        recursion_->calcDynamics(q_, still_, dynamics_);
        findNear(surroundings, time_s, 0.0);
    }
    findBox(around);
    if (isAtRest(goal, 0.0)) {
        goOneByOne();
        return;
    }
    applyStep();
    q_ += step_;
    if (clear_ && tremble_.find(q_, true) && isBarred_) rest(q_);
}

/** Each joint that can goes towards its goal; as none goes back, this ends at rest. */
void ToolReference::goOneByOne() {
    step_.setZero();
    for (int i = 0; i < n_; ++i) {
        const double way = std::clamp(goal_[i] - q_[i], std::min(0.0, lower_[i]), std::max(0.0, upper_[i]));
        step_[i] = way;
        if (way != 0.0 && !clear_->admits(step_, kEase_m)) step_[i] = 0.0;
    }
    if (!step_.isZero(0.0)) moveTo(q_ + step_);
}

void ToolReference::moveTo(const JointVector& q) {
    q_ = q;
    near_m_ = std::numeric_limits<double>::quiet_NaN();
}

/** Resting; until a command, or a distance from what is near, is another. */
bool ToolReference::isAtRest(const JointVector& goal, double same) {
    hasNewGoal_ = goal_.size() != goal.size() || (goal - goal_).cwiseAbs().maxCoeff() > same;
    if (hasNewGoal_) goal_ = goal;  // one that drifts is new again and again
    if (!clear_) return false;
    if (hasNewGoal_) tremble_.reset(q_);
    double near_m = 0.0;
    for (const ArmClearances::Item& item : *clear_->items) near_m += item.distance;
    if (rests_ && std::isnan(near_m_)) near_m_ = near_m;
    rests_ = rests_ && !hasNewGoal_ && std::abs(near_m - near_m_) <= kOtherwise_m;
    return rests_;
}

void ToolReference::rest(const JointVector& q) {
    reset(q);
    rests_ = isHeldBack_ = true;
    near_m_ = std::numeric_limits<double>::quiet_NaN();
}

void ToolReference::advance(const Pose& command, const Surroundings* surroundings, double time_s,
                            const JointBounds* around) {
    const Vector6 error = findError(q_, command);
    const ToolJacobian& J = dynamics_.J;
    ToolJacobian weighted = J;
    weighted.bottomRows<3>() *= options_.rotationLength_m;

    normal_.noalias() = weighted.transpose().lazyProduct(weighted);
    const double size = normal_.trace() / n_;
    // About what the curvature of the error, which is left out, can come to: MATH 6. With much less the reference swings in
    // stretched poses.
    const double damping = error.norm() * std::sqrt(normal_.trace()) + kLeastDamping * size;
    const double pull = options_.restRate > 0.0 ? kRestWeight * size : 0.0;
    gradient_.noalias() = weighted.transpose().lazyProduct(error);
    gradient_ += (pull * options_.restRate * tick_s_) * (rest_ - q_);
    normal_.diagonal().array() += damping + pull;
    if (clear_) {
        findNear(surroundings, time_s, options_.apart_m);
        leadApart(std::min(kApartWeight + damping / std::max(size, 1e-9), kLargestApartWeight));
    }
    Eigen::Vector4d turn = command.orientation.coeffs();
    if (goal_.size() == 7 && turn.dot(goal_.tail<4>()) < 0.0) turn = -turn;  // the same orientation
    if (isAtRest((JointVector(7) << command.position, turn).finished(), kSameCommand)) return;
    findBox(around);
    applyStep();
    const bool isAtEnd =
        around &&
        (step_.array() <= (around->lower - q_).array() || step_.array() >= (around->upper - q_).array()).any();
    q_ += step_;
    if (isAtEnd) tremble_.reset(q_);  // it goes on when what holds the arm, such as a person, is gone
    if (clear_ && tremble_.find(q_)) rest(q_);
}

}  // namespace viable
