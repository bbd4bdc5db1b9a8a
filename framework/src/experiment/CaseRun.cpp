#include "viable/experiment/CaseRun.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "viable/core/Error.h"
#include "viable/log/Recorder.h"

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
        case StopReason::PromiseBroken:
            return &plan.filter;
        case StopReason::RobustLoopFailed:
            return &*plan.robustLoop;
        case StopReason::PlantFailed:
            return &*plan.realPlant;
        case StopReason::None:
        case StopReason::Requested:
            return nullptr;
    }
    return nullptr;
}

std::string formatTime(double seconds) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4f s", seconds);
    return text;
}

/** "joint2 broke its jerk limit by ..." for the first limit found broken. */
std::string describeBreach(const Summary& summary) {
    for (LimitKind kind :
         {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk}) {
        const int joint = summary.worstJoint(kind);
        const LimitRecord& record = summary.limit(kind)[joint];
        if (record.ticksOutside == 0) continue;
        const char* names[] = {"", "position", "velocity", "acceleration", "jerk"};
        char text[160];
        std::snprintf(
            text, sizeof text, "it promises all limits, but %s passed its %s limit by %.3g",
            summary.jointNames()[joint].c_str(), names[static_cast<int>(kind)], record.worstExcess);
        return text;
    }
    return {};
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
        {"case", plan.name}, {"robot", plan.robot.folder.string()}, {"version", VIABLE_VERSION}};
    for (const PluginChoice* choice : listPlugins(plan))
        opening.metadata[getName(choice->plugin.kind)] = choice->plugin.library.string();
    opening.attachments.push_back(
        {"experiment.yaml", "application/yaml", writeConfig(plan.resolved)});
    return opening;
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
    plugins.command = makePlugin<CommandSource>(plan.command, configured->setup);
    plugins.controller = makePlugin<NominalController>(plan.controller, configured->setup);
    plugins.filter = makePlugin<SafetyFilter>(plan.filter, configured->setup);
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
        loop.tick(record);
        record.stage_us[static_cast<int>(Stage::Record)] = recordTime_us;
        result.summary.add(record);
        if (promises && !loop.isStopping() && result.summary.anyLimitBroken())
            loop.requestStop(StopReason::PromiseBroken, describeBreach(result.summary).c_str());
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
    if (result.stopReason == StopReason::Requested) {
        result.stopMessage =
            "stopped at " + formatTime(result.stopTime_s) + " because " + loop.stopMessage();
    } else if (const PluginChoice* culprit = findCulprit(plan, result.stopReason)) {
        result.stopMessage = "stopped at " + formatTime(result.stopTime_s) + ": the " +
                             getName(culprit->plugin.kind) + " plugin '" + culprit->plugin.name +
                             "' failed: " + loop.stopMessage() + " (" +
                             culprit->plugin.library.string() + ")";
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
    if (stopReason != StopReason::None && stopReason != StopReason::Requested)
        return static_cast<int>(ErrorKind::PluginFailed);
    if (!logError.empty()) return static_cast<int>(ErrorKind::LogNotWritten);
    return 0;
}

}  // namespace viable
