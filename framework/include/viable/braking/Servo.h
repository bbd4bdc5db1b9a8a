#pragma once

#include <cstdint>
#include <memory>

#include "viable/core/JointLimits.h"

namespace viable {

/** Leads an arm to a joint target, which may move or jump, as fast as its limits allow (framework/MATH.md, section 6).

Per joint it takes one of the jerks that the limits admit (see CertifiedBrakingFilter). After this jerk the stop, seen
from the target, ends exactly there. If all of them stop short of the target, it takes the one that goes farthest
towards it.
Guarantees: position, velocity, acceleration and jerk limits, at every tick and between, from every state with a stop
within them less 1e-10 of each. With this reserve a certified filter of the same limits admits these jerks. A target at
rest is reached in the shortest time that a tick grid allows, or nearly so, without overshoot, and held exactly. A
target beyond a position limit counts as one at the limit.
Real time: no allocation, lock or throw after configure(); bounded work. */
class Servo {
public:
    Servo();
    ~Servo();
    Servo(Servo&&) noexcept;
    Servo& operator=(Servo&&) noexcept;

    /** @param limits  jerk limits finite (see checkLimits)
        @param share   share of acceleration and jerk limits in (0, 1] for the motion relative to the target. The
                       rest is for the target's own motion. 1 for targets that jump and rest. */
    void configure(const JointLimits& limits, double tick_s, double share = 1.0);
    void reset(const MotionState& start);
    /** From now on; as for configure(). */
    void changeLimits(const JointLimits& limits);
    /** So many ticks passed without a call. */
    void skipTicks(std::int64_t ticks);

    /** The jerk to hold in this tick.
        @param state   of the arm [rad, rad/s, rad/s^2]
        @param target  in this tick; velocity and acceleration are zero where they are not known. If they are the
                       target's own and keep the limits, it is followed without error.
        @param jerk    [rad/s^3] */
    void calc(const MotionState& state, const MotionState& target, JointVector& jerk);
    /** In the last calc() a joint was not where the jerk before had led: somebody else, such as a filter, decided. */
    bool isLed() const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

/** The velocity of a joint target, as far as the joint can follow its changes. A target that moves evenly is followed
with its velocity. The velocity of one that starts, stops or turns faster than the joint could is not taken over at
once. It is smoothed over half the time in which the joint stops from its velocity limit. It grows no faster than with
half the deceleration of that stop, and falls at once. A target that stands still has no velocity, whatever it had. One
that jumps, faster than the velocity limit, counts as moving with the limit for that tick.
Real time: no allocation, lock or throw after configure(). */
class TargetVelocity {
public:
    /** @param filter_s  smoothed over so long instead, and growing as it likes; infinite: a target counts as resting; 0: as
       above */
    void configure(const JointLimits& limits, double tick_s, double filter_s = 0.0);
    void changeLimits(const JointLimits& limits);
    void reset(const JointVector& q);
    /** The target may stop at any moment: it counts as resting, and gets its velocity anew. */
    void forget() { smoothed_.setZero(); }

    /** One tick. @param q  the target [rad]. @return its velocity [rad/s], valid until the next call */
    const JointVector& calc(const JointVector& q);

private:
    double tick_s_ = 0.0, filter_s_ = 0.0;
    JointBounds limits_;
    JointBounds growth_;  ///< change of the velocity's size in a tick
    JointVector share_;   ///< share of a change that is followed in a tick
    JointVector last_, smoothed_, velocity_;
};

}  // namespace viable
