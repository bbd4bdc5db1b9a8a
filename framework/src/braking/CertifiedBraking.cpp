#include "braking/CertifiedBraking.h"

#include <algorithm>

namespace viable {

/** How often the joints are asked again after the QP moved them; then each takes its bound. */
constexpr int kMaxQpRounds = 4;
/** How often the path is shortened until every joint admits its jerk; then the backup stop is followed. */
constexpr int kMaxPathRounds = 8;

void CertifiedBraking::configure(const JointLimits& limits, double tick_s, double approach) {
    n_ = limits.size();
    limits_ = limits;
    for (int i = 0; i < n_; ++i) certificates_[i].configure(limits.axis(i), tick_s, approach);
}

void CertifiedBraking::reset(const MotionState& state) {
    qp_.reset();
    rowQp_.reset();
    for (int i = 0; i < n_; ++i) certificates_[i].reset({state.q[i], state.qd[i], state.qdd[i]});
}

void CertifiedBraking::changeLimits(const JointLimits& limits) {
    limits_ = limits;
    for (int i = 0; i < n_; ++i) certificates_[i].changeLimits(limits.axis(i));
}

void CertifiedBraking::skipTicks(std::int64_t ticks) {
    for (int i = 0; i < n_; ++i) certificates_[i].skipTicks(ticks);
}

/** Narrows the joint's interval to its bound on the side of `wanted`, which it does not admit. */
void CertifiedBraking::restrict(int joint, double wanted) {
    BrakingCertificate& certificate = certificates_[joint];
    Interval& interval = intervals_[joint];
    const BrakingCertificate::Bound bound = certificate.findBound(wanted);
    if (wanted > certificate.storedJerk()) {
        interval.upper = bound.jerk;
        interval.upperLimit = bound.limit;
        interval.lower = std::min(interval.lower, bound.jerk);
    } else {
        interval.lower = bound.jerk;
        interval.lowerLimit = bound.limit;
        interval.upper = std::max(interval.upper, bound.jerk);
    }
}

/** The jerks nearest to the target in torque, each certified by its joint. */
void CertifiedBraking::settle(const JointMatrix& M, const RowQp::Rows* rows, JointVector& chosen) {
    lower_.resize(n_);
    upper_.resize(n_);
    for (int round = 0; round < kMaxQpRounds; ++round) {
        for (int i = 0; i < n_; ++i) {
            lower_[i] = intervals_[i].lower;
            upper_[i] = intervals_[i].upper;
        }
        if (rows)
            rowQp_.solve(M, target_, lower_, upper_, *rows, chosen);
        else
            qp_.solve(M, target_, lower_, upper_, chosen);
        bool admitted = true;
        for (int i = 0; i < n_; ++i) {
            if (intervals_[i].fixed || certificates_[i].isAdmissible(chosen[i])) continue;
            restrict(i, chosen[i]);
            admitted = false;
        }
        if (admitted) return;
    }
    for (int i = 0; i < n_; ++i)
        if (!intervals_[i].fixed && !certificates_[i].isAdmissible(chosen[i]))
            chosen[i] = certificates_[i].findBound(chosen[i]).jerk;
}

bool CertifiedBraking::beginTick(const MotionState& state) {
    returns_ = isBounded_ = false;
    bool keepsStops = true;
    for (int i = 0; i < n_; ++i) {
        keepsStops &= certificates_[i].beginTick({state.q[i], state.qd[i], state.qdd[i]});
        returns_ |= certificates_[i].findExcess().limit != LimitKind::None;
    }
    return keepsStops;
}

bool CertifiedBraking::isAdmissible(const JointVector& jerks) {
    for (int i = 0; i < n_; ++i)
        if (!certificates_[i].isAdmissible(jerks[i])) return false;
    return true;
}

bool CertifiedBraking::isAdmissible(const JointVector& jerks, const std::array<GridStop, kMaxJoints>& stops) {
    for (int i = 0; i < n_; ++i)
        if (!certificates_[i].isAdmissible(jerks[i], stops[i])) return false;
    return true;
}

void CertifiedBraking::getStored(JointVector& jerks) const {
    jerks.resize(n_);
    for (int i = 0; i < n_; ++i) jerks[i] = certificates_[i].storedJerk();
}

/** What each joint may do, as far as the target asks for it. */
void CertifiedBraking::bound() {
    for (int i = 0; i < n_; ++i) {
        BrakingCertificate& certificate = certificates_[i];
        Interval& interval = intervals_[i];
        interval = {limits_.jerk.lower[i], limits_.jerk.upper[i], LimitKind::Jerk, LimitKind::Jerk};
        const PassedLimit& excess = certificate.findExcess();
        if (excess.limit != LimitKind::None) {
            // Back towards the limit; a jerk limit is met by following the stop until a gentler one is found.
            const double back = excess.limit == LimitKind::Jerk
                                    ? std::clamp(certificate.storedJerk(), limits_.jerk.lower[i], limits_.jerk.upper[i])
                                : excess.side == LimitSide::Upper ? limits_.jerk.lower[i]
                                                                  : limits_.jerk.upper[i];
            interval.lower = interval.upper = certificate.isAdmissible(back) ? back : certificate.findBound(back).jerk;
            interval.fixed = true;
        } else if (!certificate.isAdmissible(target_[i])) {
            restrict(i, target_[i]);
        }
    }
    isBounded_ = true;
}

FilterStatus CertifiedBraking::propose(const JointMatrix* M, const JointVector& desired, const RowQp::Rows* rows,
                                       JointVector& proposed) {
    if (!rows && !returns_ && isAdmissible(desired)) {
        proposed = desired;
        return FilterStatus::Passed;
    }
    target_ = desired.cwiseMax(limits_.jerk.lower).cwiseMin(limits_.jerk.upper);
    if (!isBounded_) bound();
    if (!M && !returns_) return proposeOnPath(desired, proposed);
    if (M)
        settle(*M, rows, proposed);
    else  // back from outside each joint goes by itself
        settle(JointMatrix::Identity(n_, n_), rows, proposed);
    return returns_ ? FilterStatus::Recovering : proposed == desired ? FilterStatus::Passed : FilterStatus::Modified;
}

/** Towards target_, with the intervals of this tick. */
FilterStatus CertifiedBraking::proposeOnPath(const JointVector& desired, JointVector& proposed) {
    getStored(lower_);
    double s = 1.0;
    for (int i = 0; i < n_; ++i) {
        const double way = target_[i] - lower_[i];
        const double bound = way > 0.0 ? intervals_[i].upper : intervals_[i].lower;
        if (way != 0.0) s = std::min(s, std::clamp((bound - lower_[i]) / way, 0.0, 1.0));
    }
    // What is admissible at its bound need not be before it: other phases of a stop fit the grid there.
    for (int round = 0; round < kMaxPathRounds && s > 0.0; ++round) {
        proposed = lower_ + s * (target_ - lower_);
        for (int i = 0; i < n_; ++i) proposed[i] = std::clamp(proposed[i], intervals_[i].lower, intervals_[i].upper);
        if (isAdmissible(proposed)) return proposed == desired ? FilterStatus::Passed : FilterStatus::Modified;
        s *= round < kMaxPathRounds - 2 ? 0.999 : 0.5;
    }
    proposed = lower_;
    return FilterStatus::Modified;
}

void CertifiedBraking::commit(const JointVector& desired, JointVector& jerks,
                              std::array<JointIntervention, kMaxJoints>& acting) {
    for (int i = 0; i < n_; ++i) {
        const Interval& interval = intervals_[i];
        acting[i] = {};
        if (isBounded_) {  // else nothing was in the way of what is desired
            if (interval.fixed)
                acting[i] = {certificates_[i].findExcess().limit, certificates_[i].findExcess().side};
            else if (jerks[i] >= interval.upper && desired[i] > interval.upper)
                acting[i] = {interval.upperLimit, LimitSide::Upper};
            else if (jerks[i] <= interval.lower && desired[i] < interval.lower)
                acting[i] = {interval.lowerLimit, LimitSide::Lower};
        }
        jerks[i] = certificates_[i].commit(jerks[i]);
    }
}

FilterStatus CertifiedBraking::choose(const MotionState& state, const JointMatrix* M, const JointVector& desired,
                                      JointVector& chosen, std::array<JointIntervention, kMaxJoints>& acting) {
    beginTick(state);
    const FilterStatus status = propose(M, desired, nullptr, chosen);
    commit(desired, chosen, acting);
    return status;
}

}  // namespace viable
