#pragma once

#include "braking/BrakingCertificate.h"
#include "qp/RowQp.h"
#include "viable/core/FilterStatus.h"
#include "viable/qp/BoxQp.h"

namespace viable {

/** Chooses the jerk of an arm, tick by tick, so that a stop of every joint within its limits always
exists: a BrakingCertificate per joint, and of the admissible jerks those nearest to the desired ones
in torque (paper, eq. 13).

The admissible intervals are not computed completely: the desired jerk of a joint is checked first, and its bound
is searched only where the check fails. What is applied has always been certified.
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
        @param M        see propose()
        @param desired  finite [rad/s^3]
        @param chosen   the jerk to hold for this tick; the stops are those after it
        @param acting   what holds each joint back
        @return Passed: `chosen` is `desired`; Modified; Recovering: the backup stop of a joint passes a limit, and that
                joint returns as fast as jerk allows, without passing any limit farther */
    FilterStatus choose(const MotionState& state, const JointMatrix* M, const JointVector& desired, JointVector& chosen,
                        std::array<JointIntervention, kMaxJoints>& acting);

    /** The same in parts, for filters with conditions on the whole arm: beginTick(), then propose() and isAdmissible()
    any number of times, then one commit(). beginTick() is false when a joint was not where its backup stop led, so that
    its stop was planned anew. */
    bool beginTick(const MotionState& state);
    /** The admissible jerks nearest to the desired ones, measured by |M .| (a torque where M is the arm's), and on the
    allowed side of `rows` (may be null) where the box has such a point. Without M: the farthest admissible jerks on the
    way from getStored() to the desired ones, as found, so that no joint is held back alone; without regard to rows. */
    FilterStatus propose(const JointMatrix* M, const JointVector& desired, const RowQp::Rows* rows,
                         JointVector& proposed);
    /** True when every joint admits its jerk; with these stops after them. */
    bool isAdmissible(const JointVector& jerks);
    bool isAdmissible(const JointVector& jerks, const std::array<GridStop, kMaxJoints>& stops);
    /** The jerks of the backup stops in this tick: always admissible. */
    void getStored(JointVector& jerks) const;
    /** The stop of the joint after `jerk`, which the last propose() or isAdmissible() certified, or getStored();
    see BrakingCertificate::findStop. */
    bool findStop(int joint, double jerk, AxisState& after, GridStop& stop) const {
        return certificates_[joint].findStop(jerk, after, stop);
    }
    /** The jerks of this tick, certified by the last propose() or isAdmissible(), or stored; on return those to
    apply. @param acting  what holds each joint back from `desired` */
    void commit(const JointVector& desired, JointVector& jerks, std::array<JointIntervention, kMaxJoints>& acting);

    /** The stop from the state that the last choice leads to. */
    const GridStop& stop(int joint) const { return certificates_[joint].stop(); }
    /** The first limit that the joint's backup stop passes; of the start after reset(). */
    const PassedLimit& findExcess(int joint) const { return certificates_[joint].findExcess(); }

private:
    /** The admissible jerks of one joint in this tick, as far as they are known. */
    struct Interval {
        double lower, upper;
        LimitKind lowerLimit, upperLimit;
        bool fixed = false;
    };
    void bound();
    FilterStatus proposeOnPath(const JointVector& desired, JointVector& proposed);
    void restrict(int joint, double wanted);
    void settle(const JointMatrix& M, const RowQp::Rows* rows, JointVector& chosen);

    int n_ = 0;
    JointLimits limits_;
    std::array<BrakingCertificate, kMaxJoints> certificates_;
    std::array<Interval, kMaxJoints> intervals_;
    bool returns_ = false;    // a backup stop passes a limit
    bool isBounded_ = false;  // intervals_ are this tick's
    BoxQp qp_;
    RowQp rowQp_;
    JointVector target_, lower_, upper_;
};

}  // namespace viable
