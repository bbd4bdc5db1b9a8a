#include "viable/filter/WholeArmBrakingFilter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "clearance/ArmStopCheck.h"
#include "core/NumberText.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

using detail::ArmPath;
using detail::ArmStopCheck;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/** Farther than so much beyond its least clearance nothing is steered away from [m]. */
constexpr double kInfluence_m = 0.1;
/** What rounding may take from a clearance [m]. */
constexpr double kRounding_m = 1e-8;
/** QPs with rows in a tick, and points tried on the way back to the stored stop. */
constexpr int kSteeringRounds = 2, kRetreats = 3;

/** For messages: four digits. */
std::string formatShort(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", value);
    return text;
}

}  // namespace

struct WholeArmBrakingFilter::Law {
    using Stops = std::array<GridStop, kMaxJoints>;

    Law(const RunSetup& setup, const WholeArmBrakingOptions& given, const ArmStopCheck::TorqueLimits& limits)
        : options(given),
          tick_s(setup.tick_s),
          share(std::isinf(given.joints.kAlpha) ? 1.0 : given.joints.kAlpha * setup.tick_s),
          feed(setup.surroundings),
          check(setup.robot, setup.geometry, limits, setup.tick_s),
          stored(check.makeResult()),
          best(check.makeResult()),
          trial(check.makeResult()) {
        const auto n = static_cast<std::size_t>(check.elements());
        for (ArmStopCheck::Demands* d : {&demands, &measures})
            for (std::vector<double>* v : {&d->floor, &d->least, &d->ahead}) v->assign(n, -kInfinity);
        measures.torqueUse = kInfinity;
        demands.beginsAbove = true;
    }
    ~Law() {
        if (feed) feed->release();
    }

    double time() const { return static_cast<double>(tick) * tick_s; }
    bool isStale() const { return feed && !(time() - view.stamp_s <= options.maxAge_s); }
    void takeSurroundings();
    static void findStops(const JointVector& jerk, const CertifiedBraking& braking, Stops& stops);
    void setStoredPath(const MotionState& state, const CertifiedBraking& braking);
    void examineStored(const MotionState& state, const CertifiedBraking& braking);
    void raiseDemands(const ArmStopCheck::Result& kept);
    bool isGood(const MotionState& state, const JointVector& jerk, const CertifiedBraking& braking, bool wantsRows);
    void keepBest(const JointVector& jerk);

    const WholeArmBrakingOptions options;
    const double tick_s, share;
    SurroundingsFeed* const feed;
    ArmStopCheck check;
    SurroundingsFeed::View view;
    double required_m = 0.0;  ///< safety distance of the surroundings
    bool isNew = true;        ///< the stored stop has not been looked at, or not in these surroundings
    std::int64_t tick = 0;

    /** Of every jerk that is taken; of the stored stop where it is looked at alone. */
    ArmStopCheck::Demands demands, measures;
    ArmStopCheck::Result stored, best, trial;
    ArmPath path, storedPath;
    /** The path that the arm is on since it was chosen, and how far. */
    ArmPath keptPath;
    std::int64_t ticksOnPath = 0;
    Stops stops, bestStops;
    RowQp::Rows rows;
    HeldMotion motion;  // of the last decision
    JointVector lastTorque, storedJerk, proposed, steered, bestJerk;
    bool hasBest = false;
    Clearance nearest;
};

void WholeArmBrakingFilter::Law::takeSurroundings() {
    if (!feed) return;
    const SurroundingsFeed::View now = feed->take();
    if (now.surroundings == view.surroundings && now.version == view.version) return;
    view = now;
    required_m = view.surroundings->environment().safetyDistance_m;
    check.setSurroundings(view.surroundings);
    isNew = true;
}

void WholeArmBrakingFilter::Law::findStops(const JointVector& jerk, const CertifiedBraking& braking, Stops& found) {
    AxisState after;
    for (int i = 0; i < static_cast<int>(jerk.size()); ++i)
        braking.findStop(i, jerk[i], after, found[static_cast<std::size_t>(i)]);
}

void WholeArmBrakingFilter::Law::setStoredPath(const MotionState& state, const CertifiedBraking& braking) {
    braking.getStored(storedJerk);
    findStops(storedJerk, braking, stops);
    storedPath.set(state, storedJerk, stops, tick_s);
}

/** What the stored stop keeps, and with it what is asked of any other: the safety distance, where it is seen to keep that;
else to come no nearer. */
void WholeArmBrakingFilter::Law::examineStored(const MotionState& state, const CertifiedBraking& braking) {
    const double aim = required_m + ArmStopCheck::kGuard_m;
    std::fill(measures.floor.begin(), measures.floor.end(), required_m);
    std::fill(measures.ahead.begin(), measures.ahead.end(), aim);
    setStoredPath(state, braking);
    check.examine(storedPath, time(), measures, lastTorque, false, stored);
    nearest = stored.nearest;
    demands.torqueUse = std::max(1.0, stored.torqueUse);
    for (std::size_t e = 0; e < stored.seen.size(); ++e) {
        // Where a map tells nothing (-infinity) nothing less is asked: the stored stop goes on until it does.
        const bool isKept = !(stored.seen[e] < required_m) || std::isinf(stored.seen[e]);
        demands.floor[e] = isKept ? required_m : stored.seen[e] - ArmStopCheck::kGuard_m;
        demands.least[e] = std::isinf(stored.seen[e]) ? aim : std::min(aim, stored.seen[e]);
    }
    isNew = false;
}

/** What has become better stays so; and how near the next stop may come of what is left. */
void WholeArmBrakingFilter::Law::raiseDemands(const ArmStopCheck::Result& kept) {
    const double aim = required_m + ArmStopCheck::kGuard_m;
    for (std::size_t e = 0; e < kept.seen.size(); ++e) {
        demands.floor[e] = std::max(demands.floor[e], std::min(required_m, kept.seen[e] - ArmStopCheck::kGuard_m));
        demands.least[e] = std::max(demands.least[e], std::min(aim, kept.seen[e]));
        const double room = std::clamp(kept.seen[e] - demands.least[e], 0.0, kInfluence_m);
        demands.ahead[e] = demands.least[e] + (1.0 - share) * room;
    }
}

/** `jerk` is vouched for by every joint; is its whole stop? `wantsRows`: if not, all that is wrong is to be known. */
bool WholeArmBrakingFilter::Law::isGood(const MotionState& state, const JointVector& jerk,
                                        const CertifiedBraking& braking, bool wantsRows) {
    findStops(jerk, braking, stops);
    path.set(state, jerk, stops, tick_s);
    check.examine(path, time(), demands, lastTorque, !wantsRows, trial);
    return trial.isClear && trial.bearsTorque;
}

void WholeArmBrakingFilter::Law::keepBest(const JointVector& jerk) {
    bestJerk = jerk;
    bestStops = stops;
    hasBest = true;
    std::swap(best, trial);
}

WholeArmBrakingFilter::WholeArmBrakingFilter() = default;
WholeArmBrakingFilter::~WholeArmBrakingFilter() = default;

void WholeArmBrakingFilter::configure(const RunSetup& setup, const Parameters& parameters) {
    law_.reset();
    CertifiedBrakingFilter::configure(setup, parameters);
    WholeArmBrakingOptions options;
    options.joints = {parameters.number("k_alpha"), parameters.number("gamma"), parameters.flag("recovery")};
    options.torqueShare = parameters.number("torque_share");
    options.torqueRate = parameters.jointNumbers("torque_rate_Nmps");
    options.steers = parameters.flag("steers");
    options.maxAge_s = parameters.number("max_age_s");
    prepare(setup, options, parameters.place("recovery"));
}

void WholeArmBrakingFilter::configure(const RunSetup& setup, const WholeArmBrakingOptions& options) {
    law_.reset();
    CertifiedBrakingFilter::configure(setup, options.joints);
    prepare(setup, options, "WholeArmBrakingOptions");
}

bool WholeArmBrakingFilter::guaranteesClearance() const {
    return law_ && law_->feed && !recovers();
}

void WholeArmBrakingFilter::prepare(const RunSetup& setup, const WholeArmBrakingOptions& options,
                                    const std::string& place) {
    const int n = setup.size();
    if (setup.surroundings && !setup.geometry)
        throw badInput(place, "there are surroundings, but nobody has said what of the arm can hit them",
                       "Set RunSetup::geometry (see loadArmGeometry).");
    if (options.torqueRate.size() != 0 && options.torqueRate.size() != n)
        throw badInput(place,
                       "torqueRate has " + std::to_string(options.torqueRate.size()) + " entries for " +
                           std::to_string(n) + " joints",
                       "Give one per joint, or none.");
    if (setup.surroundings && !setup.surroundings->claim())
        throw badInput(place, "another filter of this case has the surroundings already",
                       "Use one filter that keeps clearances.");
    const JointVector unlimited = JointVector::Constant(n, kInfinity);
    ArmStopCheck::TorqueLimits limits{unlimited, unlimited};
    if (std::isfinite(options.torqueShare)) limits.torque = options.torqueShare * setup.robot.actuation.torqueLimit;
    if (options.torqueRate.size() == n) limits.rate = options.torqueRate;
    law_ = std::make_unique<Law>(setup, options, limits);
    reset(setup.start);
    if (!options.joints.recovery) checkStart(setup, place);
}

void WholeArmBrakingFilter::checkStart(const RunSetup& setup, const std::string& place) const {
    constexpr char kWay[] = "or set `recovery: true`, which leads the arm away.";
    const ArmStopCheck::Result& start = law_->stored;
    int worst = -1;
    for (int e = 0; e < law_->check.elements(); ++e) {
        const auto at = static_cast<std::size_t>(e);
        if (start.proven[at] >= law_->required_m - kRounding_m) continue;
        if (worst < 0 || start.seen[at] < start.seen[static_cast<std::size_t>(worst)]) worst = e;
    }
    if (worst >= 0) {
        const Clearance near = law_->check.getNearest(worst);
        const auto getLink = [&](int link) { return setup.geometry->links[static_cast<std::size_t>(link)]; };
        const std::string who = getLink(near.link), required = detail::formatNumber(law_->required_m);
        std::string other = near.otherLink >= 0  ? getLink(near.otherLink)
                            : near.obstacle >= 0 ? law_->view.surroundings->name(near.obstacle)
                                                 : "what is around";
        const Environment& around = law_->view.surroundings ? law_->view.surroundings->environment() : Environment{};
        const int sphere = near.obstacle - static_cast<int>(around.solids.size());
        if (near.otherLink < 0 && sphere >= 0 && sphere < static_cast<int>(around.spheres.size()))
            other += " (a moving sphere counts with all that is left of its path)";
        if (start.seen[static_cast<std::size_t>(worst)] < law_->required_m)
            throw badInput(
                place,
                "the start, or the stop from there, brings " + who + " to " + formatShort(near.distance) + " m from " +
                    other + "; at least " + required + " m is to be kept",
                std::string(
                    "Change `start`, the obstacle or `safety_distance_m` (links: `may_touch` in collision.yaml), ") +
                    kWay);
        throw badInput(place,
                       "the stop from the start is too fast beside " + other + ", or too much is near, to prove that " +
                           who + " keeps " + required + " m from it",
                       std::string("Start slower or farther away, ") + kWay);
    }
    if (!start.bearsTorque || start.torqueUse > 1.0)
        throw badInput(
            place,
            "the start, or the stop from there, needs " + formatShort(100.0 * start.torqueUse) +
                " % of the torque that may be used" + (start.bearsTorque ? "" : ", as far as it was looked at"),
            std::string(
                "Change `start` (at rest, the arm less far out), the payload, `torque_share` or `torque_rate_Nmps`, ") +
                kWay);
}

void WholeArmBrakingFilter::reset(const MotionState& start) {
    CertifiedBrakingFilter::reset(start);
    if (!law_) return;  // the base is being configured
    law_->tick = 0;
    law_->takeSurroundings();
    law_->check.beginTick();
    braking().beginTick(start);
    law_->setStoredPath(start, braking());
    law_->check.calcTorque(law_->storedPath, 0, law_->lastTorque);
    law_->examineStored(start, braking());
    law_->keptPath = law_->storedPath;
    law_->ticksOnPath = 0;
    CertifiedBrakingFilter::reset(start);
}

void WholeArmBrakingFilter::skipTicks(std::int64_t ticks) {
    CertifiedBrakingFilter::skipTicks(ticks);
    law_->tick += ticks;
    law_->ticksOnPath += ticks;
    // The torque that was applied last is the stop's.
    law_->check.calcTorque(law_->keptPath, law_->ticksOnPath - 1, law_->lastTorque);
}

FilterStatus WholeArmBrakingFilter::filter(const FilterInput& input, FilterDecision& decision) {
    const FilterStatus status = CertifiedBrakingFilter::filter(input, decision);
    if (status == FilterStatus::InvalidInput || status == FilterStatus::Faulted) return status;
    decision.clearance = law_->nearest;
    decision.mapAge_s = law_->feed ? law_->time() - law_->view.stamp_s : 0.0;
    calcHeldMotion(input, status, decision, law_->tick_s, law_->motion);
    law_->lastTorque = law_->motion.torque;
    ++law_->tick;
    ++law_->ticksOnPath;
    return status;
}

FilterStatus WholeArmBrakingFilter::choose(const MotionState& nominal, const Dynamics& dynamics,
                                           const JointVector& desired, JointVector& jerk,
                                           std::array<JointIntervention, kMaxJoints>& joints) {
    Law& law = *law_;
    CertifiedBraking& braking = this->braking();
    law.isNew |= !braking.beginTick(nominal);
    law.check.beginTick();
    law.takeSurroundings();
    const bool isExamined = law.isNew;
    if (isExamined) law.examineStored(nominal, braking);
    law.raiseDemands(law.stored);
    law.hasBest = false;

    const FilterStatus status = braking.propose(dynamics.M, desired, nullptr, law.proposed);
    LimitKind reason = law.isStale() ? LimitKind::Clearance : LimitKind::None;
    if (!law.isStale()) {
        if (law.isGood(nominal, law.proposed, braking, law.options.steers)) law.keepBest(law.proposed);
        const ArmStopCheck::Result& first = law.hasBest ? law.best : law.trial;
        if (!law.hasBest || !first.isAhead) {
            reason = first.isClear && !first.bearsTorque ? LimitKind::Torque : LimitKind::Clearance;
            law.setStoredPath(nominal, braking);
            steer(nominal, dynamics, desired);
        }
    }
    // Whatever was tried last, the joints must vouch for what is taken, with the very stops that were looked at.
    const bool takesBest = law.hasBest && braking.isAdmissible(law.bestJerk, law.bestStops);
    if (takesBest) {
        jerk = law.bestJerk;
        std::swap(law.stored, law.best);
        law.nearest = law.stored.nearest;
        law.demands.torqueUse = std::max(1.0, std::min(law.demands.torqueUse, law.stored.torqueUse));
        law.keptPath.set(nominal, jerk, law.bestStops, law.tick_s);
        law.ticksOnPath = 0;
    } else {
        braking.getStored(jerk);
        if (isExamined) {
            law.keptPath = law.storedPath;
            law.ticksOnPath = 0;
        }
    }
    braking.commit(desired, jerk, joints);
    for (std::size_t i = 0; i < static_cast<std::size_t>(jerk.size()); ++i) {
        const auto at = static_cast<Eigen::Index>(i);
        if (jerk[at] == law.proposed[at] || reason == LimitKind::None) continue;
        const bool isUpper = reason == LimitKind::Torque && jerk[at] < law.proposed[at];
        joints[i] = {reason, isUpper ? LimitSide::Upper : LimitSide::Lower};
    }
    if (!takesBest) return FilterStatus::StoppedByPlan;
    if (status == FilterStatus::Recovering) return FilterStatus::Recovering;
    return jerk == desired ? FilterStatus::Passed : FilterStatus::Modified;
}

/** Looks for jerks near the desired ones that are good, or better ones than those proposed; then on the way from them back
to the stored stop. */
void WholeArmBrakingFilter::steer(const MotionState& nominal, const Dynamics& dynamics, const JointVector& desired) {
    Law& law = *law_;
    CertifiedBraking& braking = this->braking();
    JointVector from = law.proposed;  // what was looked at last
    if (law.options.steers) {
        law.rows.clear();
        for (int round = 0; round < kSteeringRounds; ++round) {
            law.check.addRows(from, law.storedPath, law.storedJerk, law.demands, law.rows);
            if (round == 0)
                law.check.addTickRows(dynamics, nominal.qdd, law.demands.torqueUse, law.lastTorque, law.rows);
            braking.propose(dynamics.M, desired, &law.rows, law.steered);
            if (law.steered == from) break;
            from = law.steered;
            if (!law.isGood(nominal, from, braking, round + 1 < kSteeringRounds)) continue;
            law.keepBest(from);
            if (law.best.isAhead) return;
        }
    }
    for (int k = 0; k < kRetreats && !law.hasBest; ++k) {
        from = (from + law.storedJerk) / 2.0;
        if (braking.isAdmissible(from) && law.isGood(nominal, from, braking, false)) law.keepBest(from);
    }
}

}  // namespace viable
