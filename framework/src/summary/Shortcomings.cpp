#include <algorithm>

#include "core/Text.h"
#include "summary/CaseResult.h"
#include "viable/core/Numbers.h"

namespace viable {

namespace {

using detail::format;

/** A joint that is farther than this from its nominal place in the mean does not follow it [rad, m]. */
constexpr double kFarRms = 0.02;
/** A motor at its limit in more than this share of the ticks is no exception. */
constexpr double kSaturatedShare = 0.01;
/** A tool misses its command where its error is more than this share of how the command moves about its mean place: one
that stands still there has 1. */
constexpr double kMissedShare = 0.4;
/** Nearer than this it does not miss [m]. */
constexpr double kLeastMiss_m = 0.01;
/** It swings where it misses and moves faster than this share of the command's speed; slower, it lags. */
constexpr double kSwingingShare = 1.0;

/** What stands behind a robust loop that does not hold the arm. */
const char* explainLoop(const std::optional<LoopMargins>& margins) {
    if (!margins) return "there is no robust loop whose law is known: nric is one";
    if (!margins->isStable) return "its robust loop is unstable";
    if (margins->isEnough())
        return "its robust loop has margin: leave nric's gains out where they are given; else rotor inertias that are "
               "missing "
               "in actuation.yaml, a shorter tick or less friction would help, unless something blocks or loads the "
               "arm";
    return "its robust loop has little margin: leave nric's gains out";
}

void addFollowing(const CaseResult& r, std::vector<std::string>& found) {
    const Summary& s = r.summary;
    if (r.margins && !r.margins->isStable) found.push_back("the robust loop is unstable on this arm, as accepted");
    int worst = 0;
    for (int i = 1; i < static_cast<int>(s.jointNames().size()); ++i)
        if (!(s.trackingRms(i) <= s.trackingRms(worst))) worst = i;
    if (s.trackingRms(worst) <= kFarRms) return;
    found.push_back(format(
        "the real arm does not follow the nominal one: %s is %.3g mrad (sliding: mm) from it, RMS (%s)",
        s.jointNames()[static_cast<std::size_t>(worst)].c_str(), 1e3 * s.trackingRms(worst), explainLoop(r.margins)));
}

void addMotors(const CaseResult& r, std::vector<std::string>& found) {
    const Summary& s = r.summary;
    if (r.margins && !r.margins->isStable) return;  // that is why
    std::string motors;
    for (int i = 0; i < static_cast<int>(s.jointNames().size()); ++i) {
        const double share = static_cast<double>(s.motor(i).ticksSaturated) / static_cast<double>(s.ticks());
        if (share > kSaturatedShare)
            detail::addItem(
                motors, format("%s in %.0f %%", s.jointNames()[static_cast<std::size_t>(i)].c_str(), 100.0 * share));
    }
    if (!motors.empty())
        found.push_back("motors are at their torque limits: " + motors +
                        " of the ticks (lower the limits of acceleration and jerk, or use whole_arm_braking)");
}

void addCommand(const CaseResult& r, std::vector<std::string>& found) {
    const Summary& s = r.summary;
    const double error = s.toolErrorRms(), spread = s.commandMotion().spread();
    if (r.isRelative || !(error > std::max(kMissedShare * spread, kLeastMiss_m))) return;
    const bool swings =
        s.toolMotion().speedRms() > kSwingingShare * s.commandMotion().speedRms() && s.commandMotion().speedRms() > 0.0;
    found.push_back(format(
        "the tool %s: %.3g mm and %.3g degrees from it, RMS, where the command itself moves by %.3g mm (limits, "
        "obstacles or "
        "the arm's reach%s)",
        swings ? "swings about its command" : "misses its command", 1e3 * error, s.toolError().angleRms() / kDegree,
        1e3 * spread,
        r.controller == "tool_servo" ? "" : "; where it is a jerk limit, tool_servo, which knows it, comes nearer"));
}

}  // namespace

std::vector<std::string> findShortcomings(const CaseResult& r) {
    std::vector<std::string> found;
    if (r.summary.ticks() == 0 || (r.stopReason != StopReason::None && r.stopReason != StopReason::Requested &&
                                   r.stopReason != StopReason::FilterEnded))
        return found;  // that says more
    if (r.summary.hasRealPlant()) {
        addFollowing(r, found);
        addMotors(r, found);
    }
    addCommand(r, found);
    return found;
}

}  // namespace viable
