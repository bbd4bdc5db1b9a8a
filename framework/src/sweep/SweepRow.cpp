#include "sweep/SweepRow.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "viable/core/Error.h"

namespace viable {

namespace {

using Getter = SweepValue (*)(const CasePlan&, const CaseResult&);
using JointGetter = SweepValue (*)(const CaseResult&, int joint);

struct ResultColumn {
    const char* name;
    const char* unit;
    const char* label;
    Getter get;
};

struct JointColumn {
    const char* name;  ///< behind "tracking.<joint>."
    const char* unit;
    const char* label;
    JointGetter get;
};

SweepValue getWorstUse(const CaseResult& result, LimitKind kind) {
    double worst = 0.0;
    bool exists = false;
    for (const LimitRecord& record : result.summary.limit(kind)) {
        exists |= record.exists;
        worst = std::max(worst, record.worstUse);
    }
    return exists ? SweepValue(worst) : SweepValue();
}

template <LimitKind kind>
SweepValue getUse(const CasePlan&, const CaseResult& result) {
    return getWorstUse(result, kind);
}

template <LimitKind kind>
SweepValue getOutside(const CasePlan&, const CaseResult& result) {
    return result.summary.ticksOutside(kind);
}

/** The largest over the joints of what `get` says; nothing without a real arm. */
template <class Get>
SweepValue findLargest(const CaseResult& result, const Get& get) {
    if (!result.summary.hasRealPlant()) return {};
    double largest = 0.0;
    for (int i = 0; i < static_cast<int>(result.summary.jointNames().size()); ++i) largest = std::max(largest, get(i));
    return largest;
}

template <LimitKind kind>
SweepValue getRealUse(const CasePlan&, const CaseResult& result) {
    return findLargest(result,
                       [&](int i) { return result.summary.realLimit(kind)[static_cast<std::size_t>(i)].worstUse; });
}

template <LimitKind kind>
SweepValue getRealExcess(const CasePlan&, const CaseResult& result) {
    return findLargest(result,
                       [&](int i) { return result.summary.realLimit(kind)[static_cast<std::size_t>(i)].worstExcess; });
}

template <LimitKind kind>
SweepValue getBoundShare(const CasePlan&, const CaseResult& result) {
    if (!result.summary.reference().bound) return {};
    return findLargest(result, [&](int i) { return result.summary.boundShare(kind, i); });
}

/** What `get` says of the arm's collisions; nothing where it has no environment, or there is no such arm. */
template <class Get>
SweepValue getNominalCollision(const CaseResult& result, const Get& get) {
    const std::optional<Collisions>& all = result.summary.collisions();
    return all ? SweepValue(get(all->nominal)) : SweepValue();
}
template <class Get>
SweepValue getRealCollision(const CaseResult& result, const Get& get) {
    const std::optional<Collisions>& all = result.summary.collisions();
    return all && all->real ? SweepValue(get(*all->real)) : SweepValue();
}

/** Within the horizon: a store holds finite numbers. */
double getClearance(const CollisionRecord& record) {
    return std::clamp(record.leastClearance, -kClearanceHorizon_m, kClearanceHorizon_m);
}
std::int64_t getCollisionTicks(const CollisionRecord& record) {
    return record.ticksInCollision;
}
std::int64_t getNearTicks(const CollisionRecord& record) {
    return record.ticksTooNear;
}

/** The columns of results; one line makes one more. */
const std::vector<ResultColumn>& resultColumns() {
    using R = const CaseResult&;
    using P = const CasePlan&;
    static const std::vector<ResultColumn> columns = {
        {"worst_use.position", "", "Worst use of a position limit", getUse<LimitKind::Position>},
        {"worst_use.velocity", "", "Worst use of a velocity limit", getUse<LimitKind::Velocity>},
        {"worst_use.acceleration", "", "Worst use of an acceleration limit", getUse<LimitKind::Acceleration>},
        {"worst_use.jerk", "", "Worst use of a jerk limit", getUse<LimitKind::Jerk>},
        {"ticks_outside.position", "", "Ticks outside a position limit", getOutside<LimitKind::Position>},
        {"ticks_outside.velocity", "", "Ticks outside a velocity limit", getOutside<LimitKind::Velocity>},
        {"ticks_outside.acceleration", "", "Ticks outside an acceleration limit", getOutside<LimitKind::Acceleration>},
        {"ticks_outside.jerk", "", "Ticks outside a jerk limit", getOutside<LimitKind::Jerk>},
        {"real.worst_use.position", "", "Real arm: worst use of a position limit", getRealUse<LimitKind::Position>},
        {"real.worst_use.velocity", "", "Real arm: worst use of a velocity limit", getRealUse<LimitKind::Velocity>},
        {"real.worst_excess.position_rad", "rad", "Real arm: farthest beyond a position limit",
         getRealExcess<LimitKind::Position>},
        {"real.worst_excess.velocity_radps", "rad/s", "Real arm: farthest beyond a velocity limit",
         getRealExcess<LimitKind::Velocity>},
        {"tracking.max_rad", "rad", "Largest distance of the real arm from the nominal one",
         [](P, R r) { return r.summary.hasRealPlant() ? SweepValue(r.summary.trackingMax()) : SweepValue(); }},
        {"tracking.rms_rad", "rad", "RMS distance of the real arm from the nominal one",
         [](P, R r) { return r.summary.hasRealPlant() ? SweepValue(r.summary.trackingRms()) : SweepValue(); }},
        {"bound.share", "", "Largest share of the tracking bound used", getBoundShare<LimitKind::Position>},
        {"bound.velocity_share", "", "Largest share of its rate's bound used", getBoundShare<LimitKind::Velocity>},
        {"motor.worst_use", "", "Largest share of a motor's torque used",
         [](P, R r) { return findLargest(r, [&](int i) { return r.summary.motor(i).worstUse; }); }},
        {"motor.saturated_ticks", "", "Joint-ticks with a motor at its limit",
         [](P, R r) {
             std::int64_t ticks = 0;
             if (!r.summary.hasRealPlant()) return SweepValue();
             for (int i = 0; i < static_cast<int>(r.summary.jointNames().size()); ++i)
                 ticks += r.summary.motor(i).ticksSaturated;
             return SweepValue(ticks);
         }},
        {"collision.least_clearance_m", "m", "Least clearance",
         [](P, R r) { return getNominalCollision(r, getClearance); }},
        {"collision.ticks", "", "Ticks in collision", [](P, R r) { return getNominalCollision(r, getCollisionTicks); }},
        {"collision.ticks_too_near", "", "Ticks within the safety distance",
         [](P, R r) { return getNominalCollision(r, getNearTicks); }},
        {"real.collision.least_clearance_m", "m", "Real arm: least clearance",
         [](P, R r) { return getRealCollision(r, getClearance); }},
        {"real.collision.ticks", "", "Real arm: ticks in collision",
         [](P, R r) { return getRealCollision(r, getCollisionTicks); }},
        {"real.collision.ticks_too_near", "", "Real arm: ticks within the safety distance",
         [](P, R r) { return getRealCollision(r, getNearTicks); }},
        {"infeasible_ticks", "", "Ticks without an admissible choice",
         [](P, R r) { return SweepValue(r.summary.ticksWith(FilterStatus::Infeasible)); }},
        {"tripped_at_s", "s", "When the real arm left the bound and was braked",
         [](P, R r) { return getSweepStatus(r) == SweepStatus::Tripped ? SweepValue(r.stopTime_s) : SweepValue(); }},
        {"simulated_s", "s", "Length of the run", [](P, R r) { return SweepValue(r.simulated_s); }},
    };
    return columns;
}

/** Of each joint; null in a case whose robot has no such joint. */
const std::vector<JointColumn>& jointColumns() {
    static const std::vector<JointColumn> columns = {
        {"max_rad", "rad", "Largest distance from the nominal arm",
         [](const CaseResult& r, int i) { return SweepValue(r.summary.trackingMax(i)); }},
    };
    return columns;
}

constexpr char kDrawPrefix[] = "draw.";

/** SQL knows no upper and lower case in the names of columns: A to Z are a to z. */
void checkNames(const std::vector<SweepColumn>& columns) {
    std::map<std::string, std::string> names;
    for (const SweepColumn& column : columns) {
        std::string small = column.name;
        for (char& c : small)
            if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
        const auto [known, isNew] = names.try_emplace(small, column.name);
        if (!isNew)
            throw badInput("viable sweep",
                           "the columns `" + known->second + "` and `" + column.name +
                               "` would have one name, as a table knows no upper and lower case",
                           "Rename a joint, a case or whatever makes them alike.");
    }
}

/** The unit that a key carries behind its last `_`; see the ends of the keys of experiment files. */
std::string findUnit(std::string key) {
    static const std::pair<const char*, const char*> units[] = {
        {"s", "s"},       {"rad", "rad"}, {"radps", "rad/s"}, {"radps2", "rad/s^2"}, {"radps3", "rad/s^3"},
        {"m", "m"},       {"mps", "m/s"}, {"kg", "kg"},       {"Nm", "Nm"},          {"N", "N"},
        {"Nmps", "Nm/s"}, {"Hz", "Hz"},   {"kgm2", "kg m^2"},
    };
    key.resize(std::min(key.size(), key.find('[', key.rfind('.') + 1)));
    const std::size_t last = key.rfind('_');
    if (last == std::string::npos) return {};
    const std::string end = key.substr(last + 1);
    for (const auto& [suffix, unit] : units)
        if (end == suffix) return unit;
    return {};
}

/** A number where the text is one: draws of words stay text. */
SweepValue makeValue(const std::string& text) {
    const char* const end = text.data() + text.size();
    std::int64_t whole = 0;
    auto result = std::from_chars(text.data(), end, whole);
    if (result.ec == std::errc() && result.ptr == end) return whole;
    double number = 0.0;
    result = std::from_chars(text.data(), end, number);
    if (result.ec == std::errc() && result.ptr == end && std::isfinite(number)) return number;
    return text;
}

// --- bytes: each number as it lies in memory; sender and receiver are the same program

template <class Number>
void put(std::string& bytes, Number number) {
    char raw[sizeof number];
    std::memcpy(raw, &number, sizeof number);
    bytes.append(raw, sizeof number);
}

void putText(std::string& bytes, const std::string& text) {
    put(bytes, static_cast<std::uint64_t>(text.size()));
    bytes += text;
}

class Unpacker {
public:
    explicit Unpacker(const std::string& bytes) : bytes_(bytes) {}

    template <class Number>
    Number take() {
        need(sizeof(Number));
        Number number;
        std::memcpy(&number, bytes_.data() + at_, sizeof number);
        at_ += sizeof number;
        return number;
    }
    std::string takeText() {
        const auto size = take<std::uint64_t>();
        need(size);
        at_ += size;
        return bytes_.substr(at_ - size, size);
    }
    bool isAtEnd() const { return at_ == bytes_.size(); }

private:
    void need(std::uint64_t size) const {
        if (size > bytes_.size() - at_) throw std::runtime_error("a row of the sweep is cut off");
    }
    const std::string& bytes_;
    std::size_t at_ = 0;
};

}  // namespace

const char* getName(SweepStatus status) {
    switch (status) {
        case SweepStatus::Ok:
            return "ok";
        case SweepStatus::Tripped:
            return "tripped";
        case SweepStatus::Stopped:
            return "stopped";
        case SweepStatus::GuaranteeBroken:
            return "guarantee_broken";
        case SweepStatus::Crashed:
            return "crashed";
        case SweepStatus::TimedOut:
            return "timed_out";
        case SweepStatus::Failed:
            return "failed";
    }
    return "";
}

SweepStatus getSweepStatus(const CaseResult& result) {
    const int code = result.exitCode();
    if (code == static_cast<int>(ErrorKind::GuaranteeBroken)) return SweepStatus::GuaranteeBroken;
    if (code == static_cast<int>(ErrorKind::TrackingLost)) return SweepStatus::Tripped;
    if (result.stopReason == StopReason::None) return SweepStatus::Ok;
    if (result.stopReason == StopReason::FilterEnded || result.stopReason == StopReason::TicksMissed ||
        result.stopReason == StopReason::Requested)
        return SweepStatus::Stopped;
    return SweepStatus::Failed;
}

std::vector<SweepColumn> makeSweepColumns(const std::vector<std::pair<std::string, std::string>>& drawKeys,
                                          const std::vector<std::string>& joints) {
    using Kind = SweepColumn::Kind;
    std::vector<SweepColumn> columns = {
        {Kind::Status, "status", "", "How it ended", ""},
        {Kind::Status, "exit_code", "", "What viable run ends with", ""},
        {Kind::Status, "message", "", "What stopped it", ""},
        {Kind::Status, "replay", "", "The command that does it again", ""},
        {Kind::Status, "wall_s", "s", "Time it took", ""},
    };
    for (const auto& [keyPath, distribution] : drawKeys)
        columns.push_back({Kind::Draw, kDrawPrefix + keyPath, findUnit(keyPath), keyPath, distribution});
    for (const ResultColumn& column : resultColumns())
        columns.push_back({Kind::Result, column.name, column.unit, column.label, ""});
    for (const std::string& joint : joints)
        for (const JointColumn& column : jointColumns())
            columns.push_back(
                {Kind::Result, "tracking." + joint + "." + column.name, column.unit, joint + ": " + column.label, ""});
    checkNames(columns);
    return columns;
}

SweepRow makeSweepRow(const std::vector<SweepColumn>& columns, std::int64_t run, const std::string& caseName,
                      const SweepEnd& end, const std::map<std::string, std::string>& draws, const CasePlan* plan,
                      const CaseResult* result) {
    std::map<std::string, SweepValue> values = {
        {"status", std::string(getName(end.status))},
        {"exit_code", std::int64_t{end.exitCode}},
        {"message", end.message},
        {"replay", end.replay},
        {"wall_s", end.wall_s},
    };
    for (const auto& [keyPath, text] : draws) values[kDrawPrefix + keyPath] = makeValue(text);
    if (plan && result) {
        for (const ResultColumn& column : resultColumns()) values[column.name] = column.get(*plan, *result);
        const std::vector<std::string>& joints = result->summary.jointNames();
        for (std::size_t i = 0; i < joints.size() && result->summary.hasRealPlant(); ++i)
            for (const JointColumn& column : jointColumns())
                values["tracking." + joints[i] + "." + column.name] = column.get(*result, static_cast<int>(i));
    }
    SweepRow row{run, caseName, {}};
    for (const SweepColumn& column : columns) {
        SweepValue& value = values[column.name];
        // SQL and CSV know no NaN: it is a figure that is not there.
        if (const double* number = std::get_if<double>(&value); number && std::isnan(*number)) value = {};
        row.values.push_back(std::move(value));
    }
    return row;
}

std::string packRow(const SweepRow& row) {
    std::string bytes;
    put(bytes, row.run);
    putText(bytes, row.caseName);
    put(bytes, static_cast<std::uint64_t>(row.values.size()));
    for (const SweepValue& value : row.values) {
        put(bytes, static_cast<std::uint8_t>(value.index()));
        if (const auto* number = std::get_if<double>(&value)) put(bytes, *number);
        if (const auto* whole = std::get_if<std::int64_t>(&value)) put(bytes, *whole);
        if (const auto* text = std::get_if<std::string>(&value)) putText(bytes, *text);
    }
    return bytes;
}

SweepRow unpackRow(const std::string& bytes) {
    Unpacker from(bytes);
    SweepRow row;
    row.run = from.take<std::int64_t>();
    row.caseName = from.takeText();
    const auto count = from.take<std::uint64_t>();
    for (std::uint64_t i = 0; i < count; ++i) {
        switch (from.take<std::uint8_t>()) {
            case 0:
                row.values.emplace_back();
                break;
            case 1:
                row.values.emplace_back(from.take<double>());
                break;
            case 2:
                row.values.emplace_back(from.take<std::int64_t>());
                break;
            case 3:
                row.values.emplace_back(from.takeText());
                break;
            default:
                throw std::runtime_error("a row of the sweep has a value of no known type");
        }
    }
    if (!from.isAtEnd()) throw std::runtime_error("a row of the sweep has more than it says");
    return row;
}

}  // namespace viable
