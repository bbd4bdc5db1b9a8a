#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "viable/experiment/CaseRun.h"

namespace viable {

namespace {

constexpr LimitKind kKinds[] = {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration,
                                LimitKind::Jerk};
const char* const kKindNames[] = {"position", "velocity", "acceleration", "jerk"};

template <class... Arguments>
std::string format(const char* pattern, Arguments... arguments) {
    char text[512];
    std::snprintf(text, sizeof text, pattern, arguments...);
    return text;
}

/** Percent, with enough digits that a limit passed by a hair does not read as 100.00. */
std::string formatPercent(double share) {
    if (std::isinf(share)) return "inf";
    if (share > 1.0 + kOutsideShare && share < 1.0 + 5e-5)
        return share < 1.0 + 1e-6 ? ">100" : format("%.4f", 100.0 * share);
    return format(share < 10.0 ? "%.2f" : "%.0f", 100.0 * share);
}

/** Milliradians in plain numbers as long as those are readable. */
std::string formatMrad(double rad) {
    return format(std::abs(rad) < 10.0 ? "%.4g" : "%.3e", 1e3 * rad);
}

/** What became of ticks in which the arm was led back to its limits. */
std::string formatReturn(const Summary& s) {
    std::string text =
        format(" but for %lld ticks of return", static_cast<long long>(s.returningTicks()));
    for (int k = 0; k < Summary::kQuantities; ++k) {
        double worst = 0.0;
        for (const LimitRecord& limit : s.limit(kKinds[k]))
            worst = std::max(worst, limit.worstReturning);
        if (worst > 0.0)
            text += format(", %s by %.3g %s", kKindNames[k], worst, getUnit(kKinds[k]));
    }
    return text;
}

/** One line per limit, all joints together. */
std::string formatInterventions(const Summary& s) {
    std::map<std::string, InterventionRecord> byLimit;
    for (const auto& [key, record] : s.interventions()) {
        InterventionRecord& sum = byLimit[key.second];
        sum.ticks += record.ticks;
        sum.episodes += record.episodes;
        sum.longestTicks = std::max(sum.longestTicks, record.longestTicks);
        sum.largestTorque = std::max(sum.largestTorque, record.largestTorque);
        sum.squaredTorque += record.squaredTorque;
    }
    std::string text;
    for (const auto& [name, sum] : byLimit)
        text += format(
            "  %-20s acted %lld times, %.3f joint-s, longest %.3f s, torque removed max %.3g, RMS "
            "%.3g Nm\n",
            name.c_str(), static_cast<long long>(sum.episodes),
            static_cast<double>(sum.ticks) * s.tick_s(),
            static_cast<double>(sum.longestTicks) * s.tick_s(), sum.largestTorque, sum.torqueRms());
    return text;
}

std::string formatStops(const Summary& s) {
    std::string text = "  stops         ";
    if (std::isfinite(s.worstMargin().value))
        text += format("least margin %.3g rad (%s at %.3f s), ", s.worstMargin().value,
                       s.jointNames()[static_cast<std::size_t>(s.worstMargin().joint)].c_str(),
                       s.worstMargin().time_s);
    text += format("longest %.3f s (%s at %.3f s)", s.longestStop().value,
                   s.jointNames()[static_cast<std::size_t>(s.longestStop().joint)].c_str(),
                   s.longestStop().time_s);
    if (s.unviableTicks() > 0)
        text += format(", unviable ticks %lld (first at %.3f s)",
                       static_cast<long long>(s.unviableTicks()), s.firstUnviable_s());
    if (s.missedTicks() > 0)
        text += format(", missed ticks %lld", static_cast<long long>(s.missedTicks()));
    return text + "\n";
}

}  // namespace

std::string formatComparison(const std::vector<CaseResult>& results) {
    std::string text =
        format("%-16s | %-33s | %-23s | %-19s | %s\n", "", "worst use of the limit [%]",
               "joint-ticks ticks  ticks", "real - nominal", "tick [us]");
    text += format("%-16s | %8s %8s %7s %7s | %7s %7s %8s | %9s %9s | %6s %6s\n", "case",
                   "position", "velocity", "accel.", "jerk", "outside", "empty", "changed",
                   "RMS[mrad]", "max[mrad]", "median", "p99");
    text += std::string(118, '-') + "\n";
    for (const CaseResult& r : results) {
        const Summary& s = r.summary;
        std::int64_t outside = 0;
        for (LimitKind kind : kKinds) outside += s.ticksOutside(kind);
        const auto use = [&](LimitKind kind) {
            return formatPercent(s.limit(kind)[s.worstJoint(kind)].worstUse);
        };
        const double modified =
            s.ticks() ? 100.0 *
                            static_cast<double>(s.ticksWith(FilterStatus::Modified) +
                                                s.ticksWith(FilterStatus::Infeasible)) /
                            static_cast<double>(s.ticks())
                      : 0.0;
        text += format("%-16s | %8s %8s %7s %7s | %7lld %7lld %6.1f %% | %9s %9s | %6.1f %6.1f\n",
                       r.name.c_str(), use(LimitKind::Position).c_str(),
                       use(LimitKind::Velocity).c_str(), use(LimitKind::Acceleration).c_str(),
                       use(LimitKind::Jerk).c_str(), static_cast<long long>(outside),
                       static_cast<long long>(s.ticksWith(FilterStatus::Infeasible)), modified,
                       s.hasRealPlant() ? formatMrad(s.trackingRms()).c_str() : "-",
                       s.hasRealPlant() ? formatMrad(s.trackingMax()).c_str() : "-",
                       s.tickTime().percentile(0.5), s.tickTime().percentile(0.99));
    }
    text +=
        "Limits are those of the nominal arm. outside: joint-ticks beyond any limit; empty: ticks "
        "without "
        "an\nadmissible choice; changed: ticks in which the filter changed the motion. Times are "
        "this "
        "machine's, not real-time.\n";
    return text;
}

std::string formatDetails(const CaseResult& r) {
    const Summary& s = r.summary;
    std::string text = r.name + ": filter " + r.filter;
    if (!r.realPlant.empty())
        text += ", robust loop " + r.robustLoop + ", real plant " + r.realPlant;
    text += format("; %.3f s simulated in %.2f s (%.0f times real time)\n", r.simulated_s, r.wall_s,
                   r.wall_s > 0.0 ? r.simulated_s / r.wall_s : 0.0);
    text += "  verdict       ";
    if (!s.anyLimitBroken()) text += "all limits kept";
    const char* joiner = "limits broken: ";
    for (int k = 0; k < Summary::kQuantities; ++k) {
        if (s.ticksOutside(kKinds[k]) == 0) continue;
        double excess = 0.0;
        for (const LimitRecord& limit : s.limit(kKinds[k]))
            excess = std::max(excess, limit.worstExcess);
        text += joiner + format("%s by %.3g %s", kKindNames[k], excess, getUnit(kKinds[k]));
        joiner = ", ";
    }
    if (s.returningTicks() > 0) text += formatReturn(s);
    text +=
        std::string(" (nominal arm; the filter promises ") + (r.promises ? "all" : "none") + ")\n";
    for (int k = 0; k < Summary::kQuantities; ++k) {
        const int joint = s.worstJoint(kKinds[k]);
        const LimitRecord& limit = s.limit(kKinds[k])[joint];
        text += format(
            "  %-13s worst use %9s %% (%s at %.3f s), outside in %lld joint-ticks, worst excess "
            "%.3g %s\n",
            kKindNames[k], formatPercent(limit.worstUse).c_str(), s.jointNames()[joint].c_str(),
            limit.worstTime_s, static_cast<long long>(s.ticksOutside(kKinds[k])), limit.worstExcess,
            getUnit(kKinds[k]));
    }
    text += format(
        "  filter        passed %lld, modified %lld, no admissible choice %lld, stop %lld, "
        "returning "
        "%lld of %lld ticks\n",
        static_cast<long long>(s.ticksWith(FilterStatus::Passed)),
        static_cast<long long>(s.ticksWith(FilterStatus::Modified)),
        static_cast<long long>(s.ticksWith(FilterStatus::Infeasible)),
        static_cast<long long>(s.ticksWith(FilterStatus::StoppedByPlan)),
        static_cast<long long>(s.ticksWith(FilterStatus::Returning)),
        static_cast<long long>(s.ticks()));
    text += formatInterventions(s) + formatStops(s);
    if (s.substitutedTicks() > 0)
        text += format(
            "  controller    %lld ticks without a usable torque, the last good one was used\n",
            static_cast<long long>(s.substitutedTicks()));
    if (s.hasRealPlant()) {
        text += "  real-nominal  RMS / max per joint [mrad]";
        for (int i = 0; i < static_cast<int>(s.jointNames().size()); ++i)
            text += "  " + formatMrad(s.trackingRms(i)) + " / " + formatMrad(s.trackingMax(i));
        int worst = 0;
        for (int i = 1; i < static_cast<int>(s.jointNames().size()); ++i)
            if (s.realPosition(i).worstUse > s.realPosition(worst).worstUse) worst = i;
        text += "\n  real arm      position: worst use " +
                formatPercent(s.realPosition(worst).worstUse) + " % (" + s.jointNames()[worst] +
                ")\n";
    }
    text += format("  tick          median %.1f us, p99 %.1f us, max %.1f us (median / p99:",
                   s.tickTime().percentile(0.5), s.tickTime().percentile(0.99), s.tickTime().max());
    for (int i = 0; i < kStageCount; ++i) {
        const TimeHistogram& h = s.stageTime(static_cast<Stage>(i));
        text += format("%s %s %.1f / %.1f", i ? "," : "", getName(static_cast<Stage>(i)),
                       h.percentile(0.5), h.percentile(0.99));
    }
    text += ")\n";
    if (!r.seeds.empty()) {
        text += "  seeds        ";
        for (const auto& [plugin, seed] : r.seeds) text += " " + plugin + " " + seed;
        text += "\n";
    }
    if (!r.log.empty())
        text += format("  log           %s (%lld rows)\n", r.log.c_str(),
                       static_cast<long long>(r.logRows));
    if (!r.stopMessage.empty()) text += "  STOPPED       " + r.stopMessage + "\n";
    if (!r.logError.empty()) text += "  LOG LOST      " + r.logError + "\n";
    return text;
}

std::string writeSummaryJson(const Experiment& experiment, const std::vector<CaseResult>& results) {
    using nlohmann::json;
    const auto number = [](double x) {
        return std::isfinite(x) ? json(x) : json(x > 0 ? "inf" : "-inf");
    };
    json cases = json::array();
    for (const CaseResult& r : results) {
        const Summary& s = r.summary;
        json limits = json::object();
        for (int k = 0; k < Summary::kQuantities; ++k) {
            json joints = json::object();
            for (std::size_t i = 0; i < s.jointNames().size(); ++i) {
                const LimitRecord& limit = s.limit(kKinds[k])[i];
                joints[s.jointNames()[i]] = {{"worst_use", number(limit.worstUse)},
                                             {"worst_time_s", limit.worstTime_s},
                                             {"worst_excess", number(limit.worstExcess)},
                                             {"ticks_outside", limit.ticksOutside},
                                             {"ticks_returning", limit.ticksReturning},
                                             {"worst_returning", number(limit.worstReturning)}};
            }
            limits[kKindNames[k]] = joints;
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
                         {"limits_kept", !s.anyLimitBroken()},
                         {"simulated_s", r.simulated_s},
                         {"wall_s", r.wall_s},
                         {"ticks", s.ticks()},
                         {"passed_ticks", s.ticksWith(FilterStatus::Passed)},
                         {"modified_ticks", s.ticksWith(FilterStatus::Modified)},
                         {"empty_ticks", s.ticksWith(FilterStatus::Infeasible)},
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
                         {"tracking", tracking},
                         {"tick", times(s.tickTime())},
                         {"stages", stages},
                         {"stop", r.stopMessage},
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
