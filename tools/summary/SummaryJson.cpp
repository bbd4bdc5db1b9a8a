#include "core/JsonNumber.h"
#include "limits/LimitRows.h"
#include "summary/SummaryFigures.h"

namespace viable {

namespace {

using detail::makeNumberOrWord;
using nlohmann::json;

/** Puts a figure of a joint at its place, a path of keys with dots between them. */
void put(json& to, const std::string& key, const std::string& joint, const json& value) {
    json* place = &to;
    for (std::size_t begin = 0; begin <= key.size();) {
        const std::size_t end = std::min(key.find('.', begin), key.size());
        const std::string part = key.substr(begin, end - begin);
        place = &(*place)[part == SummaryFigure::kJoint ? joint : part];
        begin = end + 1;
    }
    *place = value.is_number_float() ? makeNumberOrWord(value.get<double>()) : value;
}

json describeInterventions(const Summary& s) {
    json all = json::object();
    for (const auto& [key, record] : s.interventions())
        all[key.first][key.second] = {{"ticks", record.ticks},
                                      {"episodes", record.episodes},
                                      {"total_s", static_cast<double>(record.ticks) * s.tick_s()},
                                      {"longest_s", static_cast<double>(record.longestTicks) * s.tick_s()},
                                      {"tau_removed_max_Nm", makeNumberOrWord(record.largestTorque)},
                                      {"tau_removed_rms_Nm", makeNumberOrWord(record.torqueRms())}};
    return all;
}

json describe(const LiveTiming& live) {
    json changes = json::array();
    for (const LiveTiming::Change& change : live.changes)
        changes.push_back({{"time_s", change.time_s}, {"state", change.state}, {"asked_by", change.asker}});
    json takes = json::array();
    for (const LiveTiming::Take& take : live.takes) takes.push_back({{"from_s", take.begin_s}, {"to_s", take.end_s}});
    json one = {{"real_time", live.isRealTime},
                {"refusals", live.refusals},
                {"clock", live.hasClock ? "plant" : "computer"},
                {"ticks", live.ticks},
                {"missed", live.missed},
                {"longest_gap", live.longestGap},
                {"rows_lost", live.lostRows},
                {"compute", live.compute.toJson()},
                {"interval", live.interval.toJson()},
                {"changes", changes},
                {"takes", takes}};
    one["wake_up"] = live.hasClock ? json(nullptr) : live.wakeUp.toJson();
    return one;
}

json describe(const CaseResult& r) {
    constexpr const char* kGrades[] = {"good", "doubtful", "broken", "failed"};  // by Gravity
    const CaseSentence sentence = tellCase(r);
    json shortcomings = json::array();
    for (const Problem& problem : findProblems(r)) shortcomings.push_back(problem.text);
    json one = {{"name", r.name},
                {"filter", r.filter},
                {"robust_loop", r.robustLoop},
                {"real_plant", r.realPlant},
                {"seeds", r.seeds},
                {"guarantees_limits", r.guarantees.hasJoints()},
                {"holds_on_real", r.holdsOnReal},
                {"interventions", describeInterventions(r.summary)},
                {"controller", r.controller},
                {"sentence", sentence.text},
                {"grade", kGrades[static_cast<int>(sentence.gravity)]},
                {"verdict", formatVerdict(r)},
                {"shortcomings", shortcomings},
                {"account", formatDetails(r)},
                {"warnings", r.warnings},
                {"assumed", r.assumed},
                {"stop", r.stopMessage},
                {"stop_time_s", r.stopMessage.empty() ? json(nullptr) : json(r.stopTime_s)},
                {"log", r.log.filename().string()},
                {"log_rows", r.logRows},
                {"log_error", r.logError},
                {"live", r.live ? describe(*r.live) : json(nullptr)},
                {"exit_code", r.exitCode()}};
    for (const char* block : {"tracking", "real_limits", "bound", "motors", "trip"}) one[block] = nullptr;
    for (const LimitKind kind : listArmLimits()) {
        one[std::string("guarantees_") + getName(kind, LimitSide::Neither)] = r.guarantees.has(kind);
        if (getLimitRow(kind).watchesPeople) continue;  // without people the case has no such block
        json& block = one[getLimitRow(kind).block] = nullptr;
        if (r.summary.account(kind)) block["real"] = nullptr;
    }
    const std::vector<std::string>& joints = r.summary.jointNames();
    for (const SummaryFigure& figure : listSummaryFigures())
        for (std::size_t i = 0; i < (figure.isPerJoint() ? joints.size() : 1); ++i)
            if (!figure.key.empty() && figure.exists(r))
                put(one, figure.key, joints[i], figure.get(r, static_cast<int>(i)));
    return one;
}

/** What a case has besides the limits of libraries. */
[[maybe_unused]] const bool kReserved = detail::reserveLimitNames("something else in summary.json", [] {
    json one = describe(CaseResult(Summary({"joint"}, JointLimits::unlimited(1), false)));
    for (const LimitKind kind : listArmLimits()) {
        if (kind <= kLastOwnLimit) continue;
        one.erase(getLimitRow(kind).block);
        one.erase(std::string("guarantees_") + getName(kind, LimitSide::Neither));
    }
    std::vector<std::string> keys;
    for (const auto& [key, value] : one.items()) keys.push_back(key);
    return keys;
});

}  // namespace

std::string writeSummaryJson(const std::string& title, const std::filesystem::path& experiment,
                             const std::vector<CaseResult>& results) {
    json cases = json::array();
    for (const CaseResult& result : results) cases.push_back(describe(result));
    const json all = {{"schema", 1},
                      {"title", title},
                      {"experiment", experiment.string()},
                      {"version", VIABLE_VERSION},
                      {"cases", cases}};
    return all.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace viable
