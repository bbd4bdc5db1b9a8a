#pragma once

#include "viable/log/TickRecord.h"

namespace viable {

/** How one limit fared on one joint. */
struct LimitRecord {
    bool exists = false;       ///< a side was finite in some tick
    double worstUse = 0.0;     ///< largest share of the limit used, in any tick; 1 is the limit itself
    double worstTime_s = 0.0;  ///< when
    double worstExcess = 0.0;  ///< farthest beyond either side, in the limit's unit
    std::int64_t ticksOutside = 0;
    /** The same two while the arm was recovering (StopVerdict::Recovering), which breaks no guarantee. */
    std::int64_t ticksRecovering = 0;
    double worstRecovering = 0.0;
    double lastExcess = 0.0;  ///< how far outside at the end; 0 inside

    /** Counts the value `x` of a tick. Returns true where it is outside. */
    bool add(LimitKind kind, double lower, double upper, double x, double time_s, bool isRecovering);
};

/** How a guarded arm, the nominal one, kept its limits: the worst use of each, and ticks outside.
Real time: add() and addEnd(). */
class GuardSummary {
public:
    explicit GuardSummary(int joints);

    /** The account of a tick: guard.record(). */
    void add(const TickRecord& record);
    /** The state after the last tick. */
    void addEnd(const MotionState& nominal, double time_s);

    std::int64_t ticks() const { return ticks_; }
    /** A limit was passed while the arm was not recovering. */
    bool anyLimitBroken() const { return isBroken_; }
    /** One entry per joint. @param kind  Position, Velocity, Acceleration or Jerk */
    const std::vector<LimitRecord>& limit(LimitKind kind) const;
    int worstJoint(LimitKind kind) const;
    std::int64_t ticksOutside(LimitKind kind) const;  ///< summed over the joints
    /** Farthest that the real arm was from the nominal one in any joint [rad, m]. 0: no reading. */
    double trackingMax() const { return trackingMax_; }

private:
    void check(LimitKind kind, const JointBounds& bounds, const JointVector& values, double time_s);

    std::array<std::vector<LimitRecord>, 4> limits_;
    JointLimits bounds_;
    bool isRecovering_ = false, isBroken_ = false;
    double trackingMax_ = 0.0;
    std::int64_t ticks_ = 0;
};

}  // namespace viable
