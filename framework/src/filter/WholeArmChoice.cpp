#include "filter/WholeArmChoice.h"

#include "core/Text.h"
#include "environment/CollisionChecker.h"

namespace viable::detail {

namespace {

/** What rounding may take from a clearance [m]. */
constexpr double kRounding_m = 1e-8;
/** QPs with rows in a tick, and points tried on the way back to the backup stop. */
constexpr int kSteeringRounds = 2, kRetreats = 3;

/** An arm is still below this share of its velocity limits; one that is for so long though it is asked to move is eased [s]. */
constexpr double kStill = 1e-3, kWait_s = 0.25;

/** In messages clearances are told apart up to here [m]. */
constexpr double kLargestShown_m = 0.5;

/** For messages: four digits. */
std::string formatShort(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", value);
    return text;
}

}  // namespace

WholeArmChoice::WholeArmChoice(const RunSetup& setup, const WholeArmBrakingOptions& options,
                               const TorqueScan::Limits& limits, CertifiedBraking& braking, const ArmGeometry* limited)
    : options_(options),
      tick_s_(setup.tick_s),
      feed_(setup.surroundings),
      people_(setup.people),
      watch_(setup.people ? setup.people->people() : std::vector<Person>()),
      braking_(braking),
      check_(setup.robot, setup.geometry, limits, setup.tick_s, limited, watch_.size()),
      demands_(check_.elements(), std::isinf(options.joints.kAlpha) ? 1.0 : options.joints.kAlpha * setup.tick_s),
      identity_(JointMatrix::Identity(setup.size(), setup.size())),
      stored_(check_.makeResult()),
      best_(check_.makeResult()),
      trial_(check_.makeResult()),
      other_(check_.makeResult()),
      ofPeople_(reports_[LimitKind::Separation]),
      limited_(limited) {
    const JointBounds& fastest = setup.limits.velocity;
    still_radps_ = kStill * fastest.upper.cwiseMin(-fastest.lower);
    if (!still_radps_.allFinite()) still_radps_.setZero();
}

WholeArmChoice::~WholeArmChoice() {
    if (feed_) feed_->release();
    if (people_) people_->release();
}

void WholeArmChoice::reset(const MotionState& start) {
    tick_ = still_ = 0;
    wait_ = std::llround(kWait_s / tick_s_);
    isEasing_ = false;
    updateSurroundings();
    watch_.reset();
    ofPeople_ = {};
    updatePeople();
    check_.reset();
    check_.beginTick();
    braking_.beginTick(start);
    setStoredPath(start);
    check_.calcTorque(storedPath_, 0, lastTorque_);
    examineStored(start);
    if (people_) tellPeople(stored_.people);
}

void WholeArmChoice::skipTicks(std::int64_t ticks) {
    tick_ += ticks;
    ticksOnPath_ += ticks;
    // The torque that was applied last is the stop's.
    check_.calcTorque(keptPath_, ticksOnPath_ - 1, lastTorque_);
}

void WholeArmChoice::endTick(const FilterInput& input, const FilterDecision& decision) {
    HeldMotion motion;
    calcHeldMotion(input, FilterStatus::Modified, decision, tick_s_, motion);
    lastTorque_ = motion.torque;
    ++tick_;
    ++ticksOnPath_;
}

void WholeArmChoice::updateSurroundings() {
    if (!feed_) return;
    const SurroundingsFeed::View now = feed_->take();
    if (now.surroundings == view_.surroundings && now.version == view_.version) return;
    view_ = now;
    demands_.setRequired(view_.surroundings->environment().safetyDistance_m);
    check_.setSurroundings(view_.surroundings);
    isNew_ = true;
}

/** False: what was proven of stops before is not any more. */
bool WholeArmChoice::updatePeople() {
    if (!people_) return true;
    const bool areExpected = watch_.take(people_->take(), time());
    check_.setPeople(watch_, time());
    ofPeople_.age_s = watch_.age_s(time());
    return areExpected;
}

void WholeArmChoice::tellPeople(const PeopleCheck::Result& found) {
    ofPeople_.isKnown = true;
    ofPeople_.isKept = found.isKept;
    ofPeople_.margin = found.proven;
    ofPeople_.link = found.link;
    ofPeople_.other = found.person;
}

void WholeArmChoice::tellStored() {
    reports_[LimitKind::Clearance] = stored_.nearest;
    reports_[LimitKind::Speed] = stored_.speed.fastest;
}

LimitSet WholeArmChoice::guarantees() const {
    LimitSet kept;
    kept.set(LimitKind::Clearance, feed_ != nullptr);
    kept.set(LimitKind::Speed, check_.keepsSpeeds());
    kept.set(LimitKind::Separation, people_ != nullptr);
    return kept;
}

void WholeArmChoice::report(FilterDecision& decision) const {
    decision.reports = reports_;
    decision.reports[LimitKind::Clearance].age_s = feed_ ? time() - view_.stamp_s : 0.0;
    decision.peopleFaults = watch_.faults();
}

void WholeArmChoice::findStops(const JointVector& jerk) {
    AxisState after;
    for (int i = 0; i < static_cast<int>(jerk.size()); ++i)
        braking_.findStop(i, jerk[i], after, stops_[static_cast<std::size_t>(i)]);
}

void WholeArmChoice::setStoredPath(const MotionState& state) {
    braking_.getStored(storedJerk_);
    findStops(storedJerk_);
    storedPath_.set(state, storedJerk_, stops_, tick_s_);
}

/** What the backup stop keeps, and with it what is asked of any other. */
void WholeArmChoice::examineStored(const MotionState& state) {
    setStoredPath(state);
    check_.examine(storedPath_, time(), demands_.measure(), lastTorque_, {}, false, stored_);
    tellStored();
    keptPath_ = storedPath_;
    ticksOnPath_ = 0;
    demands_.begin(stored_);
    isNew_ = false;
}

void WholeArmChoice::setPath(const MotionState& state, const JointVector& jerk) {
    findStops(jerk);
    path_.set(state, jerk, stops_, tick_s_);
}

/** `jerk` is certified by every joint; is its whole stop? `wantsRows`: if not, all that is wrong is to be known. */
bool WholeArmChoice::isGood(const MotionState& state, const JointVector& jerk, bool wantsRows) {
    setPath(state, jerk);
    return isPathGood(wantsRows);
}

bool WholeArmChoice::isPathGood(bool wantsRows) {
    const ArmStopCheck::Known kept{keptPath_, ticksOnPath_, stored_}, other{otherPath_, 0, other_};
    check_.examine(path_, time(), demands_.get(), lastTorque_, {hasOther_ ? 2 : 1, {&kept, &other}}, !wantsRows,
                   trial_);
    return trial_.isGood();
}

void WholeArmChoice::keepBest(const JointVector& jerk) {
    bestJerk_ = jerk;
    bestStops_ = stops_;
    hasBest_ = true;
    std::swap(best_, trial_);
}

FilterStatus WholeArmChoice::choose(const MotionState& nominal, const Dynamics& dynamics, const JointMatrix* metric,
                                    const JointVector& desired, JointVector& jerk,
                                    std::array<JointIntervention, kMaxJoints>& joints) {
    const bool isOnStop = braking_.beginTick(nominal);
    isNew_ |= !isOnStop;
    check_.beginTick();
    updateSurroundings();
    const bool areExpected = updatePeople();
    if (isNew_) examineStored(nominal);
    // What is seen of people where they were expected tells nothing against the backup stop, which was proven before.
    if (people_ && !(isOnStop && areExpected)) {
        PeopleCheck::Result found;
        setStoredPath(nominal);
        check_.measurePeople(storedPath_, found);
        tellPeople(found);
    }
    demands_.raise(stored_);
    hasBest_ = hasOther_ = false;

    const FilterStatus status = braking_.propose(metric, desired, nullptr, proposed_);
    const bool isBlind = people_ && watch_.isBlind();
    if (isBlind) ofPeople_.isKept = false;
    LimitKind reason = isBlind ? LimitKind::Separation : isStale() ? LimitKind::Clearance : LimitKind::None;
    if (!isBlind && !isStale()) {
        const bool steers = options_.steers && metric;
        steered_ = proposed_;
        if (steers) setStoredPath(nominal);
        setPath(nominal, proposed_);
        updateEasing(nominal);
        const bool hasForeseen = steers && !isEasing_ && foresee(nominal, dynamics, metric, desired);
        if (hasForeseen) {
            reason = LimitKind::Clearance;
            setPath(nominal, steered_);
        }
        // Where jerks that are steered already are not good, others beside rows seldom do better, and rows cost a complete look.
        const bool wantsRows = steers && !hasForeseen;
        if (isPathGood(wantsRows)) keepBest(steered_);
        if (hasBest_) isEasing_ = false;
        const ArmStopCheck::Result& first = hasBest_ ? best_ : trial_;
        const bool hasRows = steers && (wantsRows || first.isClear);
        if (!hasBest_ || !first.isAhead) {
            // What was looked at completely is known of all that is tried next.
            if (hasRows) {
                other_ = first;
                otherPath_ = path_;
                hasOther_ = true;
            }
            // What is not kept comes before what is only near.
            reason = !first.speed.isKept                                  ? LimitKind::Speed
                     : !first.people.isKept                               ? LimitKind::Separation
                     : !first.isClear                                     ? LimitKind::Clearance
                     : !first.torque.bearsTorque                          ? LimitKind::Torque
                     : first.speed.seenLater > demands_.get().speed.ahead ? LimitKind::Speed
                     : first.people.seen < demands_.get().people.ahead    ? LimitKind::Separation
                                                                          : LimitKind::Clearance;
            if (!steers) setStoredPath(nominal);
            steer(nominal, dynamics, metric, desired, hasRows);
        }
    }
    // Whatever was tried last, the joints must certify what is taken, with the very stops that were looked at.
    const bool takesBest = hasBest_ && braking_.isAdmissible(bestJerk_, bestStops_);
    if (takesBest) {
        jerk = bestJerk_;
        std::swap(stored_, best_);
        tellStored();
        if (people_) tellPeople(stored_.people);
        demands_.lowerTorqueUse(stored_.torque.torqueUse);
        keptPath_.set(nominal, jerk, bestStops_, tick_s_);
        ticksOnPath_ = 0;
    } else {
        braking_.getStored(jerk);
    }
    braking_.commit(desired, jerk, joints);
    for (std::size_t i = 0; i < static_cast<std::size_t>(jerk.size()); ++i) {
        const auto at = static_cast<Eigen::Index>(i);
        if (jerk[at] == proposed_[at] || jerk[at] == desired[at] || reason == LimitKind::None) continue;
        const bool isUpper =
            reason == LimitKind::Torque ? jerk[at] < proposed_[at] : getLimitRow(reason).side == LimitSide::Upper;
        joints[i] = {reason, isUpper ? LimitSide::Upper : LimitSide::Lower};
    }
    if (!takesBest) return FilterStatus::StoppedByPlan;
    if (status == FilterStatus::Recovering) return FilterStatus::Recovering;
    return jerk == desired ? FilterStatus::Passed : FilterStatus::Modified;
}

/** Beside rows the change is large; with M's coupling light joints would swing to make up for the torque of those that are
held. */
const JointMatrix* WholeArmChoice::chooseMetric(const Dynamics& dynamics, const JointMatrix* metric) {
    if (options_.joints.objective != Objective::Torque && metric != &dynamics.M)
        return metric;  // that of `tool`, too, in need
    ownInertia_ = dynamics.M.diagonal().asDiagonal();
    return &ownInertia_;
}

/** Where the proposed jerks, whose path is path_, would bring the stop too near to what the backup stop, storedPath_, was nearest
to, steered_ are others: what was seen of that a tick ago tells so to first order, without a look. False: none would. */
bool WholeArmChoice::foresee(const MotionState& nominal, const Dynamics& dynamics, const JointMatrix* metric,
                             const JointVector& desired) {
    rows_.clear();
    if (!check_.addForeseenRows(stored_, static_cast<double>(ticksOnPath_) * tick_s_,
                                {storedPath_, storedJerk_, path_, proposed_}, demands_.get(), rows_))
        return false;
    check_.addTickRows(dynamics, nominal.qdd, demands_.get().torqueUse, lastTorque_, rows_);
    braking_.propose(chooseMetric(dynamics, metric), desired, &rows_, steered_);
    return true;
}

/** Looks for jerks near the desired ones that are good, or better ones than those that were looked at, steered_; then on the way
from them back to the backup stop.
@param hasRows  steered_ were looked at completely */
void WholeArmChoice::steer(const MotionState& nominal, const Dynamics& dynamics, const JointMatrix* metric,
                           const JointVector& desired, bool hasRows) {
    const bool steers = options_.steers && metric;
    JointVector from = steered_;  // what was looked at last
    if (hasRows) {
        rows_.clear();
        check_.addRows(from, storedPath_, storedJerk_, demands_.get(), rows_);
        check_.addTickRows(dynamics, nominal.qdd, demands_.get().torqueUse, lastTorque_, rows_);
    }
    if (isEasing_ && steers && demands_.isKept()) {
        goOneByOne(nominal, desired);
        if (hasBest_) return;
    }
    if (hasRows) {
        for (int round = 0; round < kSteeringRounds; ++round) {
            if (round > 0) check_.addRows(from, storedPath_, storedJerk_, demands_.get(), rows_);
            braking_.propose(chooseMetric(dynamics, metric), desired, &rows_, steered_);
            if (steered_ == from) break;
            from = steered_;
            if (!isGood(nominal, from, round + 1 < kSteeringRounds)) continue;
            keepBest(from);
            return;
        }
    } else if (steers && !(trial_.speed.isKept && trial_.people.isKept)) {
        // The first look ended there; the rows that were foreseen stand.
        check_.addMotionRows({path_, from, storedPath_, storedJerk_}, demands_.get(), rows_);
        braking_.propose(chooseMetric(dynamics, metric), desired, &rows_, steered_);
        from = steered_;
        if (isGood(nominal, from, false)) {
            keepBest(from);
            return;
        }
    }
    // What was foreseen is to first order.
    if (!hasBest_ && !hasRows && steered_ != proposed_ && braking_.isAdmissible(proposed_) &&
        isGood(nominal, proposed_, false))
        keepBest(proposed_);
    // What holds some joints is not to hold those that have nothing to do with it: one by one, the worst first, they go back,
    // and the others do what is desired of them; but on the path all are held alike, and where the distance is lost all brake.
    const bool isOfRate = check_.failsByRate(trial_), mayGo = steers && !isEasing_ && demands_.isKept();
    if (!hasBest_ && isOfRate && mayGo) goOneByOne(nominal, desired);
    for (int k = 0; k < kRetreats && !hasBest_; ++k) {
        from = (from + storedJerk_) / 2.0;
        if (braking_.isAdmissible(from) && isGood(nominal, from, false)) keepBest(from);
    }
    if (!hasBest_ && !isOfRate && mayGo) goOneByOne(nominal, desired);
}

void WholeArmChoice::goOneByOne(const MotionState& nominal, const JointVector& desired) {
    JointVector from;
    braking_.propose(&identity_, desired, nullptr, from);
    for (int k = 0; k < static_cast<int>(from.size()) && braking_.isAdmissible(from); ++k) {
        if (isGood(nominal, from, false)) return keepBest(from);
        const ArmStopCheck::Worst worst = check_.findWorstJoint(trial_, from, storedPath_, storedJerk_, demands_.get());
        if (isEasing_ && worst.isAlong) {
            demands_.ease();
            const bool isGoodNow = isPathGood(false);
            demands_.harden(isGoodNow ? &trial_ : nullptr);
            if (isGoodNow) return keepBest(from);
        }
        if (worst.joint < 0) return;
        from[worst.joint] = storedJerk_[worst.joint];
    }
}

/** An arm that is still for a while though it is asked to move, is eased until it has moved and is still again; where that
leads nowhere for as long, not again for twice the time. */
void WholeArmChoice::updateEasing(const MotionState& nominal) {
    const std::int64_t first = std::llround(kWait_s / tick_s_);
    if ((nominal.qd.array().abs() > still_radps_.array()).any()) {
        still_ = 0;
        wait_ = first;
    } else if (++still_ >= (isEasing_ ? first : wait_)) {
        still_ = 0;
        if (isEasing_) wait_ *= 2;
        isEasing_ = !isEasing_ && feed_;
    }
}

/** Who is near an element, and to what. */
std::pair<std::string, std::string> WholeArmChoice::nameNearest(int element, const ArmGeometry& geometry) const {
    const LimitReport near = check_.getNearest(element);
    const auto getLink = [&](int link) { return geometry.links[static_cast<std::size_t>(link)]; };
    if (near.otherLink >= 0) return {getLink(near.link), getLink(near.otherLink)};
    if (near.other < 0) return {getLink(near.link), "what is around"};
    const Environment& around = view_.surroundings->environment();
    const int sphere = near.other - static_cast<int>(around.solids.size());
    const bool moves = sphere >= 0 && sphere < static_cast<int>(around.spheres.size());
    return {getLink(near.link), view_.surroundings->name(near.other) +
                                    (moves ? " (a moving sphere counts with all that is left of its path)" : "")};
}

/** "link5 to -0.0123 m from link2", one entry for each two that are too near, nearest first. */
std::string WholeArmChoice::listTooNear(const ArmGeometry& geometry) const {
    std::map<std::pair<std::string, std::string>, double> least;
    for (int e = 0; e < check_.elements(); ++e) {
        const double seen = stored_.seen[static_cast<std::size_t>(e)];
        if (!(seen < demands_.required() - kRounding_m)) continue;
        const auto entry = least.try_emplace(nameNearest(e, geometry), seen).first;
        entry->second = std::min(entry->second, seen);
    }
    std::vector<std::pair<double, std::string>> found;
    for (const auto& [who, distance] : least)
        found.emplace_back(distance, who.first + " to " + formatShort(distance) + " m from " + who.second);
    std::sort(found.begin(), found.end());
    std::string text;
    for (const auto& [distance, entry] : found) addItem(text, entry);
    return text;
}

/** ", where balls cover the capsules; the capsules themselves come to 0.0123 m (link5 from shelf)". Not for ticks. */
std::string WholeArmChoice::describeExactly(const RunSetup& setup) const {
    constexpr int kPoses = 100;
    const Environment around = view_.surroundings ? view_.surroundings->environment() : Environment();
    const CollisionChecker checker(setup.robot, *setup.geometry, around);
    CollisionChecker::Contact nearest;
    nearest.distance = kLargestShown_m;
    JointVector q;
    for (int k = 0; k <= kPoses; ++k) {
        const double t = storedPath_.duration() * k / kPoses;
        storedPath_.calcPositions(t, q);
        const CollisionChecker::Contact contact = checker.findContact(q, time() + t, kLargestShown_m);
        if (contact.distance < nearest.distance) nearest = contact;
    }
    const auto getLink = [&](int link) { return setup.geometry->links[static_cast<std::size_t>(link)]; };
    const std::string meant =
        ". These are lower bounds (balls cover the capsules; a moving sphere counts with all of its path)";
    if (nearest.link < 0)
        return meant + "; the capsules themselves are clear by " + formatShort(kLargestShown_m) + " m";
    return meant + "; the capsules themselves come to " + formatShort(nearest.distance) + " m (" +
           getLink(nearest.link) + " from " +
           (nearest.obstacle < 0 ? getLink(nearest.otherLink) : view_.surroundings->name(nearest.obstacle)) + ")";
}

void WholeArmChoice::checkStart(const RunSetup& setup, const std::string& place) const {
    constexpr char kWay[] = "or set `recovery: true`, which moves the arm away.";
    const std::string required = formatNumber(demands_.required());
    const std::string tooNear = setup.geometry ? listTooNear(*setup.geometry) : std::string();
    if (!tooNear.empty())
        throw badInput(
            place,
            "the start, or the stop from there, brings " + tooNear + "; at least " + required + " m is to be kept" +
                describeExactly(setup),
            std::string(
                "Change `start`, the obstacle or `safety_distance_m` (links: `may_touch` in collision.yaml), ") +
                kWay);
    for (int e = 0; e < check_.elements(); ++e) {
        if (stored_.proven[static_cast<std::size_t>(e)] >= demands_.required() - kRounding_m) continue;
        const auto [who, other] = nameNearest(e, *setup.geometry);
        throw badInput(place,
                       "the stop from the start is too fast beside " + other + ", or too much is near, to prove that " +
                           who + " keeps " + required + " m from it",
                       std::string("Start slower or farther away, ") + kWay);
    }
    if (const SpeedCheck::Result& speed = stored_.speed; !(speed.proven <= 1.0 + SpeedCheck::kRounding)) {
        const int link = speed.fastest.link;
        throw badInput(place,
                       "the start, or the stop from there, brings " +
                           (link < 0 ? std::string("the tool") : limited_->links[static_cast<std::size_t>(link)]) +
                           " to " + formatShort(speed.fastest.value) + " m/s (an upper bound); its limit there is " +
                           formatNumber(speed.fastest.limit) + " m/s",
                       std::string("Start slower, or change `speed_limits`, ") + kWay);
    }
    if (people_ && !ofPeople_.isKept) {
        const auto person = static_cast<std::size_t>(std::max(0, ofPeople_.other));
        throw badInput(place,
                       "the start, or the stop from there, may bring " +
                           limited_->links[static_cast<std::size_t>(std::max(0, ofPeople_.link))] + " to " +
                           people_->people()[person].name + " while it is faster than the person may be touched at",
                       std::string("Start slower, or farther from people, ") + kWay);
    }
    const TorqueScan::Result& torque = stored_.torque;
    if (torque.bearsTorque && torque.torqueUse <= 1.0) return;
    JointVector q, qd, meanQdd;
    storedPath_.calcTick(torque.tick, q, qd, meanQdd);
    throw badInput(
        place,
        "the start, or the stop from there, needs " + formatShort(100.0 * torque.torqueUse) + " % of the " +
            (torque.isChange ? "change of torque" : "torque") + " that " +
            setup.robot.joints[static_cast<std::size_t>(torque.joint)].name + " may use (" +
            formatShort(torque.torque) + " Nm in the pose " + formatList(q) + ", " +
            formatShort(static_cast<double>(torque.tick) * tick_s_) + " s after the start)" +
            (torque.bearsTorque ? "" : ", as far as it was looked at"),
        std::string(
            "Change `start` (at rest, the arm less far out), the payload, `torque_share` or `torque_rate_Nmps`, ") +
            kWay);
}

}  // namespace viable::detail
