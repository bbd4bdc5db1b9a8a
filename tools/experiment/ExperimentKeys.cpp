#include "experiment/ExperimentKeys.h"

namespace viable::detail {

namespace {

/** A file as a whole. Blocks of plugins are texts here: what may stand in them, the plugins say. */
struct ExperimentSettings {
    int schema = 1;
    std::string title, robot, command, controller, filter, robustLoop, realPlant, cases;
    double duration_s = 0.0, tick_s = 0.001;
    PayloadSettings payload;
    LimitSettings limits;
    StartSettings start;
    std::optional<EnvironmentSettings> environment;
    SpeedLimits speedLimits;
    std::optional<StreamOptions> stream;
    std::optional<DisturbanceSet> disturbances;
    bool ignoresExternalTorque = true;
    std::vector<GapSettings> missedTicks;

    template <class V>
    void describe(V& v) {
        v(schema, "schema", "Version of the file format.").atLeast(1).upTo(1).required();
        v(title, "title", "The question, shown in reports.").required();
        v(robot, "robot", "A folder in robots/, or a path.").required();
        v(duration_s, "duration_s", "s", "Length of the run; at least one tick.")
            .above(0)
            .upTo(24.0 * 3600.0)
            .required();
        v(tick_s, "tick_s", "s", "Length of a tick.").atLeast(kShortestTick_s).upTo(kLongestTick_s);
        payload.describe(v);
        v(limits, "limits", "Limits over the robot's own; \"no limit\" is .inf.");
        v(start, "start", "State at the start.");
        v(environment, "environment",
          "The surroundings of the arm. With them, even empty ({}), the arm is also checked against itself; the robot "
          "needs a collision.yaml.");
        v(speedLimits, "speed_limits",
          "Largest speeds of the arm's points, over those of the robot's limits.yaml; \"no limit\" is .inf, `regions: "
          "{}` no region. whole_arm_braking keeps them; arm_mps and regions need a collision.yaml.");
        v(command, "command", "What is asked for.").required();
        v(stream, "stream",
          "The command comes in samples over a line, which may be slow and lossy; without it every tick has its "
          "command.");
        v(controller, "controller", "The torque law that follows the command.").required();
        v(filter, "filter", "What keeps the limits.").required();
        v(robustLoop, "robust_loop", "What keeps the real arm next to the nominal one; only with real_plant.");
        v(realPlant, "real_plant", "The real arm; only with robust_loop.");
        v(disturbances, "disturbance_set",
          "Disturbances of the real arm that the nominal one does not have. They give a bound on the tracking error; a "
          "run trips when it is passed. Needs the robust loop nric.");
        v(ignoresExternalTorque, "external_torque", "to_nominal|ignored",
          "What the surroundings put on the real arm, as it measures it: moves the nominal arm, too, or is left to the "
          "robust loop; only with real_plant.");
        v(missedTicks, "missed_ticks", "Ticks in which the computer is too late.");
        v(cases, "cases", "What differs; everything at the top is shared by all cases.").required();
    }
};

}  // namespace

const std::vector<ExperimentKey>& experimentKeys() {
    static const std::vector<ExperimentKey> keys = [] {
        const std::map<std::string, ExperimentKey> others = {
            {"command", {{}, KeyForm::Plugin, PluginKind::CommandSource}},
            {"controller", {{}, KeyForm::Plugin, PluginKind::NominalController}},
            {"filter", {{}, KeyForm::Plugins, PluginKind::SafetyFilter}},
            {"robust_loop", {{}, KeyForm::Plugin, PluginKind::RobustLoop}},
            {"real_plant", {{}, KeyForm::Plugin, PluginKind::RealPlant}},
            {"cases", {{}, KeyForm::Cases, {}, true}},
            {"schema", {{}, KeyForm::Setting, {}, true}},
            {"title", {{}, KeyForm::Setting, {}, true}},
        };
        std::vector<ExperimentKey> all;
        for (const ParameterSpec& spec : settingsOf<ExperimentSettings>()) {
            const auto other = others.find(spec.name);
            all.push_back(other == others.end() ? ExperimentKey() : other->second);
            all.back().spec = spec;
        }
        return all;
    }();
    return keys;
}

std::vector<std::string> listNames(const std::vector<ExperimentKey>& keys) {
    std::vector<std::string> names;
    for (const ExperimentKey& key : keys) names.push_back(key.spec.name);
    return names;
}

const ParameterSpec& getKey(const std::string& name) {
    for (const ExperimentKey& key : experimentKeys())
        if (name == key.spec.name) return key.spec;
    VIABLE_CHECK(false, "a key of an experiment file that is not declared");
}

}  // namespace viable::detail
