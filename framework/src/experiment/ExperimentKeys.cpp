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
        makeBlock("disturbance_set", "", KeyForm::Disturbances,
                  "What the real arm may have that the nominal one has not: with it a bound on the tracking error is "
                  "known, which trips the run when it is passed; with the robust loop nric."),
        {parameter::choice("external_torque", "to_nominal|ignored", "ignored",
                           "What the surroundings put on the real arm, as it measures it: moves the nominal "
                           "arm, too, or is left to the robust loop; only with real_plant.")},
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
        {parameter::choice("hold_on", "nominal|real", "nominal",
                           "real: position and velocity limits are those of the real arm; the nominal one gets them "
                           "tighter by the tracking bound of the disturbance_set.")},
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

const std::vector<ExperimentKey>& disturbanceKeys() {
    // Defaults: those of DisturbanceSet.
    static const std::vector<ExperimentKey> keys = {
        {parameter::jointNumbers("friction_scale", "", "1.0",
                                 "Largest factor on the robot's friction figures; 0: no friction.")
             .atLeast(0)},
        {parameter::number("breakaway_ratio", "", "1.0",
                           "Largest friction at standstill over Coulomb friction.")
             .atLeast(1)},
        {parameter::jointNumbers("load_friction", "", "0.0",
                                 "Largest friction per torque that the joint carries.")
             .atLeast(0)
             .below(1)},
        {parameter::jointNumbers("mass_error", "", "0.0",
                                 "Masses and inertias are within 1 - this and 1 + this of the model's.")
             .atLeast(0)
             .below(1)},
        {parameter::number("payload_kg", "kg", "0.0", "Largest payload.").atLeast(0)},
        {parameter::number("payload_offset_m", "m", "0.0",
                           "Its farthest from the tool frame's origin.")
             .atLeast(0)},
        {parameter::number("base_tilt_rad", "rad", "0.0", "Largest tilt of the base.")
             .atLeast(0)
             .upTo(3.15)},
        {parameter::jointNumbers("torque_ripple_Nm", "Nm", "0.0", "Largest torque ripple.")
             .atLeast(0)},
        {parameter::jointNumbers("external_torque_Nm", "Nm", "0.0",
                                 "Largest torque of pushes that are not fed to the nominal arm.")
             .atLeast(0)},
        {parameter::number("torque_limit_factor", "", "1.0",
                           "Least motor torque, as a share of the robot's figure.")
             .above(0)
             .orInfinite()},
        {parameter::number("reading_error_rad", "rad", "0.0",
                           "Largest error of a reading besides its rounding; of a plant with encoder_noise_rad (a "
                           "standard deviation, cut at four) four times that.")
             .atLeast(0)},
        {parameter::integer("delay_ticks", "0", "Between the computed torque and the motors.")
             .atLeast(0)
             .upTo(20)},
    };
    return keys;
}

const ParameterSpec& getKey(const std::vector<ExperimentKey>& keys, const std::string& name) {
    for (const ExperimentKey& key : keys)
        if (name == key.spec.name) return key.spec;
    VIABLE_CHECK(false, "a key of an experiment file that is not declared");
}

}  // namespace viable::detail
