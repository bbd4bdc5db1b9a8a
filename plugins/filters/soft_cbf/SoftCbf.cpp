#include "SoftCbf.h"

#include <Eigen/Cholesky>

#include "viable/plugin/PluginExport.h"

namespace viable {

/** A Newton step this small, relative to the distance from the target, is rounding. */
constexpr double kRounding = 1e-12;
/** Halvings of the line search; each doubles the accuracy of a step that need not be exact. */
constexpr int kHalvings = 30;

constexpr std::size_t kRows = ExponentialBarrierRows::kRows;

void SoftCbf::configure(const RunSetup& setup, const Parameters& parameters) {
    options_ = parameters.get<SoftCbfOptions>();
    checkKAlpha(options_.kAlpha, setup, parameters);
    JerkIntervalFilter::configure(setup, parameters);
}

void SoftCbf::reset(const MotionState& start) {
    qp_.reset();
    rounds_ = 0;
    JerkIntervalFilter::reset(start);
}

/** The rows without their slacks: only whether they have a solution matters. */
JerkIntervalFilter::Rows SoftCbf::calcRows(const AxisState& s, const AxisLimits& l) const {
    JointInterval jerk{l.jerkLower, l.jerkUpper, LimitKind::Jerk, LimitKind::Jerk};
    const ExponentialBarrierRows rows = calcExponentialBarrierRows(s, l, options_.kAlpha);
    for (std::size_t r = 0; r < kRows; ++r) {
        jerk.restrictLower(rows.lower[r], ExponentialBarrierRows::kLimits[r]);
        jerk.restrictUpper(rows.upper[r], ExponentialBarrierRows::kLimits[r]);
    }
    return {jerk, jerk.isEmpty()};
}

SoftCbf::Violated SoftCbf::findViolated(int joint, double jerk) const {
    const ExponentialBarrierRows& rows = rows_[joint];
    Violated violated;
    const auto add = [&](std::size_t bit, double bound) {
        violated.mask |= 1u << bit;
        ++violated.count;
        violated.bounds += bound;
    };
    for (std::size_t r = 0; r < kRows; ++r) {
        if (jerk < rows.lower[r]) add(r, rows.lower[r]);
        if (jerk > rows.upper[r]) add(kRows + r, rows.upper[r]);
    }
    return violated;
}

bool SoftCbf::isSamePiece(const JointVector& a, const JointVector& b) const {
    for (int i = 0; i < a.size(); ++i)
        if (findViolated(i, a[i]).mask != findViolated(i, b[i]).mask) return false;
    return true;
}

/** `minimum_`: where the quadratic that the cost is around `at` is smallest in the box. False when it cannot be
computed. */
bool SoftCbf::minimisePiece(const JointMatrix& M, const JointVector& at) {
    const int n = static_cast<int>(at.size());
    normal_ = M.transpose().lazyProduct(M);
    pieceTarget_.setZero(n);
    bool any = false;
    for (int i = 0; i < n; ++i) {
        const Violated violated = findViolated(i, at[i]);
        const double price = options_.weight * size_[i] * size_[i];
        normal_(i, i) += price * violated.count;
        pieceTarget_[i] = price * (violated.bounds - violated.count * target_[i]);
        any |= violated.count > 0;
    }
    if (!any) {
        qp_.solve(M, target_, limits().jerk.lower, limits().jerk.upper, minimum_);
        return true;
    }
    const Eigen::LLT<JointMatrix> factor(normal_);
    if (factor.info() != Eigen::Success) return false;
    factor.solveInPlace(pieceTarget_);
    pieceTarget_ += target_;
    root_ = factor.matrixU();
    qp_.solve(root_, pieceTarget_, limits().jerk.lower, limits().jerk.upper, minimum_);
    return true;
}

/** From `jerk` along `step_`, not farther than it reaches, to where the cost is least: to the zero of its slope,
which grows along the line. */
void SoftCbf::searchLine(const JointMatrix& M, JointVector& jerk) {
    const int n = static_cast<int>(jerk.size());
    moved_ = M.lazyProduct(step_);
    const double curvature = moved_.squaredNorm();
    double slope = 0.0;
    for (int r = 0; r < n; ++r) {
        double torque = 0.0;
        for (int i = 0; i < n; ++i) torque += M(r, i) * (jerk[i] - target_[i]);
        slope += moved_[r] * torque;
    }
    const auto calcSlope = [&](double share) {
        double sum = slope + share * curvature;
        for (int i = 0; i < n; ++i) {
            const double x = jerk[i] + share * step_[i];
            const Violated violated = findViolated(i, x);
            sum += options_.weight * size_[i] * size_[i] * (violated.count * x - violated.bounds) * step_[i];
        }
        return sum;
    };
    double low = 0.0, high = 1.0;
    if (calcSlope(high) <= 0.0) {
        low = 1.0;
    } else {
        for (int k = 0; k < kHalvings; ++k) {
            const double middle = (low + high) / 2.0;
            (calcSlope(middle) <= 0.0 ? low : high) = middle;
        }
    }
    jerk += low * step_;
    jerk = jerk.cwiseMax(limits().jerk.lower).cwiseMin(limits().jerk.upper);  // rounding
}

void SoftCbf::minimise(const JointMatrix& M, JointVector& jerk) {
    const int n = static_cast<int>(jerk.size());
    size_.resize(n);
    for (int i = 0; i < n; ++i) size_[i] = M.col(i).norm();
    for (rounds_ = 1; rounds_ <= kMaxRounds; ++rounds_) {
        if (!minimisePiece(M, jerk)) return;
        if (isSamePiece(jerk, minimum_)) {
            jerk = minimum_;
            return;
        }
        step_ = minimum_ - jerk;
        const double distance = size_.cwiseProduct(minimum_ - target_).norm();
        if (size_.cwiseProduct(step_).norm() <= kRounding * distance) return;
        searchLine(M, jerk);
    }
    rounds_ = kMaxRounds;
}

JointIntervention SoftCbf::findIntervention(int joint, double desired, double jerk) const {
    if (jerk == desired) return {};
    const LimitSide side = jerk < desired ? LimitSide::Upper : LimitSide::Lower;
    const JointBounds& box = limits().jerk;
    if (side == LimitSide::Upper ? jerk >= box.upper[joint] : jerk <= box.lower[joint]) return {LimitKind::Jerk, side};
    const ExponentialBarrierRows& rows = rows_[joint];
    JointIntervention found;
    double worst = 0.0;
    for (std::size_t r = 0; r < kRows; ++r) {
        const double miss = side == LimitSide::Upper ? jerk - rows.upper[r] : rows.lower[r] - jerk;
        if (!(miss > worst)) continue;
        worst = miss;
        found = {ExponentialBarrierRows::kLimits[r], side};
    }
    return found;
}

FilterStatus SoftCbf::chooseJerk(const MotionState& nominal, const Dynamics& dynamics, const JointVector& desired,
                                 JointVector& jerk, std::array<JointIntervention, kMaxJoints>& joints) {
    const int n = static_cast<int>(desired.size());
    bool infeasible = false;
    for (int i = 0; i < n; ++i) {
        const AxisState state{nominal.q[i], nominal.qd[i], nominal.qdd[i]};
        const AxisLimits axis = limits().axis(i);
        rows_[i] = calcExponentialBarrierRows(state, axis, options_.kAlpha);
        infeasible |= calcRows(state, axis).empty;
    }
    target_ = desired.cwiseMax(limits().jerk.lower).cwiseMin(limits().jerk.upper);
    jerk = target_;
    minimise(dynamics.M, jerk);
    for (int i = 0; i < n; ++i) joints[i] = findIntervention(i, desired[i], jerk[i]);
    if (infeasible) return FilterStatus::Infeasible;
    return jerk == desired ? FilterStatus::Passed : FilterStatus::Modified;
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::SoftCbf, "soft_cbf",
              "Exponential control barrier functions with a slack on every row: always a jerk, no row exact.",
              viable::SoftCbfOptions)
