#include "log/LogFields.h"

#include <mutex>

#include "core/Text.h"
#include "limits/LimitRows.h"

namespace viable {

const char* getName(Stage stage) {
    return detail::enumName<Stage::Record>(
        stage, {"command", "dynamics", "controller", "filter", "robust", "plant", "record"});
}

const char* getName(StopVerdict verdict) {
    return detail::enumName<StopVerdict::NoStop>(verdict, {"safe", "recovering", "no_stop"});
}

double LogField::getNumber(const TickRecord& record, int i) const {
    if (number) return number(record, i);
    const JointVector& v = joints(record);
    return i < v.size() ? v[i] : std::numeric_limits<double>::quiet_NaN();
}

std::string LogField::getSchemaName() const {
    std::string lower = name;
    for (char& c : lower)
        if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    return lower;
}

std::string LogField::getSchemaType() const {
    if (kind == LogKind::Vector) return "float64[" + std::to_string(elements.size()) + "]";
    return detail::enumName<LogKind::Integer>(kind, {"float64[]", "float64", "", "string[]", "string", "int64"});
}

std::string LogChannel::getSchemaText() const {
    std::string text;
    for (const LogField& field : fields) text += field.getSchemaType() + " " + field.getSchemaName() + "\n";
    return text;
}

namespace {

// `access` is a generic lambda: for a const record it gives a const reference. (It says so by decltype(auto) and parentheses:
// auto& is too much for Clang 14 here.)
template <class Access>
LogField perJoint(const char* name, Access access) {
    return {name, LogKind::JointNumber, {}, access, access};
}

template <class Access>
LogField numbers(const std::string& name, LogKind kind, std::vector<std::string> elements, Access access) {
    return {name, kind, std::move(elements), {}, {}, access, access};
}

template <class Get, class Set>
LogField text(const char* name, LogKind kind, Get get, Set set) {
    return {name, kind, {}, {}, {}, {}, {}, get, set};
}

template <class Get, class Set>
LogField integer(const std::string& name, Get get, Set set) {
    return {name, LogKind::Integer, {}, {}, {}, {}, {}, {}, {}, get, set};
}

/** A truth, as 0 or 1. */
template <class Access>
LogField flag(const std::string& name, Access access) {
    return integer(
        name, [access](const TickRecord& r) -> std::int64_t { return access(r) ? 1 : 0; },
        [access](TickRecord& r, std::int64_t value) {
            access(r) = value == 1;
            return value == 0 || value == 1;
        });
}

/** An index; -1: none. */
template <class Access>
LogField index(const std::string& name, Access access) {
    return integer(
        name, [access](const TickRecord& r) -> std::int64_t { return access(r); },
        [access](TickRecord& r, std::int64_t value) {
            access(r) = static_cast<int>(value);
            return value >= -1 && value <= std::numeric_limits<int>::max();
        });
}

template <class Access>
LogField counter(const std::string& name, Access access) {
    return integer(name, access, [access](TickRecord& r, std::int64_t value) {
        access(r) = value;
        return value >= 0;
    });
}

LogField laterThanTheRest(LogField field) {
    field.mayLack = true;
    return field;
}

template <int stage>
LogField stageTime() {
    const std::string name = std::string(getName(static_cast<Stage>(stage))) + "_us";
    return numbers(name, LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.stage_us[stage]); });
}

bool setLimit(TickRecord& record, int joint, std::string_view word) {
    for (int k = 0; k < countLimitKinds(); ++k) {
        const auto kind = static_cast<LimitKind>(k);
        for (const LimitSide side : {LimitSide::Neither, LimitSide::Lower, LimitSide::Upper}) {
            if (kind != LimitKind::None && side == LimitSide::Neither) continue;
            if (word != getName(kind, side)) continue;
            record.joints[joint] = {kind, side};
            return true;
        }
    }
    return false;
}

template <class Word>
bool setWord(Word& to, std::string_view word, std::initializer_list<Word> all) {
    if (word == "returning") word = "recovering";  // in logs of plugin interface 5 and before
    for (const Word one : all) {
        if (word != getName(one)) continue;
        to = one;
        return true;
    }
    return false;
}

bool setStatus(TickRecord& record, int, std::string_view word) {
    return setWord(record.status, word,
                   {FilterStatus::Passed, FilterStatus::Modified, FilterStatus::StoppedByPlan, FilterStatus::Recovering,
                    FilterStatus::Infeasible, FilterStatus::InvalidInput, FilterStatus::Faulted, FilterStatus::Ended});
}

bool setVerdict(TickRecord& record, int, std::string_view word) {
    return setWord(record.verdict, word, {StopVerdict::Safe, StopVerdict::Recovering, StopVerdict::NoStop});
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

/** A column of a kind's channel, by the type of the member that it holds. */
LogField declareColumn(LimitKind kind, const LimitColumn& column) {
    const std::string& name = column.name;
    return std::visit(
        [&](auto member) -> LogField {
            const auto get = [kind, member](auto& r) -> decltype(auto) {
                if constexpr (std::is_same_v<decltype(member), std::int64_t PeopleFaults::*> ||
                              std::is_same_v<decltype(member), int PeopleFaults::*>)
                    return (r.peopleFaults.*member);
                else
                    return (r.reports[kind].*member);
            };
            using Value = std::remove_const_t<std::remove_reference_t<decltype(get(std::declval<TickRecord&>()))>>;
            if constexpr (std::is_same_v<Value, bool>)
                return flag(name, get);
            else if constexpr (std::is_same_v<Value, int>)
                return index(name, get);
            else if constexpr (std::is_same_v<Value, std::int64_t>)
                return counter(name, get);
            else if constexpr (std::is_same_v<Value, double>)
                return numbers(name, LogKind::Number, {}, [get](auto& r, int) -> decltype(auto) { return get(r); });
            else
                return numbers(name + "_m", LogKind::Vector, {name + ".x_m", name + ".y_m", name + ".z_m"},
                               [get](auto& r, int i) -> decltype(auto) { return (get(r)[i]); });
        },
        column.member);
}

/** "motor_demand" as messages are named: "MotorDemand". */
std::string makeMessageName(const std::string& name) {
    std::string message;
    bool isFirst = true;
    for (const char c : name) {
        if (c != '_') message += isFirst && c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
        isFirst = c == '_';
    }
    return message;
}

LogChannel declareLimit(LimitKind kind) {
    const std::string name = getName(kind, LimitSide::Neither);
    std::vector<LogField> fields;
    for (const LimitColumn& column : getLimitRow(kind).columns) fields.push_back(declareColumn(kind, column));
    return {name, makeMessageName(name), [kind](const LogLayout& l) { return l.limits.has(kind); }, std::move(fields)};
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
    const auto motion = [](const char* name, const char* message, auto isLogged, auto state) {
        const auto q = [state](auto& r) -> decltype(auto) { return (state(r).q); };
        const auto qd = [state](auto& r) -> decltype(auto) { return (state(r).qd); };
        return LogChannel{name, message, isLogged, {perJoint("q_rad", q), perJoint("qd_radps", qd)}};
    };
    const auto torque = [](const char* name, const char* message, auto isLogged, auto access) {
        return LogChannel{name, message, isLogged, {perJoint("tau_Nm", access)}};
    };
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
        motion("real", "Real", withRealPlant, [](auto& r) -> decltype(auto) { return (r.real); }),
        motion("actual", "Actual", withRealPlant, [](auto& r) -> decltype(auto) { return (r.actual); }),
        torque("desired", "Desired", always, [](auto& r) -> decltype(auto) { return (r.desiredTorque); }),
        {"filter",
         "Filter",
         always,
         {perJoint("tau_Nm", [](auto& r) -> decltype(auto) { return (r.filterTorque); }),
          text(
              "active", LogKind::JointName,
              [](const TickRecord& r, int i) {
                  const JointIntervention& joint = r.joints[i];
                  return getName(joint.limit, joint.side);
              },
              setLimit),
          perJoint("tau_removed_Nm", [](auto& r) -> decltype(auto) { return (r.removedTorque); }),
          numbers("margin_rad", LogKind::JointNumber, {},
                  [](auto& r, int i) -> decltype(auto) { return (r.stops[i].margin); }),
          numbers("stop_s", LogKind::JointNumber, {},
                  [](auto& r, int i) -> decltype(auto) { return (r.stops[i].duration_s); }),
          numbers("rest_rad", LogKind::JointNumber, {},
                  [](auto& r, int i) -> decltype(auto) { return (r.stops[i].rest); })}},
        {"limits", "Limits", always, declareLimits(), true},
        torque("robust", "Robust", withRealPlant, [](auto& r) -> decltype(auto) { return (r.robustTorque); }),
        torque("motor", "Motor", withRealPlant, [](auto& r) -> decltype(auto) { return (r.motorTorque); }),
        torque(
            "external", "External", [](const LogLayout& l) { return l.hasExternalTorque; },
            [](auto& r) -> decltype(auto) { return (r.externalTorque); }),
        {"contact",
         "Contact",
         [](const LogLayout& l) { return l.hasContact; },
         {numbers("force_N", LogKind::Vector, {"force.x_N", "force.y_N", "force.z_N"},
                  [](auto& r, int i) -> decltype(auto) { return (r.contact.force[i]); }),
          numbers("pressing_N", LogKind::Number, {},
                  [](auto& r, int) -> decltype(auto) { return (r.contact.pressing); }),
          numbers("depth_m", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.contact.depth); }),
          numbers("point_m", LogKind::Vector, {"point.x_m", "point.y_m", "point.z_m"},
                  [](auto& r, int i) -> decltype(auto) { return (r.contact.point[i]); }),
          index("contacts", [](auto& r) -> decltype(auto) { return (r.contact.contacts); }),
          index("carrier", [](auto& r) -> decltype(auto) { return (r.contact.carrier); }),
          index("obstacle", [](auto& r) -> decltype(auto) { return (r.contact.obstacle); })}},
        {"touch",
         "Touch",
         [](const LogLayout& l) { return l.hasTouch; },
         {index("on", [](auto& r) -> decltype(auto) { return (r.touch.isOn); }),
          numbers("felt_N", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.touch.felt); }),
          numbers("asked_N", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.touch.asked); }),
          numbers("normal", LogKind::Vector, {"normal.x", "normal.y", "normal.z"},
                  [](auto& r, int i) -> decltype(auto) { return (r.touch.normal[i]); })}},
        motion(
            "command", "JointCommand", [](const LogLayout& l) { return l.commandSpace == MotionCommand::Space::Joint; },
            [](auto& r) -> decltype(auto) { return (r.command); }),
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
         {flag("paused", [](auto& r) -> decltype(auto) { return (r.paused); }),
          laterThanTheRest(counter("take", [](auto& r) -> decltype(auto) { return (r.take); }))},
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
          flag("braking", [](auto& r) -> decltype(auto) { return (r.braking); }),
          flag("missed", [](auto& r) -> decltype(auto) { return (r.missed); }),
          text(
              "stop", LogKind::Name, [](const TickRecord& r, int) { return getName(r.verdict); }, setVerdict),
          counter("substituted", [](auto& r) -> decltype(auto) { return (r.substituted); }),
          numbers("compute_us", LogKind::Number, {}, [](auto& r, int) -> decltype(auto) { return (r.compute_us); }),
          stageTime<0>(), stageTime<1>(), stageTime<2>(), stageTime<3>(), stageTime<4>(), stageTime<5>(),
          stageTime<6>()}},
    };
}

/** The channels that are of no limit of the whole arm. */
const std::vector<LogChannel>& listOtherChannels() {
    static const auto& channels = *new std::vector<LogChannel>(declareChannels());  // never destroyed, see below
    return channels;
}

[[maybe_unused]] const bool kReserved = detail::reserveLimitNames("a channel of the log", [] {
    std::vector<std::string> names;
    for (const LogChannel& channel : listOtherChannels()) names.push_back(channel.name);
    return names;
});

}  // namespace

std::vector<const LogChannel*> listLogChannels() {
    // Never destroyed: a log is finished even while exit() runs (Recorder::rescueAll).
    static std::mutex& adding = *new std::mutex;
    static auto& ofLimits = *new std::map<const LimitRow*, const LogChannel>;
    const std::lock_guard<std::mutex> guard(adding);
    std::vector<const LogChannel*> channels;
    const auto addLimits = [&](bool isOwn) {
        for (const LimitKind kind : listArmLimits())
            if (const LimitRow* row = &getLimitRow(kind); (kind <= kLastOwnLimit) == isOwn) {
                auto known = ofLimits.find(row);
                if (known == ofLimits.end()) known = ofLimits.emplace(row, declareLimit(kind)).first;
                channels.push_back(&known->second);
            }
    };
    for (const LogChannel& channel : listOtherChannels()) {
        if (channel.name == "limits") addLimits(true);  // those of the whole arm stand before those of the joints
        channels.push_back(&channel);
    }
    addLimits(false);
    return channels;
}

}  // namespace viable
