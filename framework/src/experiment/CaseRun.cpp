#include "experiment/CaseRun.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <thread>

#include "core/NumberText.h"
#include "environment/OccupancyMap.h"
#include "filter/FilterChain.h"
#include "log/LogExportColumns.h"
#include "log/Recorder.h"
#include "loop/PathExtent.h"
#include "robot/ArmReach.h"
#include "summary/CollisionCounter.h"
#include "viable/braking/Braking.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

/** Ticks between two looks at the clock for the progress display. */
constexpr std::int64_t kProgressTicks = 256;

constexpr char kOnConfigure[] =
    "configure() says what is wrong with a parameter by throwing viable::badInput(); anything else is to be mended in "
    "the "
    "plugin.";

// What a plugin is asked once, outside of ticks: asked here first, where a throw still names it.
void askOnce(const CommandSource& plugin) {
    plugin.space();
}
void askOnce(const NominalController& plugin) {
    plugin.follows(MotionCommand::Space::Joint);
    plugin.follows(MotionCommand::Space::Tool);
}
void askOnce(const SafetyFilter& plugin) {
    plugin.guaranteesLimits();
    plugin.guaranteesClearance();
    plugin.recovers();
}
void askOnce(const RobustLoop&) {}
void askOnce(const RealPlant& plugin) {
    plugin.externalTorque();
}

template <class Interface>
PluginPtr<Interface> makeHere(const PluginChoice& choice, const RunSetup& setup, const std::string& title) {
    PluginPtr<Interface> plugin = PluginLoader::create<Interface>(choice.plugin);
    PluginCall call(nullptr, kBeforeFirstTick);
    try {
        plugin->configure(setup, choice.parameters);
        askOnce(*plugin);
    } catch (const Error&) {
        throw;
    } catch (const std::exception& e) {
        throw Error(ErrorKind::PluginFailed, title, std::string("threw while it was configured: ") + e.what(),
                    kOnConfigure);
    } catch (...) {
        throw Error(ErrorKind::PluginFailed, title, "threw something that is no std::exception while it was configured",
                    kOnConfigure);
    }
    if (const char* change = call.undoArithmeticChange())
        throw Error(ErrorKind::PluginFailed, title, formatArithmeticChange(change), kOnArithmeticChange);
    return plugin;
}

/** Makes and configures the plugins of one case, each with its watch. */
class PluginMaker {
public:
    PluginMaker(ConfiguredCase& configured, const Isolation* isolation)
        : configured_(configured), isolation_(isolation) {}

    template <class Interface>
    PluginPtr<Interface> make(const PluginChoice& choice) {
        configured_.watches.push_back(std::make_unique<PluginWatch>(choice.plugin));
        PluginWatch* const watch = configured_.watches.back().get();
        const RunSetup& setup = configured_.setup;
        if (!isolation_) {
            const PluginCall call(watch, kBeforeFirstTick);
            return makeHere<Interface>(choice, setup, watch->title);
        }
        try {
            return isolatePlugin<Interface>([&] { return makeHere<Interface>(choice, setup, watch->title); }, *watch,
                                            isolation_->watchdog_s);
        } catch (const PluginFault& e) {
            throw Error(ErrorKind::PluginFailed, watch->title,
                        std::string("could not be made and configured: ") + e.what(), e.remedy());
        }
    }

    template <class Interface>
    PluginPtr<Interface> makeWatched(const PluginChoice& choice) {
        PluginPtr<Interface> plugin = make<Interface>(choice);
        configured_.plugins.watches[static_cast<std::size_t>(detail::kindOf<Interface>())] =
            configured_.watches.back().get();
        return plugin;
    }

    PluginPtr<SafetyFilter> makeFilters(const std::vector<PluginChoice>& choices) {
        if (choices.size() == 1) return makeWatched<SafetyFilter>(choices.front());
        auto chain = std::make_unique<FilterChain>();
        for (const PluginChoice& choice : choices) {
            PluginPtr<SafetyFilter> filter = make<SafetyFilter>(choice);
            chain->add(std::move(filter), configured_.watches.back().get());
        }
        configured_.chain = chain.get();
        SafetyFilter* const filter = chain.release();
        return {filter, [](void* object) { delete static_cast<SafetyFilter*>(object); }};
    }

private:
    ConfiguredCase& configured_;
    const Isolation* isolation_;
};

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

/** All plugins of a case, in the order of the data. */
std::vector<const PluginChoice*> listPlugins(const CasePlan& plan) {
    std::vector<const PluginChoice*> all{&plan.command, &plan.controller};
    for (const PluginChoice& filter : plan.filters) all.push_back(&filter);
    if (plan.robustLoop) all.push_back(&*plan.robustLoop);
    if (plan.realPlant) all.push_back(&*plan.realPlant);
    return all;
}

/** JSON has no infinity: the file's words stand for it. */
nlohmann::json listNumbers(const JointVector& values) {
    nlohmann::json list = nlohmann::json::array();
    for (const double x : values)
        list.push_back(std::isfinite(x) ? nlohmann::json(x) : nlohmann::json(x > 0.0 ? ".inf" : "-.inf"));
    return list;
}

LogOpening makeOpening(const CasePlan& plan, MotionCommand::Space space, const Surroundings* surroundings) {
    LogOpening opening;
    opening.layout = {plan.robot.jointNames(), space, plan.realPlant.has_value(), plan.feedsExternalTorque,
                      plan.environment.has_value()};
    opening.metadata = {{"case", plan.name},
                        {"robot", std::filesystem::absolute(plan.robot.folder).lexically_normal().string()},
                        {"version", VIABLE_VERSION}};
    nlohmann::json sliding = nlohmann::json::array();
    for (const JointDescription& joint : plan.robot.joints)
        if (joint.type == JointType::Prismatic) sliding.push_back(joint.name);
    if (!sliding.empty()) opening.metadata[detail::kPrismaticJoints] = sliding.dump();
    if (plan.holdsOnReal)
        opening.metadata["real_limits"] =
            nlohmann::json{{"position_lower", listNumbers(plan.realLimits.position.lower)},
                           {"position_upper", listNumbers(plan.realLimits.position.upper)},
                           {"velocity_lower", listNumbers(plan.realLimits.velocity.lower)},
                           {"velocity_upper", listNumbers(plan.realLimits.velocity.upper)}}
                .dump();
    if (plan.bound)
        opening.metadata["tracking_bound"] = nlohmann::json{
            {"position_rad", listNumbers(plan.bound->position)},
            {"velocity_radps", listNumbers(plan.bound->velocity)},
            {"measured_rad",
             listNumbers(plan.bound->measured)}}.dump();
    if (surroundings) {  // what the indices of the channel `clearance` stand for
        nlohmann::json obstacles = nlohmann::json::array();
        for (int i = 0; i < surroundings->size(); ++i) obstacles.push_back(surroundings->name(i));
        opening.metadata["obstacles"] = obstacles.dump();
        opening.metadata["links"] = nlohmann::json(plan.geometry->links).dump();
        if (const OccupancyMap* map = surroundings->map()) opening.metadata["map_sha256"] = map->sha256();
    }
    for (const PluginChoice* choice : listPlugins(plan))
        opening.metadata[getName(choice->plugin.kind)] = choice->plugin.library.string();
    if (plan.filters.size() > 1) {
        nlohmann::json chain = nlohmann::json::array();
        for (const PluginChoice& filter : plan.filters) chain.push_back(filter.plugin.library);
        opening.metadata[getName(PluginKind::SafetyFilter)] = chain.dump();
    }
    opening.attachments.push_back({"experiment.yaml", "application/yaml", writeConfig(plan.resolved)});
    return opening;
}

bool isMissed(const std::vector<TickGap>& gaps, std::int64_t tick) {
    return std::any_of(gaps.begin(), gaps.end(),
                       [&](const TickGap& gap) { return tick >= gap.begin && tick - gap.begin < gap.count; });
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
            throw badInput(plan.startPlace,
                           std::string("the start ") + getName(kind, LimitSide::Neither) + " of " +
                               plan.robot.joints[i].name + " is " + detail::formatNumber(value[i]) + " " +
                               getUnit(kind) + ", outside its " + (below ? "lower" : "upper") + " limit " +
                               detail::formatNumber(bound) + " by " + detail::formatNumber(std::abs(value[i] - bound)),
                           std::string("Start inside the limits (`start: {") + getStartKey(kind).key +
                               ": [...]}`; without it " + getStartKey(kind).otherwise + "), widen the limits, " +
                               kRecoveryRemedy);
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
        const double allowedP = kMonitorShare * calcLimitScale(axis.positionLower, axis.positionUpper);
        const double allowedV = kMonitorShare * calcLimitScale(axis.velocityLower, axis.velocityUpper);
        detail::PathExtent path(plan.start.q[i], v, a,
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
                               getName(kind, LimitSide::Neither) + " limit by " + detail::formatNumber(excess) + " " +
                               getUnit(kind),
                           std::string("Change `start`: at rest or further inside; ") + kRecoveryRemedy);
        };
        check(LimitKind::Position, "upper", path.position.upper - axis.positionUpper, allowedP);
        check(LimitKind::Position, "lower", axis.positionLower - path.position.lower, allowedP);
        check(LimitKind::Velocity, "upper", peak - axis.velocityUpper, allowedV);
        check(LimitKind::Velocity, "lower", axis.velocityLower - peak, allowedV);
    }
}

/** Refuses motors that cannot carry what motion and disturbances ask for in the long run. */
void checkMotors(const CasePlan& plan) {
    if (!plan.bound) return;
    const TrackingBound& bound = *plan.bound;
    for (int i = 0; i < plan.robot.size(); ++i) {
        if (bound.lastingTorque[i] <= bound.motorTorque[i]) continue;
        throw badInput(plan.boundPlace,
                       "the motor of " + plan.robot.joints[static_cast<std::size_t>(i)].name + " gives " +
                           detail::formatNumber(bound.motorTorque[i]) +
                           " Nm; motion within the limits and these disturbances need up to " +
                           detail::formatNumber(bound.lastingTorque[i]) + " Nm, so the real arm cannot follow",
                       "`viable bound` shows what asks for it: state smaller disturbances, or lower the limits of "
                       "acceleration and velocity.");
    }
}

/** A distance field tells distances up to here apart [m]: farther than any arm needs to stop. */
constexpr double kFieldReach_m = 1.0;

void addSurroundings(const CasePlan& plan, ConfiguredCase& configured) {
    if (!plan.environment) return;
    const Eigen::AlignedBox3d reach = calcReach(plan.robot, *plan.geometry, plan.limits);
    if (plan.environment->map && !reach.sizes().allFinite())
        throw badInput(plan.environment->map->place,
                       "the arm has a sliding joint without position limits, so that the part of the map that it can "
                       "reach has no end",
                       "Give the joint position limits.");
    configured.surroundings =
        std::make_shared<const Surroundings>(*plan.environment, reach.min(), reach.max(), kFieldReach_m);
    configured.feed = std::make_unique<SurroundingsFeed>(configured.surroundings);
    configured.setup.surroundings = configured.feed.get();
    configured.setup.geometry = &*plan.geometry;
}

}  // namespace

ConfiguredCase::ConfiguredCase(RunSetup runSetup) : setup(std::move(runSetup)) {}
ConfiguredCase::~ConfiguredCase() {
    destroyPlugins(plugins);
}

std::unique_ptr<ConfiguredCase> configureCase(const CasePlan& plan, const Isolation* isolation) {
    RunSetup setup{plan.robot, plan.limits, plan.tick_s, plan.duration_s, plan.start, {}};
    {
        RobotModel model(plan.robot);
        Dynamics dynamics;
        model.calcDynamics(plan.start.q, plan.start.qd, dynamics);
        setup.startTool = dynamics.tool;
    }
    auto configured = std::make_unique<ConfiguredCase>(setup);
    addSurroundings(plan, *configured);
    PluginMaker maker(*configured, isolation);
    LoopPlugins& plugins = configured->plugins;
    plugins.filter = maker.makeFilters(plan.filters);
    if (!plugins.filter->recovers()) {
        checkStartInside(plan);
        checkStartViable(plan);
    }
    plugins.command = maker.makeWatched<CommandSource>(plan.command);
    plugins.controller = maker.makeWatched<NominalController>(plan.controller);
    checkMotors(plan);
    if (plan.realPlant) {
        plugins.robustLoop = maker.makeWatched<RobustLoop>(*plan.robustLoop);
        plugins.realPlant = maker.makeWatched<RealPlant>(*plan.realPlant);
        if (plan.feedsExternalTorque && !plugins.realPlant->externalTorque())
            throw badInput(plan.externalTorquePlace,
                           "the real plant " + plan.realPlant->plugin.name + " has no sensors for an external torque",
                           "Use a plant that measures it, or `external_torque: ignored`.");
    }
    if (!plugins.controller->follows(plugins.command->space())) {
        const bool joint = plugins.command->space() == MotionCommand::Space::Joint;
        throw badInput(plan.controller.parameters.resolved().place(),
                       "the controller " + plan.controller.plugin.name + " cannot follow the command " +
                           plan.command.plugin.name + ", which gives " + (joint ? "joint positions" : "tool poses"),
                       joint ? "Use the controller joint_pd, or a command such as generated_hand_motion."
                             : "Use the controller task_space_pd, or a command such as waypoints.");
    }
    return configured;
}

CaseResult runCase(const CasePlan& plan, const RunOptions& options) {
    const std::unique_ptr<ConfiguredCase> configured = configureCase(plan, options.isolation);
    const bool guarantees = configured->plugins.filter->guaranteesLimits();
    const bool guaranteesClearance = configured->plugins.filter->guaranteesClearance();
    const MotionCommand::Space space = configured->plugins.command->space();
    auto ownLoop = std::make_unique<ControlLoop>(
        configured->setup, std::move(configured->plugins),
        RealArmOptions{plan.bound ? &*plan.bound : nullptr, plan.feedsExternalTorque, true, plan.holdsOnReal});
    ControlLoop& loop = *ownLoop;

    std::optional<detail::CollisionCounter> collisions;
    if (plan.environment) collisions.emplace(plan);
    std::unique_ptr<Recorder> recorder;
    if (!options.log.empty())
        recorder = std::make_unique<Recorder>(
            std::make_unique<LogWriter>(options.log, makeOpening(plan, space, configured->surroundings.get())));

    CaseResult result(plan);
    result.guarantees = guarantees;
    result.guaranteesClearance = guaranteesClearance;
    result.log = options.log;

    const std::int64_t ticks = std::llround(plan.duration_s / plan.tick_s);
    const auto begin = std::chrono::steady_clock::now();
    double recordTime_us = 0.0;
    TickRecord record;
    // After a lost tracking the real arm may need longer than the nominal one.
    std::int64_t settling = std::llround(kSettling_s / plan.tick_s);
    const auto hasEnded = [&] {
        if (!loop.hasStopped()) return false;
        return loop.hasFailed() || !result.summary.trip() || settling-- <= 0;
    };
    // A stop that has begun is led to its end, even beyond the duration.
    for (std::int64_t k = 0; (k < ticks || loop.isStopping()) && !hasEnded(); ++k) {
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
        result.stopReason == StopReason::TrackingLost) {
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
    ownLoop.reset();  // some plugins have a last word
    for (const auto& watch : configured->watches) {
        if (!watch->lastWords.empty())
            result.warnings.push_back(watch->title + " failed while it was destroyed: " + watch->lastWords);
        if (watch->allocatingTicks == 0) continue;
        result.warnings.push_back(
            watch->title + " takes memory from the heap in its tick (in " + std::to_string(watch->allocatingTicks) +
            " ticks, first in tick " + std::to_string(watch->firstAllocation) +
            "): in a real-time loop such a tick may come too late. Take the memory in configure().");
    }
    return result;
}

CaseResult::CaseResult(const CasePlan& plan)
    : name(plan.name),
      filter(plan.filterName()),
      robustLoop(plan.robustLoop ? plan.robustLoop->plugin.name : ""),
      realPlant(plan.realPlant ? plan.realPlant->plugin.name : ""),
      holdsOnReal(plan.holdsOnReal),
      summary(plan.robot.jointNames(), plan.limits, plan.realPlant.has_value(),
              {plan.holdsOnReal ? std::optional(plan.realLimits) : std::nullopt, plan.bound,
               plan.robot.actuation.torqueLimit}) {
    for (const PluginChoice* choice : listPlugins(plan))
        if (const ConfigNode* seed = choice->parameters.resolved().find("seed"))
            seeds[choice->plugin.name] = seed->text;
}

bool CaseResult::isRealGuaranteeBroken() const {
    return holdsOnReal && guarantees && summary.anyRealLimitBroken();
}

bool CaseResult::isClearanceGuaranteeBroken() const {
    return guaranteesClearance && summary.collisions() && summary.collisions()->nominal.ticksInCollision > 0;
}

bool isGraver(int a, int b) {
    const auto rank = [](int code) {
        constexpr ErrorKind order[] = {ErrorKind::GuaranteeBroken, ErrorKind::TrackingLost, ErrorKind::PluginFailed,
                                       ErrorKind::LogNotWritten, ErrorKind::BadInput};
        return std::find(std::begin(order), std::end(order), static_cast<ErrorKind>(code)) - order;
    };
    return rank(a) < rank(b);
}

int CaseResult::exitCode() const {
    if (stopReason == StopReason::GuaranteeBroken || isRealGuaranteeBroken() || isClearanceGuaranteeBroken())
        return static_cast<int>(ErrorKind::GuaranteeBroken);
    if (summary.trip()) return static_cast<int>(ErrorKind::TrackingLost);
    const bool isWanted =
        stopReason == StopReason::None || stopReason == StopReason::Requested || stopReason == StopReason::FilterEnded;
    if (!isWanted) return static_cast<int>(ErrorKind::PluginFailed);
    if (!logError.empty()) return static_cast<int>(ErrorKind::LogNotWritten);
    return 0;
}

}  // namespace viable
