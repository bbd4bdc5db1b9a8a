#include "loop/GuardSetup.h"

#include <Eigen/Cholesky>

#include "core/Text.h"

namespace viable {

namespace detail {

std::string quoteJoint(const RobotDescription& robot, int joint) {
    return "joint `" + robot.joints[joint].name + "`";
}

/** Refuses a description that was not built to its end; loadRobot() gives none such. */
static void checkRobot(const char* guard, const RobotDescription& robot) {
    const std::string n = std::to_string(robot.joints.size());
    if (robot.joints.empty() || robot.joints.size() > static_cast<std::size_t>(kMaxJoints))
        throw badInput(guard, "the robot has " + n + " joints; allowed is 1 to " + std::to_string(kMaxJoints),
                       "Load it by loadRobot(), or fill RobotDescription::joints.");
    for (int i = 0; i < robot.size(); ++i)
        if (robot.joints[i].parent < -1 || robot.joints[i].parent >= i)
            throw badInput(guard,
                           quoteJoint(robot, i) + " has joint " + std::to_string(robot.joints[i].parent) +
                               " as its parent; allowed is -1 to " + std::to_string(i - 1),
                           "List parents before children; the base is -1.");
    if (robot.toolParent < -1 || robot.toolParent >= robot.size())
        throw badInput(guard,
                       "toolParent is " + std::to_string(robot.toolParent) + "; allowed is -1 to " +
                           std::to_string(robot.size() - 1),
                       "Set the joint that carries the tool.");
    const auto check = [&](const char* name, const JointVector& values, double smallest, bool mayBeInfinite) {
        if (values.size() != robot.size())
            throw badInput(guard,
                           std::string("actuation.") + name + " has " + std::to_string(values.size()) +
                               " entries; the robot has " + n + " joints",
                           "Give one entry per joint.");
        for (int i = 0; i < robot.size(); ++i)
            if (!(values[i] >= smallest) || (std::isinf(values[i]) && !mayBeInfinite))
                throw badInput(guard,
                               std::string("actuation.") + name + " of " + quoteJoint(robot, i) + " is " +
                                   formatNumber(values[i]) + "; allowed is " +
                                   (smallest > 0.0 ? "above 0" : "0 and more"),
                               "Check the number.");
    };
    check("rotorInertia", robot.actuation.rotorInertia, 0.0, false);
    check("torqueLimit", robot.actuation.torqueLimit, std::numeric_limits<double>::min(), true);
    check("encoderCounts", robot.actuation.encoderCounts, 0.0, false);
    check("friction.coulomb", robot.actuation.friction.coulomb, 0.0, false);
    check("friction.viscous", robot.actuation.friction.viscous, 0.0, false);
    check("friction.viscousVelocity", robot.actuation.friction.viscousVelocity, std::numeric_limits<double>::min(),
          true);
}

static void checkTick(const char* guard, double tick_s) {
    if (tick_s >= kShortestTick_s && tick_s <= kLongestTick_s) return;
    throw badInput(guard,
                   "the tick is " + formatNumber(tick_s) + " s; allowed is [" + formatNumber(kShortestTick_s) + ", " +
                       formatNumber(kLongestTick_s) + "] s",
                   "Give the period of the loop in seconds: 0.001 at 1 kHz.");
}

/** The robot's own limits, or those of the options; checked. */
static const JointLimits& checkGuardLimits(const char* guard, const RobotDescription& robot, double tick_s,
                                           const std::optional<JointLimits>& own) {
    const JointLimits& limits = own ? *own : robot.limits;
    const std::string place =
        std::string(guard) + ": " + (own ? std::string(guard) + "Options" : "RobotDescription") + "::limits";
    if (limits.size() != robot.size())
        throw badInput(place,
                       "the limits are those of " + std::to_string(limits.size()) + " joints; the robot has " +
                           std::to_string(robot.size()),
                       "Give each bound one number per joint; infinity where there is none.");
    checkLimits(limits, tick_s, robot.allowLargeAngles, place, robot.jointNames());
    return limits;
}

/** At rest amid the position limits: a state that nobody can refuse, for checking all the rest. */
static MotionState makeRest(const JointLimits& limits) {
    const int n = limits.size();
    MotionState rest{JointVector::Zero(n), JointVector::Zero(n), JointVector::Zero(n)};
    for (int i = 0; i < n; ++i) {
        const double lower = limits.position.lower[i], upper = limits.position.upper[i];
        const bool hasLower = std::isfinite(lower), hasUpper = std::isfinite(upper);
        rest.q[i] = hasLower && hasUpper ? 0.5 * (lower + upper)
                    : hasLower           ? std::max(0.0, lower + 1.0)
                    : hasUpper           ? std::min(0.0, upper - 1.0)
                                         : 0.0;
    }
    return rest;
}

RunSetup makeGuardSetup(const char* guard, const RobotDescription& robot, double tick_s,
                        const std::optional<JointLimits>& own) {
    checkRobot(guard, robot);
    checkTick(guard, tick_s);
    const JointLimits& limits = checkGuardLimits(guard, robot, tick_s, own);
    return {robot, limits, tick_s, kInfinity, makeRest(limits), {}};
}

void refuseSpeedLimits(const char* guard, const RobotDescription& robot) {
    if (!robot.speedLimits.isAny()) return;
    throw badInput(guard,
                   "the robot has speed limits of its points (RobotDescription::speedLimits, or speed_limits in its "
                   "limits.yaml), which are not kept here",
                   "Use ReferenceGuard, which keeps them, or clear them where something else does.");
}

void refusePeople(const char* where, const Environment& environment, const char* who) {
    if (environment.people.empty()) return;
    throw badInput(
        where, std::string("there are people in it, and ") + who + " apart from none",
        "Leave Environment::people empty; WholeArmBrakingFilter keeps apart from those of RunSetup::people.");
}

Dynamics checkGuardStart(const char* guard, const MotionState& start, RunSetup& setup) {
    const std::string place = std::string(guard) + "::start";
    const int n = setup.size();
    if (!isFinite(start, n))
        throw badInput(
            place,
            "the start has " + std::to_string(start.q.size()) + " positions and " + std::to_string(start.qd.size()) +
                " velocities" +
                (start.qdd.size() == n ? "" : " and " + std::to_string(start.qdd.size()) + " accelerations") + " for " +
                std::to_string(n) + " joints, or a number that is not finite",
            "Start with a good reading of all joints.");
    for (const JointVector* v : {&start.q, &start.qd, &start.qdd})
        if (v->lpNorm<Eigen::Infinity>() > kLargestLimit)
            throw badInput(place, "the start is beyond 1e7 rad, rad/s or rad/s^2", "Check its unit.");
    Dynamics dynamics;
    RobotModel(setup.robot).calcDynamics(start.q, start.qd, dynamics);
    if (!isFinite(dynamics, n) || dynamics.M.llt().info() != Eigen::Success)
        throw badInput(place, "the robot's inertia matrix is not positive definite",
                       "Give every link that moves a mass and an inertia, in its URDF or in RobotDescription::joints.");
    setup.start = start;
    setup.startTool = dynamics.tool;
    return dynamics;
}

GuardStatus findStatus(const ControlLoop& loop, const TickRecord& record) {
    return loop.hasStopped()                           ? GuardStatus::Stopped
           : record.braking                            ? GuardStatus::Stopping
           : record.status == FilterStatus::Passed     ? GuardStatus::Passed
           : record.status == FilterStatus::Recovering ? GuardStatus::Recovering
                                                       : GuardStatus::Limited;
}

GuardStop toGuardStop(StopReason reason) {
    // The others: commands of guards do not fail, there is no bound, and guards judge readings themselves.
    constexpr std::pair<StopReason, GuardStop> kStops[] = {
        {StopReason::None, GuardStop::None},
        {StopReason::Requested, GuardStop::Requested},
        {StopReason::ControllerFailed, GuardStop::LawFailed},
        {StopReason::FilterFailed, GuardStop::FilterFailed},
        {StopReason::FilterEnded, GuardStop::FilterFailed},
        {StopReason::RobustLoopFailed, GuardStop::RobustLoopFailed},
        {StopReason::GuaranteeBroken, GuardStop::GuaranteeBroken},
        {StopReason::TicksMissed, GuardStop::TicksMissed},
        {StopReason::NotFollowing, GuardStop::TooFar},
    };
    for (const auto& [own, told] : kStops)
        if (own == reason) return told;
    return GuardStop::LibraryFailed;
}

}  // namespace detail

const char* getName(GuardStatus status) {
    return detail::enumName<GuardStatus::Failed>(
        status, {"not_started", "passed", "limited", "recovering", "waiting", "stopping", "stopped", "failed"});
}

}  // namespace viable
