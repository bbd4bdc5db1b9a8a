#pragma once

#include "viable/limits/ArmLimit.h"
#include "viable/log/TickRecord.h"

namespace viable::detail {

/** Follows the arms of a run past one kind of limit while it goes on, outside of the ticks: in the rows and half-way between
them, there by the cubic through both rows' positions and velocities. That is exact for the nominal arm, whose motion in a
tick is one. */
class LimitCounter {
public:
    LimitCounter(LimitKind kind, std::unique_ptr<ArmLimit> limit, bool hasRealArm);

    /** Allocates nothing where the limit does not. */
    void add(const TickRecord& record);
    /** The state that the last tick led to; of the real arm no record holds it. */
    void addEnd(const MotionState& nominal, double time_s);

    const LimitAccount& account() const { return account_; }

private:
    /** One arm on its way through the run. */
    struct ArmTrack {
        JointState last;
        double time_s = 0.0;
        bool hasBegun = false, hasGap = false;                      // hasGap: rows without a reading since
        bool isBroken = false, isViolated = false, isNear = false;  // since the last row
    };

    void follow(ArmTrack& track, ArmLimitRecord& record, const JointState& state, double time_s,
                const JointVector* torque, const JointVector* nominalTorque);
    void sample(ArmTrack& track, ArmLimitRecord& record, const ArmSample& arm);
    static void countTick(ArmTrack& track, ArmLimitRecord& record);

    const LimitRow& row_;
    std::unique_ptr<ArmLimit> limit_;
    LimitAccount account_;
    ArmTrack nominal_, real_;
    double lastTime_s_ = 0.0;
};

}  // namespace viable::detail
