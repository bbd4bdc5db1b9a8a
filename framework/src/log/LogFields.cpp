#include "log/LogFields.h"

#include <limits>

namespace viable {

const char* getName(Stage stage) {
    switch (stage) {
        case Stage::Command:
            return "command";
        case Stage::Dynamics:
            return "dynamics";
        case Stage::Controller:
            return "controller";
        case Stage::Filter:
            return "filter";
        case Stage::Robust:
            return "robust";
        case Stage::Plant:
            return "plant";
        case Stage::Record:
            return "record";
    }
    return "unknown";
}

const char* getName(StopVerdict verdict) {
    switch (verdict) {
        case StopVerdict::Safe:
            return "safe";
        case StopVerdict::Recovering:
            return "recovering";
        case StopVerdict::NoStop:
            return "no_stop";
    }
    return "unknown";
}

double LogField::getNumber(const TickRecord& record, int i) const {
    if (number) return number(record, i);
    const JointVector& v = joints(record);
    return i < v.size() ? v[i] : std::numeric_limits<double>::quiet_NaN();
}

std::string LogField::getSchemaName() const {
    std::string lower = name;
    for (char& c : lower) {
        if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    }
    return lower;
}

std::string LogField::getSchemaType() const {
    switch (kind) {
        case LogKind::JointNumber:
            return "float64[]";
        case LogKind::Number:
            return "float64";
        case LogKind::Vector:
            return "float64[" + std::to_string(elements.size()) + "]";
        case LogKind::JointName:
            return "string[]";
        case LogKind::Name:
            return "string";
        case LogKind::Integer:
            return "int64";
    }
    return {};
}

std::string LogChannel::getSchemaText() const {
    std::string text;
    for (const LogField& field : fields) {
        text += field.getSchemaType() + " " + field.getSchemaName() + "\n";
    }
    return text;
}

namespace {

// `access` is a generic lambda: for a const record it gives a const reference. (It says so by decltype(auto) and parentheses:
// auto& is too much for Clang 14 here.)
template <class Access>
LogField perJoint(const char* name, Access access) {
    LogField field{name, LogKind::JointNumber, {}};
    field.joints = access;
    field.updJoints = access;
    return field;
}

template <class Access>
LogField numbers(const char* name, LogKind kind, std::vector<std::string> elements, Access access) {
    LogField field{name, kind, std::move(elements)};
    field.number = access;
    field.updNumber = access;
    return field;
}

LogField text(const char* name, LogKind kind, const char* (*get)(const TickRecord&, int),
              bool (*set)(TickRecord&, int, std::string_view)) {
    LogField field{name, kind, {}};
    field.text = get;
    field.setText = set;
    return field;
}

LogField integer(const char* name, std::int64_t (*get)(const TickRecord&), bool (*set)(TickRecord&, std::int64_t)) {
    LogField field{name, LogKind::Integer, {}};
    field.integer = get;
    field.setInteger = set;
    return field;
}

LogField laterThanTheRest(LogField field) {
    field.mayLack = true;
    return field;
}

template <int stage>
LogField stageTime() {
    const std::string name = std::string(getName(static_cast<Stage>(stage))) + "_us";
    return numbers(name.c_str(), LogKind::Number, {},
                   [](auto& r, int) -> decltype(auto) { return (r.stage_us[stage]); });
}

bool setLimit(TickRecord& record, int joint, std::string_view word) {
    for (const LimitKind kind :
         {LimitKind::None, LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk,
          LimitKind::Torque, LimitKind::Clearance, LimitKind::Speed, LimitKind::Separation}) {
        for (const LimitSide side : {LimitSide::Neither, LimitSide::Lower, LimitSide::Upper}) {
            if (kind != LimitKind::None && side == LimitSide::Neither) continue;
            if (word != getName(kind, side)) continue;
            JointIntervention& intervention = record.joints[static_cast<std::size_t>(joint)];
            intervention.limit = kind;
            intervention.side = side;
            return true;
        }
    }
    return false;
}

/** Logs of plugin interface 5 and before say `returning`. */
std::string_view takeOldWord(std::string_view word) {
    return word == "returning" ? "recovering" : word;
}

bool setStatus(TickRecord& record, int, std::string_view word) {
    word = takeOldWord(word);
    for (const FilterStatus status :
         {FilterStatus::Passed, FilterStatus::Modified, FilterStatus::StoppedByPlan, FilterStatus::Recovering,
          FilterStatus::Infeasible, FilterStatus::InvalidInput, FilterStatus::Faulted, FilterStatus::Ended}) {
        if (word != getName(status)) continue;
        record.status = status;
        return true;
    }
    return false;
}

bool setVerdict(TickRecord& record, int, std::string_view word) {
    word = takeOldWord(word);
    for (const StopVerdict verdict : {StopVerdict::Safe, StopVerdict::Recovering, StopVerdict::NoStop}) {
        if (word != getName(verdict)) continue;
        record.verdict = verdict;
        return true;
    }
    return false;
}

/** "position_lower_rad", "position_upper_rad", ...: both sides of each limit. */
std::vector<LogField> declareLimits() {
    return {
        perJoint("position_lower_rad", [](auto& r) -> decltype(auto) { return (r.limits.position.lower); }),
        perJoint("position_upper_rad", [](auto& r) -> decltype(auto) { return (r.limits.position.upper); }),
        perJoint("velocity_lower_radps", [](auto& r) -> decltype(auto) { return (r.limits.velocity.lower); }),
        perJoint("velocity_upper_radps", [](auto& r) -> decltype(auto) { return (r.limits.velocity.upper); }),
        perJoint("acceleration_lower_radps2", [](auto& r) -> decltype(auto) { return (r.limits.acceleration.lower); }),
        perJoint("acceleration_upper_radps2", [](auto& r) -> decltype(auto) { return (r.limits.acceleration.upper); }),
        perJoint("jerk_lower_radps3", [](auto& r) -> decltype(auto) { return (r.limits.jerk.lower); }),
        perJoint("jerk_upper_radps3", [](auto& r) -> decltype(auto) { return (r.limits.jerk.upper); })};
}

template <int Clearance::*index>
LogField clearanceIndex(const char* name) {
    return integer(
        name, [](const TickRecord& r) -> std::int64_t { return r.clearance.*index; },
        [](TickRecord& r, std::int64_t value) {
            r.clearance.*index = static_cast<int>(value);
            return value >= -1 && value <= std::numeric_limits<int>::max();
        });
}

/** Names of links and obstacles are in the metadata, see CaseRun. */
std::vector<LogField> declareClearance() {
    return {integer(
                "known", [](const TickRecord& r) -> std::int64_t { return r.clearance.isKnown ? 1 : 0; },
                [](TickRecord& r, std::int64_t value) {
                    r.clearance.isKnown = value == 1;
                    return value == 0 || value == 1;
                }),
            numbers("distance_m", LogKind::Number, {},
                    [](auto& r, int) -> decltype(auto) { return (r.clearance.distance); }),
            clearanceIndex<&Clearance::link>("link"),
            clearanceIndex<&Clearance::obstacle>("obstacle"),
            clearanceIndex<&Clearance::otherLink>("other_link"),
            numbers("on_arm_m", LogKind::Vector, {"on_arm.x_m", "on_arm.y_m", "on_arm.z_m"},
                    [](auto& r, int i) -> decltype(auto) { return (r.clearance.onArm[i]); }),
            numbers("on_obstacle_m", LogKind::Vector, {"on_obstacle.x_m", "on_obstacle.y_m", "on_obstacle.z_m"},
                    [](auto& r, int i) -> decltype(auto) { return (r.clearance.onObstacle[i]); }),
            numbers("map_age_s", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.mapAge_s); })};
}

/** The names of links are in the metadata. */
std::vector<LogField> declareSpeed() {
    return {integer(
                "known", [](const TickRecord& r) -> std::int64_t { return r.speed.isKnown ? 1 : 0; },
                [](TickRecord& r, std::int64_t value) {
                    r.speed.isKnown = value == 1;
                    return value == 0 || value == 1;
                }),
            numbers("largest_mps", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.speed.speed); }),
            numbers("limit_mps", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.speed.limit); }),
            integer(
                "link", [](const TickRecord& r) -> std::int64_t { return r.speed.link; },
                [](TickRecord& r, std::int64_t value) {
                    r.speed.link = static_cast<int>(value);
                    return value >= -1 && value <= std::numeric_limits<int>::max();
                })};
}

template <int Separation::*index>
LogField separationIndex(const char* name) {
    return integer(
        name, [](const TickRecord& r) -> std::int64_t { return r.separation.*index; },
        [](TickRecord& r, std::int64_t value) {
            r.separation.*index = static_cast<int>(value);
            return value >= -1 && value <= std::numeric_limits<int>::max();
        });
}

template <bool Separation::*flag>
LogField separationFlag(const char* name) {
    return integer(
        name, [](const TickRecord& r) -> std::int64_t { return r.separation.*flag ? 1 : 0; },
        [](TickRecord& r, std::int64_t value) {
            r.separation.*flag = value == 1;
            return value == 0 || value == 1;
        });
}

template <std::int64_t PeopleFaults::*count>
LogField peopleFault(const char* name) {
    return integer(
        name, [](const TickRecord& r) -> std::int64_t { return r.separation.faults.*count; },
        [](TickRecord& r, std::int64_t value) {
            r.separation.faults.*count = value;
            return value >= 0;
        });
}

/** The names of links and people are in the metadata. */
std::vector<LogField> declareSeparation() {
    return {
        separationFlag<&Separation::isKnown>("known"),
        separationFlag<&Separation::isKept>("kept"),
        numbers("margin_m", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.separation.margin); }),
        separationIndex<&Separation::link>("link"),
        separationIndex<&Separation::person>("person"),
        numbers("age_s", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.separation.age_s); }),
        peopleFault<&PeopleFaults::appeared>("appeared"),
        peopleFault<&PeopleFaults::faster>("faster"),
        peopleFault<&PeopleFaults::lost>("lost"),
        peopleFault<&PeopleFaults::refused>("refused"),
        integer(
            "last_fault", [](const TickRecord& r) -> std::int64_t { return r.separation.faults.last; },
            [](TickRecord& r, std::int64_t value) {
                r.separation.faults.last = static_cast<int>(value);
                return value >= -1 && value <= std::numeric_limits<int>::max();
            })};
}

bool always(const LogLayout&) {
    return true;
}
bool withRealPlant(const LogLayout& layout) {
    return layout.hasRealPlant;
}

std::vector<LogChannel> declareChannels() {
    static_assert(kStageCount == 7, "a stage was added: log its time below");
    const std::vector<std::string> position = {"tool.x_m", "tool.y_m", "tool.z_m"};
    const std::vector<std::string> orientation = {"tool.qx", "tool.qy", "tool.qz", "tool.qw"};
    const std::vector<std::string> velocity = {"tool.vx_mps", "tool.vy_mps", "tool.vz_mps"};
    const std::vector<std::string> rotation = {"tool.wx_radps", "tool.wy_radps", "tool.wz_radps"};
    return {
        {"nominal",
         "Nominal",
         always,
         {perJoint("q_rad", [](auto& r) -> decltype(auto) { return (r.nominal.q); }),
          perJoint("qd_radps", [](auto& r) -> decltype(auto) { return (r.nominal.qd); }),
          perJoint("qdd_radps2", [](auto& r) -> decltype(auto) { return (r.nominal.qdd); }),
          perJoint("jerk_radps3", [](auto& r) -> decltype(auto) { return (r.nominal.jerk); }),
          numbers("tool_position_m", LogKind::Vector, position,
                  [](auto& r, int i) -> decltype(auto) { return (r.tool.position[i]); }),
          numbers("tool_orientation_xyzw", LogKind::Vector, orientation,
                  [](auto& r, int i) -> decltype(auto) { return (r.tool.orientation.coeffs()[i]); })}},
        {"real",
         "Real",
         withRealPlant,
         {perJoint("q_rad", [](auto& r) -> decltype(auto) { return (r.real.q); }),
          perJoint("qd_radps", [](auto& r) -> decltype(auto) { return (r.real.qd); })}},
        {"actual",
         "Actual",
         withRealPlant,
         {perJoint("q_rad", [](auto& r) -> decltype(auto) { return (r.actual.q); }),
          perJoint("qd_radps", [](auto& r) -> decltype(auto) { return (r.actual.qd); })}},
        {"desired",
         "Desired",
         always,
         {perJoint("tau_Nm", [](auto& r) -> decltype(auto) { return (r.desiredTorque); })}},
        {"filter",
         "Filter",
         always,
         {perJoint("tau_Nm", [](auto& r) -> decltype(auto) { return (r.filterTorque); }),
          text(
              "active", LogKind::JointName,
              [](const TickRecord& r, int i) {
                  const JointIntervention& joint = r.joints[static_cast<std::size_t>(i)];
                  return getName(joint.limit, joint.side);
              },
              setLimit),
          perJoint("tau_removed_Nm", [](auto& r) -> decltype(auto) { return (r.removedTorque); }),
          numbers("margin_rad", LogKind::JointNumber, {},
                  [](auto& r, int i) -> decltype(auto) { return (r.stops[static_cast<std::size_t>(i)].margin); }),
          numbers("stop_s", LogKind::JointNumber, {},
                  [](auto& r, int i) -> decltype(auto) { return (r.stops[static_cast<std::size_t>(i)].duration_s); }),
          numbers("rest_rad", LogKind::JointNumber, {},
                  [](auto& r, int i) -> decltype(auto) { return (r.stops[static_cast<std::size_t>(i)].rest); })}},
        {"clearance", "Clearance", [](const LogLayout& l) { return l.hasEnvironment; }, declareClearance()},
        {"speed", "Speed", [](const LogLayout& l) { return l.hasSpeedLimits; }, declareSpeed()},
        {"separation", "Separation", [](const LogLayout& l) { return l.hasPeople; }, declareSeparation()},
        {"limits", "Limits", always, declareLimits(), true},
        {"robust",
         "Robust",
         withRealPlant,
         {perJoint("tau_Nm", [](auto& r) -> decltype(auto) { return (r.robustTorque); })}},
        {"motor",
         "Motor",
         withRealPlant,
         {perJoint("tau_Nm", [](auto& r) -> decltype(auto) { return (r.motorTorque); })}},
        {"external",
         "External",
         [](const LogLayout& l) { return l.hasExternalTorque; },
         {perJoint("tau_Nm", [](auto& r) -> decltype(auto) { return (r.externalTorque); })}},
        {"command",
         "JointCommand",
         [](const LogLayout& l) { return l.commandSpace == MotionCommand::Space::Joint; },
         {perJoint("q_rad", [](auto& r) -> decltype(auto) { return (r.command.q); }),
          perJoint("qd_radps", [](auto& r) -> decltype(auto) { return (r.command.qd); })}},
        {"command",
         "ToolCommand",
         [](const LogLayout& l) { return l.commandSpace == MotionCommand::Space::Tool; },
         {numbers("tool_position_m", LogKind::Vector, position,
                  [](auto& r, int i) -> decltype(auto) { return (r.command.tool.position[i]); }),
          numbers("tool_orientation_xyzw", LogKind::Vector, orientation,
                  [](auto& r, int i) -> decltype(auto) { return (r.command.tool.orientation.coeffs()[i]); }),
          numbers("tool_velocity_mps", LogKind::Vector, velocity,
                  [](auto& r, int i) -> decltype(auto) { return (r.command.toolTwist[i]); }),
          numbers("tool_rotation_radps", LogKind::Vector, rotation,
                  [](auto& r, int i) -> decltype(auto) { return (r.command.toolTwist[3 + i]); })}},
        {"live",
         "Live",
         [](const LogLayout& l) { return l.isLive; },
         {integer(
              "paused", [](const TickRecord& r) -> std::int64_t { return r.paused ? 1 : 0; },
              [](TickRecord& r, std::int64_t value) {
                  r.paused = value == 1;
                  return value == 0 || value == 1;
              }),
          laterThanTheRest(integer(
              "take", [](const TickRecord& r) { return r.take; },
              [](TickRecord& r, std::int64_t value) {
                  r.take = value;
                  return value >= 0;
              }))},
         true},
        {"pace",
         "Pace",
         [](const LogLayout& l) { return l.isLive; },
         {numbers("interval_us", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.interval_us); })}},
        {"tick",
         "Tick",
         always,
         {numbers("time_s", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.time_s); }),
          text(
              "status", LogKind::Name, [](const TickRecord& r, int) { return getName(r.status); }, setStatus),
          integer(
              "braking", [](const TickRecord& r) -> std::int64_t { return r.braking ? 1 : 0; },
              [](TickRecord& r, std::int64_t value) {
                  r.braking = value == 1;
                  return value == 0 || value == 1;
              }),
          integer(
              "missed", [](const TickRecord& r) -> std::int64_t { return r.missed ? 1 : 0; },
              [](TickRecord& r, std::int64_t value) {
                  r.missed = value == 1;
                  return value == 0 || value == 1;
              }),
          text(
              "stop", LogKind::Name, [](const TickRecord& r, int) { return getName(r.verdict); }, setVerdict),
          integer(
              "substituted", [](const TickRecord& r) { return r.substituted; },
              [](TickRecord& r, std::int64_t value) {
                  r.substituted = value;
                  return value >= 0;
              }),
          numbers("compute_us", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.compute_us); }),
          stageTime<0>(), stageTime<1>(), stageTime<2>(), stageTime<3>(), stageTime<4>(), stageTime<5>(),
          stageTime<6>()}},
    };
}

}  // namespace

const std::vector<LogChannel>& getLogChannels() {
    // Never destroyed: a log is finished even while exit() runs (Recorder::rescueAll).
    static const auto& channels = *new std::vector<LogChannel>(declareChannels());
    return channels;
}

}  // namespace viable
