#pragma once

#include "loop/Authority.h"

namespace viable::detail {

/** Sees whether a real arm still follows the nominal one where no tracking bound says how far it may be away, and if not,
why. It does not follow where
- a joint is farther from its nominal place than it goes in kLag_s at its velocity limit, than kLargestShare of its
  range, whichever is less, and than kLeastErrorRad or kLeastErrorM;
- a joint oscillates: its velocity error changes its sign kHalfPeriods times within halfPeriod() each, every time
  beyond twice its velocity limit, or beyond a fifth of it with its motor at the torque limit, and over kLeastTravelRad
  or kLeastTravelM. Noise of an encoder changes its sign as fast; it counts only where it is as large as that;
- the robust loop drives a motor into its torque limit, or to the end of its authority, and back, however little the arm
  moves: over kPushTicks, and kHalfPeriods times halfPeriod(), its torque changes its sign within halfPeriod(), each time
  cut or with kPush of what the nominal arm leaves of the motor's limit and kLeastPush of that limit, and the motor was at
  its limit or cut in kPushedShare of the recent ticks. Noise of an encoder does so by chance for a few ticks, unless it is
  far beyond that.
A joint that is away after one such half, or two where its loop was cut, is taken for one that oscillates. Once something was
found it takes all kHalfPeriods: a joint that comes back from afar swings, too.
Real time: no allocation, lock or throw after begin(). */
class FollowingWatch {
public:
    static constexpr double kLag_s = 0.15;
    /** Of a joint's range: a fast joint of small range does not follow long before kLag_s at its velocity limit. */
    static constexpr double kLargestShare = 0.25;
    /** Whatever the limits: friction and payload alone can make so much of an error [rad, m]. */
    static constexpr double kLeastErrorRad = 0.05, kLeastErrorM = 0.02;
    /** A half-period of the slowest oscillation, unless ticks or the delay are long: a sampled velocity loop with a
    delay of d ticks swings with half-periods of 2 (1 + d) ticks where it becomes unstable. */
    static constexpr double kHalfPeriod_s = 0.025, kHalfPeriodTicks = 3.0;
    static constexpr int kHalfPeriods = 4;
    /** Of the velocity limit, with the motor at its limit and without; and the least [rad/s, m/s], and encoder counts in a
    tick, that are a swing: what a slow joint or a coarse encoder shows is none. */
    static constexpr double kShare = 0.2, kFarShare = 2.0, kLeastSwingRadps = 0.5, kLeastSwingMps = 0.2, kCounts = 4.0;
    /** A half-period of a swing is at least so long; noise of an encoder is not [rad, m]. */
    static constexpr double kLeastTravelRad = 1e-3, kLeastTravelM = 4e-4;
    /** Of what the nominal arm leaves of a motor's limit, of the limit, and of the recent ticks. */
    static constexpr double kPush = 0.8, kLeastPush = 0.2, kPushedShare = 0.2;
    static constexpr std::int64_t kPushTicks = 200;
    /** Motors at their limits in so many of the last kRecent_s, or of four half-periods, are a cause. */
    static constexpr double kSaturated = 0.3, kRecent_s = 0.1;
    /** Once stopped, an arm that goes this much farther is driven by its robust loop the wrong way. */
    static constexpr double kRunaway = 2.0;

    enum class Cause : unsigned char {
        None,
        Oscillation,  ///< of `joint`; `motor`, if any, is driven into its torque limit and back
        Saturation,   ///< `joint` is away, and the motor of `motor` was at its limit
        Weakness,     ///< `joint` is away, and the motor of `motor` gave less than was asked for, below its limit
        Withheld,     ///< `joint` is away, and the robust loop would have had to push the motor of `motor` harder
        Drift,        ///< `joint` is away, though the motors had torque to spare
    };
    struct Violation {
        Cause cause = Cause::None;
        int joint = -1, motor = -1;
        double error = 0.0, allowed = 0.0;  ///< of the position [rad]; of an oscillation: of the velocity [rad/s]
        bool isWithheld = false;  ///< of an oscillation: the end of the loop's authority, not the motor's limit
    };
    /** The motors' torques in the tick before [Nm]. */
    struct Torques {
        const JointVector& asked;
        const JointVector& robust;  ///< the robust loop's share of `asked`
        const JointVector& given;
        const Authority& authority;  ///< a joint that it cuts is as one whose motor is at its limit
    };

    /** A start at which the real arm is the nominal one. */
    void begin(const RunSetup& setup);
    /** A sign that lasts longer belongs to no oscillation [s]. */
    double halfPeriod() const { return std::max(kHalfPeriod_s, kHalfPeriodTicks * (1.0 + delayTicks_) * tick_s_); }
    /** After a violation: the arm goes on away from its nominal place. */
    bool runsAway(const JointState& real, const MotionState& nominal) const;
    /** Velocity limits that are wider from now on count. */
    void widen(const JointLimits& limits);

    /** Takes what was read. @param elapsedTicks  since the reading before, 1 unless ticks were missed */
    Violation update(const JointState& real, const MotionState& nominal, const Torques& torques,
                     std::int64_t elapsedTicks);

private:
    struct Swing {
        int sign = 0, halves = 0;
        std::int64_t since = 0;  // tick of the last change of sign
        double largest = 0.0;    // |velocity error| since then
        double travel = 0.0;     // its integral since then [rad, m]
        double last = 0.0;       // largest of the half before
        bool isAtLimit = false;  // the motor, since then
    };
    /** Of the robust loop's torque. */
    struct Push {
        int sign = 0;
        std::int64_t since = 0;  // tick of the last change of sign
        std::int64_t begun = 0;  // tick since which every half was large
        bool isLarge = false;    // in a tick since the last change of sign
    };
    bool isLate(std::int64_t since) const { return static_cast<double>(tick_ - since) * tick_s_ > halfPeriod(); }
    bool swings(int joint, double velocityError, double elapsed_s, bool isAtLimit);
    bool pushesToAndFro(int joint, double asked, double robust, bool isCut);

    bool hasFound_ = false;
    int n_ = 0, delayTicks_ = 0;
    double tick_s_ = 0.0;
    std::int64_t tick_ = 0;
    JointVector allowedError_, fastest_, leastSwing_, leastTravel_, torqueLimit_;
    JointVector leastError_, largestError_;         // bounds of allowedError_
    JointVector saturation_, weakness_, withheld_;  // share of the recent ticks, smoothed
    std::array<Swing, kMaxJoints> swings_{};
    std::array<Push, kMaxJoints> pushes_{};
};

}  // namespace viable::detail
