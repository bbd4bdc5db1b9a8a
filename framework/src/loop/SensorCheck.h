#pragma once

#include "loop/Authority.h"

namespace viable {

/** A measured position that changes in a tick by more than so many times what the joint's velocity limit allows, and
by so many encoder counts on top, is no motion. With a tracking bound what its disturbance set allows is no jump either:
(velocity limit + bound.velocity) tick, and the error of both readings, 2 (bound.measured - bound.position). Without one,
and without an Authority that keeps the arm from running away, nothing is known of the real arm. It may be falling or
swinging up: a change up to kLeastJumpTurns or kLeastJump_m is taken as it is. That is thousands of rad/s at 1 kHz, and
below a wrap by a turn. */
inline constexpr double kJumpSpeeds = 10.0, kJumpCounts = 8.0;
inline constexpr double kLeastJumpTurns = 0.45, kLeastJump_m = 1.0;

/** Without a bound, what a loop swings that is far too strong for the arm is a motion, too: so many times the change of the
deviation from the nominal joint in the tick before comes on top, up to kLeastJumpTurns or kLeastJump_m. */
inline constexpr double kGrowth = 30.0;

/** A reading that stays exactly what it is for so many ticks may be that of a sensor that is stuck. So may one that stops at once
after as many ticks in each of which it moved by kMovingCounts, by kMovingShare of its velocity limit, and by what its
acceleration limit changes in a tick. */
inline constexpr std::int64_t kStillTicks = 5;
inline constexpr double kMovingCounts = 2.0, kMovingShare = 0.02;
/** Where an encoder's count is not known: kJumpCounts of it are one of 16 bits a turn; and for a jump two of 12 bits [rad, m]. */
inline constexpr double kUnknownCount = 1.2e-5, kUnknownJump = 3e-3;

/** The largest change of each joint's position in a tick under these limits [rad, prismatic: m]; see kJumpSpeeds.
@param bound  null: none
@param authority  of the robust loop */
JointVector calcLargestChange(const RunSetup& setup, const JointLimits& limits, const TrackingBound* bound,
                              const detail::Authority& authority);

/** kJumpCounts of a joint's encoder, or kUnknownJump [rad, m]. */
double calcCounts(const RobotDescription& robot, int joint);

/** kLeastJumpTurns or kLeastJump_m of a joint [rad, m]. */
double calcLeastJump(const RobotDescription& robot, int joint);

/** Tells readings of the joints that a motion explains from those that none does, and says what stands in for the
latter: the nominal arm plus the last good deviation, since nothing is known of a change.

The control loop judges joint by joint, by the last reading; the torque guard takes or refuses a reading as a whole, by
the motion of the nominal arm.
Real time: no allocation, lock or throw. */
class SensorCheck {
public:
    /** What a new position is compared with. */
    enum class Reference : unsigned char {
        LastReading,    ///< the joint's last good position
        NominalMotion,  ///< the nominal joint plus the last good deviation from it
    };

    /** What a motion explains; one entry per joint. */
    struct Policy {
        Reference reference = Reference::LastReading;
        JointVector largestChange;     ///< of a position in a tick [rad, prismatic: m]
        JointVector largestSpeed;      ///< that a reading may say [rad/s, m/s]; infinite: any
        JointVector largestDeviation;  ///< of what stands in for a reading [rad, m]; infinite: any
        JointVector count;             ///< of the encoders [rad, m]; > 0
        JointVector moving;            ///< a step in a tick that is a motion [rad, m]
        JointVector largestGrowth;     ///< most that kGrowth adds [rad, m]
    };

    /** Count and moving of a policy, and no growth. */
    static void setMotion(const RunSetup& setup, Policy& policy);
    /** From a start at which the arm is the nominal one. */
    void begin(const Policy& policy, const JointVector& start);
    /** From now on a change in a tick up to `change` is a motion, too. */
    void widen(const JointVector& change) { policy_.largestChange = policy_.largestChange.cwiseMax(change); }

    /** How far a position is from what it is compared with [rad, m]. */
    double calcChange(int joint, const JointState& reading, const MotionState& nominal) const;
    /** What a motion explains of that [rad, m]. */
    double largestChange(int joint) const;
    /** Of the joint's encoder, or what stands for it [rad, m]. */
    double count(int joint) const { return policy_.count[joint]; }
    /** True when a motion explains the reading of a joint; both finite. */
    bool isPlausible(int joint, const JointState& reading, const MotionState& nominal) const;

    /** The reading of a joint is a good one. */
    void take(int joint, const JointState& reading, const MotionState& nominal);
    /** Ticks passed without any reading: the joints may have moved on. */
    void miss(std::int64_t ticks = 1) { elapsed_ += ticks; }
    /** Writes what stands in for the reading of a joint. */
    void standIn(int joint, const MotionState& nominal, JointState& reading);

    /** How far the nominal joint has gone since the reading changed last; 0 where that is less than kStillTicks ago [rad, m]. */
    double findStillTravel(int joint) const;
    /** The joint moved, and its reading stopped at once, though the nominal joint goes on that way: it is not known for how
    long. */
    bool isSuspect(int joint) const;
    /** By how much its reading changed at last in a tick, and what is a motion [rad, m]. */
    double lastStep(int joint) const { return std::abs(way_[joint]); }
    double moving(int joint) const { return policy_.moving[joint]; }
    std::int64_t stillTicks(int joint) const { return still_[joint]; }
    /** The last readings of a joint were wrong, as they did not change: what stands in for them goes back to the deviation
    before, in so many ticks. */
    void disownStill(int joint, int ticks);
    /** They were wrong since the deviation was that: it stands in for them. */
    void disown(int joint, double deviation) { goal_[joint] = deviation_[joint] = deviation; }
    /** Whether the last reading of a joint was that before it, to the last bit. */
    bool isStill(int joint) const { return stillTicks(joint) > 0; }
    /** The deviation when the reading of a joint changed last [rad, m]. */
    double changedDeviation(int joint) const { return changedDeviation_[joint]; }

    /** The last good reading less the nominal arm then [rad, m]. */
    const JointVector& deviation() const { return deviation_; }

private:
    Policy policy_;
    JointVector last_, swing_, deviation_;  // swing: change of the deviation in a tick, at last
    JointVector changedDeviation_, way_;    // at the last tick in which the reading changed, and by how much a tick
    JointVector goal_, step_;               // where deviation_ goes while standing in, by how much a tick
    std::array<std::int64_t, kMaxJoints> still_{}, moving_{};  // ticks
    std::int64_t elapsed_ = 1;                                 // ticks since the last good reading
};

}  // namespace viable
