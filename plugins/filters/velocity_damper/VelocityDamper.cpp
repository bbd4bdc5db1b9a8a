#include "VelocityDamper.h"

#include "viable/braking/Braking.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

void VelocityDamper::configure(const RunSetup& setup, const Parameters& parameters) {
    options_ = parameters.get<VelocityDamperOptions>();
    const double width = options_.influence_rad - options_.safety_rad;
    if (!(width > 0.0))
        throw badInput(parameters.place("influence_rad"),
                       "influence_rad = " + std::to_string(options_.influence_rad) +
                           " is not larger than safety_rad = " + std::to_string(options_.safety_rad),
                       "Choose influence_rad above safety_rad.");
    if (options_.xi * setup.tick_s > width)
        throw badInput(parameters.place("xi"),
                       "xi * tick_s is " + std::to_string(options_.xi * setup.tick_s) +
                           " rad, allowed (0, influence_rad - safety_rad = " + std::to_string(width) + "]",
                       "The sampled law overshoots beyond that; choose a smaller xi or a wider zone.");
    for (int i = 0; i < setup.size(); ++i) {
        const AxisLimits axis = setup.limits.axis(i);
        if (axis.positionUpper - axis.positionLower < 2.0 * options_.safety_rad)
            throw badInput(parameters.place("safety_rad"),
                           "the safety distances of " + setup.robot.joints[i].name + " leave no room: its range is " +
                               std::to_string(axis.positionUpper - axis.positionLower) + " rad",
                           "Choose safety_rad at most half of the range.");
    }
    JerkIntervalFilter::configure(setup, parameters);
}

/** The largest velocity towards a limit at this distance from it; infinite where it is not damped. */
double VelocityDamper::calcDampedVelocity(double toLimit) const {
    if (toLimit >= options_.influence_rad) return kInfinity;
    return options_.xi * (toLimit - options_.safety_rad) / (options_.influence_rad - options_.safety_rad);
}

JerkIntervalFilter::Rows VelocityDamper::calcRows(const AxisState& s, const AxisLimits& l) const {
    JointInterval velocity{l.velocityLower, l.velocityUpper, LimitKind::Velocity, LimitKind::Velocity};
    // Far beyond a limit the damper asks for more speed back than the velocity limit allows: as much as it allows.
    velocity.restrictLower(std::min(l.velocityUpper, -calcDampedVelocity(s.p - l.positionLower)), LimitKind::Position);
    velocity.restrictUpper(std::max(l.velocityLower, calcDampedVelocity(l.positionUpper - s.p)), LimitKind::Position);
    // v+ <= bound as a bound on the jerk.
    const auto toJerk = [&](double bound) { return (bound - s.v - s.a * tick_s()) * 2.0 / (tick_s() * tick_s()); };
    const double lower = toJerk(velocity.lower), upper = toJerk(velocity.upper);
    JointInterval jerk = calcHardLimits(s, l);
    const bool isTooFast = upper < jerk.lower;
    const bool isTooSlow = lower > jerk.upper;
    jerk.restrictLower(lower, velocity.lowerLimit);
    jerk.restrictUpper(upper, velocity.upperLimit);
    // Without a jerk that gives an allowed velocity: towards the nearest one, and to rest where there is none at all.
    const double aim = isTooFast == isTooSlow ? 0.0 : isTooFast ? velocity.upper : velocity.lower;
    return finishRows(jerk, calcStationaryStop(s.v - aim, s.a, l).jerk, s, l);
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::VelocityDamper, "velocity_damper",
              "Velocity dampers near position limits (Faverjon and Tournassoud), the other limits for one tick.",
              viable::VelocityDamperOptions)
