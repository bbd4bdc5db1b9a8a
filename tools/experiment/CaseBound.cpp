#include "experiment/CaseBound.h"

#include <cmath>

#include "core/Memo.h"
#include "core/Text.h"
#include "experiment/CaseChecks.h"
#include "experiment/ResolvedNodes.h"
#include "robot/RobotKey.h"
#include "tracking/InertiaSample.h"

namespace viable::detail {

/** Bounds that are remembered at a time; a sweep may draw its disturbance_set. */
constexpr std::size_t kMostKnownBounds = 64;

/** `bounds` with `margin` less on each side. */
static JointBounds tighten(const JointBounds& bounds, const JointVector& margin, const char* quantity, const char* unit,
                           const RobotDescription& robot, const std::string& place) {
    for (int i = 0; i < robot.size(); ++i) {
        const double range = bounds.upper[i] - bounds.lower[i];
        if (2.0 * margin[i] < range) continue;
        throw badInput(place,
                       std::string("hold_on: real leaves the nominal ") + robot.joints[i].name + " no " + quantity +
                           ": its limits are " + formatNumber(range) + " " + unit +
                           " apart and the tracking bound takes " + format("%.4g", 2.0 * margin[i]) + " " + unit,
                       "`viable bound` shows what the bound consists of: widen the limits, raise the gains of "
                       "the robust loop or state a smaller disturbance_set.");
    }
    return {bounds.lower + margin, bounds.upper - margin};
}

TrackingBound findBound(const CasePlan& plan, const LinearErrorLoop& loop) {
    const Parameters& disturbances = *plan.disturbances;
    const auto set = disturbances.get<DisturbanceSet>();
    if (!std::isinf(loop.inertiaRate))
        throw badInput(plan.robustLoop->parameters.resolved().place(),
                       "the disturbance_set asks for a tracking bound, which is known for constant gains only, not for "
                       "those that follow the arm's inertia (`auto`)",
                       "Give them in this block; stable ones are " +
                           formatGains(scaleConstantGains(plan.robot, plan.limits, plan.tick_s, set.delayTicks)) + ".");
    const ConfigNode inputs = makeMap(
        {{"robot", makeScalar(calcRobotKey(plan.robot), true)},
         {"tick_s", makeNumber(plan.tick_s)},
         {"position", makeBounds(plan.limits.position)},
         {"velocity", makeBounds(plan.limits.velocity)},
         {"acceleration", makeBounds(plan.limits.acceleration)},
         {"jerk", makeBounds(plan.limits.jerk)},
         {"gains", makeMap({{"k_r", makeList(loop.kr)}, {"k_p", makeList(loop.kp)}, {"k_i", makeList(loop.ki)}})},
         {"friction", makeMap({{"coulomb", makeList(loop.friction.figures.coulomb)},
                               {"viscous", makeList(loop.friction.figures.viscous)},
                               {"viscous_velocity", makeList(loop.friction.figures.viscousVelocity)},
                               {"speed", makeList(loop.friction.speed)}})},
         {"disturbance_set", disturbances.resolved()}});
    static Memo<TrackingBound> known(kMostKnownBounds);
    return known.get(writeConfig(inputs), [&] {
        NricOptions gains;
        gains.kr = loop.kr;
        gains.kp = loop.kp;
        gains.ki = loop.ki;
        gains.friction = loop.friction;
        return calcTrackingBound(plan.robot, plan.limits, plan.tick_s, gains, set, disturbances.resolved().place());
    });
}

JointLimits findNominalLimits(const CasePlan& plan, const TrackingBound* bound) {
    checkHoldsOnBound(plan, bound != nullptr);
    if (!plan.holdsOnReal) return plan.limits;
    JointLimits limits = plan.limits;
    limits.position = tighten(limits.position, bound->position, "range", "rad", plan.robot, plan.limitsPlace);
    limits.velocity = tighten(limits.velocity, bound->velocity, "velocity", "rad/s", plan.robot, plan.limitsPlace);
    checkLimits(limits, plan.tick_s, plan.allowsLargeAngles, plan.limitsPlace, plan.robot.jointNames());
    return limits;
}

}  // namespace viable::detail
