#include "experiment/ExperimentFile.h"

#include <algorithm>
#include <cmath>

#include "config/ConfigText.h"
#include "config/Draws.h"
#include "core/Memo.h"
#include "core/Sha256.h"
#include "core/Text.h"
#include "experiment/ExperimentKeys.h"
#include "plugin/ParameterText.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

bool isCaseKey(const std::string& name) {
    for (const detail::ExperimentKey& key : detail::experimentKeys())
        if (name == key.spec.name) return !key.isTopOnly;
    return false;
}

std::vector<std::string> getNames(const std::vector<detail::ExperimentKey>& keys) {
    std::vector<std::string> names;
    for (const detail::ExperimentKey& key : keys) names.push_back(key.spec.name);
    return names;
}

ConfigNode makeScalar(const std::string& text, bool quoted = false) {
    ConfigNode node;
    node.kind = ConfigNode::Kind::Scalar;
    node.text = text;
    node.quoted = quoted;
    return node;
}

ConfigNode makeNumber(double value) {
    if (std::isinf(value)) return makeScalar(value > 0.0 ? ".inf" : "-.inf");
    return makeScalar(detail::formatNumber(value));
}

ConfigNode makeList(const JointVector& values) {
    ConfigNode node;
    node.kind = ConfigNode::Kind::List;
    for (double value : values) node.items.push_back(makeNumber(value));
    return node;
}

ConfigNode makeMap(std::vector<std::pair<std::string, ConfigNode>> entries) {
    ConfigNode node;
    node.kind = ConfigNode::Kind::Map;
    node.entries = std::move(entries);
    return node;
}

ConfigNode makeBounds(const JointBounds& bounds) {
    return makeMap({{"lower", makeList(bounds.lower)}, {"upper", makeList(bounds.upper)}});
}

/** Refuses a key without its unit and names the one that was meant: too many letters for a slip of one key. */
void refuseMissingUnit(const ConfigNode& block, const std::vector<std::string>& keys) {
    for (const auto& [key, value] : block.entries)
        for (const std::string& known : keys)
            if (known.compare(0, key.size() + 1, key + "_") == 0)
                throw badInput(value.place(), "the key " + detail::quoteText(key) + " is unknown",
                               "Did you mean `" + known + "`? A key carries its unit.");
}

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
        const std::string shown = detail::quoteText(assignment);  // without its quotes
        detail::addItem(text, std::string(detail::kOverrideFile) + " " + shown.substr(1, shown.size() - 2));
    }
    if (text.empty()) return block.place();
    return block.file == detail::kOverrideFile ? text : text + " (over " + block.place() + ")";
}

MotionState readStart(const ConfigNode* block, const RobotDescription& robot) {
    MotionState start;
    start.q = robot.home;
    start.qd.setZero(robot.size());
    start.qdd.setZero(robot.size());
    if (!block) return start;
    ConfigMap map(*block);
    if (const ConfigNode* node = map.find("position_rad")) start.q = toJointVector(*node, robot.size());
    if (const ConfigNode* node = map.find("velocity_radps")) start.qd = toJointVector(*node, robot.size());
    if (const ConfigNode* node = map.find("acceleration_radps2")) start.qdd = toJointVector(*node, robot.size());
    refuseMissingUnit(*block, getNames(detail::startKeys()));
    map.finish();
    return start;
}

double readTick(const ConfigNode* node) {
    const ParameterSpec& spec = detail::getKey(detail::experimentKeys(), "tick_s");
    return toNumber(node ? *node : makeScalar(spec.defaultText), spec.range());
}

/** Reads a block of sizes. @param example  what to write */
Parameters readSizes(const ConfigNode& block, const char* name, const char* example,
                     const std::vector<detail::ExperimentKey>& keys, int joints) {
    if (const ConfigNode* plugin = block.find("plugin"))
        throw badInput(plugin->place(), std::string(name) + " is no plugin",
                       std::string("Write sizes: `") + name + ": " + example + "`.");
    ConfigMap known(block);  // readParameters() would offer `plugin`, too
    std::vector<ParameterSpec> specs;
    for (const detail::ExperimentKey& key : keys) {
        known.find(key.spec.name);
        specs.push_back(key.spec);
    }
    known.finish();
    return readParameters(block, specs.data(), specs.size(), joints);
}

Parameters readDisturbances(const ConfigNode& block, int joints) {
    return readSizes(block, "disturbance_set", "{friction_scale: 2, payload_kg: 3}", detail::disturbanceKeys(), joints);
}

Parameters readPayload(const ConfigNode& block, int joints) {
    return readSizes(block, "payload", "{mass_kg: 1.5, offset_m: [0, 0, 0.1]}", detail::payloadKeys(), joints);
}

RobotDescription takePayload(RobotDescription robot, const Parameters& payload) {
    const std::vector<double>& offset = payload.numbers("offset_m");
    return withPayload(std::move(robot), payload.number("mass_kg"), {offset[0], offset[1], offset[2]});
}

/** The block as it must stand in a file of any folder. */
ConfigNode resolveEnvironment(ConfigNode block, const Environment& environment) {
    const auto fill = [&](const char* key, double value) {
        if (!block.find(key)) block.entries.emplace_back(key, makeNumber(value));
    };
    fill("safety_distance_m", environment.safetyDistance_m);
    fill("field_cell_m", environment.fieldCell_m);
    ConfigNode* const map = environment.map ? block.find("map") : nullptr;
    if (!map) return block;
    const std::filesystem::path& file = environment.map->file;
    const ConfigNode path = makeScalar(
        (std::filesystem::canonical(std::filesystem::absolute(file).parent_path()) / file.filename()).string(), true);
    const ConfigNode sha256 = makeScalar(environment.map->sha256, true);
    for (const auto& [key, value] : {std::pair("file", path), std::pair("sha256", sha256)})
        if (ConfigNode* const known = map->find(key))
            *known = value;
        else
            map->entries.emplace_back(key, value);
    return block;
}

DisturbanceSet makeDisturbanceSet(const Parameters& p) {
    DisturbanceSet set;
    set.frictionScale = p.jointNumbers("friction_scale");
    set.breakawayRatio = p.number("breakaway_ratio");
    set.loadFriction = p.jointNumbers("load_friction");
    set.massError = p.jointNumbers("mass_error");
    set.payload_kg = p.number("payload_kg");
    set.payloadOffset_m = p.number("payload_offset_m");
    set.baseTilt_rad = p.number("base_tilt_rad");
    set.torqueRipple_Nm = p.jointNumbers("torque_ripple_Nm");
    set.externalTorque_Nm = p.jointNumbers("external_torque_Nm");
    set.torqueLimitFactor = p.number("torque_limit_factor");
    set.readingError_rad = p.number("reading_error_rad");
    set.delayTicks = static_cast<int>(p.integer("delay_ticks"));
    return set;
}

/** Bounds that are remembered at a time; a sweep may draw its disturbance_set. */
constexpr std::size_t kMostKnownBounds = 64;

/** The bound for a case as far as it is read. It takes seconds and depends on little: the same inputs, of several cases
or of the runs of a sweep, are computed once. */
TrackingBound findBound(const CasePlan& plan, const Parameters& disturbances,
                        const std::optional<Parameters>& payload) {
    const Parameters& loop = plan.robustLoop->parameters;
    const NricOptions gains{loop.jointNumbers("k_r"), loop.jointNumbers("k_p"), loop.jointNumbers("k_i")};
    const ConfigNode inputs = makeMap({{"robot", makeScalar(std::filesystem::canonical(plan.robot.folder), true)},
                                       {"tick_s", makeNumber(plan.tick_s)},
                                       {"position", makeBounds(plan.realLimits.position)},
                                       {"velocity", makeBounds(plan.realLimits.velocity)},
                                       {"acceleration", makeBounds(plan.realLimits.acceleration)},
                                       {"jerk", makeBounds(plan.realLimits.jerk)},
                                       {"gains", makeMap({{"k_r", makeList(gains.kr.expand(plan.robot.size()))},
                                                          {"k_p", makeList(gains.kp.expand(plan.robot.size()))},
                                                          {"k_i", makeList(gains.ki.expand(plan.robot.size()))}})},
                                       {"payload", payload ? payload->resolved() : ConfigNode()},
                                       {"disturbance_set", disturbances.resolved()}});
    static detail::Memo<TrackingBound> known(kMostKnownBounds);
    return known.get(writeConfig(inputs), [&] {
        return calcTrackingBound(plan.robot, plan.realLimits, plan.tick_s, gains, makeDisturbanceSet(disturbances),
                                 disturbances.resolved().place());
    });
}

/** `bounds` with `margin` less on each side. */
JointBounds tighten(const JointBounds& bounds, const JointVector& margin, const char* quantity, const char* unit,
                    const RobotDescription& robot, const std::string& place) {
    for (int i = 0; i < robot.size(); ++i) {
        const double range = bounds.upper[i] - bounds.lower[i];
        if (2.0 * margin[i] < range) continue;
        throw badInput(place,
                       std::string("hold_on: real leaves the nominal ") +
                           robot.joints[static_cast<std::size_t>(i)].name + " no " + quantity + ": its limits are " +
                           detail::formatNumber(range) + " " + unit + " apart and the tracking bound takes " +
                           detail::formatNumber(2.0 * margin[i]) + " " + unit,
                       "`viable bound` shows what the bound consists of: widen the limits, raise the gains of "
                       "the robust loop or state a smaller disturbance_set.");
    }
    return {bounds.lower + margin, bounds.upper - margin};
}

/** `missed_ticks: [{at_s: 3.0, count: 20}, ...]` */
std::vector<TickGap> readMissedTicks(const ConfigNode& node, double tick_s, double duration_s) {
    if (node.kind != ConfigNode::Kind::List)
        throw badInput(node.place(), "missed_ticks must be a list",
                       "Write for example `missed_ticks: [{at_s: 3.0, count: 20}]`.");
    std::vector<TickGap> gaps;
    for (const ConfigNode& item : node.items) {
        ConfigMap map(item);
        map.find("at_s");
        map.find("count");
        map.finish();  // unknown keys first: a misspelt key explains a missing one
        const double at_s = toNumber(map.require("at_s"), {0.0, duration_s});
        const ParameterSpec& range = detail::getKey(detail::gapKeys(), "count");
        const std::int64_t count =
            toInteger(map.require("count"), detail::getSmallest(range), detail::getLargest(range));
        gaps.push_back({std::llround(at_s / tick_s), count});
    }
    return gaps;
}

ConfigNode makeMissedTicks(const std::vector<TickGap>& gaps, double tick_s) {
    ConfigNode list;
    list.kind = ConfigNode::Kind::List;
    for (const TickGap& gap : gaps)
        list.items.push_back(makeMap({{"at_s", makeNumber(static_cast<double>(gap.begin) * tick_s)},
                                      {"count", makeScalar(std::to_string(gap.count))}}));
    return list;
}

/** Reads one case: `node` is the file's root overlaid by the case. */
class CaseReader {
public:
    CaseReader(const ConfigNode& node, const PluginLoader& loader, const std::vector<std::filesystem::path>& robotPath,
               const std::vector<std::string>& overrides)
        : map_(node), loader_(loader), robotPath_(robotPath), overrides_(overrides) {
        // Unknown keys first: a misspelt key explains a missing one.
        for (const detail::ExperimentKey& key : detail::experimentKeys()) map_.find(key.spec.name);
        map_.finish();
    }

    CasePlan read(const std::string& name, const std::string& title) {
        CasePlan plan;
        plan.name = name;
        const ConfigNode& robotNode = map_.require("robot");
        plan.robot = loadRobot(findRobot(toText(robotNode), robotPath_, robotNode.place()));
        std::optional<Parameters> payload;
        if (const ConfigNode* node = map_.find("payload")) {
            payload = readPayload(*node, plan.robot.size());
            plan.robot = takePayload(std::move(plan.robot), *payload);
        }
        plan.tick_s = readTick(map_.find("tick_s"));
        NumberRange durations = detail::getKey(detail::experimentKeys(), "duration_s").range();
        durations.min = plan.tick_s;
        durations.minIsOpen = false;
        plan.duration_s = toNumber(map_.require("duration_s"), durations);

        const ConfigNode* limits = map_.find("limits");
        bool allowLargeAngles = plan.robot.allowLargeAngles;
        plan.limits = plan.robot.limits;
        if (limits) {
            refuseMissingUnit(*limits, getNames(detail::limitKeys()));
            ConfigMap known(*limits);
            for (const detail::ExperimentKey& key : detail::limitKeys()) known.find(key.spec.name);
            known.finish();
            ConfigNode quantities = *limits;  // a robot's own limits have no hold_on
            if (const ConfigNode* held = limits->find("hold_on")) {
                plan.holdsOnReal = toChoice(*held, {"nominal", "real"}) == "real";
                quantities.entries.erase(std::remove_if(quantities.entries.begin(), quantities.entries.end(),
                                                        [](const auto& entry) { return entry.first == "hold_on"; }),
                                         quantities.entries.end());
            }
            plan.limits = readLimits(quantities, plan.robot.limits, allowLargeAngles);
        }
        checkLimits(
            plan.limits, plan.tick_s, allowLargeAngles,
            limits ? describePlace(*limits, "limits", name, overrides_) : plan.robot.folder.string() + "/limits.yaml",
            plan.robot.jointNames());
        plan.realLimits = plan.limits;
        const ConfigNode* start = map_.find("start");
        plan.start = readStart(start, plan.robot);
        plan.startPlace = start ? describePlace(*start, "start", name, overrides_) : map_.node().file;
        if (const ConfigNode* missed = map_.find("missed_ticks"))
            plan.missedTicks = readMissedTicks(*missed, plan.tick_s, plan.duration_s);
        const ConfigNode* environment = map_.find("environment");
        if (environment) {
            plan.environment = readEnvironment(*environment);
            // From here on it is this file, whoever reads it and when.
            if (plan.environment->map && plan.environment->map->sha256.empty())
                plan.environment->map->sha256 = detail::calcSha256(plan.environment->map->file);
            plan.geometry = loadArmGeometry(plan.robot);
        }

        plan.command = readPlugin(map_.require("command"), PluginKind::CommandSource, plan.robot.size());
        plan.controller = readPlugin(map_.require("controller"), PluginKind::NominalController, plan.robot.size());
        plan.filters = readFilters(map_.require("filter"), plan.robot.size());
        const ConfigNode* robustLoop = map_.find("robust_loop");
        const ConfigNode* realPlant = map_.find("real_plant");
        if (robustLoop && !realPlant)
            throw badInput(robustLoop->place(), "there is a robust_loop but no real_plant for it to act on",
                           "Add `real_plant: {plugin: simbody}` or remove robust_loop.");
        if (realPlant && !robustLoop)
            throw badInput(realPlant->place(), "there is a real_plant but no robust_loop",
                           "Add `robust_loop: {plugin: nric}`, or `robust_loop: {plugin: none}` to run the "
                           "real arm on the filter's torque alone.");
        if (realPlant) {
            plan.robustLoop = readPlugin(*robustLoop, PluginKind::RobustLoop, plan.robot.size());
            plan.realPlant = readPlugin(*realPlant, PluginKind::RealPlant, plan.robot.size());
        }
        if (const ConfigNode* node = map_.find("external_torque")) readExternalTorque(*node, plan);
        const ConfigNode* disturbances = map_.find("disturbance_set");
        std::optional<Parameters> sizes;
        if (disturbances) {
            sizes = readDisturbances(*disturbances, plan.robot.size());
            takeBound(plan, *sizes, payload);
        }
        if (plan.holdsOnReal) {
            const std::string place = describePlace(*limits, "limits", name, overrides_);
            holdOnReal(plan, place);
            checkLimits(plan.limits, plan.tick_s, allowLargeAngles, place, plan.robot.jointNames());
        }
        plan.resolved = resolve(plan, title, allowLargeAngles, sizes);
        // Before the cases, which stand last.
        const auto add = [&](const char* key, ConfigNode node) {
            plan.resolved.entries.emplace(plan.resolved.entries.end() - 1, key, std::move(node));
        };
        if (payload) add("payload", payload->resolved());
        if (environment) add("environment", resolveEnvironment(*environment, *plan.environment));
        return plan;
    }

private:
    /** Cases with another robust loop have no bound: nothing is known about it. */
    static void takeBound(CasePlan& plan, const Parameters& disturbances, const std::optional<Parameters>& payload) {
        const std::string place = disturbances.resolved().place();
        if (!plan.realPlant)
            throw badInput(place, "there is a disturbance_set but no real_plant that it could disturb",
                           "Add real_plant and robust_loop, or remove it.");
        if (plan.robustLoop->plugin.name != "nric") return;
        const JointVector& moving = plan.start.qd;
        for (int i = 0; i < plan.robot.size(); ++i)
            if (moving[i] != 0.0 || plan.start.qdd[i] != 0.0)
                throw badInput(plan.startPlace,
                               "the tracking bound is for arms that start at rest, and " +
                                   plan.robot.joints[static_cast<std::size_t>(i)].name + " does not",
                               "Start at rest, or remove the disturbance_set.");
        plan.bound = findBound(plan, disturbances, payload);
        checkAssumptions(plan, disturbances);
        plan.boundPlace = place;
    }

    /** Of the bound, on the robust loop's own limits and on pushes that are fed. */
    static void checkAssumptions(const CasePlan& plan, const Parameters& disturbances) {
        const Parameters& loop = plan.robustLoop->parameters;
        const auto check = [&](const char* key, const char* unit, double factor, const JointVector& needed) {
            const JointVector& given = loop.jointNumbers(key);
            for (int i = 0; i < plan.robot.size(); ++i) {
                if (std::isinf(given[i]) || factor * given[i] >= needed[i]) continue;
                throw badInput(loop.place(key),
                               "with " + detail::formatNumber(given[i]) + " " + unit + " at " +
                                   plan.robot.joints[static_cast<std::size_t>(i)].name +
                                   " the tracking bound does not hold: within the disturbance_set it takes up to " +
                                   detail::formatNumber(needed[i] / factor) + " " + unit,
                               "Raise it, leave it out, or remove the disturbance_set.");
            }
        };
        check("integral_limit_Nm", "Nm", 1.0, plan.bound->integralTorque);
        check("torque_rate_Nmps", "Nm/s", plan.tick_s, plan.bound->torqueStep);
        const ConfigNode* encoder = plan.realPlant->parameters.resolved().find("encoder");
        if (encoder && encoder->text == "exact")
            throw badInput(plan.realPlant->parameters.place("encoder"),
                           "the tracking bound is for encoders that tell positions in counts, and velocities as their "
                           "difference; this plant's tells the truth",
                           "Use `encoder: robot`, or remove the disturbance_set.");
        if (plan.feedsExternalTorque && disturbances.integer("delay_ticks") > 0)
            throw badInput(plan.externalTorquePlace,
                           "pushes that are fed to the nominal arm reach the motors of the real one later, by the "
                           "delay_ticks of the disturbance_set: no tracking bound covers that",
                           "Use `external_torque: ignored` and state external_torque_Nm, or no delay.");
    }

    static void holdOnReal(CasePlan& plan, const std::string& place) {
        if (!plan.bound)
            throw badInput(place, "hold_on: real needs a tracking bound, and this case has none",
                           "State a disturbance_set and use the robust loop nric.");
        plan.limits.position =
            tighten(plan.realLimits.position, plan.bound->position, "range", "rad", plan.robot, place);
        plan.limits.velocity =
            tighten(plan.realLimits.velocity, plan.bound->velocity, "velocity", "rad/s", plan.robot, place);
    }

    static void readExternalTorque(const ConfigNode& node, CasePlan& plan) {
        plan.feedsExternalTorque = toChoice(node, {"to_nominal", "ignored"}) == "to_nominal";
        plan.externalTorquePlace = node.place();
        if (plan.feedsExternalTorque && !plan.realPlant)
            throw badInput(node.place(), "there is no real_plant that could measure an external torque",
                           "Add `real_plant` and `robust_loop`, or remove external_torque.");
    }

    /** One block, or a list of blocks and of names without parameters. */
    std::vector<PluginChoice> readFilters(const ConfigNode& node, int joints) const {
        std::vector<PluginChoice> filters;
        if (node.kind != ConfigNode::Kind::List) {
            filters.push_back(readPlugin(node, PluginKind::SafetyFilter, joints));
            return filters;
        }
        if (node.items.empty() || node.items.size() > detail::kMaxFilters)
            throw badInput(node.place(),
                           "a list of filters must have 1 to " + std::to_string(detail::kMaxFilters) +
                               " entries, this one has " + std::to_string(node.items.size()),
                           "Write for example `filter: [{plugin: tosbp}, certified_braking]`.");
        for (const ConfigNode& item : node.items) {
            if (item.kind != ConfigNode::Kind::Scalar) {
                filters.push_back(readPlugin(item, PluginKind::SafetyFilter, joints));
                continue;
            }
            ConfigNode block = makeMap({{"plugin", item}});
            block.file = item.file;
            block.line = item.line;
            block.column = item.column;
            block.keyPath = item.keyPath;
            filters.push_back(readPlugin(block, PluginKind::SafetyFilter, joints));
        }
        return filters;
    }

    PluginChoice readPlugin(const ConfigNode& block, PluginKind kind, int joints) const {
        if (block.kind != ConfigNode::Kind::Map || !block.find("plugin"))
            throw badInput(
                block.place(), "the block must name a plugin",
                "Write `{plugin: " + (block.kind == ConfigNode::Kind::Scalar ? block.text : std::string("NAME")) +
                    ", ...parameters}`; `viable plugins` lists the names.");
        const ConfigNode& name = *block.find("plugin");
        const PluginInfo info =
            loader_.find(kind, toText(name), name.place(), std::filesystem::path(name.file).parent_path());
        return {info, readParameters(block, info.entry->parameters, info.entry->parameterCount, joints)};
    }

    /** The block as it must stand in a file of any folder. */
    static ConfigNode resolve(const PluginChoice& choice) {
        ConfigNode block = choice.parameters.resolved();
        ConfigNode* name = block.find("plugin");
        if (name->text.find('/') != std::string::npos) {  // named by its path
            name->text = choice.plugin.library.string();
            name->quoted = true;
        }
        return block;
    }

    static ConfigNode resolve(const std::vector<PluginChoice>& filters) {
        if (filters.size() == 1) return resolve(filters.front());
        ConfigNode list;
        list.kind = ConfigNode::Kind::List;
        for (const PluginChoice& filter : filters) list.items.push_back(resolve(filter));
        return list;
    }

    static ConfigNode resolve(const CasePlan& plan, const std::string& title, bool allowLargeAngles,
                              const std::optional<Parameters>& disturbances) {
        const JointLimits& written = plan.realLimits;
        ConfigNode limits = makeMap({{"position_rad", makeBounds(written.position)},
                                     {"velocity_radps", makeBounds(written.velocity)},
                                     {"acceleration_radps2", makeBounds(written.acceleration)},
                                     {"jerk_radps3", makeBounds(written.jerk)}});
        if (plan.holdsOnReal) limits.entries.emplace_back("hold_on", makeScalar("real"));
        if (allowLargeAngles) limits.entries.emplace_back("allow_large_angles", makeScalar("true"));
        ConfigNode node = makeMap({{"schema", makeScalar("1")},
                                   {"title", makeScalar(title, true)},
                                   {"robot", makeScalar(std::filesystem::canonical(plan.robot.folder).string(), true)},
                                   {"duration_s", makeNumber(plan.duration_s)},
                                   {"tick_s", makeNumber(plan.tick_s)},
                                   {"start", makeMap({{"position_rad", makeList(plan.start.q)},
                                                      {"velocity_radps", makeList(plan.start.qd)},
                                                      {"acceleration_radps2", makeList(plan.start.qdd)}})},
                                   {"limits", limits},
                                   {"command", resolve(plan.command)},
                                   {"controller", resolve(plan.controller)}});
        if (plan.realPlant) {
            if (plan.feedsExternalTorque) node.entries.emplace_back("external_torque", makeScalar("to_nominal"));
            node.entries.emplace_back("robust_loop", resolve(*plan.robustLoop));
            node.entries.emplace_back("real_plant", resolve(*plan.realPlant));
        }
        if (disturbances) node.entries.emplace_back("disturbance_set", disturbances->resolved());
        if (!plan.missedTicks.empty())
            node.entries.emplace_back("missed_ticks", makeMissedTicks(plan.missedTicks, plan.tick_s));
        node.entries.emplace_back("cases", makeMap({{plan.name, makeMap({{"filter", resolve(plan.filters)}})}}));
        return node;
    }

    ConfigMap map_;
    const PluginLoader& loader_;
    const std::vector<std::filesystem::path>& robotPath_;
    const std::vector<std::string>& overrides_;
};

/** Case names become file names. */
void checkCaseName(const std::string& name, const ConfigNode& node) {
    const bool plain = !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](unsigned char c) {
        return std::isalnum(c) || c == '_' || c == '-' || c == '+';
    });
    if (!plain)
        throw badInput(node.place(), "'" + name + "' cannot be the name of a case",
                       "Use 1 to 64 letters, digits, '_', '-' or '+': the name becomes a file name.");
}

/** Refuses what no case would ever see: a key at the top that every case replaces. */
void checkUse(const ConfigNode& shared, const ConfigNode& cases) {
    for (const auto& [key, node] : shared.entries) {
        if (!isCaseKey(key)) continue;
        bool used = false;
        for (const auto& [name, own] : cases.entries) {
            const ConfigNode* replacement = own.find(key);
            const ConfigNode* mine = node.find("plugin");
            const ConfigNode* theirs = replacement ? replacement->find("plugin") : nullptr;
            used |= !replacement || (node.kind == ConfigNode::Kind::Map && replacement->kind == ConfigNode::Kind::Map &&
                                     (!mine || !theirs || mine->text == theirs->text));
        }
        if (!used)
            throw badInput(
                node.place(), "no case uses this: every case has a `" + key + "` of its own",
                "Remove it, or set it in the case: `cases." + cases.entries.front().first + "." + key + "`.");
    }
}

/** An override may change a case, not invent one. */
void checkCaseIsInFile(const std::string& name, const ConfigNode& node, const ConfigNode& cases) {
    if (node.kind != ConfigNode::Kind::Map || node.file == cases.file) return;
    std::vector<std::string> names;
    for (const auto& [other, itsNode] : cases.entries)
        if (itsNode.file == cases.file) names.push_back(other);
    const std::string closest = findClosestName(name, names);
    throw badInput(
        node.place(), "there is no case '" + name + "'",
        (closest.empty() ? "" : "Did you mean '" + closest + "'? ") + "The file's cases: " + detail::join(names) + ".");
}

}  // namespace

std::string CasePlan::filterName() const {
    std::string text;
    for (const PluginChoice& filter : filters) detail::addItem(text, filter.plugin.name, " + ");
    return text;
}

ConfigNode readExperimentTree(const std::filesystem::path& file, const std::vector<std::string>& overrides) {
    ConfigNode root = readConfigFile(file);
    for (const std::string& assignment : overrides) applyOverride(root, assignment);
    return root;
}

Experiment readExperiment(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                          const PluginLoader& loader, const std::vector<std::filesystem::path>& robotPath) {
    return readExperiment(readExperimentTree(file, overrides), file, overrides, loader, robotPath);
}

Experiment readExperiment(const ConfigNode& root, const std::filesystem::path& file,
                          const std::vector<std::string>& overrides, const PluginLoader& loader,
                          const std::vector<std::filesystem::path>& robotPath) {
    const std::vector<DrawnKey> draws = listDraws(root);
    if (!draws.empty())
        throw badInput(
            draws.front().place, "`~" + draws.front().distribution + "` is drawn anew for every run of a sweep",
            "`viable sweep " + file.string() + "` runs them; `--draw SEED:INDEX` takes the values of one of its runs");

    Experiment experiment;
    experiment.file = file;
    {
        ConfigMap top(root);
        const std::int64_t schema = toInteger(top.require("schema"), 0, 1000000);
        if (schema != 1)
            throw badInput(root.find("schema")->place(),
                           "schema is " + std::to_string(schema) + ", this program reads 1",
                           "Use the version of viable that the file was written for.");
        experiment.title = toText(top.require("title"));
        const ConfigNode& cases = top.require("cases");
        if (cases.kind != ConfigNode::Kind::Map || cases.entries.empty())
            throw badInput(cases.place(), "cases must be a map with at least one case",
                           "Write for example `cases: {mine: {filter: {plugin: tosbp}}}`.");
    }
    ConfigNode shared = root;
    shared.entries.erase(std::remove_if(shared.entries.begin(), shared.entries.end(),
                                        [](const auto& entry) { return entry.first == "cases"; }),
                         shared.entries.end());
    checkUse(shared, *root.find("cases"));
    for (const auto& [name, node] : root.find("cases")->entries) {
        checkCaseName(name, node);
        checkCaseIsInFile(name, node, *root.find("cases"));
        ConfigNode own = node;
        if (own.kind == ConfigNode::Kind::Empty) own.kind = ConfigNode::Kind::Map;
        if (own.kind != ConfigNode::Kind::Map)
            throw badInput(node.place(), "a case must be a map of the keys that it changes");
        for (const detail::ExperimentKey& key : detail::experimentKeys())
            if (const ConfigNode* misplaced = key.isTopOnly ? own.find(key.spec.name) : nullptr)
                throw badInput(misplaced->place(),
                               "'" + std::string(key.spec.name) + "' belongs to the top of the file, not to a case");
        const ConfigNode merged = overlay(shared, own);
        experiment.cases.push_back(CaseReader(merged, loader, robotPath, overrides).read(name, experiment.title));
    }
    return experiment;
}

}  // namespace viable
