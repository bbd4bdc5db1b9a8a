
#include "core/Text.h"
#include "summary/CaseResult.h"

namespace viable {

namespace {

using detail::format;

/** A joint that is farther than this from its nominal place in the mean does not follow it [rad, m]. */
constexpr double kFarRms = 0.02;
/** A loop with less margin than that is almost unstable: half of what is enough. */
const double kSmallGain = std::sqrt(kEnoughGain);
constexpr double kSmallPhase_rad = 0.5 * kEnoughPhase_rad;
/** A motor at its limit in more than this share of the ticks is no exception. */
constexpr double kSaturatedShare = 0.01;
/** A robust loop that reverses its torque as often in the time at the limit is what drives the motor there [s]. */
constexpr double kReversal_s = 0.025;
/** A command is missed where the error is more than this share of how the command moves about its mean place: what stands
still there has 1. One that rests for long enough is missed from the next share on. What misses and is faster than the
command by the last swings. */
constexpr double kMissedShare = 0.4, kMissedAtRest = 0.1, kSwinging = 1.1;
/** Nearer than this nothing misses: a tool [m], its orientation [rad], a joint [rad, m]. */
constexpr double kLeastMiss_m = 0.01, kLeastTurnMiss = 0.05, kLeastJointMiss = 0.01;
/** RMS jerk of joints that rest at a limit, as a share of the jerk limit, from which on they chatter. */
constexpr double kChatter = 0.1;

/** What stands behind a robust loop that does not hold the arm. With a tracking bound its gains must be given. */
std::string explainLoop(const CaseResult& r) {
    if (!r.margins) return "there is no robust loop whose law is known: nric is one";
    if (!r.margins->isStable) return "its robust loop is unstable";
    if (!r.margins->isEnough())
        return std::string("its robust loop has little margin: ") +
               (r.summary.reference().bound
                    ? "give it smaller gains, such as `viable gains` prints for a tracking bound"
                    : "leave nric's gains out");
    return std::string("its robust loop has margin: ") +
           (r.summary.reference().bound ? "" : "leave nric's gains out where they are given; else ") +
           "rotor inertias that are missing in actuation.yaml, a shorter tick or less friction would help, unless "
           "something blocks or loads the arm";
}

void addFollowing(const CaseResult& r, std::vector<Problem>& found) {
    const Summary& s = r.summary;
    if (r.margins && !r.margins->isStable)
        found.emplace_back("the robust loop is unstable on this arm, as accepted");
    else if (r.margins && !(r.margins->gain >= kSmallGain && r.margins->phase_rad >= kSmallPhase_rad))
        found.emplace_back(
            "the robust loop is almost unstable: its margin is " + formatMargins(*r.margins) +
            " (6 dB and 35 degrees are enough: smaller gains, or nric's own where no tracking bound is asked for)");
    int worst = 0;
    for (int i = 1; i < s.size(); ++i)
        if (!(s.trackingRms(i) <= s.trackingRms(worst))) worst = i;
    if (s.trackingRms(worst) <= kFarRms || (s.waiting() && s.waiting()->ticks > 0)) return;
    found.emplace_back(
        format("the real arm does not follow the nominal one: %s is %.3g mrad (sliding: mm) from it, RMS (%s)",
               s.jointName(worst), 1e3 * s.trackingRms(worst), explainLoop(r)),
        Problem::Kind::DoesNotFollow);
}

/** What a bound that does not hold says: none of the disturbances that it is for can do that. */
void addBound(const CaseResult& r, std::vector<Problem>& found) {
    const Summary& s = r.summary;
    if (!s.reference().bound) return;
    constexpr double kRounding = 1e-9;
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity}) {
        const int worst = s.worstBoundJoint(kind);
        if (!(s.boundShare(kind, worst) > 1.0 + kRounding)) continue;
        found.emplace_back(format(
            "the real arm was beyond its tracking bound: the %s of %s by up to %.3g of it (what acts on the "
            "arm, or its sensors, are not within the disturbance_set, a motor was at its limit, or the nominal "
            "arm beyond its limits)",
            kind == LimitKind::Position ? "position" : "velocity", s.jointName(worst), s.boundShare(kind, worst)));
        return;
    }
}

/** "joint1 in 12 %, joint2 in 3 %" of the ticks: the motors that were so in more than an exception. */
template <class Count, class Accept>
std::string listMotors(const Summary& s, const Count& count, const Accept& accepts) {
    std::string list;
    for (int i = 0; i < s.size(); ++i) {
        const MotorRecord& motor = s.motor(i);
        const double share = static_cast<double>(motor.*count) / static_cast<double>(s.ticks());
        if (share > kSaturatedShare && accepts(motor))
            detail::addItem(list, format("%s in %.0f %%", s.jointName(i), 100.0 * share));
    }
    return list;
}

void addMotors(const CaseResult& r, std::vector<Problem>& found) {
    const Summary& s = r.summary;
    if (r.margins && !r.margins->isStable) return;  // that is why
    const auto swings = [&](const MotorRecord& motor) {
        return static_cast<double>(motor.reversals) * kReversal_s >=
               static_cast<double>(motor.ticksSaturated) * s.tick_s();
    };
    const std::string swinging = listMotors(s, &MotorRecord::ticksSaturated, swings);
    const std::string motors =
        listMotors(s, &MotorRecord::ticksSaturated, [&](const MotorRecord& motor) { return !swings(motor); });
    const std::string assumed = r.assumedLimits.has(LimitKind::Torque) ? ", which are assumed" : "";
    const std::string late = listMotors(s, &MotorRecord::ticksRateLimited, [](const MotorRecord&) { return true; });
    if (!swinging.empty())
        found.emplace_back("the robust loop swings and drives motors to their torque limits" + assumed + ": " +
                           swinging +
                           " of the ticks (smaller gains, or the true masses, inertias, rotors and delay: nric's gains "
                           "follow from them where they are left out)");
    if (!motors.empty())
        found.emplace_back("motors are at their torque limits" + assumed + ": " + motors +
                           " of the ticks (lower the limits of acceleration and jerk, or use whole_arm_braking with a "
                           "torque_share below 1)");
    if (!late.empty())
        found.emplace_back("motors change their torque as fast as they may: " + late +
                           " of the ticks (lower the jerk limits, or use whole_arm_braking with a torque_rate_Nmps)");
}

/** What acted in at least this share of an error is its cause. */
constexpr double kCauseShare = 0.5;

bool isHeldOff(const Following& f) {
    return f.share(LimitKind::Clearance) >= kCauseShare;
}

/** "held off by obstacles or by itself, in 80 % of that error": what keeps an arm from its command, where that is no speed. One that
swings is at its position limits again and again, which is not why. */
std::string nameCause(const Following& f, bool swings, const char* otherwise) {
    if (swings) return otherwise;
    if (isHeldOff(f))
        return format("held off by the safety distance to obstacles or to itself, in %.0f %% of that error",
                      100.0 * f.share(LimitKind::Clearance));
    std::vector<std::pair<LimitKind, std::string>> kinds{{LimitKind::Torque, "torque"}};
    for (const LimitKind kind : listArmLimits()) kinds.emplace_back(kind, getLimitRow(kind).limitWord);
    kinds.emplace_back(LimitKind::Position, "position");
    for (const auto& [kind, name] : kinds)
        if (f.share(kind) >= kCauseShare)
            return format("held by %s limits, in %.0f %% of that error", name, 100.0 * f.share(kind));
    return otherwise;
}

/** How far something misses its command. */
struct Miss {
    double size = 0.0, error = 0.0;  ///< as a share of what is let pass, above 1: it misses; RMS [rad, m]
    bool isAtRest = false;           ///< where the command rests, or jumped
};

Miss findMiss(const Following& f, double least, double tick_s) {
    const double moving = f.judged().rms(tick_s), resting = f.atRest().rms(tick_s);
    const auto show = [&](double rms) { return std::isnan(rms) ? f.errorRms() : rms; };
    const Miss first{moving / std::max(kMissedShare * f.asked(), least), show(moving), f.jumps()};
    const Miss second{resting / std::max(kMissedAtRest * f.asked(), least), resting, true};
    return first.size > 1.0 || !(second.size > 1.0) ? first : second;
}

void tellMiss(const Following& f, const Miss& miss, const std::string& who, const std::string& error,
              const std::string& asked, const char* otherwise, const std::string& hint, std::vector<Problem>& found) {
    const bool swings =
        !miss.isAtRest && !isHeldOff(f) && f.targetSpeedRms() > 0.0 && f.speedRms() > kSwinging * f.targetSpeedRms();
    found.emplace_back(who +
                           (swings          ? " swings about its command: "
                            : miss.isAtRest ? " is not at its command in the time that its limits need: "
                                            : " misses its command: ") +
                           error + " from it, RMS, where the command itself moves by " + asked + " (" +
                           nameCause(f, swings, otherwise) + (isHeldOff(f) ? "" : hint) + ")",
                       Problem::Kind::MissesCommand);
}

void addCommand(const CaseResult& r, std::vector<Problem>& found) {
    const Summary& s = r.summary;
    const Miss place = findMiss(s.tool(), kLeastMiss_m, s.tick_s());
    const Miss turn = findMiss(s.turn(), kLeastTurnMiss, s.tick_s());
    const bool isPlace = place.size > 1.0;
    if (!isPlace && !(s.task().hasTurns && turn.size > 1.0)) return;
    tellMiss(isPlace ? s.tool() : s.turn(), isPlace ? place : turn, isPlace ? "the tool" : "the tool's orientation",
             format("%.3g mm and %.3g degrees", 1e3 * place.error, turn.error / kDegree),
             format("%.3g mm", 1e3 * s.tool().asked()) +
                 (isPlace ? "" : format(" and %.3g degrees", s.turn().asked() / kDegree)),
             "limits, obstacles or the arm's reach",
             r.controller == "tool_servo" ? "" : "; where it is a jerk limit, tool_servo, which knows it, comes nearer",
             found);
}

/** In degrees, or in millimetres. */
std::string formatJointMove(const CaseResult& r, int joint, double size) {
    return r.summary.slides(joint) ? format("%.3g mm", 1e3 * size) : format("%.3g degrees", size / kDegree);
}

/** The joint that swings most about a command at rest, and of the others the one that misses its command most. */
void addJointCommand(const CaseResult& r, std::vector<Problem>& found) {
    const Summary& s = r.summary;
    int swinging = 0, missing = -1;
    Miss worst{1.0};
    for (int i = 0; i < s.size(); ++i) {
        const Following& f = s.following(i);
        if (f.swing() > s.following(swinging).swing()) swinging = i;
        const Miss miss = findMiss(f, kLeastJointMiss, s.tick_s());
        if (!(miss.size > worst.size) || f.swing() >= miss.error) continue;  // what swings is told as that
        worst = miss;
        missing = i;
    }
    const bool knows = r.controller == "joint_servo";
    if (const double swing = s.following(swinging).swing(); swing > 0.0)
        found.emplace_back(s.jointName(swinging) + " swings about a command at rest, by " +
                           formatJointMove(r, swinging, swing) +
                           " to each side: the limits keep it going, not the command (" +
                           (knows ? "" : "joint_servo, which knows them, comes to rest; else ") +
                           "less stiffness, more damping, or higher limits of jerk and acceleration)");
    if (missing >= 0)
        tellMiss(s.following(missing), worst, s.jointName(missing), formatJointMove(r, missing, worst.error),
                 formatJointMove(r, missing, s.following(missing).asked()), "limits, obstacles or a slow controller",
                 knows ? "" : "; joint_servo, which knows the limits, comes nearer", found);
}

/** The joints may not press as hard as was asked. */
void addWeakTouch(const CaseResult& r, std::vector<Problem>& found) {
    const auto& w = r.summary.waiting();
    constexpr double kEnough = 0.9;
    if (!w || w->ticks == 0 || !(w->leastAsked < kEnough * w->force)) return;
    found.emplace_back(
        format("the tool pressed with less than the %.3g N asked for, down to %.3g N: the robust loop may add, or a "
               "motor give, no "
               "more at a joint there (`viable gains` tells how much; a smaller contact_force_N, or a pose with a "
               "shorter lever)",
               w->force, w->leastAsked));
}

void addChatter(const CaseResult& r, std::vector<Problem>& found) {
    if (r.summary.chatter() > kChatter)
        found.emplace_back(
            format("joints that their command presses against a position limit chatter: RMS jerk %.3g %% of the jerk "
                   "limit (a lower gain of the filter, or certified_braking)",
                   100.0 * r.summary.chatter()));
}

/** " (link5 next to table)"; empty: not known. */
std::string nameNearest(const CaseResult& r) {
    const LimitReport& nearest = r.summary.standstill().nearest;
    const auto find = [](const std::vector<std::string>& names, int index) {
        return index >= 0 && index < static_cast<int>(names.size()) ? names[index] : std::string("what is around");
    };
    if (!nearest.isKnown || r.links.empty()) return "";
    return " (" + find(r.links, nearest.link) + " next to " +
           (nearest.otherLink >= 0 ? find(r.links, nearest.otherLink) : find(r.obstacles, nearest.other)) + ")";
}

/** An arm that stood on its backup stop though it was asked to move. */
void addStandstill(const CaseResult& r, std::vector<Problem>& found) {
    const StandstillRecord& s = r.summary.standstill();
    if (!(s.longest_s > 0.0)) return;
    const bool isClearance = s.limit == LimitKind::Clearance;
    const std::string remedy =
        s.limit >= kFirstArmLimit ? getLimitRow(s.limit).remedy
        : s.limit == LimitKind::Torque
            ? " (a larger torque_share or torque_rate_Nmps, or lower limits of acceleration and jerk)"
            : " (larger limits of that kind, or a command that keeps to them)";
    found.emplace_back(
        format("the arm stood on its backup stop for %.1f s from %.3f s on, %.1f s in all, though it was "
               "asked to move; what held it: %s",
               s.longest_s, s.begin_s, s.total_s, getName(s.limit, LimitSide::Neither)) +
        (isClearance ? nameNearest(r) : "") + remedy);
}

}  // namespace

std::string tellUnjudged(const Summary& s) {
    std::string text;
    double most = 0.0;
    const auto look = [&](const Following& f, double least, const std::string& who) {
        const double size = f.errorRms() / std::max(kMissedShare * f.asked(), least);
        const bool isShort = f.jumps() && size > 1.0 && std::isnan(f.judged().rms(s.tick_s()));
        const bool stands = f.asked() > least && f.moved() < kMissedAtRest * f.asked();
        if (!(isShort || stands) || !(size > most)) return;
        most = size;
        text = "whether " + who + " follows cannot be told, as it " +
               (stands ? "hardly moved" : "had less than 0.5 s at its set-points beyond what its limits need");
    };
    look(s.tool(), kLeastMiss_m, "the tool");
    if (s.task().hasTurns) look(s.turn(), kLeastTurnMiss, "the tool's orientation");
    for (int i = 0; i < s.size(); ++i) look(s.following(i), kLeastJointMiss, s.jointName(i));
    return text;
}

std::vector<Problem> findProblems(const CaseResult& r) {
    std::vector<Problem> found;
    if (r.summary.ticks() == 0 || (r.stopReason != StopReason::None && r.stopReason != StopReason::Requested &&
                                   r.stopReason != StopReason::FilterEnded))
        return found;  // that says more
    if (r.summary.hasRealPlant()) {
        addFollowing(r, found);
        addBound(r, found);
        addMotors(r, found);
    }
    addStandstill(r, found);
    addWeakTouch(r, found);
    addCommand(r, found);
    addJointCommand(r, found);
    addChatter(r, found);
    return found;
}

}  // namespace viable
