#include "experiment/ExperimentKeys.h"

#include "viable/core/Error.h"

namespace viable::detail {

namespace {

ExperimentKey makeBlock(const char* name, const char* defaultText, KeyForm form, const char* help,
                        PluginKind kind = PluginKind::CommandSource) {
    return {parameter::text(name, defaultText, help), form, kind};
}

ExperimentKey makeTopOnly(const ParameterSpec& spec, KeyForm form = KeyForm::Value) {
    return {spec, form, PluginKind::CommandSource, true};
}

ExperimentKey makeBounds(const char* name, const char* unit, KeyForm form, const char* help) {
    return {parameter::jointNumbers(name, unit, "", help).above(0).orInfinite(), form};
}

}  // namespace

const std::vector<ExperimentKey>& experimentKeys() {
    static const std::vector<ExperimentKey> keys = {
        makeTopOnly(parameter::integer("schema", nullptr, "Version of the file format.")
                        .atLeast(1)
                        .upTo(1)),
        makeTopOnly(parameter::text("title", nullptr, "The question, shown in reports.")),
        {parameter::text("robot", nullptr, "A folder in robots/, or a path.")},
        {parameter::number("duration_s", "s", nullptr, "Length of the run; at least one tick.")
             .above(0)
             .upTo(24.0 * 3600.0)},
        {parameter::number("tick_s", "s", "0.001", "Length of a tick.")
             .atLeast(kShortestTick_s)
             .upTo(kLongestTick_s)},
        makeBlock("limits", "", KeyForm::Limits,
                  "Limits over the robot's own; \"no limit\" is .inf."),
        makeBlock("start", "", KeyForm::Start, "State at the start."),
        makeBlock("command", nullptr, KeyForm::Plugin, "What is asked for.",
                  PluginKind::CommandSource),
        makeBlock("controller", nullptr, KeyForm::Plugin, "The torque law that wants to get there.",
                  PluginKind::NominalController),
        makeBlock("filter", nullptr, KeyForm::Plugins, "What keeps the limits.",
                  PluginKind::SafetyFilter),
        makeBlock("robust_loop", "", KeyForm::Plugin,
                  "What keeps the real arm next to the nominal one; only with real_plant.",
                  PluginKind::RobustLoop),
        makeBlock("real_plant", "", KeyForm::Plugin, "The real arm; only with robust_loop.",
                  PluginKind::RealPlant),
        makeBlock("missed_ticks", "", KeyForm::Gaps, "Ticks in which the computer comes too late."),
        makeTopOnly(parameter::text("cases", nullptr,
                                    "What differs; everything at the top is shared by all cases."),
                    KeyForm::Cases),
    };
    return keys;
}

const std::vector<ExperimentKey>& limitKeys() {
    static const std::vector<ExperimentKey> keys = {
        makeBounds("position_rad", "rad", KeyForm::Positions,
                   "x (that is -x to x), {lower, upper} or {center, half_range}."),
        makeBounds("velocity_radps", "rad/s", KeyForm::Bounds,
                   "x (that is -x to x) or {lower, upper}."),
        makeBounds("acceleration_radps2", "rad/s^2", KeyForm::Bounds,
                   "x (that is -x to x) or {lower, upper}."),
        makeBounds("jerk_radps3", "rad/s^3", KeyForm::Bounds,
                   "x (that is -x to x) or {lower, upper}."),
        {parameter::flag("allow_large_angles", "false",
                         "Position limits beyond 4 pi are meant so, not degrees.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& startKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::jointNumbers("position_rad", "rad", "", "Default: the robot's home pose.")},
        {parameter::jointNumbers("velocity_radps", "rad/s", "0", "Of every joint.")},
        {parameter::jointNumbers("acceleration_radps2", "rad/s^2", "0", "Of every joint.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& gapKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("at_s", "s", nullptr, "Time of the first missed tick, within the run.")
             .atLeast(0)},
        // Beyond what the loop bears in a row, so that its answer to that can be tried.
        {parameter::integer("count", nullptr, "How many ticks are missed.").atLeast(1).upTo(1e6)},
    };
    return keys;
}

const ParameterSpec& getKey(const std::vector<ExperimentKey>& keys, const std::string& name) {
    for (const ExperimentKey& key : keys)
        if (name == key.spec.name) return key.spec;
    VIABLE_CHECK(false, "a key of an experiment file that is not declared");
}

}  // namespace viable::detail
