#pragma once

#include "viable/braking/BrakingCertificate.h"
#include "viable/core/FilterStatus.h"
#include "viable/qp/BoxQp.h"
#include "viable/qp/RowQp.h"

namespace viable {

/** Chooses the jerk of an arm, tick by tick, so that every joint can always still stop within its
limits: a BrakingCertificate per joint, and of the admissible jerks those nearest to the desired ones
in torque (paper, eq. 13).

The admissible intervals are not computed whole: a joint is asked first for the jerk that is wanted
of it, and for a bound only where it refuses. What is applied has always been vouched for.
Guarantees: limits hold at every tick and between, from every state that keeps them (see findExcess)
and for any input; a desired jerk that all joints admit is taken bit for bit.
Real time: no allocation, lock or throw; bounded work. */
class CertifiedBraking {
public:
    /** @param limits    jerk limits finite (see checkLimits)
        @param approach  see BrakingCertificate::configure  */
    void configure(const JointLimits& limits, double tick_s, double approach);
    void reset(const MotionState& state);
    void changeLimits(const JointLimits& limits);
    void skipTicks(std::int64_t ticks);

    /** One tick.
        @param desired  finite [rad/s^3]
        @param chosen   the jerk to hold for this tick; the stops are those after it
        @param acting   what holds each joint back
        @return Passed: `chosen` is `desired`; Modified; Recovering: the stored stop of a joint passes a limit, and that
                joint goes back as fast as jerk allows, without passing any limit farther */
    FilterStatus choose(const MotionState& state, const JointMatrix& M, const JointVector& desired, JointVector& chosen,
                        std::array<JointIntervention, kMaxJoints>& acting);

    /** The same in parts, for whoever has a say on the arm as a whole: beginTick(), then propose() and isAdmissible()
    any number of times, then one commit(). beginTick() is false when a joint was not where its stored stop had it, so that
    its stop is another one now. */
    bool beginTick(const MotionState& state);
    /** Of the jerks that every joint admits those nearest to the desired ones in torque, and on the right side of
    `rows` (may be null) where the box has such a place. */
    FilterStatus propose(const JointMatrix& M, const JointVector& desired, const RowQp::Rows* rows,
                         JointVector& proposed);
    /** True when every joint admits its jerk; with these stops after them. */
    bool isAdmissible(const JointVector& jerks);
    bool isAdmissible(const JointVector& jerks, const std::array<GridStop, kMaxJoints>& stops);
    /** What the stored stops would do in this tick: always admissible. */
    void getStored(JointVector& jerks) const;
    /** The stop that joint has after `jerk`, for which the last propose() or isAdmissible() vouched, or getStored();
    see BrakingCertificate::findStop. */
    bool findStop(int joint, double jerk, AxisState& after, GridStop& stop) const {
        return certificates_[joint].findStop(jerk, after, stop);
    }
    /** The jerks of this tick, vouched for by the last propose() or isAdmissible(), or stored; what is really to be
    applied comes back. @param acting  what holds each joint back from `desired` */
    void commit(const JointVector& desired, JointVector& jerks, std::array<JointIntervention, kMaxJoints>& acting);

    /** The stop from the state that the last choice leads to. */
    const GridStop& stop(int joint) const { return certificates_[joint].stop(); }
    /** The first limit that the joint's stored stop passes; of the start after reset(). */
    const PassedLimit& findExcess(int joint) const { return certificates_[joint].findExcess(); }

private:
    /** What one joint may do in this tick, as far as it is known. */
    struct Interval {
        double lower, upper;
        LimitKind lowerLimit, upperLimit;
        bool fixed = false;
    };
    void bound();
    void restrict(int joint, double wanted);
    void settle(const JointMatrix& M, const RowQp::Rows* rows, JointVector& chosen);

    int n_ = 0;
    JointLimits limits_;
    std::array<BrakingCertificate, kMaxJoints> certificates_;
    std::array<Interval, kMaxJoints> intervals_;
    bool returns_ = false;    // a stored stop passes a limit
    bool isBounded_ = false;  // intervals_ are this tick's
    BoxQp qp_;
    RowQp rowQp_;
    JointVector target_, lower_, upper_;
};

}  // namespace viable
