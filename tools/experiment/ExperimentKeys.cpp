#include "experiment/ExperimentKeys.h"

#include "core/Text.h"
#include "viable/core/Error.h"
#include "viable/environment/People.h"
#include "viable/robot/SpeedLimits.h"

namespace viable::detail {

namespace {

ExperimentKey makeBlock(const char* name, const char* defaultText, KeyForm form, const char* help,
                        PluginKind kind = PluginKind::CommandSource) {
    return {parameter::text(name, defaultText, help), form, kind};
}

ExperimentKey makeBlock(const char* name, const char* defaultText, const std::vector<ExperimentKey>& (*keys)(),
                        const char* help, KeyForm form = KeyForm::Block) {
    return {parameter::text(name, defaultText, help), form, PluginKind::CommandSource, false, keys};
}

ExperimentKey makeTopOnly(const ParameterSpec& spec, KeyForm form = KeyForm::Value) {
    return {spec, form, PluginKind::CommandSource, true};
}

ExperimentKey makeBounds(const char* name, const char* unit, KeyForm form, const char* help) {
    return {parameter::jointNumbers(name, unit, "", help).above(0).orInfinite(), form};
}

// --- parts of `environment`: what readEnvironment() knows, with its ranges

ParameterSpec makePlace(const char* name, const char* help) {
    return parameter::numbers(name, "m", 3, 3, nullptr, help).atLeast(-1000).upTo(1000);
}

ParameterSpec makeSize(const char* name, const char* defaultText, const char* help) {
    return parameter::number(name, "m", defaultText, help).above(0).upTo(1000);
}

const std::vector<ExperimentKey>& poseKeys() {
    static const std::vector<ExperimentKey> keys = {
        {makePlace("xyz", "Origin in the robot's base frame.")},
        {parameter::numbers("rpy", "rad", 3, 3, "[0, 0, 0]",
                            "Roll, pitch and yaw as in a URDF: about x, then y, then z of the base frame.")
             .atLeast(-100)
             .upTo(100)},
    };
    return keys;
}

const std::vector<ExperimentKey>& cylinderKeys() {
    static const std::vector<ExperimentKey> keys = {
        {makeSize("radius", nullptr, "Of the cylinder.")},
        {makeSize("length", nullptr, "Along its z axis.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& halfSpaceKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::numbers("normal", "", 3, 3, nullptr, "Points to the free side.").atLeast(-1000).upTo(1000)},
        {parameter::number("offset", "", nullptr, "A point x is on the surface where normal . x is this.")
             .atLeast(-1000)
             .upTo(1000)},
    };
    return keys;
}

const std::vector<ExperimentKey>& waypointKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("time_s", "s", nullptr, "Of the run; rising.").atLeast(0).upTo(1e6)},
        {makePlace("xyz", "The centre then, base frame.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& obstacleKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::numbers("box", "m", 3, 3, "", "Its edges along x, y and z.").above(0).upTo(1000)},
        {makeSize("sphere", "", "Its radius.")},
        makeBlock("cylinder", "", &cylinderKeys, "Its sizes."),
        makeBlock("half_space", "", &halfSpaceKeys, "All that lies behind a plane is solid: a floor, a wall."),
        makeBlock("at", "", &poseKeys, "The centre of a box, sphere or cylinder, and its orientation."),
        makeBlock("path", "", &waypointKeys,
                  "Of a sphere that moves: straight and at constant speed from one waypoint to the next.",
                  KeyForm::Blocks),
        {parameter::flag("repeats", "false",
                         "After its last waypoint, which is at the place of the first, the path starts again.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& regionKeys() {
    static const std::vector<ExperimentKey> keys = {
        {makePlace("lower_m", "Its corner with the smallest x, y and z, base frame.")},
        {makePlace("upper_m", "Its corner with the largest.")},
        {parameter::number("speed_mps", "m/s", nullptr, "Largest speed there.")
             .atLeast(kSmallestSpeedLimit)
             .orInfinite()},
    };
    return keys;
}

const std::vector<ExperimentKey>& mapKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::text("file", nullptr, "An OctoMap file, .bt or .ot, relative to this file.")},
        {parameter::text("sha256", "", "Of the file; another file is refused.")},
        makeBlock("at", "", &poseKeys, "Where the map's frame lies in the robot's base frame."),
        {parameter::choice("unknown", "occupied|free", "occupied", "How cells without information count.")},
    };
    return keys;
}

}  // namespace

const std::vector<ExperimentKey>& experimentKeys() {
    static const std::vector<ExperimentKey> keys = {
        makeTopOnly(parameter::integer("schema", nullptr, "Version of the file format.").atLeast(1).upTo(1)),
        makeTopOnly(parameter::text("title", nullptr, "The question, shown in reports.")),
        {parameter::text("robot", nullptr, "A folder in robots/, or a path.")},
        {parameter::number("duration_s", "s", nullptr, "Length of the run; at least one tick.")
             .above(0)
             .upTo(24.0 * 3600.0)},
        {parameter::number("tick_s", "s", "0.001", "Length of a tick.").atLeast(kShortestTick_s).upTo(kLongestTick_s)},
        makeBlock("payload", "", &payloadKeys,
                  "A point mass fixed to the tool that the nominal arm knows: model, filter and real arm have it. "
                  "A plant's own payload_kg comes on top of it."),
        makeBlock("limits", "", &limitKeys, "Limits over the robot's own; \"no limit\" is .inf."),
        makeBlock("start", "", &startKeys, "State at the start."),
        makeBlock(
            "environment", "", &environmentKeys,
            "The surroundings of the arm. With them, even empty ({}), the arm is also checked against itself; the "
            "robot needs a collision.yaml."),
        makeBlock("speed_limits", "", &speedLimitKeys,
                  "Largest speeds of the arm's points, over those of the robot's limits.yaml; \"no limit\" is .inf, "
                  "`regions: {}` no region. whole_arm_braking keeps them; arm_mps and regions need a collision.yaml."),
        makeBlock("command", nullptr, KeyForm::Plugin, "What is asked for.", PluginKind::CommandSource),
        makeBlock("stream", "", &streamKeys,
                  "The command comes in samples over a line, which may be slow and lossy; without it every tick has "
                  "its command."),
        makeBlock("controller", nullptr, KeyForm::Plugin, "The torque law that follows the command.",
                  PluginKind::NominalController),
        makeBlock("filter", nullptr, KeyForm::Plugins, "What keeps the limits.", PluginKind::SafetyFilter),
        makeBlock("robust_loop", "", KeyForm::Plugin,
                  "What keeps the real arm next to the nominal one; only with real_plant.", PluginKind::RobustLoop),
        makeBlock("real_plant", "", KeyForm::Plugin, "The real arm; only with robust_loop.", PluginKind::RealPlant),
        makeBlock("disturbance_set", "", &disturbanceKeys,
                  "Disturbances of the real arm that the nominal one does not have. They give a bound on the tracking "
                  "error; a run trips when it is passed. Needs the robust loop nric."),
        {parameter::choice("external_torque", "to_nominal|ignored", "ignored",
                           "What the surroundings put on the real arm, as it measures it: moves the nominal "
                           "arm, too, or is left to the robust loop; only with real_plant.")},
        makeBlock("missed_ticks", "", &gapKeys, "Ticks in which the computer is too late.", KeyForm::Blocks),
        makeTopOnly(parameter::text("cases", nullptr, "What differs; everything at the top is shared by all cases."),
                    KeyForm::Cases),
    };
    return keys;
}

const std::vector<ExperimentKey>& limitKeys() {
    static const std::vector<ExperimentKey> keys = {
        makeBounds("position_rad", "rad", KeyForm::Positions,
                   "x (that is -x to x), {lower, upper} or {center, half_range}."),
        makeBounds("velocity_radps", "rad/s", KeyForm::Bounds, "x (that is -x to x) or {lower, upper}."),
        makeBounds("acceleration_radps2", "rad/s^2", KeyForm::Bounds, "x (that is -x to x) or {lower, upper}."),
        makeBounds("jerk_radps3", "rad/s^3", KeyForm::Bounds, "x (that is -x to x) or {lower, upper}."),
        {parameter::flag("allow_large_angles", "false", "Position limits beyond 4 pi are intended, not degrees.")},
        {parameter::choice("hold_on", "nominal|real", "nominal",
                           "real: position and velocity limits are those of the real arm; the nominal one gets them "
                           "tighter by the tracking bound of the disturbance_set.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& speedLimitKeys() {
    // Defaults: those of SpeedLimits.
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("arm_mps", "m/s", ".inf", "Of every point of the capsules that a joint moves.")
             .atLeast(kSmallestSpeedLimit)
             .orInfinite()},
        {parameter::number("tool_mps", "m/s", ".inf", "Of the origin of the tool frame.")
             .atLeast(kSmallestSpeedLimit)
             .orInfinite()},
        makeBlock(
            "regions", "", &regionKeys,
            "By name: a box in which a lower speed counts, for all points of a capsule as soon as it reaches into it.",
            KeyForm::Named),
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
        {parameter::number("at_s", "s", nullptr, "Time of the first missed tick, within the run.").atLeast(0)},
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
        {parameter::jointNumbers("friction_scale_min", "", "0.0",
                                 "Smallest factor; it counts where the robust loop feeds friction forward.")
             .atLeast(0)},
        {parameter::choice("friction", "jumps|constant_in_a_run", "jumps",
                           "Whether that factor changes at any time, or is the same all through a run.")},
        {parameter::number("breakaway_ratio", "", "1.0", "Largest friction at standstill over Coulomb friction.")
             .atLeast(1)},
        {parameter::jointNumbers("load_friction", "", "0.0", "Largest friction per torque that the joint carries.")
             .atLeast(0)
             .below(1)},
        {parameter::jointNumbers("mass_error", "", "0.0",
                                 "Masses and inertias are within 1 - this and 1 + this of the model's.")
             .atLeast(0)
             .below(1)},
        {parameter::number("payload_kg", "kg", "0.0", "Largest payload.").atLeast(0).upTo(1000)},
        {parameter::number("payload_offset_m", "m", "0.0", "Its largest distance from the tool frame's origin.")
             .atLeast(0)},
        {parameter::number("base_tilt_rad", "rad", "0.0", "Largest tilt of the base.").atLeast(0).upTo(3.15)},
        {parameter::jointNumbers("torque_ripple_Nm", "Nm", "0.0", "Largest torque ripple.").atLeast(0)},
        {parameter::jointNumbers("external_torque_Nm", "Nm", "0.0",
                                 "Largest torque of pushes that are not fed to the nominal arm.")
             .atLeast(0)},
        {parameter::number("torque_limit_factor", "", "1.0", "Smallest motor torque, as a share of the robot's figure.")
             .above(0)
             .orInfinite()},
        {parameter::number("reading_error_rad", "rad", "0.0",
                           "Largest error of a reading besides its rounding; of a plant with encoder_noise_rad (a "
                           "standard deviation, cut at four) four times that.")
             .atLeast(0)},
        {parameter::integer("delay_ticks", "0", "Between the computed torque and the motors.").atLeast(0).upTo(20)},
    };
    return keys;
}

const std::vector<ExperimentKey>& payloadKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("mass_kg", "kg", nullptr, "Its mass.").atLeast(0).upTo(1000)},
        {parameter::numbers("offset_m", "m", 3, 3, "[0, 0, 0]", "Its place in the tool frame: x, y, z.")
             .atLeast(-10)
             .upTo(10)},
    };
    return keys;
}

const std::vector<ExperimentKey>& streamKeys() {
    // Defaults: those of StreamOptions.
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("rate_hz", "Hz", nullptr, "Samples sent; at most one a tick.").atLeast(0.1).upTo(1e5)},
        {parameter::number("jitter", "", "0.0", "A sample is late by up to this share of a period, drawn evenly.")
             .atLeast(0)
             .below(1)},
        {parameter::number("loss", "", "0.0", "Share of the samples that never come.").atLeast(0).below(1)},
        {parameter::number("gap_s", "s", "0.0", "Nothing comes for so long, once in every gap_every_s.").atLeast(0)},
        {parameter::number("gap_every_s", "s", "5.0", "Longer than gap_s; where in it a gap begins is drawn.")
             .atLeast(0.001)
             .upTo(1e5)},
        {parameter::choice("between", "hold|interpolate|extrapolate", "extrapolate",
                           "What the command is between two samples: the newest one at rest; straight to the newest "
                           "one, which is reached when the next is due; on from the newest as the last two went.")},
        {parameter::integer("seed", "1", "Of what is drawn.").atLeast(0)},
    };
    return keys;
}

const std::vector<ExperimentKey>& personCapsuleKeys() {
    static const std::vector<ExperimentKey> keys = {
        {makePlace("from_m", "One end of its axis, from the person's place.")},
        {parameter::numbers("to_m", "m", 3, 3, "", "The other end; without it, it is a ball.")
             .atLeast(-1000)
             .upTo(1000)},
        {makeSize("radius_m", nullptr, "Around the axis.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& walkKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("time_s", "s", nullptr, "Of the run; rising.").atLeast(0).upTo(1e6)},
        {makePlace("xyz", "The person's place then, base frame.")},
    };
    return keys;
}

const std::vector<ExperimentKey>& absenceKeys() {
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("from_s", "s", nullptr, "Nothing sees the person from here on.").atLeast(0).upTo(1e6)},
        {parameter::number("to_s", "s", nullptr, "Until here.").atLeast(0).upTo(1e6)},
    };
    return keys;
}

const std::vector<ExperimentKey>& personKeys() {
    static const std::string bodyParts = join(bodyPartNames(), "|");
    // Defaults: those of Person.
    static const std::vector<ExperimentKey> keys = {
        makeBlock("capsules", nullptr, &personCapsuleKeys, "What the person is made of, up to 8.", KeyForm::Blocks),
        makeBlock("walk", nullptr, &walkKeys,
                  "Where it is when: straight and at constant speed from one to the next. The arm does not know it.",
                  KeyForm::Blocks),
        {parameter::flag("repeats", "false", "Walk it again and again; it must end where it begins.")},
        {parameter::number("max_speed_mps", "m/s", "1.6",
                           "None of the person's points is faster: 1.6 walking, 2 a hand (ISO 13855).")
             .above(0)
             .upTo(20)},
        {parameter::number("latency_s", "s", "0", "What is seen is up to so much older than it says.")
             .atLeast(0)
             .upTo(10)},
        {parameter::number("error_m", "m", "0", "And wrong by no more than this.").atLeast(0).upTo(10)},
        {parameter::number("contact_speed_mps", "m/s", "0",
                           "Points of the arm may touch the person at this speed; 0: they rest before.")
             .atLeast(0)
             .upTo(20)},
        {parameter::choice(
            "body_part", bodyParts.c_str(), "",
            "What all capsules are of, instead of the speed: the one at which this arm may touch somebody "
            "there who stands still, by ISO/TS 15066.")},
        makeBlock("unseen", "", &absenceKeys, "When nothing sees the person.", KeyForm::Blocks),
    };
    return keys;
}

const std::vector<ExperimentKey>& environmentKeys() {
    // Defaults: those of Environment.
    static const std::vector<ExperimentKey> keys = {
        {parameter::number("safety_distance_m", "m", "0.02", "Smallest clearance that must be kept.")
             .atLeast(0)
             .upTo(1)},
        {parameter::number("field_cell_m", "m", "0.02", "Edge of the cells of the distance field around a map.")
             .atLeast(0.001)
             .upTo(1)},
        makeBlock("obstacles", "", &obstacleKeys,
                  "By name: one of box, sphere, cylinder and half_space, and where it is.", KeyForm::Named),
        makeBlock("people", "", &personKeys,
                  "By name: who may come near, as far as whole_arm_braking can know it, and for tests how they walk.",
                  KeyForm::Named),
        makeBlock("map", "", &mapKeys, "A map of occupied, free and unknown space."),
    };
    return keys;
}

std::vector<std::string> listNames(const std::vector<ExperimentKey>& keys) {
    std::vector<std::string> names;
    for (const ExperimentKey& key : keys) names.push_back(key.spec.name);
    return names;
}

const ParameterSpec& getKey(const std::vector<ExperimentKey>& keys, const std::string& name) {
    for (const ExperimentKey& key : keys)
        if (name == key.spec.name) return key.spec;
    VIABLE_CHECK(false, "a key of an experiment file that is not declared");
}

}  // namespace viable::detail
