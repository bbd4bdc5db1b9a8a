#include "experiment/CaseReader.h"

#include "config/ConfigText.h"
#include "core/Complaints.h"
#include "experiment/CaseBlocks.h"
#include "experiment/CaseChecks.h"
#include "experiment/ResolvedNodes.h"

namespace viable::detail {

namespace {

/** True for `root` itself and for what stands in it. */
bool isWithin(const std::string& keyPath, const std::string& root) {
    return keyPath.compare(0, root.size(), root) == 0 &&
           (keyPath.size() == root.size() || keyPath[root.size()] == '.' || keyPath[root.size()] == '[');
}

/** The place of a case's block for complaints about its values together: the assignments of the command line that
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
    const ParameterSpec& spec = getKey(experimentKeys(), "tick_s");
    return toNumber(node ? *node : makeScalar(spec.defaultText), spec.range());
}

double readDuration(const ConfigNode& node, double tick_s) {
    NumberRange range = getKey(experimentKeys(), "duration_s").range();
    range.min = tick_s;
    range.minIsOpen = false;
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
    if (plan.payload) add("payload", plan.payload->resolved());
    if (plan.hasOwnSpeedLimits || plan.robot.speedLimits.isAny())
        add("speed_limits", resolveSpeedLimits(plan.robot.speedLimits));
    if (environment) add("environment", resolveEnvironment(*environment, *plan.environment));
    add("cases", makeMap({{plan.name, makeMap({{"filter", resolveFilters(plan.filters)}})}}));
    return node;
}

}  // namespace

CasePlan readCase(const ConfigNode& node, const std::string& name, const std::string& title, const PluginLoader& loader,
                  const std::vector<std::filesystem::path>& robotPath, const std::vector<std::string>& overrides) {
    ConfigMap map(node);
    for (const ExperimentKey& key : experimentKeys()) map.find(key.spec.name);
    Complaints complaints;
    const bool isKnown = complaints.gather([&] { map.finish(); });
    const auto offer = [&](const char* key, const auto& read) {
        if (const ConfigNode* block = map.find(key)) complaints.gather([&] { read(*block); });
    };
    // Beside an unknown key none is called missing: a misspelt key explains it.
    const auto require = [&](const char* key, const auto& read) {
        if (isKnown && !map.find(key))
            complaints.add(node.place(), "the key " + quoteText(key) + " is missing",
                           std::string("Add `") + key + ": ...` here, or at the top of the file for all cases.");
        offer(key, read);
    };
    const auto findPlace = [&](const char* key, const std::string& otherwise) {
        const ConfigNode* block = map.find(key);
        return block ? describePlace(*block, key, name, overrides) : otherwise;
    };

    CasePlan plan;
    plan.name = name;
    require("robot", [&](const ConfigNode& block) {
        RobotBlock robot = readRobot(block, map.find("payload"), robotPath);
        plan.robot = std::move(robot.robot);
        plan.payload = std::move(robot.payload);
    });
    const bool hasTick = complaints.gather([&] { plan.tick_s = readTick(map.find("tick_s")); });
    if (plan.robot.size() == 0 || !hasTick) complaints.throwIfAny(node.file);  // the others are read by them
    const int joints = plan.robot.size();

    complaints.gather([&] {
        plan.limitsPlace = findPlace("limits", plan.robot.folder.string() + "/limits.yaml");
        const LimitsBlock limits = readLimitsBlock(map.find("limits"), plan.robot, plan.tick_s, plan.limitsPlace);
        plan.limits = limits.limits;
        plan.allowsLargeAngles = limits.allowsLargeAngles;
        plan.holdsOnReal = limits.holdsOnReal;
    });
    complaints.gather([&] {
        plan.start = readStart(map.find("start"), plan.robot);
        plan.startPlace = findPlace("start", node.file);
    });
    bool hasDuration = false;
    require("duration_s", [&](const ConfigNode& block) {
        plan.duration_s = readDuration(block, plan.tick_s);
        hasDuration = true;
    });
    if (hasDuration)
        offer("missed_ticks", [&](const ConfigNode& block) {
            plan.missedTicks = readMissedTicks(block, plan.tick_s, plan.duration_s);
        });
    offer("environment", [&](const ConfigNode& block) {
        plan.environment = readEnvironmentBlock(block);
        setContactSpeeds(plan.environment->people, plan.robot.movingMass());
    });
    offer("speed_limits", [&](const ConfigNode& block) {
        plan.robot.speedLimits = readSpeedLimits(block, plan.robot.speedLimits);
        plan.hasOwnSpeedLimits = true;
    });
    complaints.gather([&] {
        if (map.find("environment") || plan.robot.speedLimits.needsCapsules())
            plan.geometry = loadArmGeometry(plan.robot);
    });
    require("command", [&](const ConfigNode& block) {
        plan.command = readPlugin(block, PluginKind::CommandSource, loader, joints);
    });
    offer("stream", [&](const ConfigNode& block) { plan.stream = readStream(block, plan.tick_s); });
    require("controller", [&](const ConfigNode& block) {
        plan.controller = readPlugin(block, PluginKind::NominalController, loader, joints);
    });
    require("filter", [&](const ConfigNode& block) { plan.filters = readFilters(block, loader, joints); });
    offer("real_plant",
          [&](const ConfigNode& block) { plan.realPlant = readPlugin(block, PluginKind::RealPlant, loader, joints); });
    offer("robust_loop", [&](const ConfigNode& block) {
        plan.robustLoop = readPlugin(block, PluginKind::RobustLoop, loader, joints);
    });
    offer("external_torque", [&](const ConfigNode& block) {
        plan.feedsExternalTorque = readExternalTorque(block);
        plan.externalTorquePlace = block.place();
    });
    offer("disturbance_set", [&](const ConfigNode& block) { plan.disturbances = readDisturbances(block, joints); });
    complaints.throwIfAny(node.file);

    complaints.gather([&] { checkRealArmIsWhole(map.find("robust_loop"), map.find("real_plant")); });
    complaints.gather([&] { checkExternalTorqueHasPlant(plan); });
    complaints.gather([&] { checkDisturbancesHavePlant(plan); });
    complaints.gather([&] { checkHoldsOnBound(plan, plan.disturbances.has_value()); });
    complaints.throwIfAny(node.file);
    plan.resolved = resolveCase(plan, title, map.find("environment"));
    return plan;
}

}  // namespace viable::detail
