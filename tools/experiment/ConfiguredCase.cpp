#include "experiment/ConfiguredCase.h"
#include "experiment/UnlikelyValues.h"

#include "core/ErrorParts.h"
#include "environment/ArmSurroundings.h"
#include "experiment/CaseBound.h"
#include "experiment/CaseChecks.h"
#include "experiment/StartCheck.h"
#include "filter/FilterChain.h"
#include "host/ProcessGuard.h"
#include "host/WatchedLimit.h"
#include "limits/LimitRows.h"
#include "tracking/InertiaSample.h"

namespace viable {

namespace {

constexpr char kOnConfigure[] =
    "configure() says what is wrong with a parameter by throwing viable::badInput(); anything else must be fixed in "
    "the plugin.";

template <class Interface>
PluginPtr<Interface> makeHere(const PluginChoice& choice, const RunSetup& setup, PluginWatch& watch) {
    const std::string& title = watch.title;
    ProcessGuard guard;
    PluginPtr<Interface> plugin = PluginLoader::create<Interface>(choice.plugin);
    PluginCall call(&watch, kConfiguring);
    try {
        plugin->configure(setup, choice.parameters);
        const PluginCall asking(&watch, kAsking);
        plugin->traits();  // here first, where a throw still names it
        if constexpr (std::is_same_v<Interface, RealPlant>) plugin->externalTorque();
    } catch (const Error&) {
        throw;
    } catch (const std::exception& e) {
        throw Error(ErrorKind::PluginFailed, title, std::string("threw while it was configured: ") + e.what(),
                    kOnConfigure);
    } catch (...) {
        throw Error(ErrorKind::PluginFailed, title,
                    "threw something other than a std::exception while it was configured", kOnConfigure);
    }
    if (const char* change = call.undoArithmeticChange())
        throw Error(ErrorKind::PluginFailed, title, formatArithmeticChange(change), kOnArithmeticChange);
    addSharedChange(watch, "made", guard.undo());
    return plugin;
}

/** Makes and configures the plugins of one case, each with its watch. */
class PluginMaker {
public:
    PluginMaker(ConfiguredCase& configured, const Isolation* isolation)
        : configured_(configured), isolation_(isolation) {}

    template <class Interface>
    PluginPtr<Interface> make(const PluginChoice& choice) {
        constexpr bool isReal = std::is_same_v<Interface, RobustLoop> || std::is_same_v<Interface, RealPlant>;
        configured_.watches.push_back(std::make_unique<PluginWatch>(choice.plugin));
        PluginWatch* const watch = configured_.watches.back().get();
        const RunSetup& setup = isReal ? configured_.realSetup : configured_.setup;
        if (!isolation_) return makeHere<Interface>(choice, setup, *watch);
        try {
            PluginPtr<Interface> plugin = isolatePlugin<Interface>(
                [&] { return makeHere<Interface>(choice, setup, *watch); }, *watch, isolation_->watchdog_s);
            if constexpr (std::is_same_v<Interface, SafetyFilter>)
                if (setup.people && !(plugin->traits().guarantees & findPeopleLimits()).isEmpty())
                    throw badInput(watch->title,
                                   "in a process of its own it does not see how the people of `environment` move",
                                   "Run it without --isolate, or without `people`.");
            return plugin;
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
        auto chain = std::make_unique<FilterChain>(configured_.setup.tick_s);
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

/** A plugin's numbers become a bound. */
void checkErrorLoop(const LinearErrorLoop& loop, int n, const std::string& title) {
    bool isSound = true;
    for (const JointVector* gains : {&loop.kr, &loop.kp, &loop.ki})
        isSound &= isFinite(*gains, n) && (gains->array() >= 0.0).all();
    for (const JointVector* limits : {&loop.integralLimit, &loop.torqueRate})
        isSound &= limits->size() == n && (limits->array() > 0.0).all();
    isSound &= loop.inertiaRate > 0.0;
    if (loop.motorRate.size() > 0) isSound &= loop.motorRate.size() == n && (loop.motorRate.array() > 0.0).all();
    isSound &= detail::isSound(loop.friction, n);
    if (!isSound)
        throw Error(
            ErrorKind::PluginFailed, title, "gave an error loop of the wrong size or with numbers that it cannot have",
            "errorLoop has one number per joint: gains and friction finite and at least 0, limits and inertiaRate "
            "above 0 or infinite, speeds finite and above 0.");
}

/** What a plant and a robust loop tell of how fast the motors' torque may change; of size 0 where it may in any way. */
JointVector combineRates(const JointVector& one, const JointVector& other) {
    JointVector rate = one;
    if (other.size() > 0) rate = one.size() > 0 ? JointVector(one.cwiseMin(other)) : other;
    return rate.array().isInf().all() ? JointVector() : rate;
}

void addSurroundings(ConfiguredCase& configured) {
    const CasePlan& plan = configured.plan;
    if (!plan.environment) return;
    configured.surroundings = makeSurroundings(*plan.environment, plan.robot, *plan.geometry, configured.setup.limits);
    configured.feed = std::make_unique<SurroundingsFeed>(configured.surroundings);
    configured.setup.surroundings = configured.feed.get();
    if (plan.environment->people.empty()) return;
    configured.people = std::make_unique<PeopleFeed>(plan.environment->people);
    configured.setup.people = configured.people.get();
    PeopleObservation seen;  // the start is judged by it
    observeWalks(plan.environment->people, 0.0, seen);
    configured.people->put(seen);
}

/** All but the plugins. */
std::unique_ptr<ConfiguredCase> beginCase(const CasePlan& plan) {
    RunSetup setup{plan.robot, plan.limits, plan.tick_s, plan.duration_s, plan.start, {}};
    RobotModel model(plan.robot);
    Dynamics dynamics;
    model.calcDynamics(plan.start.q, plan.start.qd, dynamics);
    setup.startTool = dynamics.tool;
    if (plan.environment) {
        setup.geometry = &*plan.geometry;
        setup.environment = &*plan.environment;
    }
    return std::make_unique<ConfiguredCase>(plan, std::move(setup));
}

}  // namespace

LimitScene makeScene(const CasePlan& plan) {
    return {plan.robot, plan.geometry ? &*plan.geometry : nullptr, plan.environment ? &*plan.environment : nullptr};
}

LimitSet findLimits(const CasePlan& plan) {
    LimitSet found;
    for (const LimitKind kind : listArmLimits()) {
        const std::set<std::string> libraries = detail::findLimitLibraries(kind);
        const bool isUsed = std::any_of(libraries.begin(), libraries.end(),
                                        [&](const std::string& one) { return plan.libraries.count(one) > 0; });
        if (libraries.empty() || isUsed) found.set(kind, hasLimit(kind, makeScene(plan)));
    }
    return found;
}

ConfiguredCase::ConfiguredCase(const CasePlan& casePlan, RunSetup runSetup)
    : plan(casePlan), realSetup(runSetup), setup(std::move(runSetup)) {}
ConfiguredCase::~ConfiguredCase() {
    destroyPlugins(plugins);
}

std::unique_ptr<ConfiguredCase> configureTracking(const CasePlan& plan, const Isolation* isolation) {
    auto configured = beginCase(plan);
    if (plan.realPlant) {
        PluginMaker maker(*configured, isolation);
        LoopPlugins& plugins = configured->plugins;
        plugins.realPlant = maker.makeWatched<RealPlant>(*plan.realPlant);
        const PlantTraits plant = plugins.realPlant->traits();
        detail::checkTold(plant, plan.robot.size(), configured->watches.back()->title);
        configured->realSetup.delayTicks = configured->setup.delayTicks = plant.delayTicks;
        configured->realSetup.motorRate = configured->setup.motorRate = combineRates(plant.motorRate, {});
        plugins.robustLoop = maker.makeWatched<RobustLoop>(*plan.robustLoop);
        const std::optional<LinearErrorLoop> loop = plugins.robustLoop->traits().errorLoop;
        if (loop) {
            checkErrorLoop(*loop, plan.robot.size(), configured->watches.back()->title);
            configured->margins = detail::checkStability(plan, *loop, configured->realSetup.delayTicks);
        }
        if (loop) configured->robustRate = loop->torqueRate;
        configured->motorRate = combineRates(plant.motorRate, loop ? loop->motorRate : JointVector());
        if (loop && plan.disturbances) {
            detail::checkStartsAtRest(plan);
            configured->bound = detail::findBound(plan, *loop);
            detail::checkBoundAssumptions(plan, *configured->bound, *loop, configured->motorRate, plant.encoder);
        }
    }
    return configured;
}

void applyBound(const CasePlan& plan, ConfiguredCase& configured) {
    configured.setup.limits = detail::findNominalLimits(plan, configured.bound ? &*configured.bound : nullptr);
    if (configured.bound) detail::checkMotors(plan, *configured.bound);
}

std::unique_ptr<ConfiguredCase> configureCase(const CasePlan& plan, const Isolation* isolation) try {
    auto configured = configureTracking(plan, isolation);
    applyBound(plan, *configured);
    addSurroundings(*configured);
    PluginMaker maker(*configured, isolation);
    LoopPlugins& plugins = configured->plugins;
    plugins.filter = maker.makeFilters(plan.filters);
    if (!plugins.filter->traits().recovers) detail::checkStart(plan, configured->setup.limits);
    plugins.command = maker.makeWatched<CommandSource>(plan.command);
    if (plan.stream) plugins.stream = std::make_unique<CommandStream>(plan.stream->get<StreamOptions>());
    plugins.controller = maker.makeWatched<NominalController>(plan.controller);
    if (plugins.realPlant) {
        detail::checkExternalTorqueIsMeasured(plan, *plugins.realPlant);
        detail::checkContactCanBeFelt(plan, *plugins.realPlant);
    }
    detail::checkControllerFollows(plan, *plugins.command, *plugins.controller);
    return configured;
} catch (const Error& e) {
    const std::string start = detail::findUnlikelyStart(plan);
    const bool isOfStart = getParts(e).cause.find("the start") != std::string::npos;
    if (start.empty() || e.kind() != ErrorKind::BadInput || !isOfStart) throw;
    throw badInput(plan.startPlace, start, e.what());
}

}  // namespace viable
