#pragma once

#include "tracking/ToolReference.h"
#include "viable/braking/Servo.h"

namespace viable {

struct ToolFollowerOptions {
    ToolReferenceOptions reference;
    /** Share of acceleration and jerk limits for the motion relative to the reference: see Servo. */
    double share = 1.0;
    double velocityFilter_s = 0.0;  ///< filter of the reference's velocity: see TargetVelocity

    template <class V>
    void describe(V& v) {
        v(share, "share", "",
          "Share of acceleration and jerk limits for the motion relative to the reference; the rest is for the "
          "reference's own.")
            .above(0)
            .upTo(1);
        v(velocityFilter_s, "velocity_filter_s", "s",
          "Time constant in which the reference's velocity is smoothed before it is followed. Infinite: the reference "
          "counts as resting. 0: from each joint's limits, as far as it could follow.")
            .atLeast(0)
            .orInfinite();
        v(reference.restRate, "rest_rate", "1/s",
          "How fast joints that the tool leaves free go to the middle of their limits, once the tool is where it is "
          "commanded. Without limits they go to where they started. Behind a hand that moves they wait.")
            .atLeast(0);
        v(reference.apart_m, "apart_m", "m",
          "Joints that the tool leaves free lead the arm away from obstacles and from itself where it is nearer than "
          "this. 0, or with keeps_clear: false: they do not.")
            .atLeast(0);
    }
};

/** Leads the tool to a commanded pose, as fast as the joints' limits allow. A joint reference within the position
limits follows the pose (ToolReference). Each joint follows its reference (Servo), with as much of its velocity as the
joint could (TargetVelocity).

Lead: the reference is bounded ahead of the arm, or of the place where the arm would stop. The bound is the way in which
a joint stops from its velocity limit, and three ticks at that. If the arm is stopped sooner, the reference goes back at
that speed. So an arm that is held back is not left behind. A joint without a velocity limit has no such bound.
Pace: a joint that is stronger than the one with the longest way to go goes with it, in proportion to their ways, the
more strictly the stronger it is. Otherwise the tool would pass its command, as a weak joint is there long after the
others. For this the lead of each joint is as long as if all stopped as slowly as the slowest. Joints with the same
limits do not wait. What this adds to the lead goes while a filter leads the arm elsewhere.
Rest: a command that stands for the longest stop, and joint positions at once, are led with a lead that shrinks while a
filter leads the arm. A reference beyond it goes on from where the arm would stop. An arm that goes to and fro rests;
under a tool command, only beside what bars its way.
Leap: a reference may be held back and off by more than 1 mm. It then leaps to where the arm would stop, if that is
nearer to the command by half. So a hand that lets go commands that place, and the arm does not first follow the
reference. This is the law of the plugin tool_servo and of ArmBatch.
Real time: no allocation, lock or throw after configure(). */
class ToolFollower {
public:
    /** Spare joints rest in the middle of their position limits, and where they start without.
        @param limits     jerk limits finite (see checkLimits)
        @param geometry   null: the reference keeps clear of nothing (see ToolReference); need not outlive this call
        @param recursion  of the robot, shared by many; null: one of its own */
    void configure(const RobotDescription& robot, const JointLimits& limits, double tick_s, const MotionState& start,
                   const ToolFollowerOptions& options, const ArmGeometry* geometry = nullptr,
                   std::shared_ptr<const ArmRecursion> recursion = nullptr);
    void reset(const MotionState& start);
    /** From now on. */
    void changeLimits(const JointLimits& limits);
    /** So many ticks passed without a call. */
    void skipTicks(std::int64_t ticks);

    /** The jerk to hold in this tick.
        @param state         of the arm, finite
        @param command       finite, its orientation of unit length
        @param surroundings  null: none are known
        @param time_s        of the run
        @param jerk          [rad/s^3] */
    void calc(const MotionState& state, const Pose& command, const Surroundings* surroundings, double time_s,
              JointVector& jerk) {
        lead(state, command, surroundings, time_s, jerk);
    }
    /** The same towards joint positions. */
    void calc(const MotionState& state, const JointVector& goal, const Surroundings* surroundings, double time_s,
              JointVector& jerk) {
        lead(state, goal, surroundings, time_s, jerk);
    }
    const ToolReference& reference() const { return reference_; }
    bool isLed() const { return servo_.isLed(); }  ///< see Servo

private:
    template <class Goal>
    void lead(const MotionState& state, const Goal& goal, const Surroundings* surroundings, double time_s,
              JointVector& jerk);
    void updateLimits(const JointLimits& limits);
    JointVector findRest(const JointLimits& limits) const;
    void findAround(const MotionState& state, bool isTool, bool stands);
    /** Brings the targets of joints that are faster than the slowest one so near that all arrive with it. */
    void keepPace(const MotionState& state);

    JointVector start_;
    double tick_s_ = 0.0, share_ = 1.0;
    JointLimits stopLimits_;  ///< limits of the servo's stop
    JointBounds lead_;        ///< bounds of the reference's lead [rad]
    JointBounds around_;      ///< bounds of the reference in this tick [rad]
    JointVector together_;    ///< longest stop of all joints, in stops of this one
    JointVector stop_;        ///< place where the arm would stop [rad]
    ToolReference reference_;
    Servo servo_;
    TargetVelocity velocity_;  ///< velocity of the reference
    MotionState target_;
    Tremble tremble_;                                     ///< of the arm
    std::int64_t stopTicks_ = 0, stoodTicks_ = 0;         ///< of the longest stop, and since the command changed
    double leadShare_ = 1.0, shrink_ = 1.0, grow_ = 1.0;  ///< the latter two a tick
};

/** Makes the quaternion of a commanded pose unit length. False where its length is not between 0.5 and 2, or a
number is not finite. */
bool normalise(Pose& command);

}  // namespace viable
