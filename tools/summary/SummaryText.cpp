#include <set>
#include <tuple>

#include "core/Characters.h"
#include "core/Text.h"
#include "host/WatchedLimit.h"
#include "summary/CaseResult.h"
#include "summary/Sliding.h"
#include "summary/SummaryFigures.h"

namespace viable {

const char* const kAccountLegend =
    R"(worst use: largest share of a limit that the nominal arm used, in any tick. outside: joint-ticks beyond a limit, not
counting those while recovering. infeasible: ticks in which the filter had no admissible choice.
acted N times = in N episodes; joint-s = their seconds, summed over the joints; the limit named is the one that
bound the joint's own choice. torque removed: desired minus filtered, whatever the cause (other joints' limits through
coupling and the lag gamma, too). least margin: smallest distance to a position limit along a tick and the stop after it;
negative: beyond. unviable ticks: the state after them was not viable (no stop within the limits was found). Times are
this machine's, not real-time.
)";

namespace {

using detail::addItem;
using detail::format;
using detail::formatPercent;
using detail::formatPlain;

/** Milliradians in plain numbers as long as those are readable; "-" where there is no number. */
std::string formatMrad(double rad) {
    if (std::isnan(rad)) return "-";
    return format(std::abs(rad) < 10.0 ? "%.4g" : "%.3e", 1e3 * rad);
}

/** A distance to a limit; rounding is no distance. */
std::string formatDistance(double distance) {
    constexpr double kRounding = 1e-12;
    return formatPlain(std::abs(distance) < kRounding ? 0.0 : distance);
}

bool hasLimit(const Summary& s, LimitKind kind) {
    const std::vector<LimitRecord>& records = s.limit(kind);
    return std::any_of(records.begin(), records.end(), [](const LimitRecord& record) { return record.exists; });
}

/** In ticks of joints, of all limits. */
std::int64_t countOutside(const Summary& s) {
    std::int64_t outside = 0;
    for (LimitKind kind : kNominalKinds) outside += s.ticksOutside(kind);
    return outside;
}

/** The joint with the largest `value` among those with a limit that slide, or do not; -1: there is none. */
int findWorst(const Summary& s, const std::vector<LimitRecord>& records, bool slides, double LimitRecord::*value) {
    int worst = -1;
    for (int i = 0; i < static_cast<int>(records.size()); ++i)
        if (records[i].exists && s.slides(i) == slides && (worst < 0 || records[i].*value > records[worst].*value))
            worst = i;
    return worst;
}

/** "0.2 rad", of an arm with both kinds of joints "0.2 rad and 0.01 m": the largest `value` of each kind, as `show` has it. */
template <class Show>
std::string formatWorst(const Summary& s, const std::vector<LimitRecord>& records, LimitKind kind,
                        double LimitRecord::*value, const Show& show) {
    std::string text;
    for (const bool slides : {false, true})
        if (const int worst = findWorst(s, records, slides, value); worst >= 0)
            text +=
                (text.empty() ? "" : " and ") + std::string(show(records[worst].*value)) + " " + getUnit(kind, slides);
    return text;
}

/** "position by 0.2 rad", of both kinds of joints "position by 0.2 rad and 0.01 m"; empty: every `value` is zero. */
std::string formatExcess(const Summary& s, LimitKind kind, double LimitRecord::*value) {
    std::string text;
    for (const bool slides : {false, true}) {
        const int worst = findWorst(s, s.limit(kind), slides, value);
        if (worst < 0 || !(s.limit(kind)[worst].*value > 0.0)) continue;
        text += (text.empty() ? std::string(getName(kind, LimitSide::Neither)) + " by " : " and ") +
                formatPlain(s.limit(kind)[worst].*value) + " " + getUnit(kind, slides);
    }
    return text;
}

/** ", position by 0.2 rad, velocity by ...": every quantity whose worst `value` is not zero. */
std::string formatExcesses(const Summary& s, double LimitRecord::*value) {
    std::string text;
    for (const LimitKind kind : kNominalKinds)
        if (const std::string excess = formatExcess(s, kind, value); !excess.empty()) text += ", " + excess;
    return text;
}

/** What became of the limits, and of ticks in which the arm was recovering. */
std::string formatVerdict(const Summary& s) {
    std::string text;
    if (s.anyLimitBroken()) {
        for (LimitKind kind : kNominalKinds)
            if (s.ticksOutside(kind) > 0) addItem(text, formatExcess(s, kind, &LimitRecord::worstExcess));
        text = "limits broken: " + text;
    } else if (s.endsOutside()) {
        text = "not back within its limits at the end" + formatExcesses(s, &LimitRecord::lastExcess);
    } else {
        text = "all limits kept";
    }
    if (s.recoveringTicks() == 0) return text;
    text += s.anyLimitBroken() || s.endsOutside() ? ";" : " but for";
    return text + format(" %lld of %lld ticks recovering", s.recoveringTicks(), s.ticks()) +
           formatExcesses(s, &LimitRecord::worstRecovering);
}

std::string formatLimit(const Summary& s, LimitKind kind) {
    std::string text = format("  %-13s ", getName(kind, LimitSide::Neither));
    if (!hasLimit(s, kind)) return text + "no limit\n";
    const int joint = s.worstJoint(kind);
    const LimitRecord& worst = s.limit(kind)[joint];
    text += format("worst use %9s %% (%s at %.3f s), outside in %lld joint-ticks, worst excess %s",
                   formatPercent(worst.worstUse), s.jointName(joint), worst.worstTime_s, s.ticksOutside(kind),
                   formatWorst(s, s.limit(kind), kind, &LimitRecord::worstExcess, formatDistance));
    std::int64_t recovering = 0;
    for (const LimitRecord& record : s.limit(kind)) recovering += record.ticksRecovering;
    if (recovering > 0)
        text += format("; while recovering outside in %lld, worst excess ", recovering) +
                formatWorst(s, s.limit(kind), kind, &LimitRecord::worstRecovering,
                            [](double excess) { return format("%.3g", excess); });
    return text + "\n";
}

std::string formatStatuses(const Summary& s) {
    std::string text;
    for (FilterStatus status : {FilterStatus::Passed, FilterStatus::Modified, FilterStatus::Infeasible,
                                FilterStatus::StoppedByPlan, FilterStatus::Recovering}) {
        addItem(text, format("%s %lld", getName(status), s.ticksWith(status)));
        if (status == FilterStatus::Infeasible && s.ticksWith(status) > 0)
            text += format(" (first at %.3f s)", s.firstInfeasible_s());
        if (status == FilterStatus::StoppedByPlan && s.ticksWith(status) > 0)
            text += format(" (%lld of them missed ticks)", s.missedTicks());
    }
    return "  filter        " + text + format(" of %lld ticks\n", s.ticks());
}

/** One line per limit, all joints of a kind together. */
std::string formatInterventions(const Summary& s) {
    std::map<std::pair<std::string, bool>, InterventionRecord> byLimit;  // and whether the joints slide
    for (const auto& [key, record] : s.interventions()) {
        const auto joint = std::find(s.jointNames().begin(), s.jointNames().end(), key.first) - s.jointNames().begin();
        InterventionRecord& sum = byLimit[{key.second, s.slides(static_cast<int>(joint))}];
        sum.ticks += record.ticks;
        sum.episodes += record.episodes;
        sum.longestTicks = std::max(sum.longestTicks, record.longestTicks);
        sum.largestTorque = std::max(sum.largestTorque, record.largestTorque);
        sum.squaredTorque += record.squaredTorque;
    }
    std::string text;
    for (const auto& [key, sum] : byLimit)
        text += format("  %-20s acted %lld times, %.3f joint-s, longest %.3f s, %s removed max %.3g, RMS %.3g %s\n",
                       key.first, sum.episodes, static_cast<double>(sum.ticks) * s.tick_s(),
                       static_cast<double>(sum.longestTicks) * s.tick_s(), key.second ? "force" : "torque",
                       sum.largestTorque, sum.torqueRms(), getUnit(LimitKind::Torque, key.second));
    return text;
}

std::string formatStops(const Summary& s) {
    std::string text = "  stops         ";
    if (std::isfinite(s.worstMargin().value))
        text += format("least margin %s %s (%s at %.3f s), ", formatDistance(s.worstMargin().value),
                       getUnit(LimitKind::Position, s.slides(s.worstMargin().joint)),
                       s.jointName(s.worstMargin().joint), s.worstMargin().time_s);
    text += format("longest %.3f s (%s at %.3f s)", s.longestStop().value, s.jointName(s.longestStop().joint),
                   s.longestStop().time_s);
    if (s.unviableTicks() > 0)
        text += format(", unviable ticks %lld (first at %.3f s)", s.unviableTicks(), s.firstUnviable_s());
    if (s.missedTicks() > 0) text += format(", missed ticks %lld", s.missedTicks());
    return text + "\n";
}

/** Ticks outside a limit and the worst excess; below a tick outside it is rounding. */
std::string formatOutside(const Summary& s, LimitKind kind) {
    const auto ticks = static_cast<long long>(s.ticksOutside(kind));
    double excess = 0.0;
    if (ticks > 0)
        for (const LimitRecord& record : s.limit(kind)) excess = std::max(excess, record.worstExcess);
    return format(excess == 0.0 ? "%7lld%9.0f" : "%7lld%9.2g", ticks, excess);
}

/** "position by 0.2 rad (joint3), velocity by ...": what the real arm passed; empty: nothing. */
std::string formatRealExcesses(const Summary& s, const std::vector<LimitRecord>& (Summary::*limit)(LimitKind) const) {
    std::string text;
    for (const LimitKind kind : kRealKinds) {
        const std::vector<LimitRecord>& records = (s.*limit)(kind);
        for (const bool slides : {false, true}) {
            const int worst = findWorst(s, records, slides, &LimitRecord::worstExcess);
            if (worst < 0 || records[worst].ticksOutside == 0) continue;
            addItem(text, std::string(getName(kind, LimitSide::Neither)) + " by " +
                              formatPlain(records[worst].worstExcess) + " " + getUnit(kind, slides) + " (" +
                              s.jointName(worst) + ")");
        }
    }
    return text;
}

/** What became of the real arm's limits, where there is something to tell. */
std::string formatRealVerdict(const CaseResult& r) {
    if (!r.summary.hasRealPlant()) return "";
    const std::string passed = formatRealExcesses(r.summary, &Summary::realLimit);
    if (!r.holdsOnReal) return passed.empty() ? "" : "; the real arm exceeded limits: " + passed;
    return (passed.empty() ? "; the real arm kept its position and velocity limits"
                           : "; the real arm exceeded its limits: " + passed) +
           (r.guarantees.hasJoints() ? " (guaranteed as long as the disturbances are within their set; of its "
                                       "acceleration and jerk nothing is)"
                                     : " (of which the filter guarantees nothing)");
}

/** How far from its command each arm was. */
std::string formatCommandErrors(const CaseResult& r) {
    const Summary& s = r.summary;
    std::string text;
    const auto add = [&](const char* arm, const Following& tool, const Following& turn) {
        if (tool.ticks() == 0) return;
        text += format("%s %s tool %.4g mm and %.3g degrees RMS, at most %.4g mm", text.empty() ? "" : ";", arm,
                       1e3 * tool.errorRms(), turn.errorRms() / kDegree, 1e3 * tool.largestError());
    };
    add("nominal", s.tool(), s.turn());
    add("real", s.realTool(), s.realTurn());
    if (s.tool().ticks() > 0)
        text += format("; the command moves by %.4g mm and %.3g degrees", 1e3 * s.tool().asked(),
                       s.turn().asked() / kDegree);
    if (!std::isnan(s.commandErrorRms())) {
        const Sliding sliding = findSliding(s);
        const double unit = sliding == Sliding::None ? kDegree : 1e-3;
        const char* const name = choose(sliding, "degrees", "mrad and mm", "mm");
        const int n = s.size();
        int farthest = 0;
        std::string joints;
        for (int i = 0; i < n; ++i) {
            if (s.following(i).largestError() > s.following(farthest).largestError()) farthest = i;
            joints += format("  %.3g / %.3g", s.following(i).errorRms() / unit, s.following(i).asked() / unit);
        }
        text += format(" nominal joints %.4g %s RMS, at most %.4g (%s)", s.commandErrorRms() / unit, name,
                       s.following(farthest).largestError() / unit, s.jointName(farthest));
        if (s.hasRealPlant()) text += format("; real joints %.4g %s RMS", s.realCommandErrorRms() / unit, name);
        text += format("\n  per joint     RMS error / what the command moves by [%s]", name) + joints;
    }
    return text.empty() ? "" : "  command      " + text + "\n";
}

/** "the nominal arm collided: link4 ...". @param pattern  of the row, with the arm as %s */
std::string tellBroken(LimitKind kind, const std::string& pattern, const char* arm, const ArmLimitRecord& record) {
    return detail::replaceAll(pattern, "%s", arm) + tell(kind, &LimitRow::tellWorst, record) +
           (record.violatedTicks > 0 ? "" : ", no fault of the arm");
}

/** Whether the arms kept a limit of theirs as a whole. */
std::string formatVerdict(const LimitAccount& account) {
    const LimitRow& row = getLimitRow(account.kind);
    std::string text;
    if (account.nominal.brokenTicks > 0)
        text += "; " + tellBroken(account.kind, row.verdict, "nominal", account.nominal);
    if (account.real && account.real->brokenTicks > 0)
        text += "; " + tellBroken(account.kind, row.verdict, "real", *account.real);
    if (text.empty()) text = "; " + row.kept;
    return text + tell(account.kind, &LimitRow::tellInVerdict, account);
}

std::string formatAccount(const LimitAccount& account) {
    const LimitRow& row = getLimitRow(account.kind);
    std::string text = format("  %-13s nominal: ", row.label) +
                       tell(account.kind, &LimitRow::tellArm, account, account.nominal) + "\n";
    if (account.real)
        text += format("  %-13s real: ", "") + tell(account.kind, &LimitRow::tellArm, account, *account.real) + "\n";
    return text + tell(account.kind, &LimitRow::tellMore, account);
}

/** Of a table: cases may be of different arms. */
Sliding findSliding(const std::vector<CaseResult>& results) {
    const Sliding first = results.empty() ? Sliding::None : findSliding(results.front().summary);
    const bool isSame = std::all_of(results.begin(), results.end(),
                                    [&](const CaseResult& r) { return findSliding(r.summary) == first; });
    return isSame ? first : Sliding::Some;
}

/** The kinds of limits of the whole arm that any case counted. */
std::vector<LimitKind> listCounted(const std::vector<CaseResult>& results) {
    std::vector<LimitKind> kinds;
    for (const LimitKind kind : listArmLimits())
        if (std::any_of(results.begin(), results.end(),
                        [&](const CaseResult& r) { return r.summary.account(kind) != nullptr; }))
            kinds.push_back(kind);
    return kinds;
}

/** The worst of an arm for a table; "-" where there is nothing to tell. */
std::string formatWorstOf(const LimitRow& row, const ArmLimitRecord* r) {
    if (!r) return "-";
    if (r->worst == -kInfinity) return "?";
    if (r->worst == kInfinity) return format("> %g", row.headingScale * row.horizon);
    return format("%.1f", row.headingScale * r->worst);
}

std::int64_t countBroken(const Summary& s, LimitKind kind) {
    const LimitAccount* const account = s.account(kind);
    return account ? account->nominal.brokenTicks : 0;
}

/** Below this a joint of the real arm has come to rest [rad/s, m/s]. */
constexpr double kRealRest = 0.01;

std::string formatTrip(const Summary& s) {
    const TrackingTrip& trip = *s.trip();
    const char* const unit = getUnit(LimitKind::Position, s.slides(trip.joint));
    std::string text = format("  tripped       at %.4f s: %s measured %.4g %s from its nominal place, bound %.4g %s; ",
                              trip.time_s, s.jointName(trip.joint), trip.error, unit, trip.bound, unit);
    const std::string passed = formatRealExcesses(s, &Summary::realStop);
    text += passed.empty() ? "the real arm stayed inside its position and velocity limits"
                           : "after it the real arm exceeded its limits: " + passed;
    text += s.realEndSpeed() <= kRealRest ? ", and has come to rest"
                                          : format("; at the end it still moved, at %.3g %s", s.realEndSpeed(),
                                                   choose(findSliding(s), "rad/s", "rad/s or m/s", "m/s"));
    return text + "\n";
}

/** The real arm against its limits, its bound and its motors. */
std::string formatReal(const Summary& s) {
    const int n = s.size();
    std::string text;
    for (const LimitKind kind : kRealKinds) {
        const std::vector<LimitRecord>& records = s.realLimit(kind);
        text += format(kind == LimitKind::Position ? "  real arm      %s: " : "                %s: ",
                       getName(kind, LimitSide::Neither));
        int worst = -1;
        for (int i = 0; i < n; ++i)
            if (records[i].exists && (worst < 0 || records[i].worstUse > records[worst].worstUse)) worst = i;
        if (worst < 0) {
            text += "no limit\n";
            continue;
        }
        std::int64_t outside = 0;
        for (const LimitRecord& record : records) outside += record.ticksOutside;
        text += format("worst use %s %% (%s at %.3f s), outside in %lld joint-ticks, worst excess %s\n",
                       formatPercent(records[worst].worstUse), s.jointName(worst), records[worst].worstTime_s, outside,
                       formatWorst(s, records, kind, &LimitRecord::worstExcess, formatDistance));
    }
    if (s.reference().bound) {
        text += "  bound used    position / velocity per joint [%]";
        for (int i = 0; i < n; ++i)
            text += "  " + formatPercent(s.boundShare(LimitKind::Position, i)) + " / " +
                    formatPercent(s.boundShare(LimitKind::Velocity, i));
        text += "\n";
    }
    if (s.reference().torqueLimit.size() == n && (s.reference().torqueLimit.array() < INFINITY).any()) {
        std::int64_t saturated = 0, rateLimited = 0;
        double added = 0.0;
        text += "  motors        largest share of the torque limit per joint [%]";
        for (int i = 0; i < n; ++i) {
            text += "  " + formatPercent(s.motor(i).worstUse);
            added = std::max(added, s.motor(i).worstAdded);
            saturated += s.motor(i).ticksSaturated;
            rateLimited += s.motor(i).ticksRateLimited;
        }
        text += format(", saturated in %lld joint-ticks", saturated);
        text += ", at most " + formatPercent(added) + " % added by the robust loop";
        if (s.reference().torqueRate.size() == n) text += format(", changing as fast as they may in %lld", rateLimited);
        text += "\n";
    }
    if (const auto& touching = s.touching()) {
        const ContactReport& peak = touching->peak;
        text += "  contact       ";
        if (touching->ticks == 0)
            text += "the real arm touched nothing\n";
        else
            text += format(
                "in %lld ticks, first at %.3f s, %lld times; at most %.3g N at %.3f s, %.2g mm deep; at the end %.3g "
                "N\n",
                touching->ticks, touching->first_s, touching->touches, peak.pressing, touching->peak_s,
                1e3 * peak.depth, touching->last);
    }
    if (s.waiting())
        text += s.waiting()->ticks == 0
                    ? "  held          never: the tool met nothing that holds it\n"
                    : format(
                          "  held          the nominal arm waited for the tool in %lld ticks, "
                          "first at %.3f s; it pressed with %.3g N in the mean, %.3g N asked for\n",
                          s.waiting()->ticks, s.waiting()->first_s, s.waiting()->mean(), s.waiting()->force);
    if (s.externalTorqueMissing() > 0)
        text += format("  external      %lld ticks without a usable external torque\n", s.externalTorqueMissing());
    return text;
}

std::string formatTimes(const char* name, const LatencyHistogram& h) {
    return format("  %-13s p50 %.1f, p99 %.1f, p99.9 %.1f, worst %.1f us (tick %lld)\n", name, h.calcQuantile_us(0.5),
                  h.calcQuantile_us(0.99), h.calcQuantile_us(0.999), 1e-3 * static_cast<double>(h.worst_ns()),
                  h.worstTick());
}

std::string formatLive(const LiveTiming& live) {
    std::string text =
        format("  live          %s, by the clock of the %s; missed %lld of %lld ticks (at most %lld in a row)",
               live.isRealTime ? "real time" : "NOT real time", live.hasClock ? "plant" : "computer", live.missed,
               live.ticks, live.longestGap);
    if (live.lostRows > 0) text += format("; the log lacks %lld ticks, for which the disk was too slow", live.lostRows);
    text += "\n";
    if (!live.hasClock) text += formatTimes("wake-up", live.wakeUp);
    text += formatTimes("interval", live.interval) + formatTimes("compute", live.compute);
    for (const std::string& refusal : live.refusals) text += "  not had       " + refusal + "\n";
    text += "  states       ";
    for (const LiveTiming::Change& change : live.changes)
        text += format("%s %s at %.3f s (%s)", &change == &live.changes.front() ? "" : ",", change.state, change.time_s,
                       change.asker);
    text += "\n";
    if (live.takes.empty()) return text;
    constexpr std::size_t kTold = 5;
    text += "  takes        ";
    for (std::size_t k = 0; k < std::min(kTold, live.takes.size()); ++k)
        text +=
            format("%s %zu from %.3f to %.3f s", k == 0 ? "" : ",", k + 1, live.takes[k].begin_s, live.takes[k].end_s);
    if (live.takes.size() > kTold) text += format(" and %zu more in summary.json", live.takes.size() - kTold);
    return text + "\n";
}

/** "the arm collided": of the first guarantee that was broken; empty: none was. */
std::string nameBroken(const CaseResult& r) {
    for (const LimitAccount& account : r.summary.accounts())
        if (r.brokenGuarantees().has(account.kind)) return getLimitRow(account.kind).broken;
    return "";
}

/** "acceleration and jerk limits are assumed": those of the joints that the verdict rests on; empty: none. */
std::string tellAssumed(const CaseResult& r, const char* before) {
    std::string kinds;
    for (const LimitKind kind : kNominalKinds)
        if (r.assumedLimits.has(kind)) addItem(kinds, getName(kind, LimitSide::Neither), " and ");
    return kinds.empty() ? "" : before + ("those of " + kinds) + " are assumed";
}

/** What ended a run, or broke a guarantee; empty: nothing. */
std::string formatEnd(const CaseResult& r) {
    if (r.stopReason == StopReason::GuaranteeBroken) return "guarantee broken, the arm was stopped";
    if (r.isRealGuaranteeBroken()) return "guarantee on the real arm broken";
    if (const std::string broken = nameBroken(r); !broken.empty()) return "guarantee broken, " + broken;
    if (r.stopReason == StopReason::TrackingLost) return "tracking lost, the arm was stopped";
    if (r.stopReason == StopReason::NotFollowing) return "the real arm did not follow, and the nominal one was stopped";
    return r.stopReason == StopReason::None ? "" : "stopped early";
}

/** "11.7 mrad": of all joints together. */
std::string formatThousandths(const Summary& s, double x) {
    return (x < 1e-6 ? "< 0.001" : formatPlain(1e3 * x)) + " " + choose(findSliding(s), "mrad", "mrad, mm", "mm");
}

/** "42.5 mm 5.03 deg": how far an arm was from its command, RMS; empty: there is none. */
std::string formatCommandError(const Summary& s, bool isReal) {
    const Following &tool = isReal ? s.realTool() : s.tool(), &turn = isReal ? s.realTurn() : s.turn();
    if (tool.ticks() > 0) return format("%.3g mm %.3g deg", 1e3 * tool.errorRms(), turn.errorRms() / kDegree);
    const double error = isReal ? s.realCommandErrorRms() : s.commandErrorRms();
    if (std::isnan(error) || (isReal && !s.hasRealPlant())) return "";
    return formatThousandths(s, error);
}

/** What moves by less stands [rad, m]. */
constexpr double kLeastAsked = 1e-3;

/** "the arm was 31.9 mm 7.03 deg from its command, RMS (the real one ...), where the command itself moves by 120 mm": of one that follows. */
std::string tellFollowing(const Summary& s) {
    const std::string error = formatCommandError(s, false), real = formatCommandError(s, true);
    if (error.empty()) return "";
    std::string text =
        "the arm was " + error + " from its command, RMS" + (real.empty() ? "" : " (the real one " + real + ")");
    if (s.tool().ticks() > 0)
        return text +
               (s.tool().asked() > kLeastAsked
                    ? format(", where the command itself moves by %.3g mm", 1e3 * s.tool().asked())
                    : std::string(", which stands still")) +
               (s.task().hasTurns ? "" : "; the arm cannot turn its tool as it likes: its place counts");
    int worst = -1;
    double most = -1.0;
    bool jumps = false;
    for (int i = 0; i < s.size(); ++i) {
        const Following& f = s.following(i);
        jumps |= f.jumps();
        const double share = f.judged().rms(s.tick_s()) / f.asked();
        if (!(share > most && f.asked() > kLeastAsked)) continue;
        most = share;
        worst = i;
    }
    if (jumps) text += ", the ways to its set-points included";
    if (worst < 0) return text;
    const Following& f = s.following(worst);
    const auto show = [&](double x) {
        return (x < 1e-6 ? "< 0.001" : formatPlain(1e3 * x)) + (s.slides(worst) ? " mm" : " mrad");
    };
    return text + (jumps ? "; after them " : "; ") + s.jointName(worst) +
           " was farthest from it: " + show(f.judged().rms(s.tick_s())) + ", RMS, where the command itself moves by " +
           show(f.asked());
}

bool hasKeptLimits(const CaseResult& r, bool isReal) {
    const Summary& s = r.summary;
    bool isKept = isReal ? formatRealExcesses(s, &Summary::realLimit).empty() : !s.anyLimitBroken() && !s.endsOutside();
    for (const LimitAccount& account : s.accounts())
        if (account.kind != LimitKind::Clearance || r.guarantees.has(account.kind))  // has a column of its own
            isKept &= isReal ? !account.real || account.real->brokenTicks == 0 : account.nominal.brokenTicks == 0;
    return isKept;
}

/** "jerk 66667 %" */
std::string formatWorstUse(const Summary& s) {
    LimitKind worst = LimitKind::None;
    const auto use = [&](LimitKind kind) { return s.limit(kind)[s.worstJoint(kind)].worstUse; };
    for (const LimitKind kind : kNominalKinds)
        if (hasLimit(s, kind) && (worst == LimitKind::None || use(kind) > use(worst))) worst = kind;
    if (worst == LimitKind::None) return "no limit";
    return (worst == LimitKind::Acceleration ? "accel." : getName(worst, LimitSide::Neither)) +
           (" " + formatPercent(use(worst))) + " %";
}

/** What is in parentheses, remedies and figures, is left to the account. */
std::string dropParentheses(const std::string& text) {
    std::string shorter;
    int depth = 0;
    for (const char c : text) {
        depth += c == '(';
        if (depth == 0) shorter += c;
        if (depth == 1 && c == '(' && !shorter.empty() && shorter.back() == ' ') shorter.pop_back();
        depth -= c == ')' && depth > 0;
    }
    return shorter;
}

/** Of joint commands [rad], or of tool commands [m]: a case has one of them, and cases of one kind are compared. */
double getCommandError(const Summary& s) {
    return std::isnan(s.toolErrorRms()) ? s.commandErrorRms() : s.toolErrorRms();
}

/** "controller, limits": what differs besides the filter. */
std::string listDifferences(const CaseResult& a, const CaseResult& b) {
    std::set<std::string> keys;
    for (const CaseResult* one : {&a, &b})
        for (const auto& entry : one->others) keys.insert(entry.first);
    std::string list;
    for (const std::string& key : keys) {
        const auto mine = a.others.find(key), theirs = b.others.find(key);
        if (!(mine != a.others.end() && theirs != b.others.end() && mine->second == theirs->second)) addItem(list, key);
    }
    return list;
}

/** The kinds of limits of the whole arm that cases are ranked by, the first one first. */
std::vector<LimitKind> listRanking(const std::vector<CaseResult>& results) {
    std::vector<LimitKind> ranking = listCounted(results);
    ranking.erase(
        std::remove_if(ranking.begin(), ranking.end(), [](LimitKind k) { return getLimitRow(k).ranked.empty(); }),
        ranking.end());
    std::reverse(ranking.begin(), ranking.end());
    return ranking;
}

/** Less is better. What stopped early comes last, whatever it kept until then. */
auto rankLimits(const CaseResult& r, const std::vector<LimitKind>& ranking) {
    std::vector<std::int64_t> broken;
    for (const LimitKind kind : ranking) broken.push_back(countBroken(r.summary, kind));
    return std::make_tuple(r.stopReason != StopReason::None, broken, countOutside(r.summary));
}

/** No number comes after every number. */
auto rankError(double error) {
    return std::make_pair(std::isnan(error), std::isnan(error) ? 0.0 : error);
}

bool has(const std::vector<Problem>& problems, Problem::Kind kind) {
    return std::any_of(problems.begin(), problems.end(), [&](const Problem& problem) { return problem.kind == kind; });
}

}  // namespace

std::string formatComparison(const std::vector<CaseResult>& results) {
    constexpr std::size_t kMostColumns = 100, kLongestName = 23;
    std::vector<std::string> rows(results.size() + 2);
    /** Adds a column where it tells something and there is room for it. */
    const auto add = [&](const char* head, const char* second, const auto& tell) {
        std::vector<std::string> cells{head, second};
        for (const CaseResult& r : results) cells.push_back(tell(r));
        std::size_t width = 0;
        for (const std::string& cell : cells) width = std::max(width, detail::countCharacters(cell));
        const bool isFirst = rows[0].empty();
        if (std::all_of(cells.begin() + 2, cells.end(), [](const std::string& cell) { return cell.empty(); }) ||
            (!isFirst && rows[0].size() + 2 + width > kMostColumns))
            return false;
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const std::string cell = cells[i].empty() && i > 1 ? "-" : cells[i];
            const std::string blanks(width - detail::countCharacters(cell), ' ');
            rows[i] += isFirst ? cell + blanks : "  " + blanks + cell;
        }
        return true;
    };
    const auto addOfReal = [&](const char* head, const char* second, const auto& tell) {
        return add(head, second,
                   [&](const CaseResult& r) { return r.summary.hasRealPlant() ? tell(r) : std::string(); });
    };
    add("", "case", [](const CaseResult& r) { return detail::shorten(r.name, kLongestName); });
    add("nominal arm", "from command", [](const CaseResult& r) { return formatCommandError(r.summary, false); });
    addOfReal("real arm", "from command", [](const CaseResult& r) { return formatCommandError(r.summary, true); });
    add("nominal", "limits", [](const CaseResult& r) { return hasKeptLimits(r, false) ? "kept" : "BROKEN"; });
    const bool hasReal = addOfReal("real from", "nominal, max", [](const CaseResult& r) {
        return formatThousandths(r.summary, r.summary.trackingMax());
    });
    addOfReal("real", "limits",
              [](const CaseResult& r) { return std::string(hasKeptLimits(r, true) ? "kept" : "EXCEEDED"); });
    add("STOPPED", "at",
        [](const CaseResult& r) { return r.stopReason == StopReason::None ? "" : format("%.3f s", r.stopTime_s); });
    std::string legend = "nominal arm: the ideal one, which the filter moves. from command: RMS. ";
    if (hasReal) legend += "max: the largest of a joint. ";
    for (const LimitKind kind : listCounted(results)) {
        const LimitRow& row = getLimitRow(kind);
        if (row.heading == "-") continue;
        const bool isShown = add(row.heading.c_str(), "nominal / real", [&](const CaseResult& r) {
            const LimitAccount* const account = r.summary.account(kind);
            return !account ? ""
                            : formatWorstOf(row, &account->nominal) + " / " +
                                  formatWorstOf(row, account->real ? &*account->real : nullptr);
        });
        if (isShown) legend += row.headingLegend;
    }
    if (add("largest use", "of a limit", [](const CaseResult& r) { return formatWorstUse(r.summary); }))
        legend += "largest use: by the nominal arm.";
    rows.insert(rows.begin() + 2, std::string(rows[0].size(), '-'));
    return detail::join(rows, "\n") + "\n" + detail::wrap(legend) + "\n";
}

CaseSentence tellCase(const CaseResult& r) {
    const Summary& s = r.summary;
    std::vector<std::pair<Gravity, std::string>> parts;
    const auto add = [&](Gravity gravity, const std::string& text) {
        if (!text.empty()) parts.emplace_back(gravity, text);
    };
    const std::string end = formatEnd(r);
    add(r.stopReason == StopReason::Requested ? Gravity::Doubtful : Gravity::Failed, dropParentheses(r.stopMessage));
    if (r.stopMessage.empty() || r.exitCode() == static_cast<int>(ErrorKind::GuaranteeBroken))
        add(Gravity::Failed, end);
    if (!r.logError.empty()) add(Gravity::Failed, "the log was not written to its end");
    const std::vector<Problem> problems = findProblems(r);
    const bool follows = !has(problems, Problem::Kind::DoesNotFollow);
    const bool isTold = has(problems, Problem::Kind::MissesCommand);
    for (const Problem& problem : problems)
        add(problem.kind == Problem::Kind::DoesNotFollow ? Gravity::Broken : Gravity::Doubtful,
            dropParentheses(problem.text));
    const std::string unjudged = isTold ? "" : tellUnjudged(s);
    if (!isTold) add(unjudged.empty() ? Gravity::Good : Gravity::Doubtful, tellFollowing(s));
    add(Gravity::Doubtful, unjudged);
    if (const std::size_t n = r.warnings.size(); n > 0)
        add(Gravity::Doubtful, n == 1 ? "there is a warning" : format("there are %zu warnings", n));
    const bool isKept = !s.anyLimitBroken() && !s.endsOutside();
    add(isKept ? Gravity::Good : Gravity::Broken,
        isKept && s.recoveringTicks() == 0
            ? std::string("the nominal arm kept its joints' limits, ") +
                  (r.guarantees.hasJoints() ? "as guaranteed" : "without a guarantee") + tellAssumed(r, ", of which ")
            : "nominal arm: " + formatVerdict(s));
    for (const LimitAccount& account : s.accounts()) {
        const LimitRow& row = getLimitRow(account.kind);
        const auto addArm = [&](const char* arm, const ArmLimitRecord& record) {
            if (record.brokenTicks > 0)
                add(record.violatedTicks > 0 ? Gravity::Broken : Gravity::Doubtful,
                    tellBroken(account.kind, row.verdict, arm, record));
            return record.brokenTicks == 0;
        };
        const bool isNominalKept = addArm("nominal", account.nominal);
        if ((!account.real || addArm("real", *account.real)) && isNominalKept) add(Gravity::Good, row.kept);
    }
    if (s.hasRealPlant()) {
        const std::string passed = formatRealExcesses(s, &Summary::realLimit);
        std::string text = "the real arm ";
        if (follows)
            text += "stayed within " + formatThousandths(s, s.trackingMax()) + " of the nominal one " +
                    (passed.empty() ? "and " : "but ");
        add(passed.empty() ? Gravity::Good : Gravity::Doubtful,
            text + (passed.empty() ? "kept its position and velocity limits" : "exceeded limits: " + passed));
    }
    if (r.live)
        add(r.live->missed > 0 ? Gravity::Doubtful : Gravity::Good,
            format("%s, %lld of %lld ticks missed", r.live->isRealTime ? "in real time" : "not in real time",
                   r.live->missed, r.live->ticks));
    constexpr std::size_t kMostNamed = 3;
    if (const std::size_t n = r.assumed.size(); n > 0)
        add(Gravity::Good, format("%zu figure%s of the robot %s assumed", n, n == 1 ? "" : "s", n == 1 ? "is" : "are") +
                               (n > kMostNamed ? "" : ": " + dropParentheses(detail::join(r.assumed))));
    std::stable_sort(parts.begin(), parts.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    CaseSentence sentence{parts.front().first, ""};
    for (const auto& part : parts) addItem(sentence.text, part.second, "; ");
    sentence.text += ".";
    return sentence;
}

std::string formatOrder(const std::vector<CaseResult>& results) {
    const auto isSame = [&](const char* key) {
        return std::all_of(results.begin(), results.end(), [&](const CaseResult& r) {
            const auto mine = r.others.find(key), first = results.front().others.find(key);
            return mine != r.others.end() && first != results.front().others.end() && mine->second == first->second;
        });
    };
    if (results.size() < 2 || !isSame("command") || !isSame("robot")) return "";
    const std::vector<LimitKind> ranking = listRanking(results);
    const auto rank = [&](const CaseResult* r) {
        const Summary& s = r->summary;
        const double tool = s.realTool().errorRms(), joints = s.hasRealPlant() ? s.realCommandErrorRms() : kNan;
        const std::vector<Problem> problems = findProblems(*r);
        return std::make_tuple(r->stopReason != StopReason::None, has(problems, Problem::Kind::DoesNotFollow),
                               rankLimits(*r, ranking), s.ticksWith(FilterStatus::Infeasible),
                               has(problems, Problem::Kind::MissesCommand),
                               rankError(!std::isnan(tool)     ? tool
                                         : !std::isnan(joints) ? joints
                                                               : getCommandError(s)));
    };
    std::vector<const CaseResult*> order;
    for (const CaseResult& r : results) order.push_back(&r);
    std::stable_sort(order.begin(), order.end(), [&](const auto* a, const auto* b) { return rank(a) < rank(b); });
    std::string text;
    for (const CaseResult* r : order) addItem(text, r->name);
    return "best first (ran to its end, " +
           std::string(results.front().summary.hasRealPlant() ? "the real arm follows the nominal one, " : "") +
           "fewest ticks beyond the nominal arm's limits, fewest without an admissible choice, not told to "
           "miss the command, then nearest to it): " +
           text;
}

std::string formatRanking(const std::vector<CaseResult>& results) {
    // The largest set of cases that are equal but for the filter; of equally large ones the first.
    const auto isEqual = [](const CaseResult& a, const CaseResult& b) { return a.others == b.others; };
    const CaseResult* model = nullptr;
    std::ptrdiff_t most = 1;
    for (const CaseResult& r : results) {
        const auto equal = std::count_if(results.begin(), results.end(), [&](const auto& o) { return isEqual(r, o); });
        if (equal <= most) continue;
        most = equal;
        model = &r;
    }
    if (!model) return {};
    std::vector<const CaseResult*> order;
    for (const CaseResult& r : results) order.push_back(&r);
    const std::vector<LimitKind> ranking = listRanking(results);
    const auto rank = [&](const CaseResult& r) {
        return std::make_tuple(rankLimits(r, ranking), r.summary.ticksWith(FilterStatus::Infeasible),
                               rankError(getCommandError(r.summary)));
    };
    const auto isBetter = [&](const CaseResult* a, const CaseResult* b) {
        const bool first = isEqual(*a, *model), second = isEqual(*b, *model);
        return first != second ? first : rank(*a) < rank(*b);
    };
    std::stable_sort(order.begin(), order.end(), isBetter);
    const Sliding sliding = findSliding(results);
    std::string text = format("%-25s |%16s |%16s |%16s |%16s | %6s | %7s | %9s | %7s | %s\n", "ranking: joint-ticks",
                              "position", "velocity", "acceleration", "jerk", "no", "", "command", "chatter", "filter");
    text += format("%-25s |%7s%9s |%7s%9s |%7s%9s |%7s%9s | %6s | %7s | %9s | %7s | %s\n", "outside and worst excess",
                   "ticks", choose(sliding, "rad", "SI", "m"), "ticks", choose(sliding, "rad/s", "SI", "m/s"), "ticks",
                   choose(sliding, "rad/s^2", "SI", "m/s^2"), "ticks", choose(sliding, "rad/s^3", "SI", "m/s^3"),
                   "choice", "changed", choose(sliding, "[mrad]", "[1e-3]", "[mm]"), "[%]", "[us]");
    text += std::string(143, '-') + "\n";
    int place = 0;
    for (const CaseResult* r : order) {
        const Summary& s = r->summary;
        const bool isRanked = isEqual(*r, *model);
        text += format("%2s %-22s |", isRanked ? std::to_string(++place).c_str() : "-", r->name);
        for (LimitKind kind : kNominalKinds) text += formatOutside(s, kind) + " |";
        const std::string error = formatMrad(getCommandError(s)) + (std::isnan(s.toolErrorRms()) ? "" : " mm");
        const std::string chatter = std::isnan(s.chatter()) ? "-" : format("%.3g", 100.0 * s.chatter());
        text += format(" %6lld | %5.1f %% | %9s | %7s | %.1f\n", s.ticksWith(FilterStatus::Infeasible),
                       100.0 * s.changedShare(), error, chatter, s.stageTime(Stage::Filter).calcQuantile_us(0.5));
        std::string remarks;
        for (const LimitKind kind : ranking)
            if (const std::int64_t ticks = countBroken(s, kind); ticks > 0)
                remarks += " (" + getLimitRow(kind).ranked + format(" in %lld ticks)", ticks);
        if (r->stopReason != StopReason::None) remarks += format(" (stopped at %.3f s)", r->stopTime_s);
        if (!isRanked) remarks += " (other " + listDifferences(*r, *model) + ")";
        text.insert(text.size() - 1, remarks);
    }
    if (sliding == Sliding::Some)
        text += "SI: rad, rad/s, ..., and m, m/s, ... of joints that slide. 1e-3: mrad, and mm of joints that slide.\n";
    for (const LimitKind kind : ranking)
        text += (kind == ranking.front() ? "First by ticks of the nominal arm " : "Then by its ticks ") +
                getLimitRow(kind).rankedBy + ". ";
    return text +
           R"(Ranked by joint-ticks outside, then ticks without an admissible choice, then command error; cases that stopped early come last.
-: differs in more than the filter, and has no place.
command: RMS distance of the nominal joints to the commanded positions, those moved to the nearest limit; of a tool
command: of the nominal tool to the commanded one, in mm. chatter: RMS jerk of joints at rest whose command presses them against a position limit, in percent of the jerk
limit; at rest: within 5 % of the range of the limit, and for 0.5 s not moved by more than 0.1 % of the range ("-": less
than 1 joint-second of that). filter: median time of a tick.
)";
}

std::string formatVerdict(const CaseResult& r) {
    std::string text = formatEnd(r);
    if (!text.empty()) text += "; ";
    text += formatVerdict(r.summary) + " (nominal arm; the filter guarantees " +
            (r.guarantees.hasJoints() ? "all" : "none");
    for (const LimitAccount& account : r.summary.accounts())
        text += (r.guarantees.has(account.kind) ? ", and " : ", no ") + getLimitRow(account.kind).guarantee;
    text += tellAssumed(r, "; ") + ")" + formatRealVerdict(r);
    for (const LimitAccount& account : r.summary.accounts()) text += formatVerdict(account);
    for (const LimitKind kind : listArmLimits())
        if (const LimitRow& row = getLimitRow(kind); r.guarantees.has(kind) && !r.summary.account(kind) && !row.isSlow)
            text += "; " + row.guarantee + " guaranteed, but not judged";
    for (const Problem& problem : findProblems(r)) text += "; " + problem.text;
    return text;
}

std::string formatBreach(const CaseResult& r) {
    std::string text;
    if (r.isRealGuaranteeBroken())
        text = "the real arm exceeded its limits: " + formatRealExcesses(r.summary, &Summary::realLimit);
    for (const LimitAccount& account : r.summary.accounts()) {
        if (!r.brokenGuarantees().has(account.kind)) continue;
        const LimitRow& row = getLimitRow(account.kind);
        addItem(text, tellBroken(account.kind, row.breach, "nominal", account.nominal), "; ");
    }
    return text;
}

std::string formatDetails(const CaseResult& r) {
    const Summary& s = r.summary;
    std::string text = r.name + ": filter " + r.filter;
    if (!r.realPlant.empty()) text += ", robust loop " + r.robustLoop + ", real plant " + r.realPlant;
    if (r.live)
        text += format("; %.3f s live\n", r.simulated_s);
    else
        text += format("; %.3f s simulated in %.2f s (%.0f times real time)\n", r.simulated_s, r.wall_s,
                       r.wall_s > 0.0 ? r.simulated_s / r.wall_s : 0.0);
    text += "  verdict       " + formatVerdict(r) + "\n";
    for (LimitKind kind : kNominalKinds) text += formatLimit(s, kind);
    text += formatCommandErrors(r) + formatStatuses(s) + formatInterventions(s) + formatStops(s);
    for (const LimitKind kind : listArmLimits()) {
        const LimitRow& row = getLimitRow(kind);
        if (const LimitAccount* account = s.account(kind))
            text += formatAccount(*account);
        else if (r.guarantees.has(kind))
            text += format("  %-13s not judged: %s\n", row.label,
                           row.isSlow ? "the judge takes longer than a tick of a live run may"
                                      : "the filter guarantees it, but nobody counts it in this case");
    }
    if (s.substitutedTicks() > 0)
        text += format("  controller    %lld ticks without a usable torque, the last good one was used\n",
                       s.substitutedTicks());
    if (r.margins)
        text += "  robust loop   margin " + formatMargins(*r.margins) + ", least at " + s.jointName(r.margins->joint) +
                "\n";
    if (s.hasRealPlant()) {
        text += "  real-nominal  RMS / max per joint [mrad]";
        for (int i = 0; i < s.size(); ++i)
            text += "  " + formatMrad(s.trackingRms(i)) + " / " + formatMrad(s.trackingMax(i));
        text += "\n" + formatReal(s);
        if (s.trip()) text += formatTrip(s);
    }
    text += format("  tick          median %.1f us, p99 %.1f us, max %.1f us (median / p99:",
                   s.tickTime().calcQuantile_us(0.5), s.tickTime().calcQuantile_us(0.99), s.tickTime().worst_us());
    for (int i = 0; i < kStageCount; ++i) {
        const LatencyHistogram& h = s.stageTime(static_cast<Stage>(i));
        text += format("%s %s %.1f / %.1f", i ? "," : "", getName(static_cast<Stage>(i)), h.calcQuantile_us(0.5),
                       h.calcQuantile_us(0.99));
    }
    text += ")\n";
    if (r.live) text += formatLive(*r.live);
    if (!r.seeds.empty()) {
        text += "  seeds        ";
        for (const auto& [plugin, seed] : r.seeds) text += " " + plugin + " " + seed;
        text += "\n";
    }
    if (!r.log.empty()) text += format("  log           %s (%lld rows)\n", r.log.c_str(), r.logRows);
    if (!r.tool.empty()) text += "  tool          " + r.tool + "\n";
    if (!r.assumed.empty())
        text += "  assumed       figures of the robot that nobody gave: " + detail::join(r.assumed) + "\n";
    for (const std::string& warning : r.warnings) text += "  WARNING       " + warning + "\n";
    if (!r.stopMessage.empty())
        text += "  STOPPED       " + r.stopMessage + (r.stopRemedy.empty() ? "" : ". " + r.stopRemedy) + "\n";
    if (!r.logError.empty()) text += "  LOG LOST      " + r.logError + "\n";
    return text;
}

}  // namespace viable
