#include "clearance/TorqueScan.h"

#include <algorithm>
#include <cmath>

namespace viable::detail {

namespace {

/** A torque that differs by less is the same: rounding, as a share of its limit. */
constexpr double kRounding = 1e-9;

}  // namespace

TorqueScan::TorqueScan(const RobotDescription& robot, const Limits& limits, double tick_s)
    : n_(robot.size()),
      limits_(limits),
      tick_s_(tick_s),
      arm_(robot),
      torqueRate_(robot),
      limitsTorque_(!limits.torque.array().isInf().all()),
      limitsRate_(!limits.rate.array().isInf().all()) {
    for (JointVector* v : {&position_, &velocity_, &acceleration_, &torque_, &torqueBefore_, &rate_}) v->setZero(n_);
}

void TorqueScan::calcTorque(const ArmPath& path, std::int64_t tick, JointVector& torque) {
    path.calcTick(tick, position_, velocity_, acceleration_);
    arm_.calcTorque(position_, velocity_, acceleration_, torque);
}

bool TorqueScan::isKnown(const ArmPath::Extremes& extremes, const Neighbour& neighbour, Result& result) {
    if (limitsRate_) return false;
    torqueRate_.calcDifference(extremes, *neighbour.apart, rate_);
    result.proven = *neighbour.proven + rate_;
    if (!(result.proven.array() <= limits_.torque.array()).all()) return false;
    result.torqueUse = result.proven.cwiseQuotient(limits_.torque).maxCoeff(&result.joint);
    result.torque = result.proven[result.joint];
    return true;
}

void TorqueScan::addFault(std::int64_t tick, int joint, double value, double allowed, bool isChange) {
    if (faultCount_ < static_cast<int>(faults_.size()))
        faults_[static_cast<std::size_t>(faultCount_++)] = {tick, joint, value, std::abs(value) - allowed, isChange};
    if (!isChange) return;
    const auto end = suspects_.begin() + suspectCount_;
    auto at = std::find(suspects_.begin(), end, tick);
    if (at == end && end != suspects_.end()) ++suspectCount_;
    if (at == suspects_.end()) --at;  // the oldest
    std::copy_backward(suspects_.begin(), at, at + 1);
    suspects_[0] = tick;
}

void TorqueScan::beginTick() {
    left_ = kMaxTorques;
    const auto end = suspects_.begin() + suspectCount_;
    for (auto at = suspects_.begin(); at != end; ++at) --*at;
    suspectCount_ = static_cast<int>(std::remove(suspects_.begin(), end, -1) - suspects_.begin());
}

/** Whether the torque of the path changes too fast where that of another one did. */
bool TorqueScan::failsAgain(const ArmPath& path, double torqueUse) {
    for (int k = 0; k < suspectCount_ && faultCount_ == 0; ++k) {
        const std::int64_t tick = suspects_[static_cast<std::size_t>(k)];
        if (tick > path.ticks() || (left_ -= 2) < 0) continue;
        torqueBefore_ = lastTorque_;
        if (tick > 0) calcTorque(path, tick - 1, torqueBefore_);
        calcTorque(path, tick, torque_);
        for (int i = 0; i < n_; ++i) {
            const double change = torque_[i] - torqueBefore_[i], allowed = torqueUse * limits_.rate[i] * tick_s_;
            if (std::abs(change) > allowed * (1.0 + kRounding)) addFault(tick, i, change, allowed, true);
        }
    }
    return faultCount_ > 0;
}

int TorqueScan::findWorstJoint(const ArmPath& path, const JointVector& jerk, const ArmPath& other,
                               const JointVector& otherJerk) {
    int worst = -1;
    double least = kInfinity;
    if (isTooLong_) {
        for (int i = 0; i < n_; ++i) {
            const double rests_s = path.calcRestTime(i);
            if (!(rests_s > other.calcRestTime(i) && -rests_s < least)) continue;
            least = -rests_s;
            worst = i;
        }
        return worst;
    }
    const Fault& fault = faults_[0];
    least = std::abs(fault.value);
    struct Tick {
        JointVector q, qd, qdd;
    } here[2], there[2];
    const int first = fault.tick > 0 ? 0 : 1;
    for (int k = first; k < 2; ++k) {
        path.calcTick(fault.tick - 1 + k, here[k].q, here[k].qd, here[k].qdd);
        other.calcTick(std::min(fault.tick - 1 + k, other.ticks()), there[k].q, there[k].qd, there[k].qdd);
    }
    for (int i = 0; i < n_ && (left_ -= 2) >= 0; ++i) {
        if (jerk[i] == otherJerk[i]) continue;
        torqueBefore_ = lastTorque_;
        for (int k = first; k < 2; ++k) {
            Tick tick = here[k];
            tick.q[i] = there[k].q[i];
            tick.qd[i] = there[k].qd[i];
            tick.qdd[i] = there[k].qdd[i];
            arm_.calcTorque(tick.q, tick.qd, tick.qdd, k == 0 ? torqueBefore_ : torque_);
        }
        const double left = std::abs(torque_[fault.joint] - torqueBefore_[fault.joint]);
        if (left >= least) continue;
        least = left;
        worst = i;
    }
    return worst;
}

/** Between two looks, h apart, no torque is farther from zero than (|sum of both| + rate h) / 2. */
void TorqueScan::scan(const ArmPath& path, const ArmPath::Extremes& extremes, double torqueUse,
                      const JointVector& lastTorque, const Neighbour* neighbours, int count, Result& result) {
    result.bearsTorque = true;
    result.torqueUse = result.torque = 0.0;
    result.joint = 0;
    result.tick = 0;
    result.isChange = false;
    faultCount_ = 0;
    isTooLong_ = false;
    if (!limitsTorque_ && !limitsRate_) return;
    for (int k = 0; k < count; ++k)
        if (isKnown(extremes, neighbours[k], result)) return;
    result.torqueUse = result.torque = 0.0;
    result.joint = 0;
    torqueRate_.calcBound(extremes, rate_);
    // Where the torque cannot change faster than allowed nobody need look at its changes.
    const bool looksAtChanges = limitsRate_ && !(rate_.array() <= limits_.rate.array()).all();
    const bool measures = std::isinf(torqueUse);
    lastTorque_ = lastTorque;
    // Beside its suspects; a shorter one may still be looked at.
    isTooLong_ = looksAtChanges && !measures && path.ticks() >= left_ - 2 * suspectCount_;
    if (isTooLong_ || (!measures && failsAgain(path, torqueUse))) {
        result.bearsTorque = false;
        result.proven.setConstant(kInfinity);
        return;
    }
    torqueBefore_ = lastTorque;
    const std::int64_t last = path.ticks();
    for (std::int64_t tick = 0, before = 0;;) {
        if (--left_ < 0) {
            result.bearsTorque = false;
            break;
        }
        calcTorque(path, tick, torque_);
        const double most = (measures ? std::max(1.0, result.torqueUse) : torqueUse) + kRounding;
        double free = static_cast<double>(last);
        for (int i = 0; i < n_; ++i) {
            const double limit = limits_.torque[i];
            const double use = std::abs(torque_[i]) / limit;
            const double change = looksAtChanges || tick == 0
                                      ? std::abs(torque_[i] - torqueBefore_[i]) / (limits_.rate[i] * tick_s_)
                                      : 0.0;
            if (const double larger = std::max(use, change); larger > result.torqueUse) {
                result.torqueUse = larger;
                result.joint = i;
                result.tick = tick;
                result.torque = torque_[i];
                result.isChange = change > use;
            }
            const double gap = static_cast<double>(tick - before) * tick_s_;
            const double between =
                tick - before > 1 ? (std::abs(torque_[i] + torqueBefore_[i]) + rate_[i] * gap) / 2.0 : 0.0;
            result.proven[i] = std::max({tick == 0 ? 0.0 : result.proven[i], std::abs(torque_[i]), between});
            free = std::min(free, (most * limit - std::abs(torque_[i])) / (rate_[i] * tick_s_));
            if (measures || (use <= most && change <= most)) continue;
            result.bearsTorque = false;
            if (use > most) addFault(tick, i, torque_[i], torqueUse * limit, false);
            if (change > most)
                addFault(tick, i, torque_[i] - torqueBefore_[i], torqueUse * limits_.rate[i] * tick_s_, true);
        }
        if (!result.bearsTorque || tick >= last) break;
        torqueBefore_ = torque_;
        before = tick;
        const bool maySkip = !looksAtChanges && free >= 1.0;
        tick = std::min(last, tick + (maySkip ? static_cast<std::int64_t>(free) : 1));
    }
    if (!result.bearsTorque) result.proven.setConstant(kInfinity);
}

}  // namespace viable::detail
