#include "experiment/StartCheck.h"

#include <cmath>

#include "core/Text.h"
#include "loop/PathExtent.h"
#include "loop/StopMonitor.h"
#include "viable/braking/Braking.h"

namespace viable::detail {

/** A path is followed to this share of the threshold for rounding. */
constexpr double kPathResolution = 1.0 / 16.0;

constexpr const char* kRecoveryRemedy =
    "or use the filter certified_braking with `recovery: true`, which recovers from such a start.";

/** Refuses a start outside a limit. */
static void checkInside(const CasePlan& plan, const JointLimits& limits) {
    // `otherwise`: what stands there without the key of the file's `start`.
    const auto check = [&](LimitKind kind, const JointVector& value, const JointBounds& bounds, const char* key,
                           const char* otherwise) {
        for (int i = 0; i < plan.robot.size(); ++i) {
            const bool below = value[i] < bounds.lower[i];
            if (!below && value[i] <= bounds.upper[i]) continue;
            const double bound = below ? bounds.lower[i] : bounds.upper[i];
            throw badInput(plan.startPlace,
                           std::string("the start ") + getName(kind, LimitSide::Neither) + " of " +
                               plan.robot.joints[i].name + " is " + formatNumber(value[i]) + " " +
                               getUnit(kind, plan.robot.slides(i)) + ", outside its " + (below ? "lower" : "upper") +
                               " limit " + formatNumber(bound) + " by " + formatNumber(std::abs(value[i] - bound)),
                           std::string("Start inside the limits (`start: {") + key + ": [...]}`; without it " +
                               otherwise + "), widen the limits, " + kRecoveryRemedy);
        }
    };
    check(LimitKind::Position, plan.start.q, limits.position, "position_rad", "the robot's home pose is taken");
    check(LimitKind::Velocity, plan.start.qd, limits.velocity, "velocity_radps", "0 is taken");
    check(LimitKind::Acceleration, plan.start.qdd, limits.acceleration, "acceleration_radps2", "0 is taken");
}

/** Refuses a start inside the limits whose fastest stop leaves them. */
static void checkViable(const CasePlan& plan, const JointLimits& limits) {
    for (int i = 0; i < plan.robot.size(); ++i) {
        const AxisLimits axis = limits.axis(i);
        if (std::isinf(axis.jerkLower) || std::isinf(axis.jerkUpper)) continue;
        const double v = plan.start.qd[i], a = plan.start.qdd[i];
        const StationaryStop stop = calcStationaryStop(v, a, axis);
        const double allowedP = kMonitorShare * calcLimitScale(axis.positionLower, axis.positionUpper);
        const double allowedV = kMonitorShare * calcLimitScale(axis.velocityLower, axis.velocityUpper);
        PathExtent path(plan.start.q[i], v, a,
                        {axis.positionLower, axis.positionUpper, allowedP, kPathResolution * allowedP},
                        {axis.velocityLower, axis.velocityUpper, allowedV, kPathResolution * allowedV});
        path.follow(stop.jerk, stop.T1);
        path.follow(0.0, stop.T2);
        path.follow(stop.side == LimitSide::Upper ? axis.jerkUpper : axis.jerkLower, stop.T3);
        const double peak = calcVelocityPeak(v, a, axis);
        const auto check = [&](LimitKind kind, const char* side, double excess, double allowed) {
            if (!(excess > allowed)) return;
            throw badInput(plan.startPlace,
                           "the start of " + plan.robot.joints[i].name +
                               " is not viable: its fastest stop passes the " + side + " " +
                               getName(kind, LimitSide::Neither) + " limit by " + formatNumber(excess) + " " +
                               getUnit(kind, plan.robot.slides(i)),
                           std::string("Change `start`: at rest or further inside; ") + kRecoveryRemedy);
        };
        check(LimitKind::Position, "upper", path.position.upper - axis.positionUpper, allowedP);
        check(LimitKind::Position, "lower", axis.positionLower - path.position.lower, allowedP);
        check(LimitKind::Velocity, "upper", peak - axis.velocityUpper, allowedV);
        check(LimitKind::Velocity, "lower", axis.velocityLower - peak, allowedV);
    }
}

void checkStart(const CasePlan& plan, const JointLimits& limits) {
    checkInside(plan, limits);
    checkViable(plan, limits);
}

}  // namespace viable::detail
