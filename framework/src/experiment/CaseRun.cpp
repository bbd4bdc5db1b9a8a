#include "viable/experiment/CaseRun.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <thread>

#include "PathExtent.h"
#include "core/NumberText.h"
#include "log/LogExportColumns.h"
#include "viable/core/Error.h"
#include "viable/log/Recorder.h"
#include "viable/motion/Braking.h"

namespace viable {

namespace {

/** Ticks between two looks at the clock for the progress display. */
constexpr std::int64_t kProgressTicks = 256;

template <class Interface>
PluginPtr<Interface> makePlugin(const PluginChoice& choice, const RunSetup& setup) {
    PluginPtr<Interface> plugin = PluginLoader::create<Interface>(choice.plugin);
    const std::string who = std::string(getName(choice.plugin.kind)) + " plugin '" +
                            choice.plugin.name + "' (" + choice.plugin.library.string() + ")";
    try {
        plugin->configure(setup, choice.parameters);
    } catch (const Error&) {
        throw;
    } catch (const std::exception& e) {
        throw Error(ErrorKind::PluginFailed, who,
                    std::string("threw while it was configured: ") + e.what());
    } catch (...) {
        throw Error(ErrorKind::PluginFailed, who,
                    "threw something that is no std::exception while it was configured");
    }
    return plugin;
}

const PluginChoice* findCulprit(const CasePlan& plan, StopReason reason) {
    switch (reason) {
        case StopReason::CommandFailed:
            return &plan.command;
        case StopReason::ControllerFailed:
            return &plan.controller;
        case StopReason::FilterFailed:
        case StopReason::FilterEnded:
        case StopReason::PromiseBroken:
            return &plan.filter;
        case StopReason::RobustLoopFailed:
            return &*plan.robustLoop;
        case StopReason::PlantFailed:
            return &*plan.realPlant;
        case StopReason::None:
        case StopReason::Requested:
        case StopReason::TicksMissed:
            return nullptr;
    }
    return nullptr;
}

std::string formatTime(double seconds) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4f s", seconds);
    return text;
}

/** All plugins of a case, in the order of the data. */
std::vector<const PluginChoice*> listPlugins(const CasePlan& plan) {
    std::vector<const PluginChoice*> all{&plan.command, &plan.controller, &plan.filter};
    if (plan.robustLoop) all.push_back(&*plan.robustLoop);
    if (plan.realPlant) all.push_back(&*plan.realPlant);
    return all;
}

LogOpening makeOpening(const CasePlan& plan, MotionCommand::Space space) {
    LogOpening opening;
    opening.layout = {plan.robot.jointNames(), space, plan.realPlant.has_value()};
    opening.metadata = {
        {"case", plan.name},
        {"robot", std::filesystem::absolute(plan.robot.folder).lexically_normal().string()},
        {"version", VIABLE_VERSION}};
    nlohmann::json sliding = nlohmann::json::array();
    for (const JointDescription& joint : plan.robot.joints)
        if (joint.type == JointType::Prismatic) sliding.push_back(joint.name);
    if (!sliding.empty()) opening.metadata[detail::kPrismaticJoints] = sliding.dump();
    for (const PluginChoice* choice : listPlugins(plan))
        opening.metadata[getName(choice->plugin.kind)] = choice->plugin.library.string();
    opening.attachments.push_back(
        {"experiment.yaml", "application/yaml", writeConfig(plan.resolved)});
    return opening;
}

bool isMissed(const std::vector<TickGap>& gaps, std::int64_t tick) {
    return std::any_of(gaps.begin(), gaps.end(), [&](const TickGap& gap) {
        return tick >= gap.begin && tick - gap.begin < gap.count;
    });
}

/** A path is followed to this share of what counts as rounding. */
constexpr double kPathResolution = 1.0 / 16.0;

constexpr const char* kRecoveryRemedy =
    "or use the filter certified_braking with `recovery: true`, which leads the arm back.";

/** The key of a quantity in the file's `start`, and what stands there without it. */
struct StartKey {
    const char *key, *otherwise;
};

StartKey getStartKey(LimitKind kind) {
    switch (kind) {
        case LimitKind::Velocity:
            return {"velocity_radps", "0 is taken"};
        case LimitKind::Acceleration:
            return {"acceleration_radps2", "0 is taken"};
        default:
            return {"position_rad", "the robot's home pose is taken"};
    }
}

/** Refuses a start outside a limit. */
void checkStartInside(const CasePlan& plan) {
    const auto check = [&](LimitKind kind, const JointVector& value, const JointBounds& bounds) {
        for (int i = 0; i < plan.robot.size(); ++i) {
            const bool below = value[i] < bounds.lower[i];
            if (!below && value[i] <= bounds.upper[i]) continue;
            const double bound = below ? bounds.lower[i] : bounds.upper[i];
            throw badInput(
                plan.startPlace,
                std::string("the start ") + getName(kind, LimitSide::Neither) + " of " +
                    plan.robot.joints[i].name + " is " + detail::formatNumber(value[i]) + " " +
                    getUnit(kind) + ", outside its " + (below ? "lower" : "upper") + " limit " +
                    detail::formatNumber(bound) + " by " +
                    detail::formatNumber(std::abs(value[i] - bound)),
                std::string("Start inside the limits (`start: {") + getStartKey(kind).key +
                    ": [...]}`; without it " + getStartKey(kind).otherwise +
                    "), widen the limits, " + kRecoveryRemedy);
        }
    };
    check(LimitKind::Position, plan.start.q, plan.limits.position);
    check(LimitKind::Velocity, plan.start.qd, plan.limits.velocity);
    check(LimitKind::Acceleration, plan.start.qdd, plan.limits.acceleration);
}

/** Refuses a start inside the limits whose fastest stop leaves them. */
void checkStartViable(const CasePlan& plan) {
    for (int i = 0; i < plan.robot.size(); ++i) {
        const AxisLimits axis = plan.limits.axis(i);
        if (std::isinf(axis.jerkLower) || std::isinf(axis.jerkUpper)) continue;
        const double v = plan.start.qd[i], a = plan.start.qdd[i];
        const StationaryStop stop = calcStationaryStop(v, a, axis);
        const double allowedP =
            kMonitorShare * calcLimitScale(axis.positionLower, axis.positionUpper);
        const double allowedV =
            kMonitorShare * calcLimitScale(axis.velocityLower, axis.velocityUpper);
        detail::PathExtent path(
            plan.start.q[i], v, a,
            {axis.positionLower, axis.positionUpper, allowedP, kPathResolution * allowedP},
            {axis.velocityLower, axis.velocityUpper, allowedV, kPathResolution * allowedV});
        path.follow(stop.jerk, stop.T1);
        path.follow(0.0, stop.T2);
        path.follow(stop.side == LimitSide::Upper ? axis.jerkUpper : axis.jerkLower, stop.T3);
        const double peak = calcVelocityPeak(v, a, axis);
        const auto check = [&](LimitKind kind, const char* side, double excess, double allowed) {
            if (!(excess > allowed)) return;
            throw badInput(
                plan.startPlace,
                "the start of " + plan.robot.joints[i].name +
                    " is not viable: its fastest stop passes the " + side + " " +
                    getName(kind, LimitSide::Neither) + " limit by " +
                    detail::formatNumber(excess) + " " + getUnit(kind),
                std::string("Change `start`: at rest or further inside; ") + kRecoveryRemedy);
        };
        check(LimitKind::Position, "upper", path.position.upper - axis.positionUpper, allowedP);
        check(LimitKind::Position, "lower", axis.positionLower - path.position.lower, allowedP);
        check(LimitKind::Velocity, "upper", peak - axis.velocityUpper, allowedV);
        check(LimitKind::Velocity, "lower", axis.velocityLower - peak, allowedV);
    }
}

}  // namespace

std::unique_ptr<ConfiguredCase> configureCase(const CasePlan& plan) {
    RunSetup setup{plan.robot, plan.limits, plan.tick_s, plan.duration_s, plan.start, {}};
    {
        RobotModel model(plan.robot);
        Dynamics dynamics;
        model.calcDynamics(plan.start.q, plan.start.qd, dynamics);
        setup.startTool = dynamics.tool;
    }
    auto configured = std::make_unique<ConfiguredCase>(ConfiguredCase{setup, {}});
    LoopPlugins& plugins = configured->plugins;
    plugins.filter = makePlugin<SafetyFilter>(plan.filter, configured->setup);
    if (!plugins.filter->recovers()) {
        checkStartInside(plan);
        checkStartViable(plan);
    }
    plugins.command = makePlugin<CommandSource>(plan.command, configured->setup);
    plugins.controller = makePlugin<NominalController>(plan.controller, configured->setup);
    if (plan.realPlant) {
        plugins.robustLoop = makePlugin<RobustLoop>(*plan.robustLoop, configured->setup);
        plugins.realPlant = makePlugin<RealPlant>(*plan.realPlant, configured->setup);
    }
    if (!plugins.controller->follows(plugins.command->space())) {
        const bool joint = plugins.command->space() == MotionCommand::Space::Joint;
        throw badInput(
            plan.controller.parameters.resolved().place(),
            "the controller " + plan.controller.plugin.name + " cannot follow the command " +
                plan.command.plugin.name + ", which gives " +
                (joint ? "joint positions" : "tool poses"),
            joint ? "Use the controller joint_pd, or a command such as generated_hand_motion."
                  : "Use the controller task_space_pd, or a command such as waypoints.");
    }
    return configured;
}

CaseResult runCase(const CasePlan& plan, const RunOptions& options) {
    const std::unique_ptr<ConfiguredCase> configured = configureCase(plan);
    const bool promises = configured->plugins.filter->promisesLimits();
    const MotionCommand::Space space = configured->plugins.command->space();
    ControlLoop loop(configured->setup, std::move(configured->plugins));

    std::unique_ptr<Recorder> recorder;
    if (!options.log.empty())
        recorder = std::make_unique<Recorder>(
            std::make_unique<LogWriter>(options.log, makeOpening(plan, space)));

    CaseResult result(plan);
    result.promises = promises;
    result.log = options.log;

    const std::int64_t ticks = std::llround(plan.duration_s / plan.tick_s);
    const auto begin = std::chrono::steady_clock::now();
    double recordTime_us = 0.0;
    TickRecord record;
    // A stop that has begun is led to its end, even beyond the duration.
    for (std::int64_t k = 0; (k < ticks || loop.isStopping()) && !loop.hasStopped(); ++k) {
        if (options.stopRequest && options.stopRequest->load(std::memory_order_relaxed) != 0)
            loop.requestStop(StopReason::Requested, "the user asked for it");
        if (isMissed(plan.missedTicks, k))
            loop.missTick(record);
        else
            loop.tick(record);
        record.stage_us[static_cast<int>(Stage::Record)] = recordTime_us;
        result.summary.add(record);
        if (recorder) {
            // Simulated time can wait for the disk. The time of the hand-over itself goes into the
            // next row.
            auto before = std::chrono::steady_clock::now();
            while (!recorder->append(record)) {
                std::this_thread::yield();
                before = std::chrono::steady_clock::now();
            }
            recordTime_us =
                std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - before)
                    .count();
        }
        if (options.progress && k % kProgressTicks == 0)
            options.progress(std::min(1.0, static_cast<double>(k) / static_cast<double>(ticks)));
    }
    result.summary.addEnd(loop.nominal(), loop.time());
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
    if (result.stopReason == StopReason::Requested ||
        result.stopReason == StopReason::TicksMissed) {
        result.stopMessage =
            "stopped at " + formatTime(result.stopTime_s) + " because " + loop.stopMessage();
        if (result.stopReason == StopReason::TicksMissed)
            result.stopRemedy =
                "Lower the `count` in missed_ticks, or leave a tick between entries.";
    } else if (const PluginChoice* culprit = findCulprit(plan, result.stopReason)) {
        result.stopMessage = "stopped at " + formatTime(result.stopTime_s) + ": the " +
                             getName(culprit->plugin.kind) + " plugin '" + culprit->plugin.name +
                             (result.stopReason == StopReason::FilterEnded
                                  ? std::string("' ended the case: ") + loop.stopMessage()
                                  : std::string("' failed: ") + loop.stopMessage() + " (" +
                                        culprit->plugin.library.string() + ")");
    }
    return result;
}

CaseResult::CaseResult(const CasePlan& plan)
    : name(plan.name),
      filter(plan.filter.plugin.name),
      robustLoop(plan.robustLoop ? plan.robustLoop->plugin.name : ""),
      realPlant(plan.realPlant ? plan.realPlant->plugin.name : ""),
      summary(plan.robot.jointNames(), plan.limits, plan.realPlant.has_value()) {
    for (const PluginChoice* choice : listPlugins(plan))
        if (const ConfigNode* seed = choice->parameters.resolved().find("seed"))
            seeds[choice->plugin.name] = seed->text;
}

int CaseResult::exitCode() const {
    if (stopReason == StopReason::PromiseBroken) return static_cast<int>(ErrorKind::PromiseBroken);
    const bool isWanted = stopReason == StopReason::None || stopReason == StopReason::Requested ||
                          stopReason == StopReason::FilterEnded;
    if (!isWanted)
        return static_cast<int>(ErrorKind::PluginFailed);
    if (!logError.empty()) return static_cast<int>(ErrorKind::LogNotWritten);
    return 0;
}

}  // namespace viable
