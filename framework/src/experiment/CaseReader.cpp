#include "experiment/CaseReader.h"

#include "config/ConfigText.h"
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
    // Unknown keys first: a misspelt key explains a missing one.
    for (const ExperimentKey& key : experimentKeys()) map.find(key.spec.name);
    map.finish();
    const auto findPlace = [&](const char* key, const std::string& otherwise) {
        const ConfigNode* block = map.find(key);
        return block ? describePlace(*block, key, name, overrides) : otherwise;
    };

    CasePlan plan;
    plan.name = name;
    RobotBlock robot = readRobot(map.require("robot"), map.find("payload"), robotPath);
    plan.robot = std::move(robot.robot);
    plan.payload = std::move(robot.payload);
    const int joints = plan.robot.size();
    plan.tick_s = readTick(map.find("tick_s"));
    plan.duration_s = readDuration(map.require("duration_s"), plan.tick_s);

    plan.limitsPlace = findPlace("limits", plan.robot.folder.string() + "/limits.yaml");
    const LimitsBlock limits = readLimitsBlock(map.find("limits"), plan.robot, plan.tick_s, plan.limitsPlace);
    plan.limits = limits.limits;
    plan.allowsLargeAngles = limits.allowsLargeAngles;
    plan.holdsOnReal = limits.holdsOnReal;
    plan.start = readStart(map.find("start"), plan.robot);
    plan.startPlace = findPlace("start", node.file);
    if (const ConfigNode* missed = map.find("missed_ticks"))
        plan.missedTicks = readMissedTicks(*missed, plan.tick_s, plan.duration_s);
    const ConfigNode* environment = map.find("environment");
    if (environment) {
        plan.environment = readEnvironmentBlock(*environment);
        setContactSpeeds(plan.environment->people, plan.robot.movingMass());
    }
    if (const ConfigNode* speeds = map.find("speed_limits")) {
        plan.robot.speedLimits = readSpeedLimits(*speeds, plan.robot.speedLimits);
        plan.hasOwnSpeedLimits = true;
    }
    if (environment || plan.robot.speedLimits.needsCapsules()) plan.geometry = loadArmGeometry(plan.robot);

    plan.command = readPlugin(map.require("command"), PluginKind::CommandSource, loader, joints);
    if (const ConfigNode* stream = map.find("stream")) plan.stream = readStream(*stream, plan.tick_s);
    plan.controller = readPlugin(map.require("controller"), PluginKind::NominalController, loader, joints);
    plan.filters = readFilters(map.require("filter"), loader, joints);
    const ConfigNode* robustLoop = map.find("robust_loop");
    const ConfigNode* realPlant = map.find("real_plant");
    checkRealArmIsWhole(robustLoop, realPlant);
    if (realPlant) {
        plan.realPlant = readPlugin(*realPlant, PluginKind::RealPlant, loader, joints);
        plan.robustLoop = readPlugin(*robustLoop, PluginKind::RobustLoop, loader, joints);
    }
    if (const ConfigNode* external = map.find("external_torque")) {
        plan.feedsExternalTorque = readExternalTorque(*external);
        plan.externalTorquePlace = external->place();
        checkExternalTorqueHasPlant(plan);
    }
    if (const ConfigNode* disturbances = map.find("disturbance_set")) {
        plan.disturbances = readDisturbances(*disturbances, joints);
        checkDisturbancesHavePlant(plan);
    }
    checkHoldsOnBound(plan, plan.disturbances.has_value());
    plan.resolved = resolveCase(plan, title, environment);
    return plan;
}

}  // namespace viable::detail
