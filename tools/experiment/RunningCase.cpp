#include "experiment/RunningCase.h"
#include "experiment/UnlikelyValues.h"

#include <unistd.h>

#include <fstream>

#include "core/Text.h"
#include "environment/OccupancyMap.h"
#include "filter/FilterChain.h"
#include "host/PythonClass.h"
#include "host/WatchedLimit.h"
#include "log/LogMetadata.h"
#include "robot/ArmRecursion.h"
#include "tracking/ToolReference.h"
#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** Growth in a case's ticks from which on it is told. */
constexpr double kMostGrowth_MB = 50.0;

/** What this process has in memory; 0 where the system does not tell. */
double readMemory_MB() {
    std::ifstream file("/proc/self/statm");
    double total = 0.0, resident = 0.0;
    file >> total >> resident;
    return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) * 1e-6;
}

/** The plugin that ended the run; null: none did. */
const PluginChoice* findCulprit(const CasePlan& plan, const FilterChain* chain, StopReason reason) {
    switch (reason) {
        case StopReason::CommandFailed:
            return &plan.command;
        case StopReason::ControllerFailed:
            return &plan.controller;
        case StopReason::FilterFailed:
        case StopReason::FilterEnded:
        case StopReason::GuaranteeBroken:
            return &plan.filters[chain ? chain->answerable() : 0];
        case StopReason::RobustLoopFailed:
            return &*plan.robustLoop;
        case StopReason::PlantFailed:
        case StopReason::SensorFailed:
            return &*plan.realPlant;
        case StopReason::None:
        case StopReason::Requested:
        case StopReason::TicksMissed:
        case StopReason::TrackingLost:
        case StopReason::NotFollowing:
            return nullptr;
    }
    return nullptr;
}

/** True when the guarantee that was broken is that of a filter before the one that is to be named. */
bool isOthersGuarantee(const FilterChain* chain, StopReason reason) {
    return reason == StopReason::GuaranteeBroken && chain &&
           chain->answerable() != static_cast<std::size_t>(chain->guaranteeing());
}

LogLayout makeLayout(const ConfiguredCase& configured, bool isLive) {
    const CasePlan& plan = configured.plan;
    return {plan.robot.jointNames(),
            configured.plugins.command->traits().space,
            plan.realPlant.has_value(),
            plan.feedsExternalTorque,
            findLimits(plan),
            isLive,
            configured.plugins.realPlant && configured.plugins.realPlant->contact(),
            plan.robustLoop && plan.robustLoop->host.contactForce > 0.0};
}

LogOpening makeOpening(const ConfiguredCase& configured, const LogLayout& layout, const CaseLog& log) {
    const CasePlan& plan = configured.plan;
    LogOpening opening;
    opening.layout = layout;
    LogMetadata metadata;
    metadata.caseName = plan.name;
    metadata.version = VIABLE_VERSION;
    metadata.robot = std::filesystem::absolute(plan.robot.folder).lexically_normal().string();
    for (const JointDescription& joint : plan.robot.joints)
        if (joint.type == JointType::Prismatic) metadata.prismaticJoints.push_back(joint.name);
    if (plan.holdsOnReal) metadata.realLimits = plan.limits;
    if (configured.bound)
        metadata.bound = {configured.bound->position, configured.bound->velocity, configured.bound->measured};
    if (const Surroundings* surroundings = configured.surroundings.get()) {
        metadata.obstacles.emplace();
        for (int i = 0; i < surroundings->size(); ++i) metadata.obstacles->push_back(surroundings->name(i));
        metadata.obstacles->insert(metadata.obstacles->end(), log.moreObstacles.begin(), log.moreObstacles.end());
        if (const OccupancyMap* map = surroundings->map()) metadata.mapSha256 = map->sha256();
    }
    if (plan.geometry) metadata.links = plan.geometry->links;
    if (configured.people) {
        metadata.people.emplace();
        for (const Person& person : configured.people->people()) metadata.people->push_back(person.name);
    }
    for (const PluginChoice* choice : plan.plugins())
        metadata.libraries[getName(choice->plugin.kind)].push_back(choice->plugin.library.string());
    opening.metadata = writeLogMetadata(std::move(metadata));
    opening.attachments.push_back({"experiment.yaml", "application/yaml", writeConfig(plan.resolved)});
    return opening;
}

/** Joints that are faster have diverged [rad/s, m/s]. */
constexpr double kFastest = 20.0;

/** Ticks that a stop may take: twice that of an arm at its velocity limits, or at `qd`, and 10 s at least. */
std::int64_t calcMostBraking(const JointLimits& limits, const JointVector& qd, double tick_s) {
    double longest_s = std::max(5.0, calcLongestStop(limits));
    for (int i = 0; i < limits.size(); ++i) {
        const double stop_s =
            calcStationaryStop(std::clamp(qd[i], -kFastest, kFastest), 0.0, limits.axis(i)).duration();
        if (std::isfinite(stop_s)) longest_s = std::max(longest_s, stop_s);
    }
    return std::llround(std::min(2.0 * longest_s / tick_s, 1e12));
}

/** The limits that nobody gave: neither the robot's maker nor the experiment. */
LimitSet findAssumedLimits(const CasePlan& plan) {
    LimitSet found;
    const std::vector<std::string>& assumed = plan.robot.assumed;
    const auto add = [&](LimitKind kind, const char* key, const JointBounds& own, const JointBounds& used) {
        if (own.lower == used.lower && own.upper == used.upper &&
            std::find(assumed.begin(), assumed.end(), key) != assumed.end())
            found.set(kind);
    };
    const JointLimits &own = plan.robot.limits, &used = plan.limits;
    add(LimitKind::Position, "position_rad", own.position, used.position);
    add(LimitKind::Velocity, "velocity_radps", own.velocity, used.velocity);
    add(LimitKind::Acceleration, "acceleration_radps2", own.acceleration, used.acceleration);
    add(LimitKind::Jerk, "jerk_radps3", own.jerk, used.jerk);
    add(LimitKind::Torque, "torque_limit_Nm", own.jerk, own.jerk);
    return found;
}

}  // namespace

CaseResult makeResult(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    CaseResult result(
        Summary(plan.robot.jointNames(), configured.setup.limits, plan.realPlant.has_value(),
                {plan.holdsOnReal ? std::optional(plan.limits) : std::nullopt, configured.bound,
                 plan.robot.actuation.torqueLimit, makeToolCalculator(plan.robot), configured.motorRate}));
    std::vector<bool> slides;
    for (int i = 0; i < plan.robot.size(); ++i) slides.push_back(plan.robot.slides(i));
    result.summary.setSliding(std::move(slides));
    result.name = plan.name;
    result.assumed = plan.robot.assumed;
    result.assumedLimits = findAssumedLimits(plan);
    if (configured.plugins.command->traits().space == MotionCommand::Space::Tool) {
        const ToolFreedom freedom(plan.robot, configured.setup.limits);
        const ConfigNode* relative = plan.controller.parameters.resolved().find("relative");
        result.summary.setTask({freedom.place, freedom.all == 6, relative && relative->text == "true"});
        result.tool = freedom.describe();
    }
    result.controller = plan.controller.plugin.name;
    result.filter = plan.filterName();
    for (const auto& [key, block] : plan.resolved.entries)
        if (key != "cases") result.others[key] = writeConfig(block);
    if (plan.realPlant) {
        result.robustLoop = plan.robustLoop->plugin.name;
        result.realPlant = plan.realPlant->plugin.name;
    }
    result.margins = configured.margins;
    result.warnings = detail::findUnlikelyValues(plan);
    result.guarantees = configured.plugins.filter->traits().guarantees;
    if (plan.geometry) result.links = plan.geometry->links;
    if (plan.environment) {
        result.obstacles = plan.environment->obstacleNames();
        result.summary.setSafetyDistance(plan.environment->safetyDistance_m);
    }
    result.holdsOnReal = plan.holdsOnReal;
    for (const PluginChoice* choice : plan.plugins())
        if (const ConfigNode* seed = choice->parameters.resolved().find("seed"))
            result.seeds[choice->plugin.name] = seed->text;
    if (plan.stream) result.seeds["stream"] = plan.stream->resolved().find("seed")->text;
    return result;
}

std::function<Pose(const JointVector&)> makeToolCalculator(const RobotDescription& robot) {
    return [recursion = std::make_shared<const ArmRecursion>(robot), parent = robot.toolParent,
            placement = robot.toolPlacement](const JointVector& q) {
        ArmRecursion::Frames frames;
        recursion->calcFrames(q, frames);
        Eigen::Isometry3d pose = placement;
        if (parent >= 0) {
            pose.linear() = frames.rotation[parent] * placement.linear();
            pose.translation() = frames.origin[parent] + frames.rotation[parent] * placement.translation();
        }
        return Pose{pose.translation(), Eigen::Quaterniond(pose.linear())};
    };
}

RunningCase::RunningCase(std::unique_ptr<ConfiguredCase> configured, const CaseLog& log, bool judgesSlowly)
    : configured_(std::move(configured)),
      result_(makeResult(*configured_)),
      layout_(makeLayout(*configured_, log.isLive)),
      settling_(std::llround(kSettling_s / configured_->plan.tick_s)),
      begin_(std::chrono::steady_clock::now()) {
    const CasePlan& plan = configured_->plan;
    result_.log = log.file;
    if (layout_.hasContact) result_.summary.watchContact();
    if (layout_.hasTouch) result_.summary.watchTouch(plan.robustLoop->host.contactForce);
    result_.obstacles.insert(result_.obstacles.end(), log.moreObstacles.begin(), log.moreObstacles.end());
    LogOpening opening;
    if (!log.file.empty()) opening = makeOpening(*configured_, layout_, log);
    loop_ = std::make_unique<ControlLoop>(
        configured_->setup, std::move(configured_->plugins),
        RealArmOptions{configured_->bound ? &*configured_->bound : nullptr, plan.feedsExternalTorque, true,
                       plan.holdsOnReal, plan.robustLoop && !plan.robustLoop->host.acceptsUnstable,
                       configured_->motorRate, configured_->robustRate,
                       !plan.robustLoop || !plan.robustLoop->host.acceptsUnstable,
                       plan.robustLoop ? plan.robustLoop->host.contactForce : 0.0});
    const LimitScene scene = makeScene(plan);
    for (const LimitKind kind : listArmLimits()) {
        const LimitRow& row = getLimitRow(kind);
        if (layout_.limits.has(kind) && (judgesSlowly || !row.isSlow))
            counters_.emplace_back(kind, makeLimit(kind, scene), plan.realPlant.has_value());
    }
    if (!log.file.empty())
        recorder_ = std::make_unique<Recorder>(
            std::make_unique<LogSeries>(log.file, std::move(opening), log.limit_bytes), log.capacity);
    begin_ = std::chrono::steady_clock::now();
    memory_MB_ = readMemory_MB();
}

void RunningCase::showPeople() {
    if (!configured_->people) return;
    observeWalks(configured_->people->people(), loop_->time(), seen_);
    configured_->people->put(seen_);
}

bool RunningCase::isStopOver() {
    showPeople();
    if (loop_->hasStopped()) {
        const bool isLost = result_.summary.trip() || loop_->stopReason() == StopReason::NotFollowing;
        if (loop_->hasFailed() || !isLost || settling_-- <= 0) return true;
    }
    if (brakingTicks_ >= mostBraking_) return true;
    if (loop_->isStopping() && !loop_->hasStopped() && brakingTicks_++ == 0)
        mostBraking_ = calcMostBraking(record_.limits, record_.nominal.qd, plan().tick_s);
    return false;
}

void RunningCase::count() {
    result_.summary.add(record_);
    for (detail::LimitCounter& counter : counters_) counter.add(record_);
}

CaseResult RunningCase::finish(bool isAlone) {
    loop_->releasePlant();  // a robot must not wait for the rest
    const double grown_MB = readMemory_MB() - memory_MB_;
    result_.summary.addEnd(loop_->nominal(), loop_->time());
    for (detail::LimitCounter& counter : counters_) {
        counter.addEnd(loop_->nominal(), loop_->time());
        result_.summary.addAccount(counter.account());
    }
    result_.simulated_s = loop_->time();
    result_.stopReason = loop_->stopReason();
    result_.stopTime_s = loop_->stopTime();
    const std::string when = "stopped at " + detail::format("%.4f s", result_.stopTime_s) + " (tick " +
                             std::to_string(std::llround(result_.stopTime_s / plan().tick_s)) + ")";
    if (result_.stopReason == StopReason::Requested || result_.stopReason == StopReason::TicksMissed ||
        result_.stopReason == StopReason::TrackingLost || result_.stopReason == StopReason::NotFollowing) {
        result_.stopMessage = when + " because " + loop_->stopMessage();
        result_.stopRemedy = loop_->stopRemedy();
        if (result_.stopReason == StopReason::TicksMissed)
            result_.stopRemedy =
                plan().missedTicks.empty()
                    ? "See what kept this program or its plant for so long; `viable doctor` shows what "
                      "the machine lacks."
                    : "Lower the `count` in missed_ticks, or leave a tick between entries.";
    } else if (const PluginChoice* culprit = findCulprit(plan(), configured_->chain, result_.stopReason)) {
        constexpr std::string_view kSubject = "it ";  // as every message begins
        std::string what = loop_->stopMessage();
        result_.stopRemedy = loop_->stopRemedy();
        if (isOthersGuarantee(configured_->chain, result_.stopReason)) {
            what = "it changed what '" + plan().filters[configured_->chain->guaranteeing()].plugin.name +
                   "' before it had decided, which " + what.substr(kSubject.size());
            result_.stopRemedy = "The decision was not applied. Put the filter before the one that guarantees.";
        }
        result_.stopMessage = when + ": " + PluginWatch(culprit->plugin).title +
                              (result_.stopReason == StopReason::FilterEnded ? " ended the case: " : " failed: ") +
                              what;
    }
    if (brakingTicks_ >= mostBraking_ && !loop_->hasStopped())
        result_.stopMessage += "; it was still braking after " +
                               detail::format("%.4f s", static_cast<double>(brakingTicks_) * plan().tick_s) +
                               ", which is no stop any more, and the run ended";
    loop_.reset();  // some plugins have a last word
    if (recorder_) {
        const LogStatus status = recorder_->finish();
        result_.logRows = static_cast<std::int64_t>(status.rows);
        result_.logError = status.error;
    }
    result_.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    const auto isOfPython = [&](const PluginWatch& watch) {  // Python cannot do without
        const auto plugins = plan().plugins();
        return std::any_of(plugins.begin(), plugins.end(), [&](const PluginChoice* choice) {
            return isPython(choice->plugin) && PluginWatch(choice->plugin).title == watch.title;
        });
    };
    for (const auto& watch : configured_->watches) {
        if (!watch->sharedChange.empty()) result_.warnings.push_back(formatSharedChange(*watch));
        if (!watch->lastWords.empty())
            result_.warnings.push_back(watch->title + " failed while it was destroyed: " + watch->lastWords);
        if (watch->allocatingTicks == 0 || isOfPython(*watch)) continue;
        result_.warnings.push_back(
            watch->title + " takes memory from the heap in its tick (in " + std::to_string(watch->allocatingTicks) +
            " ticks, first in tick " + std::to_string(watch->firstAllocation) +
            "): in a real-time loop such a tick may come too late. Take the memory in configure()." +
            (isAlone && grown_MB > kMostGrowth_MB
                 ? " The program grew by " + std::to_string(std::llround(grown_MB)) +
                       " MB in this case's ticks: memory that is taken in each must be given back, too."
                 : ""));
    }
    return std::move(result_);
}

}  // namespace viable
