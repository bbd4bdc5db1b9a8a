#include "viable/loop/GuardSummary.h"

#include <algorithm>
#include <cmath>

namespace viable {

bool LimitRecord::add(LimitKind kind, double lower, double upper, double x, double time_s, bool isRecovering) {
    const bool bothFinite = std::isfinite(lower) && std::isfinite(upper);
    const double tolerance = kOutsideShare * calcLimitScale(lower, upper);
    const double excess = std::isnan(x) ? INFINITY : std::max({0.0, lower - x, x - upper});
    const bool isOutside = excess > tolerance;
    // Positions are measured from the middle of their range, the rest from zero. A position with a limit
    // on one side only has no share of it that could be used: it is inside or beyond.
    double use = 0.0;
    if (kind != LimitKind::Position) {
        const double limit = x >= 0.0 ? upper : lower;
        use = std::isfinite(limit) && limit != 0.0 ? x / limit : 0.0;
    } else if (bothFinite && upper > lower) {
        use = std::abs(2.0 * x - lower - upper) / (upper - lower);
    }
    if (isOutside) use = std::max(use, 1.0 + 2.0 * kOutsideShare);
    if (std::isnan(x)) use = INFINITY;
    exists |= std::isfinite(lower) || std::isfinite(upper);
    lastExcess = isOutside ? excess : 0.0;
    if (use > worstUse) {
        worstUse = use;
        worstTime_s = time_s;
    }
    if (isRecovering && isOutside) {
        ++ticksRecovering;
        worstRecovering = std::max(worstRecovering, excess);
        return true;
    }
    worstExcess = std::max(worstExcess, excess);
    if (isOutside) ++ticksOutside;
    return isOutside;
}

GuardSummary::GuardSummary(int joints) {
    for (auto& records : limits_) records.resize(static_cast<std::size_t>(joints));
}

void GuardSummary::add(const TickRecord& record) {
    bounds_ = record.limits;
    isRecovering_ = record.verdict == StopVerdict::Recovering;
    addEnd({record.nominal.q, record.nominal.qd, record.nominal.qdd}, record.time_s);
    check(LimitKind::Jerk, bounds_.jerk, record.nominal.jerk, record.time_s);
    if (record.hasReading && record.actual.q.size() == record.nominal.q.size())  // a ReferenceGuard has no real arm
        trackingMax_ = std::max(trackingMax_, (record.actual.q - record.nominal.q).lpNorm<Eigen::Infinity>());
    ++ticks_;
}

void GuardSummary::addEnd(const MotionState& nominal, double time_s) {
    check(LimitKind::Position, bounds_.position, nominal.q, time_s);
    check(LimitKind::Velocity, bounds_.velocity, nominal.qd, time_s);
    check(LimitKind::Acceleration, bounds_.acceleration, nominal.qdd, time_s);
}

void GuardSummary::check(LimitKind kind, const JointBounds& bounds, const JointVector& values, double time_s) {
    std::vector<LimitRecord>& records = limits_[static_cast<std::size_t>(kind) - 1];
    const auto n = static_cast<Eigen::Index>(records.size());
    if (values.size() != n || bounds.lower.size() != n || bounds.upper.size() != n) return;  // a record of no tick
    for (Eigen::Index i = 0; i < n; ++i) {
        const bool isOutside = records[i].add(kind, bounds.lower[i], bounds.upper[i], values[i], time_s, isRecovering_);
        isBroken_ |= isOutside && !isRecovering_;
    }
}

const std::vector<LimitRecord>& GuardSummary::limit(LimitKind kind) const {
    return limits_[static_cast<std::size_t>(kind) - 1];
}

int GuardSummary::worstJoint(LimitKind kind) const {
    const std::vector<LimitRecord>& records = limit(kind);
    const auto isLess = [](const LimitRecord& a, const LimitRecord& b) { return a.worstUse < b.worstUse; };
    return static_cast<int>(std::max_element(records.begin(), records.end(), isLess) - records.begin());
}

std::int64_t GuardSummary::ticksOutside(LimitKind kind) const {
    std::int64_t sum = 0;
    for (const LimitRecord& record : limit(kind)) sum += record.ticksOutside;
    return sum;
}

}  // namespace viable
