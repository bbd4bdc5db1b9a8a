#include "summary/SummaryFigures.h"

#include <mutex>

namespace viable {

namespace {

using nlohmann::json;
using Over = SummaryFigure::Over;
using R = const CaseResult&;
using S = const Summary&;

bool hasRealArm(R r) {
    return r.summary.hasRealPlant();
}
bool hasTripped(R r) {
    return r.summary.trip().has_value();
}

template <class Value>
json toJson(const Value& value) {
    return value;
}
template <class Value>
json toJson(const std::optional<Value>& value) {
    return value ? json(*value) : json(nullptr);
}
std::optional<double> onlyIf(bool exists, double value) {
    return exists ? std::optional(value) : std::nullopt;
}

class Table {
public:
    std::vector<SummaryFigure> figures;

    /** What is added from here on stands in this block of summary.json; it is null in a case that has no such thing. */
    void begin(
        const std::string& block, std::function<bool(R)> exists = [](R) { return true; }) {
        block_ = block;
        exists_ = std::move(exists);
    }
    /** @param get  of the summary and a joint, of the summary, or of the result */
    template <class Get>
    Table& add(const std::string& key, const Get& get) {
        std::function<json(R, int)> asJson;
        if constexpr (std::is_invocable_v<Get, S, int>)
            asJson = [get](R r, int i) { return toJson(std::invoke(get, r.summary, i)); };
        else if constexpr (std::is_invocable_v<Get, S>)
            asJson = [get](R r, int) { return toJson(std::invoke(get, r.summary)); };
        else
            asJson = [get](R r, int) { return toJson(std::invoke(get, r)); };
        figures.push_back({key.empty() ? "" : block_ + key, exists_, asJson});
        return *this;
    }
    /** The figure last added is a column of a sweep's table, too. */
    SummaryFigure& column(const std::string& name, const std::string& unit, const std::string& label,
                          Over over = Over::None) {
        SummaryFigure& last = figures.back();
        std::tie(last.column, last.unit, last.label, last.over) = std::tie(name, unit, label, over);
        return last;
    }
    void addTimes(const std::function<const LatencyHistogram&(S)>& get) {
        add("median_us", [get](S s) { return get(s).calcQuantile_us(0.5); });
        add("p99_us", [get](S s) { return get(s).calcQuantile_us(0.99); });
        add("max_us", [get](S s) { return get(s).worst_us(); });
    }
    void addExtreme(const char* block, const char* key, const ExtremeRecord& (Summary::*get)() const) {
        begin(block);
        add(key, [get](S s) { return (s.*get)().value; });
        add("joint", [get](S s) { return s.jointName((s.*get)().joint); });
        add("time_s", [get](S s) { return (s.*get)().time_s; });
    }

    /** Of each joint's limits. @param column  without the kind at its end  @param unitEnds  of the kinds; or no unit */
    template <class Get>
    void addLimits(const std::vector<LimitRecord>& (Summary::*records)(LimitKind) const, std::size_t kinds,
                   const std::string& key, const Get& get, const std::string& column = "",
                   const std::string& label = "", Over over = Over::Largest,
                   const std::vector<std::string>& unitEnds = {}) {
        for (std::size_t k = 0; k < kinds; ++k) {
            const LimitKind kind = kNominalKinds[k];
            const std::string name = getName(kind, LimitSide::Neither);
            add(name + ".<joint>." + key,
                [records, kind, get](S s, int i) { return toJson(std::invoke(get, (s.*records)(kind)[i])); });
            if (column.empty()) continue;
            this->column(column + name + (unitEnds.empty() ? "" : unitEnds[k]),
                         unitEnds.empty() ? "" : getUnit(kind, false),
                         label + (kind == LimitKind::Acceleration ? " an " : " a ") + name + " limit", over);
        }
    }

private:
    std::string block_;
    std::function<bool(R)> exists_;
};

json getFigure(const LimitFigure::Member& member, const ArmLimitRecord& record) {
    return std::visit(
        [&](auto of) -> json {
            if constexpr (std::is_same_v<decltype(of), std::string ArmLimitRecord::*>)
                return (record.*of).empty() ? json(nullptr) : json(record.*of);
            else
                return toJson(std::invoke(of, record));
        },
        member);
}

/** "Real arm: ticks too fast" of "Ticks too fast". */
std::string nameOfReal(std::string label) {
    label.front() = static_cast<char>(std::tolower(static_cast<unsigned char>(label.front())));
    return "Real arm: " + label;
}

/** The figures of a limit of the whole arm. */
void addArmLimit(Table& t, LimitKind kind) {
    const LimitRow& row = getLimitRow(kind);
    for (const bool isReal : {false, true}) {
        t.begin(row.block + (isReal ? ".real." : ".nominal."), [=](R r) {
            const LimitAccount* account = r.summary.account(kind);
            return account && (!isReal || account->real);
        });
        for (const LimitFigure& figure : row.figures) {
            t.add(figure.key, [=, member = figure.member](S s) {
                const LimitAccount& account = *s.account(kind);
                return getFigure(member, isReal ? *account.real : account.nominal);
            });
            if (figure.column.empty()) continue;
            SummaryFigure& column = t.column((isReal ? "real." : "") + row.columnBlock + "." + figure.column,
                                             figure.unit, isReal ? nameOfReal(figure.label) : figure.label);
            if (figure.member == LimitFigure::Member(&ArmLimitRecord::worst))
                column.horizon = row.horizon;  // a store holds finite numbers
        }
    }
    t.begin(row.block + ".", [=](R r) { return r.summary.account(kind) != nullptr; });
    if (!row.limitKey.empty()) t.add(row.limitKey, [=](S s) { return toJson(s.account(kind)->limit); });
    if (!row.watchesPeople) return;
    t.add("resting_s", [=](S s) { return s.account(kind)->resting_s; });
    t.column(row.columnBlock + ".resting_s", "s", "At rest because of people");
    t.add("contact_speeds_mps", [=](S s) {
        json speeds = json::object();
        for (const auto& [name, speed] : s.account(kind)->allowances) speeds[name] = speed;
        return speeds;
    });
    t.add("appeared", [=](S s) { return s.account(kind)->faults.appeared; });
    t.add("faster_than_stated", [=](S s) { return s.account(kind)->faults.faster; });
    t.add("lost", [=](S s) { return s.account(kind)->faults.lost; });
    t.add("refused", [=](S s) { return s.account(kind)->faults.refused; });
}

std::vector<SummaryFigure> makeFigures() {
    Table t;
    const auto worstUse = [](const LimitRecord& limit) { return onlyIf(limit.exists, limit.worstUse); };
    const auto nominal = [&](const auto&... figure) {
        t.addLimits(&Summary::limit, std::size(kNominalKinds), figure...);
    };
    t.begin("limits.");
    nominal("worst_use", worstUse, "worst_use.", "Worst use of");
    nominal("ticks_outside", &LimitRecord::ticksOutside, "ticks_outside.", "Ticks outside", Over::Sum);
    nominal("worst_time_s", &LimitRecord::worstTime_s);
    nominal("worst_excess", &LimitRecord::worstExcess);
    nominal("ticks_recovering", &LimitRecord::ticksRecovering);
    nominal("worst_recovering", &LimitRecord::worstRecovering);
    const auto real = [&](const char* key, const auto& get, const auto&... column) {
        t.begin("real_limits.", hasRealArm);
        t.addLimits(&Summary::realLimit, std::size(kRealKinds), key, get, column...);
        t.begin("trip.real_limits.", hasTripped);
        t.addLimits(&Summary::realStop, std::size(kRealKinds), key, get);
    };
    real("worst_use", worstUse, "real.worst_use.", "Real arm: worst use of");
    real("worst_excess", &LimitRecord::worstExcess, "real.worst_excess.", "Real arm: farthest beyond", Over::Largest,
         std::vector<std::string>{"_rad", "_radps"});
    real("worst_time_s", &LimitRecord::worstTime_s);
    real("ticks_outside", &LimitRecord::ticksOutside);

    t.begin("tracking.", hasRealArm);
    t.add("max_rad", [](S s) { return s.trackingMax(); });
    t.column("tracking.max_rad", "rad", "Largest distance of the real arm from the nominal one");
    t.add("rms_rad", [](S s) { return s.trackingRms(); });
    t.column("tracking.rms_rad", "rad", "RMS distance of the real arm from the nominal one");
    t.add("joints.<joint>.max_rad", [](S s, int i) { return s.trackingMax(i); });
    t.column("tracking.<joint>.max_rad", "rad", "Largest distance from the nominal arm");
    t.add("joints.<joint>.rms_rad", [](S s, int i) { return s.trackingRms(i); });
    t.begin("bound.", [](R r) { return r.summary.reference().bound.has_value(); });
    t.add("joints.<joint>.worst_position_share", [](S s, int i) { return s.boundShare(LimitKind::Position, i); });
    t.column("bound.share", "", "Largest share of the tracking bound used", Over::Largest);
    t.add("joints.<joint>.worst_velocity_share", [](S s, int i) { return s.boundShare(LimitKind::Velocity, i); });
    t.column("bound.velocity_share", "", "Largest share of its rate's bound used", Over::Largest);
    t.add("joints.<joint>.position_rad", [](S s, int i) { return s.reference().bound->position[i]; });
    t.add("joints.<joint>.velocity_radps", [](S s, int i) { return s.reference().bound->velocity[i]; });
    t.add("joints.<joint>.measured_rad", [](S s, int i) { return s.reference().bound->measured[i]; });
    t.add("worst_share", [](S s) { return s.boundShare(LimitKind::Position, s.worstBoundJoint(LimitKind::Position)); });
    t.add("worst_joint", [](S s) { return s.jointName(s.worstBoundJoint(LimitKind::Position)); });
    t.begin("motors.", hasRealArm);
    t.add("<joint>.worst_use", [](S s, int i) { return s.motor(i).worstUse; });
    t.column("motor.worst_use", "", "Largest share of a motor's torque used", Over::Largest);
    t.add("<joint>.worst_added", [](S s, int i) { return s.motor(i).worstAdded; });
    t.column("motor.worst_added", "", "Largest share of a motor's torque added by the robust loop", Over::Largest);
    t.add("<joint>.ticks_saturated", [](S s, int i) { return s.motor(i).ticksSaturated; });
    t.column("motor.saturated_ticks", "", "Joint-ticks with a motor at its limit", Over::Sum);
    t.add("<joint>.ticks_rate_limited", [](S s, int i) { return s.motor(i).ticksRateLimited; });
    t.add("<joint>.worst_time_s", [](S s, int i) { return s.motor(i).worstTime_s; });

    t.begin("contact.", [](R r) { return r.summary.touching().has_value(); });
    t.add("peak_N", [](S s) { return s.touching()->peak.pressing; });
    t.column("contact.peak_N", "N", "Largest force that the real arm presses with", Over::Largest);
    t.add("ticks", [](S s) { return s.touching()->ticks; });
    t.column("contact.ticks", "", "Ticks in which the real arm touches something", Over::Sum);
    t.add("touches", [](S s) { return s.touching()->touches; });
    t.add("last_N", [](S s) { return s.touching()->last; });
    t.add("peak_s", [](S s) { return onlyIf(s.touching()->ticks > 0, s.touching()->peak_s); });
    t.add("first_s", [](S s) { return onlyIf(s.touching()->ticks > 0, s.touching()->first_s); });
    t.add("obstacle", [](R r) {
        const int obstacle = r.summary.touching()->peak.obstacle, count = static_cast<int>(r.obstacles.size());
        return obstacle >= 0 && obstacle < count ? r.obstacles[obstacle] : std::string();
    });

    t.begin("touch.", [](R r) { return r.summary.waiting().has_value(); });
    t.add("ticks", [](S s) { return s.waiting()->ticks; });
    t.column("touch.ticks", "", "Ticks in which the nominal arm waits for a tool that is held", Over::Sum);
    t.add("force_N", [](S s) { return s.waiting()->force; });
    t.add("first_s", [](S s) { return onlyIf(s.waiting()->ticks > 0, s.waiting()->first_s); });
    t.add("mean_N", [](S s) { return onlyIf(s.waiting()->ticks > 0, s.waiting()->mean()); });
    t.add("least_asked_N", [](S s) { return onlyIf(s.waiting()->ticks > 0, s.waiting()->leastAsked); });

    for (const LimitKind kind : listArmLimits()) addArmLimit(t, kind);

    t.begin("");
    t.add("standstill_s", [](S s) { return s.standstill().total_s; });
    t.add("longest_standstill_s", [](S s) { return s.standstill().longest_s; });
    t.add("infeasible_ticks", [](S s) { return s.ticksWith(FilterStatus::Infeasible); });
    t.column("infeasible_ticks", "", "Ticks without an admissible choice");
    t.add("", [](R r) { return onlyIf(r.exitCode() == static_cast<int>(ErrorKind::TrackingLost), r.stopTime_s); });
    t.column("tripped_at_s", "s", "When the real arm left the bound and was braked");
    t.add("simulated_s", &CaseResult::simulated_s).column("simulated_s", "s", "Length of the run");
    t.add("wall_s", &CaseResult::wall_s);
    t.add("limits_kept", [](S s) { return !s.anyLimitBroken() && !s.endsOutside(); });
    t.add("ends_outside", &Summary::endsOutside);
    t.add("ticks", &Summary::ticks);
    t.add("passed_ticks", [](S s) { return s.ticksWith(FilterStatus::Passed); });
    t.add("modified_ticks", [](S s) { return s.ticksWith(FilterStatus::Modified); });
    t.add("stopped_ticks", [](S s) { return s.ticksWith(FilterStatus::StoppedByPlan); });
    t.add("first_infeasible_s",
          [](S s) { return onlyIf(s.ticksWith(FilterStatus::Infeasible) > 0, s.firstInfeasible_s()); });
    t.add("recovering_ticks", &Summary::recoveringTicks);
    t.add("unviable_ticks", &Summary::unviableTicks);
    t.add("first_unviable_s", [](S s) { return onlyIf(s.unviableTicks() > 0, s.firstUnviable_s()); });
    t.add("missed_ticks", &Summary::missedTicks);
    t.add("substituted_ticks", &Summary::substitutedTicks);
    t.add("external_torque_missing_ticks", &Summary::externalTorqueMissing);
    t.add("changed_share", &Summary::changedShare);
    t.add("command_error_rms_rad", &Summary::commandErrorRms)
        .column("command_error.rms_rad", "rad", "RMS distance of the nominal joints to those commanded");
    t.add("command_error_max_rad", [](S s) {
        double largest = kNan;
        for (int i = 0; i < s.size(); ++i) largest = std::fmax(largest, s.following(i).largestError());
        return largest;
    });
    t.add("real_command_error_rms_rad", &Summary::realCommandErrorRms)
        .column("real.command_error.rms_rad", "rad", "RMS distance of the real joints to those commanded");
    t.add("tool_error_rms_m", &Summary::toolErrorRms)
        .column("tool_error.rms_m", "m", "RMS distance of the nominal tool to the one commanded");
    t.add("tool_error_max_m", [](S s) { return s.tool().largestError(); });
    t.column("tool_error.max_m", "m", "Largest distance of the nominal tool to the one commanded");
    t.add("tool_error_rms_rad", [](S s) { return s.turn().errorRms(); });
    t.column("tool_error.rms_rad", "rad", "RMS angle between the nominal tool and the one commanded");
    t.add("real_tool_error_rms_m", [](S s) { return s.realTool().errorRms(); });
    t.column("real.tool_error.rms_m", "m", "RMS distance of the real tool to the one commanded");
    t.add("real_tool_error_max_m", [](S s) { return s.realTool().largestError(); });
    t.add("real_tool_error_rms_rad", [](S s) { return s.realTurn().errorRms(); });
    t.add("jerk_rms_radps3", &Summary::jerkRms).column("jerk.rms_radps3", "rad/s^3", "RMS jerk of the nominal joints");
    t.add("chatter", &Summary::chatter);
    t.add("tripped", [](R r) { return hasTripped(r) || r.stopReason == StopReason::NotFollowing; });
    t.begin("trip.", hasTripped);
    t.add("joint", [](S s) { return s.jointName(s.trip()->joint); });
    t.add("time_s", [](S s) { return s.trip()->time_s; });
    t.add("error_rad", [](S s) { return s.trip()->error; });
    t.add("bound_rad", [](S s) { return s.trip()->bound; });
    t.add("real_end_speed_radps", &Summary::realEndSpeed);
    t.add("real_arm_inside", [](S s) {
        std::int64_t outside = 0;
        for (const LimitKind kind : kRealKinds)
            for (const LimitRecord& limit : s.realStop(kind)) outside += limit.ticksOutside;
        return outside == 0;
    });
    t.addExtreme("stops.least_margin.", "margin_rad", &Summary::worstMargin);
    t.addExtreme("stops.longest_stop.", "stop_s", &Summary::longestStop);
    t.begin("tick.");
    t.addTimes(&Summary::tickTime);
    for (int i = 0; i < kStageCount; ++i) {
        const auto stage = static_cast<Stage>(i);
        t.begin(std::string("stages.") + getName(stage) + ".");
        t.addTimes([stage](S s) -> const LatencyHistogram& { return s.stageTime(stage); });
    }
    return t.figures;
}

}  // namespace

json SummaryFigure::getColumn(const CaseResult& result, int joint) const {
    if (!exists(result)) return nullptr;
    json value = over == Over::None ? get(result, joint) : json(nullptr);
    for (int i = 0; over != Over::None && i < result.summary.size(); ++i) {
        const json own = get(result, i);
        if (over == Over::Sum)
            value = (value.is_null() ? 0 : value.get<std::int64_t>()) + own.get<std::int64_t>();
        else if (!own.is_null())
            value = std::max(value.is_null() ? 0.0 : value.get<double>(), own.get<double>());
    }
    if (value.is_number_float()) value = std::clamp(value.get<double>(), -horizon, horizon);
    return value;
}

const std::vector<SummaryFigure>& listSummaryFigures() {
    static std::mutex making;
    static std::map<std::vector<const LimitRow*>, const std::vector<SummaryFigure>> byRows;  // what was told once stays
    const std::lock_guard<std::mutex> guard(making);
    std::vector<const LimitRow*> rows;
    for (const LimitKind kind : listArmLimits()) rows.push_back(&getLimitRow(kind));
    auto known = byRows.find(rows);
    if (known == byRows.end()) known = byRows.emplace(rows, makeFigures()).first;
    return known->second;
}

}  // namespace viable
