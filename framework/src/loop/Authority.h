#pragma once

#include <algorithm>
#include <cmath>

#include "tracking/TrackingBound.h"

namespace viable::detail {

/** How much a robust loop may add to the torques that move the nominal arm; one entry per joint. */
struct AuthoritySizes {
    JointVector reach;      ///< besides friction and what lasts [Nm]; infinite: any
    JointVector lasting;    ///< most that it may need all the time, as for a payload; 0 where `reach` has it [Nm]
    double friction = 0.0;  ///< factor on the robot's figures: may be made up for at the real velocity; 0 likewise
    JointVector kp;         ///< of its law [1/s]; zero: not known
};

/** The sizes for an arm and its loop.

With a tracking bound the loop may add what the bound's disturbances can make it ask for, k_r (v + 2 r / tick + k_p m) and
its integral and friction: nothing is cut inside the set. Without one it may make up for kFrictionFactor times the
robot's friction figures. Beside them it has kMotorShare of the motor's torque less the Coulomb part, and at least half of
that share. Rounding of the readings to counts comes on top: it is no push.
@param loop   null: the law of the loop is not known
@param bound  null: none */
AuthoritySizes calcAuthority(const RunSetup& setup, const LinearErrorLoop* loop, const TrackingBound* bound);

inline constexpr double kFrictionFactor = 2.0, kMotorShare = 0.25;

/** Keeps what a robust loop adds to the motors within d - f - reach and d + f + reach of every joint. So a joint that is
held, or whose encoder says nonsense, gets no more than that, however far the loop takes it to be from its nominal place.

f is friction at the real joint's velocity (both ways Coulomb friction), smoothed over kVelocity_s. d is what the loop gave
in the last kLasting_s beyond the friction figures, and at most AuthoritySizes::lasting; it stands still while the joint's
torque is cut. What is not cut is not changed in a bit.

A joint that was cut for kHeldTicks is let go without a throw: until it is near again the loop sees it no farther away than
its law answers with a velocity kFastReturn times the limit.

It also tells how far a joint must have been pushed since its reading changed last, where dry friction took what it can
(twice calcHold()). A joint whose readings are of no use is left to d (open()).
Real time: no allocation, lock or throw after construction. */
class Authority {
public:
    static constexpr double kVelocity_s = 0.01, kLasting_s = 0.1, kFastReturn = 1.02;
    /** A joint that is cut for so many ticks, and a delay, is held. */
    static constexpr int kHeldTicks = 5;
    /** A joint that is pressed with more than this share of its reach for kHeldTicks, beside friction either way, and stands
    exactly still, does not answer. */
    static constexpr double kPressing = 0.5;
    /** What was pushed in vain is taken back in this time [s]. It takes up to twice kTakeBackTicks, and kLasting_s or two ticks,
    where that is longer and it takes more than this share of the reach. The reach itself is not exceeded: the rest is left to
    friction. */
    static constexpr double kTakeBack_s = 0.025, kTakeBackShare = 0.5;
    static constexpr int kTakeBackTicks = 20;
    /** Slower than this a joint is not sure to move, and dry friction may act either way [rad/s, m/s]. */
    static constexpr double kStandstill = 0.02;

    /** Without limits. */
    Authority() = default;
    Authority(const RunSetup& setup, AuthoritySizes sizes);

    /** From a start at which the real arm is the nominal one. */
    void reset();
    /** What may be added to the joint's motor has an end. */
    bool limits(int joint) const { return joint < n_ && std::isfinite(sizes_.reach[joint]); }
    /** Velocity limits that are wider from now on count, until reset(). */
    void widen(const JointLimits& limits);

    /** Takes what is known of the real arm now; before the loop is asked. A joint that is to be seen nearer is written so. */
    void update(const MotionState& nominal, JointState& real);
    /** True where it changed something. @param nominal  what moves the nominal arm: what the loop takes off that beyond a motor's
    limit is no push [Nm] */
    bool cut(const JointVector& nominal, JointVector& torque);
    /** Adds a push that the loop knows nothing of, as far as it may be added beside `torque`, which was cut [Nm]. */
    void add(const JointVector& push, JointVector& torque) const;
    /** What the motors really get of it, after all rates.
    @param isStill  the joint's reading is that of the tick before
    @param inertia  of the joint, the others held [kg m^2, kg] */
    void take(const JointVector& torque, const std::array<bool, kMaxJoints>& isStill, const JointVector& inertia);

    bool isCut(int joint) const { return cutTicks_[joint] > 0; }
    /** Something was added to the joint's motor since reset(). */
    bool hasAdded(int joint) const { return hasAdded_[joint]; }
    /** In the tick before [Nm]. */
    double added(int joint) const { return last_[joint]; }
    /** The joint reads the same, and was pushed for some ticks by more than friction and d explain: it should have moved. */
    bool isPressed(int joint) const { return pressedTicks_[joint] >= heldTicks_; }
    /** How far the joint must have been pushed since its reading changed last, with what is beyond d, 0 and twice calcHold()
    [rad, m]: half of that may have held it against what lasted. */
    double impliedTravel(int joint) const { return impliedTravel_[joint]; }
    bool isOpen(int joint) const { return isOpen_[joint]; }
    /** From now on, until reset(), d is all that is added to the joint: nothing is known of where it is. It gets there
    without a step.
    @param isInVain  it was pushed and read the same: the momentum that this must have made is taken back */
    void open(int joint, bool isInVain);

    /** Most that may be added to a joint that stands still while nothing lasts [Nm]. */
    double calcRest(int joint) const { return sizes_.reach[joint] + calcFriction(joint, 0.0); }
    /** And after a push that grew so slowly that it was taken for what lasts [Nm]. */
    double calcMost(int joint) const { return calcRest(joint) + sizes_.lasting[joint]; }
    /** What a joint that stands may take without moving, as far as is known: twice the figure of its dry friction, 0 without
    one; with a bound kPressing of the reach [Nm]. */
    double calcHold(int joint) const {
        return sizes_.friction > 0.0 ? kFrictionFactor * figures_.coulomb[joint] : kPressing * sizes_.reach[joint];
    }

private:
    /** By the robot's description [Nm]; `speed` >= 0. */
    double calcFigure(int joint, double speed) const {
        return figures_.coulomb[joint] + figures_.calcViscous(joint, speed);
    }
    double calcFriction(int joint, double speed) const { return sizes_.friction * calcFigure(joint, speed); }
    double calcOpen(int joint);
    /** Of what lasted, what may be added beside `reach` [Nm]. */
    double calcLasting(int joint) const {
        return std::clamp(lasting_[joint], -sizes_.lasting[joint], sizes_.lasting[joint]);
    }

    int n_ = 0, heldTicks_ = 0, wayTicks_ = 1;
    double tick_s_ = 0.0;
    AuthoritySizes sizes_;
    JointVector torqueLimit_;
    JointFriction figures_;
    JointBounds ownFastest_, fastest_;  // of the setup, and widened
    JointVector velocity_, lasting_, lowest_, highest_;
    JointVector last_;  // added in the tick before [Nm]
    std::array<int, kMaxJoints> cutTicks_{}, cutSide_{}, pressedTicks_{};
    std::array<bool, kMaxJoints> isHeld_{}, isNear_{}, isPressing_{}, isOpen_{}, hasAdded_{};

    // Since the reading changed last, if the joint did not stand, by calcHold() and by twice that [Nms, Ns; rad, m].
    JointVector pushedMomentum_, impliedMomentum_, impliedTravel_;
    // Of an open joint at the beginning: torque beyond d [Nm], and impulse that is owed [Nm ticks].
    JointVector excess_, owed_;
    std::array<int, kMaxJoints> backTick_{}, backTicks_{};  // now, and of all the way
};

/** Makes motors that gave `last` in the tick before change by at most `step` [Nm]: what is added to `nominal` gives way. */
void limitMotorStep(const JointVector& nominal, const JointVector& last, const JointVector& step, JointVector& added);

/** "at most joint0 108 Nm at once and 176 Nm slowly (25 and 41 % of the motor), ... at rest; the tool presses with at most 140 N
along x, ...", in the pose of J. */
std::string tellPush(const RobotDescription& robot, const Authority& authority, const ToolJacobian& J);

}  // namespace viable::detail
