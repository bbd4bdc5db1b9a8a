#include "experiment/CaseReader.h"

#include "config/ConfigText.h"
#include "experiment/CaseBlocks.h"
#include "experiment/CaseChecks.h"
#include "experiment/MapReader.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

namespace {

/** True for `root` itself and for what stands in it. */
bool isWithin(const std::string& keyPath, const std::string& root) {
    return keyPath.compare(0, root.size(), root) == 0 &&
           (keyPath.size() == root.size() || keyPath[root.size()] == '.' || keyPath[root.size()] == '[');
}

/** The place of a case's block for errors about its values together: the assignments of the command line that
reach into it, if any, and the file's. */
std::string describePlace(const ConfigNode& block, const std::string& key, const std::string& caseName,
                          const std::vector<std::string>& overrides) {
    std::string text;
    for (const std::string& assignment : overrides) {
        const std::string path = assignment.substr(0, assignment.find('='));
        const std::string own = "cases." + caseName;
        if (!isWithin(path, key) && !isWithin(path, own + "." + key) && path != own) continue;
        const std::string shown = quoteText(assignment);  // without its quotes
        text += (text.empty() ? "" : ", ") + std::string(kOverrideFile) + " " + shown.substr(1, shown.size() - 2);
    }
    if (text.empty()) return block.place();
    return block.file == kOverrideFile ? text : text + " (over " + block.place() + ")";
}

double readTick(const ConfigNode* node) {
    const ParameterSpec spec = getKey("tick_s");
    return toNumber(node ? *node : makeScalar(spec.defaultText), spec.range());
}

/** @param tick_s  0: not known */
double readDuration(const ConfigNode& node, double tick_s) {
    NumberRange range = getKey("duration_s").range();
    if (tick_s > 0.0) {
        range.min = tick_s;
        range.minIsOpen = false;
    }
    return toNumber(node, range);
}

/** @param environment  the block, where there is one */
ConfigNode resolveCase(const CasePlan& plan, const std::string& title, const ConfigNode* environment) {
    ConfigNode node = makeMap({{"schema", makeScalar("1")},
                               {"title", makeScalar(title, true)},
                               {"robot", makeScalar(std::filesystem::canonical(plan.robot.folder).string(), true)},
                               {"duration_s", makeNumber(plan.duration_s)},
                               {"tick_s", makeNumber(plan.tick_s)},
                               {"start", resolveStart(plan.start)},
                               {"limits", resolveLimits(plan)},
                               {"command", resolvePlugin(plan.command)},
                               {"controller", resolvePlugin(plan.controller)}});
    const auto add = [&](const char* key, ConfigNode value) { node.entries.emplace_back(key, std::move(value)); };
    if (plan.stream) add("stream", plan.stream->resolved());
    if (plan.realPlant) {
        if (plan.feedsExternalTorque) add("external_torque", makeScalar("to_nominal"));
        add("robust_loop", resolvePlugin(*plan.robustLoop));
        add("real_plant", resolvePlugin(*plan.realPlant));
    }
    if (plan.disturbances) add("disturbance_set", plan.disturbances->resolved());
    if (!plan.missedTicks.empty()) add("missed_ticks", resolveMissedTicks(plan.missedTicks, plan.tick_s));
    if (plan.payload)
        for (const auto& [key, value] : plan.payload->resolved().entries) add(key.c_str(), value);
    if (plan.hasOwnSpeedLimits || plan.robot.speedLimits.isAny())
        add("speed_limits", resolveSpeedLimits(plan.robot.speedLimits));
    if (environment) add("environment", resolveEnvironment(*environment, *plan.environment));
    add("cases", makeMap({{plan.name, makeMap({{"filter", resolveFilters(plan.filters)}})}}));
    return node;
}

}  // namespace

CasePlan readCase(const ConfigNode& node, const std::string& name, const std::string& title, const PluginLoader& loader,
                  const std::vector<std::filesystem::path>& robotPath, const std::vector<std::string>& overrides,
                  const std::vector<std::string>& lacking) {
    ErrorList errors;
    MapReader map(node, listNames(experimentKeys()), errors);
    const auto require = [&](const std::string& key, const auto& read) {
        if (map.isKnown() && std::find(lacking.begin(), lacking.end(), key) != lacking.end())
            errors.add(node.file, "the key " + quoteText(key) + " is missing",
                       "Add `" + key + ": ...` at the top, for all cases, or to each of them");
        else
            map.require(key, read);
    };
    const auto findPlace = [&](const char* key, const std::string& otherwise) {
        const ConfigNode* block = map.find(key);
        return block ? describePlace(*block, key, name, overrides) : otherwise;
    };

    CasePlan plan;
    plan.name = name;
    require("robot", [&](const ConfigNode& value) { plan.robot = readRobot(value, robotPath); });
    if (plan.robot.size() == 0) errors.throwIfAny(node.file);  // the others are read by it
    const int joints = plan.robot.size();

    errors.collect([&] {
        plan.payload = readPayload(node);
        if (!plan.payload) return;
        const auto payload = plan.payload->get<PayloadSettings>();
        plan.robot = withPayload(plan.robot, payload.mass_kg, payload.offset);
    });
    if (map.isSure("tick_s")) {
        // Wrong, it hides nothing else: the rest is read with the usual one.
        const bool hasTick = errors.collect([&] { plan.tick_s = readTick(map.find("tick_s")); });
        if (!hasTick) plan.tick_s = readTick(nullptr);
        bool hasDuration = false;
        require("duration_s", [&](const ConfigNode& value) {
            plan.duration_s = readDuration(value, hasTick ? plan.tick_s : 0.0);
            hasDuration = true;
        });
        if (hasDuration && map.isSure("duration_s"))
            map.readOptional("missed_ticks", [&](const ConfigNode& block) {
                plan.missedTicks = readMissedTicks(block, plan.tick_s, plan.duration_s);
            });
        map.readOptional("stream", [&](const ConfigNode& block) { plan.stream = readStream(block, plan.tick_s); });
        const ConfigNode* own = map.find("limits");
        if (map.isSure("limits"))
            errors.collect([&] {
                plan.limitsPlace = findPlace("limits", plan.robot.folder.string() + "/limits.yaml");
                const LimitSettings limits = readLimitsBlock(own, plan.robot, plan.tick_s, plan.limitsPlace);
                plan.limits = limits.limits;
                plan.allowsLargeAngles = limits.allowsLargeAngles;
                plan.holdsOnReal = limits.holdsOnReal;
            });
    }
    errors.collect([&] {
        plan.start = readStart(map.find("start"), plan.robot);
        plan.startPlace = findPlace("start", node.file);
    });
    map.readOptional("environment", [&](const ConfigNode& block) {
        plan.environment = readEnvironmentBlock(block);
        for (const Person& person : plan.environment->people)
            if (person.bodyPart)
                requireDynamics(plan.robot, block.place(), "the contact speed of a body_part (give contact_speed_mps)");
        setContactSpeeds(plan.environment->people, plan.robot.movingMass());
    });
    const bool hasSpeeds = map.isSure("speed_limits") && errors.collect([&] {
        const ConfigNode* block = map.find("speed_limits");
        if (!block) return;
        readSettings(*block, plan.robot.speedLimits);
        plan.hasOwnSpeedLimits = true;
    });
    if (map.find("environment") || (hasSpeeds && plan.robot.speedLimits.needsCapsules()))
        errors.collect([&] { plan.geometry = loadArmGeometry(plan.robot); });
    const auto read = [&](const ConfigNode& block, PluginKind kind) { return readPlugin(block, kind, loader, joints); };
    require("command", [&](const ConfigNode& block) { plan.command = read(block, PluginKind::CommandSource); });
    require("controller",
            [&](const ConfigNode& block) { plan.controller = read(block, PluginKind::NominalController); });
    require("filter", [&](const ConfigNode& block) { plan.filters = readFilters(block, loader, joints); });
    map.readOptional("real_plant", [&](const ConfigNode& block) {
        requireDynamics(plan.robot, block.place(), "a real arm that takes torques");
        plan.realPlant = read(block, PluginKind::RealPlant);
    });
    map.readOptional("robust_loop",
                     [&](const ConfigNode& block) { plan.robustLoop = read(block, PluginKind::RobustLoop); });
    map.readOptional("external_torque", [&](const ConfigNode& value) {
        plan.feedsExternalTorque = toChoice(value, {"to_nominal", "ignored"}) == "to_nominal";
        plan.externalTorquePlace = value.place();
    });
    map.readOptional("disturbance_set",
                     [&](const ConfigNode& block) { plan.disturbances = readDisturbances(block, joints); });
    errors.throwIfAny(node.file);

    errors.collect([&] { checkRealArmIsWhole(map.find("robust_loop"), map.find("real_plant")); });
    errors.collect([&] { checkExternalTorqueHasPlant(plan); });
    errors.collect([&] { checkDisturbancesHavePlant(plan); });
    errors.collect([&] { checkHoldsOnBound(plan, plan.disturbances.has_value()); });
    errors.throwIfAny(node.file);
    plan.resolved = resolveCase(plan, title, map.find("environment"));
    return plan;
}

}  // namespace viable::detail
