#pragma once

#include <array>
#include <cstdint>

#include "viable/plugin/Plugin.h"

namespace viable::detail {

/** Sees whether a real arm still follows the nominal one where no tracking bound says how far it may be away, and if not,
why. Two things are no following:
- a joint is farther from its nominal place than it goes in kLag_s at its velocity limit, and than kLeastError;
- a joint oscillates: its velocity error changes its sign kHalfPeriods times within kHalfPeriod_s each, every time
  beyond twice its velocity limit, or beyond a fifth of it with its motor at the torque limit, and over kLeastTravel. Noise
  of an encoder changes its sign as fast; it counts only where it is as large as that.
Real time: no allocation, lock or throw after begin(). */
class FollowingWatch {
public:
    static constexpr double kLag_s = 0.15;
    /** Whatever the limits: friction and payload alone can make so much of an error [rad, m]. */
    static constexpr double kLeastError = 0.05;
    static constexpr double kHalfPeriod_s = 0.025;
    static constexpr int kHalfPeriods = 4;
    /** Of the velocity limit, with the motor at its limit and without; and the least [rad/s, m/s], and encoder counts in a
    tick, that are a swing: what a slow joint or a coarse encoder shows is none. */
    static constexpr double kShare = 0.2, kFarShare = 2.0, kLeastSwing = 0.5, kCounts = 4.0;
    /** So far goes a half of a swing at least: noise of an encoder does not [rad, m]. */
    static constexpr double kLeastTravel = 1e-3;
    /** Motors at their limits in so many of the last kRecent_s are a cause. */
    static constexpr double kSaturated = 0.3, kRecent_s = 0.1;
    /** Once stopped, an arm that goes this much farther is driven by its robust loop the wrong way. */
    static constexpr double kRunaway = 2.0;

    enum class Cause : unsigned char {
        None,
        Oscillation,  ///< of `joint`
        Saturation,   ///< `joint` is away, and the motor of `motor` was at its limit
        Weakness,     ///< `joint` is away, and the motor of `motor` gave less than was asked for, below its limit
        Drift,        ///< `joint` is away, though the motors had torque to spare
    };
    struct Finding {
        Cause cause = Cause::None;
        int joint = -1, motor = -1;
        double error = 0.0, allowed = 0.0;  ///< of the position [rad]; of an oscillation: of the velocity [rad/s]
    };

    /** A start at which the real arm is the nominal one. */
    void begin(const RunSetup& setup);
    /** A sign that lasts longer belongs to no oscillation [s]. */
    double halfPeriod() const;
    /** After a finding: the arm goes on away from its nominal place. */
    bool runsAway(const JointState& real, const MotionState& nominal) const;
    /** Velocity limits that are wider from now on count. */
    void widen(const JointLimits& limits);

    /** One tick.
    @param asked, given  the motors' torque in the tick before [Nm] */
    Finding look(const JointState& real, const MotionState& nominal, const JointVector& asked,
                 const JointVector& given);

private:
    struct Swing {
        int sign = 0, halves = 0;
        std::int64_t since = 0;  // tick of the last change of sign
        double largest = 0.0;    // |velocity error| since then
        double travel = 0.0;     // its integral since then [rad, m]
        double last = 0.0;       // largest of the half before
        bool isAtLimit = false;  // the motor, since then
    };
    bool swings(int joint, double velocityError, bool isAtLimit);

    int n_ = 0, delayTicks_ = 0;
    double tick_s_ = 0.0;
    std::int64_t tick_ = 0;
    JointVector allowedError_, fastest_, count_, torqueLimit_;
    JointVector saturation_, weakness_;  // share of the recent ticks, smoothed
    std::array<Swing, kMaxJoints> swings_{};
};

}  // namespace viable::detail
