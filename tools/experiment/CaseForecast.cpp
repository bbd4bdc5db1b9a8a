#include "experiment/CaseForecast.h"

#include <Eigen/Cholesky>

#include "core/Text.h"
#include "environment/ArmClearances.h"
#include "experiment/NominalLoop.h"
#include "experiment/TrialTick.h"
#include "experiment/UnlikelyValues.h"
#include "host/PythonClass.h"
#include "host/WatchedLimit.h"
#include "plugin/RehearsedCommand.h"
#include "robot/PoseSampling.h"

namespace viable {

namespace {

using detail::format;
using detail::formatList;

/** Poses in which the motors are looked at. */
constexpr int kMotorPoses = 1000;
/** A command that starts nearer to the tool is taken up on the way [m, rad]. */
constexpr double kFar_m = 0.1, kFarAngle_rad = 30.0 * kDegree;
/** Nearer than this a place counts as reached [m]. */
constexpr double kReached_m = 0.005;
/** Searches for a pose whose tool is at a place, from so many poses, each in so many steps. */
constexpr int kSearches = 40, kSearchSteps = 100;

std::string getJoint(const RobotDescription& robot, int joint) {
    return robot.joints[joint].name;
}

/** The largest share of its torque limit that a joint takes, and where. */
struct MotorShare {
    double share = 0.0;
    int joint = 0;
    double torque = 0.0;  ///< [Nm]
    JointVector q;

    /** @param torques  of all joints at pose `at`, at least 0 [Nm] */
    void add(const JointVector& torques, const JointVector& limits, const JointVector& at) {
        for (int i = 0; i < static_cast<int>(torques.size()); ++i)
            if (torques[i] / limits[i] > share) *this = {torques[i] / limits[i], i, torques[i], at};
    }
};

std::string formatShare(const MotorShare& worst, const RobotDescription& robot) {
    return format("%.0f %% (", 100.0 * worst.share) + getJoint(robot, worst.joint) + ")";
}

/** "takes 182 % of its motor's torque limit (91 of 50 Nm)". */
std::string formatLoad(const MotorShare& worst, const RobotDescription& robot) {
    return format("takes %.0f %% of its motor's torque limit (%.3g of %.3g Nm)", 100.0 * worst.share, worst.torque,
                  robot.actuation.torqueLimit[worst.joint]);
}

bool limitsTorque(const CasePlan& plan) {
    return std::any_of(plan.filters.begin(), plan.filters.end(), [](const PluginChoice& filter) {
        const ConfigNode* share = filter.parameters.resolved().find("torque_share");
        NumberRange any;
        any.mayBeInfinite = true;
        return share && !isPython(filter.plugin) && std::isfinite(toNumber(*share, any));
    });
}

void addMotors(const ConfiguredCase& configured, CaseForecast& forecast) {
    const CasePlan& plan = configured.plan;
    const RobotDescription& robot = plan.robot;
    const JointVector& limits = robot.actuation.torqueLimit;
    if (limits.array().isInf().all()) return;
    RobotModel model(robot);
    Dynamics dynamics;
    const JointVector still = JointVector::Zero(robot.size());
    const auto calc = [&](const JointVector& q) { model.calcDynamics(q, still, dynamics); };
    MotorShare start, anywhere, moving;
    calc(plan.start.q);
    start.add(dynamics.gravity.cwiseAbs(), limits, plan.start.q);
    const JointBounds& acceleration = configured.setup.limits.acceleration;
    const JointVector fastest = acceleration.upper.cwiseMax(-acceleration.lower);
    const bool hasFastest = fastest.allFinite();
    for (const JointVector& q : detail::samplePoses(configured.setup.limits, kMotorPoses)) {
        calc(q);
        anywhere.add(dynamics.gravity.cwiseAbs(), limits, q);
        if (hasFastest)
            moving.add(dynamics.gravity.cwiseAbs() + dynamics.M.diagonal().cwiseProduct(fastest), limits, q);
    }
    forecast.motors = "of the torque limits: " + formatShare(start, robot) + " to hold the start, " +
                      formatShare(anywhere, robot) + " any pose within the limits";
    if (hasFastest) forecast.motors += ", " + formatShare(moving, robot) + " with a joint at its acceleration limit";

    if (start.share > 1.0)
        forecast.warnings.push_back(
            "the motors cannot hold the start: " + getJoint(robot, start.joint) + " " + formatLoad(start, robot) +
            " in the pose " + formatList(start.q) +
            ". Start with the arm less far out (`start.position_rad`), with a lighter payload, or correct "
            "torque_limit_Nm in actuation.yaml.");
    if (limitsTorque(plan)) return;  // the filter keeps the rest
    if (anywhere.share > 1.0)
        forecast.warnings.push_back(
            "the motors cannot hold every pose within the limits: " + getJoint(robot, anywhere.joint) + " " +
            formatLoad(anywhere, robot) + " in the pose " + formatList(anywhere.q) +
            ". Narrow `limits.position_rad`, or use whole_arm_braking with `torque_share`.");
    else if (moving.share > 1.0 && plan.realPlant) {
        calc(moving.q);
        const int i = moving.joint;
        const double carried = (limits[i] - std::abs(dynamics.gravity[i])) / dynamics.M(i, i);
        forecast.warnings.push_back(
            "the motors cannot carry the limits: " + getJoint(robot, i) + " alone, at its acceleration limit of " +
            format("%.3g rad/s^2, ", fastest[i]) + formatLoad(moving, robot) + " in the pose " + formatList(moving.q) +
            format(". Lower its acceleration_radps2 to %.3g there, or use whole_arm_braking with `torque_share`.",
                   carried));
    }
}

void addGains(const ConfiguredCase& configured, CaseForecast& forecast) {
    const CasePlan& plan = configured.plan;
    if (!configured.margins) return;
    std::string automatic, given;
    for (const char* name : {"k_r", "k_p", "k_i"})
        if (const ConfigNode* value = plan.robustLoop->parameters.resolved().find(name))
            detail::addItem(value->text == "auto" ? automatic : given, name);
    forecast.gains = "robust loop " + plan.robustLoop->plugin.name + ": ";
    if (!automatic.empty()) forecast.gains += automatic + " from the arm's inertia";
    if (!given.empty()) forecast.gains += (automatic.empty() ? "" : ", ") + given + " given";
    const LoopMargins& margins = *configured.margins;
    forecast.gains += automatic.empty() && given.empty() ? "" : "; ";
    forecast.gains += margins.isStable
                          ? "margins " + formatMargins(margins) + ", least at " + getJoint(plan.robot, margins.joint) +
                                (margins.isEnough() ? "" : " (6 dB and 35 degrees would be enough)")
                          : "unstable, as accepted";
}

/** What the robust loop may add to the motors. */
void addPush(const ConfiguredCase& configured, CaseForecast& forecast) {
    const std::optional<detail::AuthoritySizes> sizes = findAuthority(configured);
    if (!sizes) return;
    const CasePlan& plan = configured.plan;
    const detail::Authority authority(configured.setup, *sizes);
    Dynamics dynamics;
    RobotModel(plan.robot).calcDynamics(plan.start.q, plan.start.qd, dynamics);
    forecast.push = "the robust loop adds " + detail::tellPush(plan.robot, authority, dynamics.J) + " at the start";
    if (configured.bound) forecast.push += " (what the disturbance_set asks for)";
}

/** How near the tool can come to a place, as far as damped least squares from many poses find: an upper bound [m]. */
double findNearest(const RobotDescription& robot, const JointLimits& limits, const JointVector& start,
                   const Eigen::Vector3d& place) {
    constexpr double kDamping = 1e-6, kLongestStep_rad = 0.3;
    RobotModel model(robot);
    Dynamics dynamics;
    const JointVector still = JointVector::Zero(robot.size());
    std::vector<JointVector> from = detail::samplePoses(limits, kSearches);
    from.insert(from.begin(), start);
    double nearest = kInfinity;
    for (JointVector q : from) {
        for (int step = 0; step < kSearchSteps && nearest > kReached_m; ++step) {
            model.calcDynamics(q, still, dynamics);
            const Eigen::Vector3d error = place - dynamics.tool.position;
            nearest = std::min(nearest, error.norm());
            const Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxJoints> J = dynamics.J.topRows<3>();
            const Eigen::Matrix3d square =
                J * J.transpose() + (kDamping + 0.01 * error.squaredNorm()) * Eigen::Matrix3d::Identity();
            JointVector move = JointVector::Zero(robot.size());
            move.noalias() += J.transpose() * square.llt().solve(error);
            const double largest = move.lpNorm<Eigen::Infinity>();
            if (largest > kLongestStep_rad) move *= kLongestStep_rad / largest;
            q = (q + move).cwiseMax(limits.position.lower).cwiseMin(limits.position.upper);
        }
    }
    return nearest;
}

void addCommand(const ConfiguredCase& configured, CaseForecast& forecast) {
    const CasePlan& plan = configured.plan;
    const PluginKind kind = PluginKind::CommandSource;
    PluginWatch* const watch = configured.plugins.watches[static_cast<std::size_t>(kind)];
    CommandSource& source = *configured.plugins.command;
    const ConfigNode* relative = plan.controller.parameters.resolved().find("relative");
    if (source.traits().space != MotionCommand::Space::Tool || (relative && relative->text == "true")) return;
    if (auto* const rehearsed = dynamic_cast<RehearsedCommand*>(&source)) rehearsed->beginRehearsal();
    resetPlugin(source, kind, watch, plan.start);
    MotionCommand command;
    if (detail::tryTick(kind, watch, "sample", [&] { return source.sample(0.0, command); }) != TickStatus::Ok)
        return;  // a device that is silent until the run
    const Pose& tool = configured.setup.startTool;
    if (!command.tool.position.allFinite() || !(command.tool.orientation.norm() > 0.5)) return;
    const double distance = (command.tool.position - tool.position).norm();
    const double angle = command.tool.orientation.normalized().angularDistance(tool.orientation);
    if (distance <= kFar_m && angle <= kFarAngle_rad) return;
    const double nearest = findNearest(plan.robot, configured.setup.limits, plan.start.q, command.tool.position);
    constexpr char kRemedy[] =
        ". Move the command or `start.position_rad`, or follow its motion alone with tool_servo and `relative: true`.";
    const std::string far =
        format("the command starts %.3g m and %.0f degrees from the tool", distance, angle / kDegree);
    forecast.warnings.push_back(
        (nearest > kReached_m ? far + format(", out of its reach: the nearest place found within the position limits "
                                             "is %.3g m from there",
                                             nearest)
                              : far + ": the arm goes there first, as fast as the limits allow") +
        kRemedy);
}

void addNominalLoop(const ConfiguredCase& configured, CaseForecast& forecast) {
    const auto swing = detail::findNominalSwing(configured);
    if (!swing) return;
    const CasePlan& plan = configured.plan;
    forecast.warnings.push_back(
        "the controller " + plan.controller.plugin.name + " and the filter " + plan.filterName() +
        " do not bring the nominal arm to rest at the start: after 5 mrad " + getJoint(plan.robot, swing->joint) +
        format(" goes on swinging (feedback there: %.3g 1/s^2 and %.3g 1/s", swing->stiffness, swing->damping) +
        (swing->needsJerk
             ? format("; its jerk limit of %.3g rad/s^3 is too small for that). Less stiffness, more damping, a higher "
                      "jerk limit, or tool_servo or joint_servo, which know it.",
                      swing->jerk)
             : format(" at a tick of %g s). Damping of about 2 sqrt(stiffness) that is well below 1 / tick_s, "
                      "less stiffness, or a shorter tick.",
                      plan.tick_s)));
}

/** Where the filter keeps clearances configureCase() has refused such a start. */
void addClearances(const ConfiguredCase& configured, CaseForecast& forecast) {
    const CasePlan& plan = configured.plan;
    if (!plan.environment) return;
    const auto getLink = [&](int capsule) {
        const LinkCapsule& of = plan.geometry->capsules[capsule];
        return plan.geometry->links[of.link];
    };
    ArmClearances clearances(plan.robot, *plan.geometry);
    std::map<std::pair<std::string, std::string>, double> least;
    const double required = plan.environment->safetyDistance_m;
    for (const ArmClearances::Item& item :
         clearances.find(plan.start.q, configured.surroundings.get(), 0.0, required)) {
        const std::string other = item.otherCapsule < 0 ? "an obstacle" : getLink(item.otherCapsule);
        const auto entry = least.try_emplace({getLink(item.capsule), other}, item.distance).first;
        entry->second = std::min(entry->second, item.distance);
    }
    if (least.empty()) return;
    std::vector<std::pair<double, std::string>> found;
    for (const auto& [who, distance] : least)
        found.emplace_back(distance, who.first + " to " + who.second +
                                         format(distance < 0.0 ? " %.3g m deep" : " %.3g m", std::abs(distance)));
    std::sort(found.begin(), found.end());
    std::string list;
    for (const auto& [distance, entry] : found) detail::addItem(list, entry);
    forecast.warnings.push_back(
        "the arm starts nearer than safety_distance_m, " + detail::formatNumber(required) + " m: " + list +
        ". Change `start.position_rad`, move the obstacle, or correct capsules and `may_touch` in collision.yaml.");
}

void addPeople(const ConfiguredCase& configured, CaseForecast& forecast) {
    const std::optional<Environment>& environment = configured.plan.environment;
    if (!environment || environment->people.empty()) return;
    for (const Person& person : environment->people) {
        const std::string touch =
            person.contactSpeed <= 0.0 ? std::string("what can touch it must rest first")
            : person.bodyPart          ? format("contact (%s) at %.3g m/s at most",
                                                bodyPartNames()[static_cast<std::size_t>(*person.bodyPart)], person.contactSpeed)
                                       : format("contact at %.3g m/s at most", person.contactSpeed);
        forecast.people.push_back(format("%s: at most %.3g m/s, seen at most %.3g s late and %.3g m off, ", person.name,
                                         person.maxSpeed, person.latency_s, person.error_m) +
                                  touch);
    }
}

/** What is guaranteed of the limits of the whole arm, and whether the start keeps them. */
void addLimits(const ConfiguredCase& configured, CaseForecast& forecast) {
    const CasePlan& plan = configured.plan;
    const LimitScene scene = makeScene(plan);
    const LimitSet limits = findLimits(plan), guarantees = configured.plugins.filter->traits().guarantees;
    for (const LimitKind kind : listArmLimits()) {
        if (!limits.has(kind)) continue;
        const LimitRow& row = getLimitRow(kind);
        detail::addItem(forecast.limits, row.label + (guarantees.has(kind) ? " guaranteed" : " not guaranteed"));
        if (row.watchesPeople) forecast.keepsApart &= guarantees.has(kind);
        if (row.isSlow) continue;                                        // addClearances() looks at the one that is
        const std::unique_ptr<ArmLimit> limit = makeLimit(kind, scene);  // the names in its sample live as long as it
        const double none = row.lessIsWorse ? kInfinity : 0.0;
        const LimitSample start = limit->sample({plan.start.q, plan.start.qd, 0.0, false, none});
        if (!start.isBroken) continue;
        ArmLimitRecord record;
        record.worst = start.value;
        record.part = start.part;
        record.other = start.other;
        record.otherLink = start.otherLink;
        record.brokenTicks = 1;
        record.firstBroken_s = 0.0;
        forecast.warnings.push_back("at the start " + row.broken + ": " + tell(kind, &LimitRow::tellWorst, record) +
                                    ". Change `start`, or what the limit hangs on.");
    }
}

}  // namespace

CaseForecast forecastCase(const ConfiguredCase& configured) {
    CaseForecast forecast;
    forecast.warnings = detail::findUnlikelyValues(configured.plan);
    addGains(configured, forecast);
    addPush(configured, forecast);
    addMotors(configured, forecast);
    addPeople(configured, forecast);
    addLimits(configured, forecast);
    addClearances(configured, forecast);
    addCommand(configured, forecast);
    addNominalLoop(configured, forecast);
    return forecast;
}

std::optional<detail::AuthoritySizes> findAuthority(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    if (!plan.robustLoop || plan.robustLoop->host.acceptsUnstable || plan.robustLoop->plugin.name == "none") return {};
    const std::optional<LinearErrorLoop> law = configured.plugins.robustLoop->traits().errorLoop;
    return detail::calcAuthority(configured.setup, law ? &*law : nullptr,
                                 configured.bound ? &*configured.bound : nullptr);
}

}  // namespace viable
