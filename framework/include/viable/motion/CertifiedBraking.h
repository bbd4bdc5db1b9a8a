#pragma once

#include "viable/motion/BoxQp.h"
#include "viable/motion/BrakingCertificate.h"

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
    enum class Status : unsigned char {
        Passed,     ///< `chosen` is `desired`
        Modified,   ///< changed so that the limits hold
        Returning,  ///< the stored stop of a joint passes a limit: that joint goes back as fast as
                    ///< jerk allows, without passing any limit farther
    };
    struct ActingLimit {
        LimitKind limit = LimitKind::None;
        LimitSide side = LimitSide::Neither;
    };

    /** @param limits    jerk limits finite (see checkLimits)
        @param approach  see BrakingCertificate::configure  */
    void configure(const JointLimits& limits, double tick_s, double approach);
    void reset(const MotionState& state);
    void changeLimits(const JointLimits& limits);
    void skipTicks(std::int64_t ticks);

    /** One tick.
        @param desired  finite [rad/s^3]
        @param chosen   the jerk to hold for this tick; the stops are those after it
        @param acting   what holds each joint back */
    Status choose(const MotionState& state, const JointMatrix& M, const JointVector& desired,
                  JointVector& chosen, std::array<ActingLimit, kMaxJoints>& acting);

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
    void restrict(int joint, double wanted);
    void settle(const JointMatrix& M, JointVector& chosen);

    int n_ = 0;
    JointLimits limits_;
    std::array<BrakingCertificate, kMaxJoints> certificates_;
    std::array<Interval, kMaxJoints> intervals_;
    BoxQp qp_;
    JointVector target_, lower_, upper_;
};

}  // namespace viable
