#include <cmath>
#include <nlohmann/json.hpp>

#include "summary/CaseResult.h"

namespace viable {

std::string writeSummaryJson(const std::string& title, const std::filesystem::path& experiment,
                             const std::vector<CaseResult>& results) {
    using nlohmann::json;
    const auto number = [](double x) { return std::isfinite(x) ? json(x) : json(x > 0 ? "inf" : "-inf"); };
    const auto orNull = [](double x) { return std::isnan(x) ? json(nullptr) : json(x); };
    json cases = json::array();
    for (const CaseResult& r : results) {
        const Summary& s = r.summary;
        json limits = json::object();
        for (LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk}) {
            json joints = json::object();
            for (std::size_t i = 0; i < s.jointNames().size(); ++i) {
                const LimitRecord& limit = s.limit(kind)[i];
                joints[s.jointNames()[i]] = {{"worst_use", limit.exists ? number(limit.worstUse) : json(nullptr)},
                                             {"worst_time_s", limit.worstTime_s},
                                             {"worst_excess", number(limit.worstExcess)},
                                             {"ticks_outside", limit.ticksOutside},
                                             {"ticks_recovering", limit.ticksRecovering},
                                             {"worst_recovering", number(limit.worstRecovering)}};
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
            return json{{"median_us", h.percentile(0.5)}, {"p99_us", h.percentile(0.99)}, {"max_us", h.max()}};
        };
        for (int i = 0; i < kStageCount; ++i)
            stages[getName(static_cast<Stage>(i))] = times(s.stageTime(static_cast<Stage>(i)));
        json tracking = nullptr;
        if (s.hasRealPlant()) {
            tracking = json::object();
            tracking["rms_rad"] = s.trackingRms();
            tracking["max_rad"] = s.trackingMax();
            for (std::size_t i = 0; i < s.jointNames().size(); ++i)
                tracking["joints"][s.jointNames()[i]] = {{"rms_rad", s.trackingRms(static_cast<int>(i))},
                                                         {"max_rad", s.trackingMax(static_cast<int>(i))}};
        }
        json realLimits = nullptr, bound = nullptr, trip = nullptr, motors = nullptr;
        const auto describeReal = [&](const std::vector<LimitRecord>& records) {
            json joints = json::object();
            for (std::size_t i = 0; i < s.jointNames().size(); ++i) {
                const LimitRecord& limit = records[i];
                joints[s.jointNames()[i]] = {{"worst_use", limit.exists ? number(limit.worstUse) : json(nullptr)},
                                             {"worst_time_s", limit.worstTime_s},
                                             {"worst_excess", number(limit.worstExcess)},
                                             {"ticks_outside", limit.ticksOutside}};
            }
            return joints;
        };
        if (s.hasRealPlant()) {
            realLimits = json::object();
            motors = json::object();
            for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity})
                realLimits[getName(kind, LimitSide::Neither)] = describeReal(s.realLimit(kind));
            for (std::size_t i = 0; i < s.jointNames().size(); ++i) {
                const MotorRecord& motor = s.motor(static_cast<int>(i));
                motors[s.jointNames()[i]] = {{"worst_use", number(motor.worstUse)},
                                             {"worst_time_s", motor.worstTime_s},
                                             {"ticks_saturated", motor.ticksSaturated}};
            }
        }
        if (const std::optional<TrackingBound>& b = s.reference().bound) {
            json joints = json::object();
            for (int i = 0; i < static_cast<int>(s.jointNames().size()); ++i)
                joints[s.jointNames()[static_cast<std::size_t>(i)]] = {
                    {"position_rad", number(b->position[i])},
                    {"velocity_radps", number(b->velocity[i])},
                    {"measured_rad", number(b->measured[i])},
                    {"worst_position_share", number(s.boundShare(LimitKind::Position, i))},
                    {"worst_velocity_share", number(s.boundShare(LimitKind::Velocity, i))}};
            const int worst = s.worstBoundJoint();
            bound = {{"worst_share", number(s.boundShare(LimitKind::Position, worst))},
                     {"worst_joint", s.jointNames()[static_cast<std::size_t>(worst)]},
                     {"joints", joints}};
        }
        if (s.trip()) {
            bool isInside = true;
            json stop = json::object();
            for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity}) {
                for (const LimitRecord& record : s.realStop(kind)) isInside &= record.ticksOutside == 0;
                stop[getName(kind, LimitSide::Neither)] = describeReal(s.realStop(kind));
            }
            trip = {{"joint", s.jointNames()[static_cast<std::size_t>(s.trip()->joint)]},
                    {"time_s", s.trip()->time_s},
                    {"error_rad", s.trip()->error},
                    {"bound_rad", s.trip()->bound},
                    {"real_arm_inside", isInside},
                    {"real_end_speed_radps", number(s.realEndSpeed())},
                    {"real_limits", stop}};
        }
        json collisions = nullptr;
        if (s.collisions()) {
            const auto describe = [&](const CollisionRecord& c) {
                const auto name = [](const std::string& text) { return text.empty() ? json(nullptr) : json(text); };
                return json{{"least_clearance_m", number(c.leastClearance)},
                            {"least_clearance_s", c.leastClearance_s},
                            {"penetration_m", c.penetration()},
                            {"link", name(c.link)},
                            {"obstacle", name(c.obstacle)},
                            {"other_link", name(c.otherLink)},
                            {"ticks_in_collision", c.ticksInCollision},
                            {"first_collision_s", c.firstCollision_s ? json(*c.firstCollision_s) : json(nullptr)},
                            {"ticks_too_near", c.ticksTooNear}};
            };
            collisions = {{"safety_distance_m", s.collisions()->safetyDistance_m},
                          {"nominal", describe(s.collisions()->nominal)},
                          {"real", s.collisions()->real ? describe(*s.collisions()->real) : json(nullptr)}};
        }
        cases.push_back({{"name", r.name},
                         {"filter", r.filter},
                         {"robust_loop", r.robustLoop},
                         {"real_plant", r.realPlant},
                         {"seeds", r.seeds},
                         {"guarantees_limits", r.guarantees},
                         {"holds_on_real", r.holdsOnReal},
                         {"guarantees_clearance", r.guaranteesClearance},
                         {"collisions", collisions},
                         {"limits_kept", !s.anyLimitBroken() && !s.endsOutside()},
                         {"ends_outside", s.endsOutside()},
                         {"simulated_s", r.simulated_s},
                         {"wall_s", r.wall_s},
                         {"ticks", s.ticks()},
                         {"passed_ticks", s.ticksWith(FilterStatus::Passed)},
                         {"modified_ticks", s.ticksWith(FilterStatus::Modified)},
                         {"infeasible_ticks", s.ticksWith(FilterStatus::Infeasible)},
                         {"first_infeasible_s",
                          s.ticksWith(FilterStatus::Infeasible) > 0 ? json(s.firstInfeasible_s()) : json(nullptr)},
                         {"stopped_ticks", s.ticksWith(FilterStatus::StoppedByPlan)},
                         {"recovering_ticks", s.recoveringTicks()},
                         {"unviable_ticks", s.unviableTicks()},
                         {"first_unviable_s", s.unviableTicks() > 0 ? json(s.firstUnviable_s()) : json(nullptr)},
                         {"missed_ticks", s.missedTicks()},
                         {"substituted_ticks", s.substitutedTicks()},
                         {"stops", stops},
                         {"limits", limits},
                         {"interventions", interventions},
                         {"changed_share", s.changedShare()},
                         {"command_error_rms_rad", orNull(s.commandErrorRms())},
                         {"chatter", orNull(s.chatter())},
                         {"tracking", tracking},
                         {"real_limits", realLimits},
                         {"bound", bound},
                         {"motors", motors},
                         {"tripped", s.trip().has_value()},
                         {"trip", trip},
                         {"external_torque_missing_ticks", s.externalTorqueMissing()},
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
                      {"title", title},
                      {"experiment", experiment.string()},
                      {"version", VIABLE_VERSION},
                      {"cases", cases}};
    return all.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace viable
