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

/** Between two looks, h apart, no torque is farther from zero than (|sum of both| + rate h) / 2. */
void TorqueScan::scan(const ArmPath& path, const ArmPath::Extremes& extremes, double torqueUse,
                      const JointVector& lastTorque, const Neighbour* neighbours, int count, Result& result) {
    result.bearsTorque = true;
    result.torqueUse = result.torque = 0.0;
    result.joint = 0;
    result.tick = 0;
    result.isChange = false;
    faultCount_ = 0;
    if (!limitsTorque_ && !limitsRate_) return;
    for (int k = 0; k < count; ++k)
        if (isKnown(extremes, neighbours[k], result)) return;
    result.torqueUse = result.torque = 0.0;
    result.joint = 0;
    torqueRate_.calcBound(extremes, rate_);
    // Where the torque cannot change faster than allowed nobody need look at its changes.
    const bool looksAtChanges = limitsRate_ && !(rate_.array() <= limits_.rate.array()).all();
    const bool measures = std::isinf(torqueUse);
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
            if (use > most && faultCount_ < static_cast<int>(faults_.size()))
                faults_[static_cast<std::size_t>(faultCount_++)] = {tick, i, torque_[i]};
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
