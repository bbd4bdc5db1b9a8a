#pragma once

#include "viable/core/Error.h"
#include "viable/core/JointTypes.h"

namespace viable {

/** Which limit acts on a joint. The text names are those of the logs (see getName). Kinds from Clearance on are of
the whole arm: each has a row (viable/limits/ArmLimit.h), and addLimitKind() adds more. */
enum class LimitKind : unsigned char {
    None,
    Position,
    Velocity,
    Acceleration,
    Jerk,
    Torque,      ///< torque of the motors, now or along the stop
    Clearance,   ///< from obstacles, or of the links from each other; acts as a lower limit
    Speed,       ///< speed of the arm's points, see SpeedLimits; acts as an upper limit
    Separation,  ///< from people; acts as an upper limit
};

inline constexpr LimitKind kFirstArmLimit = LimitKind::Clearance, kLastOwnLimit = LimitKind::Separation;
/** There is room for as many kinds, None included. */
inline constexpr int kMostLimitKinds = 12;

/** Which side of a limit acts. */
enum class LimitSide : signed char { Lower = -1, Neither = 0, Upper = 1 };

/** Which limit holds one joint back. */
struct JointIntervention {
    LimitKind limit = LimitKind::None;
    LimitSide side = LimitSide::Neither;
};

/** "none", "position_lower", "jerk_upper", ...: the words used in logs and summaries. */
const char* getName(LimitKind kind, LimitSide side);

/** "lower", "upper"; empty for Neither. */
const char* getName(LimitSide side);

/** The kind of that name, a new one where there is none yet. Any thread. Throws Error (BadInput) where there is no room
for one more, where the kind has another unit, or where the name is no snake_case word.
@param unit  of it, such as "deg" */
LimitKind addLimitKind(const std::string& name, const std::string& unit);

/** How many kinds there are now, None included: those below are LimitKind 0, 1, ... Real time. */
int countLimitKinds() noexcept;

/** The scale of tolerances on one joint's limits: the size of the larger limit. If one side or both are unlimited,
it is at least 1 rad, rad/s, rad/s^2 or rad/s^3. Rounding is relative to this size, not to the range: limits may lie
close together and far from zero. */
double calcLimitScale(double lower, double upper);

/** A value counts as outside its limit when it is beyond it by more than this share of calcLimitScale(), or NaN.
Rounding of a limit met exactly does not count. */
inline constexpr double kOutsideShare = 1e-9;

/** "rad", "rad/s", "rad/s^2", "rad/s^3", "Nm". For a joint that slides "m", "m/s", "m/s^2", "m/s^3", "N". Limits of
the whole arm have their own. Empty for None. */
const char* getUnit(LimitKind kind, bool slides);

/** Lower and upper bound of one quantity for every joint. "No limit" is infinity. */
struct JointBounds {
    JointVector lower;
    JointVector upper;
};

/** The limits of one joint, signed: lower <= upper, SI and radians. */
struct AxisLimits {
    double positionLower, positionUpper;          // [rad]
    double velocityLower, velocityUpper;          // [rad/s]
    double accelerationLower, accelerationUpper;  // [rad/s^2]
    double jerkLower, jerkUpper;                  // [rad/s^3]
};

/** Position, velocity, acceleration and jerk limits of all joints; each side of each joint has its
own. Velocity, acceleration and jerk limits contain zero in their interior, so that every joint can
stop and start. In a file, each of them in one of the forms
    3 | [1, 2, 3]                                 both sides, symmetric about zero
    {lower: -1 | [...], upper: 2 | [...]}         each side
    {center: [...], half_range: [...]}            position only */
struct JointLimits {
    JointBounds position;      // [rad]
    JointBounds velocity;      // [rad/s]
    JointBounds acceleration;  // [rad/s^2]
    JointBounds jerk;          // [rad/s^3]

    template <class V>
    void describe(V& v) {
        v(position, "position_rad", "rad", "x (that is -x to x), {lower, upper} or {center, half_range}.").positions();
        v(velocity, "velocity_radps", "rad/s", "x (that is -x to x) or {lower, upper}.");
        v(acceleration, "acceleration_radps2", "rad/s^2", "x (that is -x to x) or {lower, upper}.");
        v(jerk, "jerk_radps3", "rad/s^3", "x (that is -x to x) or {lower, upper}.");
    }

    int size() const { return static_cast<int>(position.lower.size()); }
    AxisLimits axis(int joint) const;
    /** Every joint has a finite jerk limit on both sides. */
    bool hasJerkLimits() const { return jerk.lower.allFinite() && jerk.upper.allFinite(); }

    /** No limit at all for n joints. */
    static JointLimits unlimited(int n);
};

/** Smallest and largest finite velocity, acceleration or jerk limit accepted: a number outside this
window is a mistake in the unit or in the exponent. [rad/s, rad/s^2, rad/s^3] */
inline constexpr double kSmallestLimit = 1e-6;
inline constexpr double kLargestLimit = 1e7;

/** Window for the times A/J and V/A in seconds. Outside, one of the two limits has no effect that double precision
at the given tick can resolve. */
inline constexpr double kShortestRamp_s = 1e-6;
inline constexpr double kLongestRamp_s = 1e4;

/** Position limits beyond this many radians need `allow_large_angles`: they are usually degrees.
kLargestLimit bounds them in any case. */
inline constexpr double kLargestAngle_rad = 4.0 * kPi;

/** Throws Error (BadInput) unless every joint's limits are usable at the given tick: ordered, of the right sign, inside
the windows above. The acceleration range must hold one tick of jerk (A >= J dt). The position range must hold one tick
of jerk and its stop (8 J dt^3). J is the larger side's; an unlimited jerk has neither condition. The message names
joint, limit, side, value and allowed range.
@param where  place of the limits, for the message */
void checkLimits(const JointLimits& limits, double tick_s, bool allowLargeAngles, const std::string& where,
                 const std::vector<std::string>& jointNames);

/** Throws Error (BadInput) unless hasJerkLimits(): for laws that choose jerks.
@param where  place, for the message
@param who    needs them: "the filter tosbp" */
void requireJerkLimits(const JointLimits& limits, const std::string& where, const std::string& who,
                       const std::string& remedy = "Set limits.jerk_radps3.");

/** True when checkLimits() would accept the limits of n joints, large angles allowed. Real time: no allocation,
no throw. */
bool areUsable(const JointLimits& limits, int n, double tick_s) noexcept;

}  // namespace viable
