#include <cmath>
#include <nlohmann/json.hpp>

#include "viable/experiment/CaseRun.h"

namespace viable {

std::string writeSummaryJson(const Experiment& experiment, const std::vector<CaseResult>& results) {
    using nlohmann::json;
    const auto number = [](double x) {
        return std::isfinite(x) ? json(x) : json(x > 0 ? "inf" : "-inf");
    };
    const auto orNull = [](double x) { return std::isnan(x) ? json(nullptr) : json(x); };
    json cases = json::array();
    for (const CaseResult& r : results) {
        const Summary& s = r.summary;
        json limits = json::object();
        for (LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration,
                               LimitKind::Jerk}) {
            json joints = json::object();
            for (std::size_t i = 0; i < s.jointNames().size(); ++i) {
                const LimitRecord& limit = s.limit(kind)[i];
                joints[s.jointNames()[i]] = {
                    {"worst_use", limit.exists ? number(limit.worstUse) : json(nullptr)},
                    {"worst_time_s", limit.worstTime_s},
                    {"worst_excess", number(limit.worstExcess)},
                    {"ticks_outside", limit.ticksOutside},
                    {"ticks_returning", limit.ticksReturning},
                    {"worst_returning", number(limit.worstReturning)}};
            }
            limits[getName(kind, LimitSide::Neither)] = joints;
        }
        json interventions = json::object();
        for (const auto& [key, record] : s.interventions())
            interventions[key.first][key.second] = {
                {"ticks", record.ticks},
                {"episodes", record.episodes},
                {"total_s", static_cast<double>(record.ticks) * s.tick_s()},
                {"longest_s", static_cast<double>(record.longestTicks) * s.tick_s()},
                {"tau_removed_max_Nm", number(record.largestTorque)},
                {"tau_removed_rms_Nm", number(record.torqueRms())}};
        const auto extreme = [&](const ExtremeRecord& e, const char* unit) {
            return json{{unit, number(e.value)},
                        {"joint", s.jointNames()[static_cast<std::size_t>(e.joint)]},
                        {"time_s", e.time_s}};
        };
        const json stops = {{"least_margin", extreme(s.worstMargin(), "margin_rad")},
                            {"longest_stop", extreme(s.longestStop(), "stop_s")}};
        json stages = json::object();
        const auto times = [](const TimeHistogram& h) {
            return json{{"median_us", h.percentile(0.5)},
                        {"p99_us", h.percentile(0.99)},
                        {"max_us", h.max()}};
        };
        for (int i = 0; i < kStageCount; ++i)
            stages[getName(static_cast<Stage>(i))] = times(s.stageTime(static_cast<Stage>(i)));
        json tracking = nullptr;
        if (s.hasRealPlant()) {
            tracking = json::object();
            tracking["rms_rad"] = s.trackingRms();
            tracking["max_rad"] = s.trackingMax();
            for (std::size_t i = 0; i < s.jointNames().size(); ++i)
                tracking["joints"][s.jointNames()[i]] = {
                    {"rms_rad", s.trackingRms(static_cast<int>(i))},
                    {"max_rad", s.trackingMax(static_cast<int>(i))}};
        }
        cases.push_back({{"name", r.name},
                         {"filter", r.filter},
                         {"robust_loop", r.robustLoop},
                         {"real_plant", r.realPlant},
                         {"seeds", r.seeds},
                         {"promises_limits", r.promises},
                         {"limits_kept", !s.anyLimitBroken() && !s.endsOutside()},
                         {"ends_outside", s.endsOutside()},
                         {"simulated_s", r.simulated_s},
                         {"wall_s", r.wall_s},
                         {"ticks", s.ticks()},
                         {"passed_ticks", s.ticksWith(FilterStatus::Passed)},
                         {"modified_ticks", s.ticksWith(FilterStatus::Modified)},
                         {"infeasible_ticks", s.ticksWith(FilterStatus::Infeasible)},
                         {"first_infeasible_s", s.ticksWith(FilterStatus::Infeasible) > 0
                                                    ? json(s.firstInfeasible_s())
                                                    : json(nullptr)},
                         {"stopped_ticks", s.ticksWith(FilterStatus::StoppedByPlan)},
                         {"returning_ticks", s.returningTicks()},
                         {"unviable_ticks", s.unviableTicks()},
                         {"first_unviable_s",
                          s.unviableTicks() > 0 ? json(s.firstUnviable_s()) : json(nullptr)},
                         {"missed_ticks", s.missedTicks()},
                         {"substituted_ticks", s.substitutedTicks()},
                         {"stops", stops},
                         {"limits", limits},
                         {"interventions", interventions},
                         {"changed_share", s.changedShare()},
                         {"command_error_rms_rad", orNull(s.commandErrorRms())},
                         {"chatter", orNull(s.chatter())},
                         {"tracking", tracking},
                         {"tick", times(s.tickTime())},
                         {"stages", stages},
                         {"verdict", formatVerdict(r)},
                         {"account", formatDetails(r)},
                         {"warnings", r.warnings},
                         {"stop", r.stopMessage},
                         {"stop_time_s", r.stopMessage.empty() ? json(nullptr) : json(r.stopTime_s)},
                         {"log", r.log.filename().string()},
                         {"log_rows", r.logRows},
                         {"log_error", r.logError},
                         {"exit_code", r.exitCode()}});
    }
    const json all = {{"schema", 1},
                      {"title", experiment.title},
                      {"experiment", experiment.file.string()},
                      {"version", VIABLE_VERSION},
                      {"cases", cases}};
    return all.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace viable
