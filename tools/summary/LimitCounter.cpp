#include "summary/LimitCounter.h"

#include <algorithm>

#include "limits/ArmMotion.h"

namespace viable::detail {

/** Joints slower than this stand still [rad/s, m/s]. */
constexpr double kStandsStill = 1e-3;
constexpr double kLeastTick_s = 1e-9;
/** Names are taken over in ticks, without memory of their own. */
constexpr std::size_t kLongestName = 256;

static void begin(ArmLimitRecord& record, const LimitRow& row) {
    record.worst = row.lessIsWorse ? kInfinity : 0.0;
    for (std::string* name : {&record.part, &record.other, &record.otherLink}) name->reserve(kLongestName);
}

static bool isHeld(const TickRecord& record, LimitKind kind) {
    const LimitReport& report = record.reports[kind];
    bool isHeld = report.isKnown && !report.isKept;
    for (Eigen::Index i = 0; i < record.nominal.q.size(); ++i) isHeld |= record.joints[i].limit == kind;
    return isHeld;
}

LimitCounter::LimitCounter(LimitKind kind, std::unique_ptr<ArmLimit> limit, bool hasRealArm)
    : row_(getLimitRow(kind)), limit_(std::move(limit)) {
    account_.kind = kind;
    begin(account_.nominal, row_);
    if (hasRealArm) begin(account_.real.emplace(), row_);
    account_.limit = limit_->limit();
    account_.allowances = limit_->allowances();
    account_.lastFault.reserve(kLongestName);
}

void LimitCounter::sample(ArmTrack& track, ArmLimitRecord& record, const ArmSample& arm) {
    const LimitSample found = limit_->sample(arm);
    track.isBroken |= found.isBroken;
    track.isViolated |= found.isBroken && !found.isExcused;
    track.isNear |= found.isNear;
    record.largest = std::max(record.largest, found.largest);
    const bool isFirst = found.isBroken && !record.firstBroken_s;
    if (isFirst) record.firstBroken_s = arm.time_s;
    const bool isWorse = row_.lessIsWorse ? found.value < record.worst : !(found.value <= record.worst);
    if (isWorse) record.worst = found.value;
    if (!isWorse && !isFirst) return;
    record.worst_s = arm.time_s;
    record.part = found.part;
    record.other = found.other;
    record.otherLink = found.otherLink;
}

void LimitCounter::countTick(ArmTrack& track, ArmLimitRecord& record) {
    record.brokenTicks += track.isBroken;
    record.violatedTicks += track.isViolated;
    record.nearTicks += track.isNear;
    track.isBroken = track.isViolated = track.isNear = false;
}

void LimitCounter::follow(ArmTrack& track, ArmLimitRecord& record, const JointState& state, double time_s,
                          const JointVector* torque, const JointVector* nominalTorque) {
    const bool isReal = &track == &real_;
    if (track.hasBegun && (row_.bridgesGaps || !track.hasGap)) {  // between rows that are far apart nobody knows
        const double h = std::max(time_s - track.time_s, kLeastTick_s);
        const JointState middle = calcHalfWay(track.last, state, h);
        sample(track, record, {middle.q, middle.qd, track.time_s + h / 2.0, isReal, record.worst});
    }
    sample(track, record, {state.q, state.qd, time_s, isReal, record.worst, torque, nominalTorque});
    if (track.hasBegun) {
        ++record.ticks;
        countTick(track, record);
    }
    track.last = state;
    track.time_s = time_s;
    track.hasBegun = true;
    track.hasGap = false;
}

void LimitCounter::add(const TickRecord& record) {
    const JointVector* const nominalTorque = record.filterTorque.size() > 0 ? &record.filterTorque : nullptr;
    follow(nominal_, account_.nominal, {record.nominal.q, record.nominal.qd}, record.time_s, nominalTorque,
           nominalTorque);
    if (row_.watchesPeople) {
        const double h = record.time_s - lastTime_s_;
        lastTime_s_ = record.time_s;
        if (isHeld(record, account_.kind) && record.nominal.qd.cwiseAbs().maxCoeff() < kStandsStill)
            account_.resting_s += h;
        if (record.reports[account_.kind].isKnown) account_.faults = record.peopleFaults;
        if (const char* const name = limit_->otherName(account_.faults.last); *name) account_.lastFault = name;
    }
    if (!account_.real) return;
    if (record.hasReading)
        follow(real_, *account_.real, record.actual, record.time_s,
               record.motorTorque.size() > 0 ? &record.motorTorque : nullptr, nominalTorque);
    else
        real_.hasGap = true;
}

void LimitCounter::addEnd(const MotionState& nominal, double time_s) {
    follow(nominal_, account_.nominal, {nominal.q, nominal.qd}, time_s, nullptr, nullptr);
    // Of the real arm's last tick only its beginning is known.
    if (account_.real && row_.bridgesGaps) countTick(real_, *account_.real);
}

}  // namespace viable::detail
