#include "viable/core/JointLimits.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <mutex>

#include "core/Text.h"

namespace viable {

namespace {

using detail::formatNumber;

double getUnlimited(LimitSide side) {
    return side == LimitSide::Upper ? kInfinity : -kInfinity;
}

/** A velocity, acceleration or jerk limit of the right sign and within its window, or none. */
bool isRate(LimitSide side, double value) {
    const double size = side == LimitSide::Upper ? value : -value;
    return size == kInfinity || (size >= kSmallestLimit && size <= kLargestLimit);
}

/** The time that one limit takes to use up the next (A/J or V/A) is within its window. */
bool isRamp(double value, double rate) {
    if (std::isinf(value) || std::isinf(rate)) return true;
    const double time = value / rate;
    return time >= kShortestRamp_s && time <= kLongestRamp_s;
}

/** An angle of ordinary size, or no limit. */
bool isPosition(LimitSide side, double value) {
    return value == getUnlimited(side) ||
           (std::isfinite(value) && std::fpclassify(value) != FP_SUBNORMAL && std::abs(value) <= kLargestLimit);
}

/** One side's limits of velocity, acceleration and jerk. */
struct SideLimits {
    LimitSide side;
    double velocity, acceleration, jerk;
};

std::array<SideLimits, 2> listSides(const AxisLimits& axis) {
    return {{{LimitSide::Lower, axis.velocityLower, axis.accelerationLower, axis.jerkLower},
             {LimitSide::Upper, axis.velocityUpper, axis.accelerationUpper, axis.jerkUpper}}};
}

/** Jerk of either sign acts on either side: it builds an acceleration up and takes it back. */
double getLargerJerk(const AxisLimits& axis) {
    return std::max(-axis.jerkLower, axis.jerkUpper);
}

/** The range that one tick of jerk and its stop need. */
double calcNeededRange(double jerk, double tick_s) {
    return 8.0 * jerk * tick_s * tick_s * tick_s;
}

bool isUsable(const AxisLimits& axis, double tick_s) {
    if (!isPosition(LimitSide::Lower, axis.positionLower) || !isPosition(LimitSide::Upper, axis.positionUpper) ||
        axis.positionLower >= axis.positionUpper)
        return false;
    const double jerk = getLargerJerk(axis);
    for (const SideLimits& s : listSides(axis))
        if (!isRate(s.side, s.velocity) || !isRate(s.side, s.acceleration) || !isRate(s.side, s.jerk) ||
            !isRamp(s.acceleration, s.jerk) || !isRamp(s.velocity, s.acceleration) ||
            (!std::isinf(jerk) && std::abs(s.acceleration) < jerk * tick_s))
            return false;
    return std::isinf(jerk) || axis.positionUpper - axis.positionLower >= calcNeededRange(jerk, tick_s);
}

/** Remarks of one set of limits, all with the same beginning. */
class LimitCheck {
public:
    LimitCheck(const std::string& where, const std::vector<std::string>& jointNames)
        : where_(where), jointNames_(jointNames) {}

    std::string nameJoint(int joint) const {
        const auto i = static_cast<std::size_t>(joint);
        return i < jointNames_.size() ? "joint `" + jointNames_[i] + "`" : "joint " + std::to_string(joint);
    }

    [[noreturn]] void fail(int joint, const std::string& what, const std::string& remedy) const {
        throw badInput(where_, nameJoint(joint) + ": " + what, remedy);
    }

    /** One signed velocity, acceleration or jerk limit. */
    void checkRate(int joint, LimitKind kind, LimitSide side, double value, const char* unit) const {
        if (isRate(side, value)) return;
        const std::string smallest = formatNumber(kSmallestLimit);
        const std::string largest = formatNumber(kLargestLimit);
        const std::string allowed = side == LimitSide::Upper ? "[" + smallest + ", " + largest + "] or .inf"
                                                             : "[-" + largest + ", -" + smallest + "] or -.inf";
        fail(joint,
             std::string(getName(kind, side)) + " is " + formatNumber(value) + " " + unit + "; allowed is " + allowed,
             side == LimitSide::Upper
                 ? "An upper limit is positive, so that the joint can start and stop; check its unit and exponent"
                 : "A lower limit is negative, so that the joint can start and stop; check its unit and exponent");
    }

    /** The time that one limit takes to use up the next: A/J or V/A. */
    void checkRamp(int joint, LimitSide side, LimitKind kind, double value, LimitKind rateKind, double rate) const {
        if (isRamp(value, rate)) return;
        fail(joint,
             std::string(getName(kind, side)) + " " + formatNumber(value) + " divided by " + getName(rateKind, side) +
                 " " + formatNumber(rate) + " is " + formatNumber(value / rate) + " s; allowed is [" +
                 formatNumber(kShortestRamp_s) + ", " + formatNumber(kLongestRamp_s) + "] s",
             "One of the two would have no effect: check their units and exponents");
    }

private:
    const std::string& where_;
    const std::vector<std::string>& jointNames_;
};

void checkPosition(const LimitCheck& check, int joint, LimitSide side, double value, bool allowLargeAngles) {
    const std::string shown = std::string(getName(LimitKind::Position, side)) + " is " + formatNumber(value) + " rad";
    if (value == getUnlimited(side)) return;
    if (!isPosition(side, value)) {
        const std::string largest = formatNumber(kLargestLimit);
        check.fail(joint,
                   shown + "; allowed is [-" + largest + ", " + largest + "] or " +
                       (side == LimitSide::Upper ? ".inf" : "-.inf"),
                   "Check the number");
    }
    if (std::abs(value) > kLargestAngle_rad && !allowLargeAngles) {
        const std::string largest = formatNumber(kLargestAngle_rad);
        check.fail(joint, shown + "; allowed is [-" + largest + ", " + largest + "]",
                   "If these are degrees, write them as `170*pi/180`; if the joint really turns that far, set "
                   "`allow_large_angles: true`");
    }
}

struct KindNames {
    std::string lower, neither, upper, unit, slidingUnit;
};

/** Never moves and is never destroyed: names are told until the last log is finished. */
struct KindTable {
    KindTable() {
        rows[0] = {"none", "none", "none", "", ""};
        add("position", "rad", "m");
        add("velocity", "rad/s", "m/s");
        add("acceleration", "rad/s^2", "m/s^2");
        add("jerk", "rad/s^3", "m/s^3");
        add("torque", "Nm", "N");
        add("clearance", "m", "m");
        add("speed", "m/s", "m/s");
        add("separation", "m", "m");
    }
    LimitKind add(const std::string& name, const std::string& unit, const std::string& slidingUnit) {
        const int kind = count.load();
        rows[static_cast<std::size_t>(kind)] = {name + "_lower", name, name + "_upper", unit, slidingUnit};
        count = kind + 1;
        return static_cast<LimitKind>(kind);
    }

    std::array<KindNames, kMostLimitKinds> rows;
    std::atomic<int> count{1};
    std::mutex adding;
};

KindTable& getKinds() {
    static KindTable& kinds = *new KindTable;
    return kinds;
}

}  // namespace

LimitKind addLimitKind(const std::string& name, const std::string& unit) {
    KindTable& kinds = getKinds();
    const std::lock_guard<std::mutex> guard(kinds.adding);
    const std::string where = "kind of limit '" + name + "'";
    for (int k = 0; k < kinds.count; ++k) {
        const KindNames& known = kinds.rows[k];
        if (known.neither != name) continue;
        if (known.unit != unit)
            throw badInput(where, "it has the unit '" + known.unit + "' here already, not '" + unit + "'",
                           "Choose another name, or the same unit.");
        return static_cast<LimitKind>(k);
    }
    const bool isWord = !name.empty() && name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_") == name.npos;
    if (!isWord)
        throw badInput(where, "its name is no word of small letters, digits and _",
                       "Choose a word such as `upright`: log channels are named after it.");
    if (kinds.count == kMostLimitKinds)
        throw badInput(
            where, "there is no room for it beside " + std::to_string(kMostLimitKinds - 1) + " others",
            "Leave out a plugin that adds a kind of limit. If logs brought kinds along, start a new process.");
    return kinds.add(name, unit, unit);
}

int countLimitKinds() noexcept {
    return getKinds().count;
}

const char* getName(LimitKind kind, LimitSide side) {
    if (static_cast<int>(kind) >= countLimitKinds()) return "unknown";
    const KindNames& names = getKinds().rows[static_cast<std::size_t>(kind)];
    return (side == LimitSide::Lower ? names.lower : side == LimitSide::Upper ? names.upper : names.neither).c_str();
}

const char* getName(LimitSide side) {
    return side == LimitSide::Lower ? "lower" : side == LimitSide::Upper ? "upper" : "";
}

const char* getUnit(LimitKind kind, bool slides) {
    if (static_cast<int>(kind) >= countLimitKinds()) return "";
    const KindNames& names = getKinds().rows[static_cast<std::size_t>(kind)];
    return (slides ? names.slidingUnit : names.unit).c_str();
}

AxisLimits JointLimits::axis(int joint) const {
    return {position.lower[joint],     position.upper[joint],     velocity.lower[joint], velocity.upper[joint],
            acceleration.lower[joint], acceleration.upper[joint], jerk.lower[joint],     jerk.upper[joint]};
}

double calcLimitScale(double lower, double upper) {
    const bool isOpen = !std::isfinite(lower) || !std::isfinite(upper);
    const auto size = [](double limit) { return std::isfinite(limit) ? std::abs(limit) : 0.0; };
    return std::max({isOpen ? 1.0 : 0.0, size(lower), size(upper)});
}

JointLimits JointLimits::unlimited(int n) {
    VIABLE_CHECK(n >= 0 && n <= kMaxJoints, "the number of joints is beyond the capacity");
    const JointBounds none{JointVector::Constant(n, -kInfinity), JointVector::Constant(n, kInfinity)};
    return {none, none, none, none};
}

void requireJerkLimits(const JointLimits& limits, const std::string& where, const std::string& who,
                       const std::string& remedy) {
    if (!limits.hasJerkLimits()) throw badInput(where, who + " needs a finite jerk limit on every joint", remedy);
}

void checkLimits(const JointLimits& limits, double tick_s, bool allowLargeAngles, const std::string& where,
                 const std::vector<std::string>& jointNames) {
    const int n = limits.size();
    for (const auto& [kind, bounds] : {std::pair(LimitKind::Position, &limits.position),
                                       {LimitKind::Velocity, &limits.velocity},
                                       {LimitKind::Acceleration, &limits.acceleration},
                                       {LimitKind::Jerk, &limits.jerk}})
        for (const LimitSide side : {LimitSide::Lower, LimitSide::Upper}) {
            const JointVector& values = side == LimitSide::Lower ? bounds->lower : bounds->upper;
            if (values.size() == n) continue;
            throw badInput(where,
                           std::string(getName(kind, side)) + " has " + std::to_string(values.size()) +
                               " numbers; allowed is " + std::to_string(n) + ", one per joint",
                           "Write one number per joint, or a single one for all");
        }
    if (!(tick_s > 0.0) || !std::isfinite(tick_s))
        throw badInput(where, "the tick is " + formatNumber(tick_s) + " s; allowed is (0, inf)",
                       "Set `tick_s` to a positive time such as 0.001");

    const LimitCheck check(where, jointNames);
    for (int i = 0; i < n; ++i) {
        const AxisLimits axis = limits.axis(i);
        checkPosition(check, i, LimitSide::Lower, axis.positionLower, allowLargeAngles);
        checkPosition(check, i, LimitSide::Upper, axis.positionUpper, allowLargeAngles);
        if (axis.positionLower >= axis.positionUpper)
            check.fail(i,
                       "position_lower is " + formatNumber(axis.positionLower) + " rad and position_upper is " +
                           formatNumber(axis.positionUpper) + " rad; allowed is lower < upper",
                       "Swap the two or check their signs");
        const std::array<SideLimits, 2> sides = listSides(axis);
        for (const SideLimits& s : sides) {
            check.checkRate(i, LimitKind::Velocity, s.side, s.velocity, "rad/s");
            check.checkRate(i, LimitKind::Acceleration, s.side, s.acceleration, "rad/s^2");
            check.checkRate(i, LimitKind::Jerk, s.side, s.jerk, "rad/s^3");
        }
        for (const SideLimits& s : sides) {
            check.checkRamp(i, s.side, LimitKind::Acceleration, s.acceleration, LimitKind::Jerk, s.jerk);
            check.checkRamp(i, s.side, LimitKind::Velocity, s.velocity, LimitKind::Acceleration, s.acceleration);
        }

        const double jerk = getLargerJerk(axis);
        if (std::isinf(jerk)) continue;
        const double needed = jerk * tick_s;
        for (const SideLimits& s : sides) {
            if (std::abs(s.acceleration) >= needed) continue;
            check.fail(i,
                       std::string(getName(LimitKind::Acceleration, s.side)) + " is " + formatNumber(s.acceleration) +
                           " rad/s^2; allowed is at least " + formatNumber(needed) + " rad/s^2, which one tick of " +
                           formatNumber(tick_s) + " s at a jerk of " + formatNumber(jerk) + " rad/s^3 reaches",
                       "A braking step would not fit the time grid: lower the jerk limit, raise the acceleration "
                       "limit, or shorten the tick");
        }
        const double range = axis.positionUpper - axis.positionLower;
        const double stop = calcNeededRange(jerk, tick_s);
        if (range < stop)
            check.fail(i,
                       "position_lower " + formatNumber(axis.positionLower) + " rad to position_upper " +
                           formatNumber(axis.positionUpper) + " rad is a range of " + formatNumber(range) +
                           " rad; allowed is at least " + formatNumber(stop) +
                           " rad, which one tick of jerk and its stop need",
                       "Widen the position range, lower the jerk limit, or shorten the tick");
    }
}

bool areUsable(const JointLimits& limits, int n, double tick_s) noexcept {
    for (const JointBounds* bounds : {&limits.position, &limits.velocity, &limits.acceleration, &limits.jerk})
        if (bounds->lower.size() != n || bounds->upper.size() != n) return false;
    if (!(tick_s > 0.0) || !std::isfinite(tick_s)) return false;
    for (int i = 0; i < n; ++i)
        if (!isUsable(limits.axis(i), tick_s)) return false;
    return true;
}

}  // namespace viable
