#include "experiment/CaseRun.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <string_view>
#include <thread>

#include "core/Text.h"
#include "environment/OccupancyMap.h"
#include "filter/FilterChain.h"
#include "log/LogMetadata.h"
#include "log/Recorder.h"
#include "robot/ArmRecursion.h"
#include "summary/CollisionCounter.h"
#include "viable/braking/Braking.h"

namespace viable {

namespace {

/** Ticks between two looks at the clock for the progress display. */
constexpr std::int64_t kProgressTicks = 256;
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

std::string formatTime(double seconds) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4f s", seconds);
    return text;
}

LogOpening makeOpening(const ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    LogOpening opening;
    opening.layout = {plan.robot.jointNames(), configured.plugins.command->space(), plan.realPlant.has_value(),
                      plan.feedsExternalTorque, plan.environment.has_value()};
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
        metadata.links = plan.geometry->links;
        if (const OccupancyMap* map = surroundings->map()) metadata.mapSha256 = map->sha256();
    }
    for (const PluginChoice* choice : plan.plugins())
        metadata.libraries[getName(choice->plugin.kind)].push_back(choice->plugin.library.string());
    opening.metadata = writeLogMetadata(std::move(metadata));
    opening.attachments.push_back({"experiment.yaml", "application/yaml", writeConfig(plan.resolved)});
    return opening;
}

/** The poses of the tool, which the records of a run do not have of the real arm. */
std::function<Pose(const JointVector&)> makeToolCalculator(const RobotDescription& robot) {
    struct Arm {
        explicit Arm(const RobotDescription& r) : recursion(r), parent(r.toolParent), placement(r.toolPlacement) {}
        const ArmRecursion recursion;
        ArmRecursion::Frames frames;
        const int parent;
        const Eigen::Isometry3d placement;
    };
    const auto arm = std::make_shared<Arm>(robot);
    return [arm](const JointVector& q) {
        arm->recursion.calcFrames(q, arm->frames);
        Eigen::Isometry3d pose = arm->placement;
        if (arm->parent >= 0) {
            const auto at = static_cast<std::size_t>(arm->parent);
            pose.linear() = arm->frames.rotation[at] * arm->placement.linear();
            pose.translation() = arm->frames.origin[at] + arm->frames.rotation[at] * arm->placement.translation();
        }
        return Pose{pose.translation(), Eigen::Quaterniond(pose.linear())};
    };
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

bool isMissed(const std::vector<TickGap>& gaps, std::int64_t tick) {
    return std::any_of(gaps.begin(), gaps.end(),
                       [&](const TickGap& gap) { return tick >= gap.begin && tick - gap.begin < gap.count; });
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
    result.controller = plan.controller.plugin.name;
    result.filter = plan.filterName();
    for (const auto& [key, block] : plan.resolved.entries)
        if (key != "cases") result.others[key] = writeConfig(block);
    if (plan.realPlant) {
        result.robustLoop = plan.robustLoop->plugin.name;
        result.realPlant = plan.realPlant->plugin.name;
    }
    const ConfigNode* relative = plan.controller.parameters.resolved().find("relative");
    result.isRelative = relative && relative->text == "true";
    result.margins = configured.margins;
    result.guarantees = configured.plugins.filter->guaranteesLimits();
    result.guaranteesClearance = configured.plugins.filter->guaranteesClearance();
    result.holdsOnReal = plan.holdsOnReal;
    for (const PluginChoice* choice : plan.plugins())
        if (const ConfigNode* seed = choice->parameters.resolved().find("seed"))
            result.seeds[choice->plugin.name] = seed->text;
    if (plan.stream) result.seeds["stream"] = plan.stream->resolved().find("seed")->text;
    return result;
}

CaseResult runCase(std::unique_ptr<ConfiguredCase> configured, const RunOptions& options) {
    const CasePlan& plan = configured->plan;
    CaseResult result = makeResult(*configured);
    result.log = options.log;
    LogOpening opening;
    if (!options.log.empty()) opening = makeOpening(*configured);
    auto ownLoop = std::make_unique<ControlLoop>(
        configured->setup, std::move(configured->plugins),
        RealArmOptions{configured->bound ? &*configured->bound : nullptr, plan.feedsExternalTorque, true,
                       plan.holdsOnReal, plan.robustLoop && !plan.robustLoop->acceptsUnstable, configured->motorRate,
                       configured->robustRate});
    ControlLoop& loop = *ownLoop;
    std::optional<detail::CollisionCounter> collisions;
    if (plan.environment) collisions.emplace(plan.robot, *plan.geometry, *plan.environment, plan.realPlant.has_value());
    std::unique_ptr<Recorder> recorder;
    if (!options.log.empty())
        recorder =
            std::make_unique<Recorder>(std::make_unique<LogWriter>(options.log, std::move(opening), options.logForm));

    const std::int64_t ticks = std::llround(plan.duration_s / plan.tick_s);
    const auto begin = std::chrono::steady_clock::now();
    const double memory_MB = readMemory_MB();
    double recordTime_us = 0.0;
    TickRecord record;
    // After a lost tracking the real arm may need longer than the nominal one.
    std::int64_t settling = std::llround(kSettling_s / plan.tick_s);
    const auto hasEnded = [&] {
        if (!loop.hasStopped()) return false;
        const bool isLost = result.summary.trip() || loop.stopReason() == StopReason::NotFollowing;
        return loop.hasFailed() || !isLost || settling-- <= 0;
    };
    // A stop that has begun is led to its end, even beyond the duration; but an arm that has diverged may never come to it.
    std::int64_t brakingTicks = 0;
    std::int64_t mostBraking = std::numeric_limits<std::int64_t>::max();
    for (std::int64_t k = 0; (k < ticks || loop.isStopping()) && !hasEnded() && brakingTicks < mostBraking; ++k) {
        if (loop.isStopping() && !loop.hasStopped() && brakingTicks++ == 0)
            mostBraking = calcMostBraking(record.limits, record.nominal.qd, plan.tick_s);
        if (options.stopRequest && options.stopRequest->load(std::memory_order_relaxed) != 0)
            loop.requestStop(StopReason::Requested, "the user asked for it");
        if (isMissed(plan.missedTicks, k))
            loop.missTick(record);
        else
            loop.tick(record);
        record.stage_us[static_cast<int>(Stage::Record)] = recordTime_us;
        result.summary.add(record);
        if (collisions) collisions->add(record);
        if (recorder) {
            // Simulated time can wait for the disk. The time of the hand-over itself goes into the
            // next row.
            auto before = std::chrono::steady_clock::now();
            while (!recorder->append(record)) {
                std::this_thread::yield();
                before = std::chrono::steady_clock::now();
            }
            recordTime_us =
                std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - before).count();
        }
        if (options.progress && k % kProgressTicks == 0)
            options.progress(std::min(1.0, static_cast<double>(k) / static_cast<double>(ticks)));
    }
    const double grown_MB = readMemory_MB() - memory_MB;
    result.summary.addEnd(loop.nominal(), loop.time());
    if (collisions) {
        collisions->addEnd(loop.nominal(), loop.time());
        result.summary.setCollisions(collisions->collisions());
    }
    if (options.progress) options.progress(1.0);
    result.simulated_s = loop.time();
    if (recorder) {
        const LogStatus status = recorder->finish();
        result.logRows = static_cast<std::int64_t>(status.rows);
        result.logError = status.error;
    }
    result.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();

    result.stopReason = loop.stopReason();
    result.stopTime_s = loop.stopTime();
    const std::string when = "stopped at " + formatTime(result.stopTime_s) + " (tick " +
                             std::to_string(std::llround(result.stopTime_s / plan.tick_s)) + ")";
    if (result.stopReason == StopReason::Requested || result.stopReason == StopReason::TicksMissed ||
        result.stopReason == StopReason::TrackingLost || result.stopReason == StopReason::NotFollowing) {
        result.stopMessage = when + " because " + loop.stopMessage();
        result.stopRemedy = loop.stopRemedy();
        if (result.stopReason == StopReason::TicksMissed)
            result.stopRemedy = "Lower the `count` in missed_ticks, or leave a tick between entries.";
    } else if (const PluginChoice* culprit = findCulprit(plan, configured->chain, result.stopReason)) {
        constexpr std::string_view kSubject = "it ";  // as every message begins
        std::string what = loop.stopMessage();
        result.stopRemedy = loop.stopRemedy();
        if (isOthersGuarantee(configured->chain, result.stopReason)) {
            what = "it changed what '" + plan.filters[configured->chain->guaranteeing()].plugin.name +
                   "' before it had decided, which " + what.substr(kSubject.size());
            result.stopRemedy = "The decision was not applied. Put the filter before the one that guarantees.";
        }
        result.stopMessage = when + ": " + PluginWatch(culprit->plugin).title +
                             (result.stopReason == StopReason::FilterEnded ? " ended the case: " : " failed: ") + what;
    }
    if (brakingTicks >= mostBraking && !loop.hasStopped())
        result.stopMessage += "; it was still braking after " +
                              formatTime(static_cast<double>(brakingTicks) * plan.tick_s) +
                              ", which is no stop any more, and the run ended";
    ownLoop.reset();  // some plugins have a last word
    for (const auto& watch : configured->watches) {
        if (!watch->sharedChange.empty()) result.warnings.push_back(formatSharedChange(*watch));
        if (!watch->lastWords.empty())
            result.warnings.push_back(watch->title + " failed while it was destroyed: " + watch->lastWords);
        if (watch->allocatingTicks == 0) continue;
        result.warnings.push_back(
            watch->title + " takes memory from the heap in its tick (in " + std::to_string(watch->allocatingTicks) +
            " ticks, first in tick " + std::to_string(watch->firstAllocation) +
            "): in a real-time loop such a tick may come too late. Take the memory in configure()." +
            (options.isAlone && grown_MB > kMostGrowth_MB
                 ? " The program grew by " + std::to_string(std::llround(grown_MB)) +
                       " MB in this case's ticks: memory that is taken in each must be given back, too."
                 : ""));
    }
    return result;
}

}  // namespace viable
