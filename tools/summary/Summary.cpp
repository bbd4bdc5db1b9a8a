#include "summary/Summary.h"

#include "core/FarthestJoint.h"

namespace viable {

// What counts as rest near a limit, see Summary::chatter().
constexpr double kNearShare = 0.05, kRestShare = 1e-3, kRest_s = 0.5, kLeastRest_s = 1.0;

// What counts as a swing that does not die out, see JointFollowing::swing() [rad, m].
constexpr double kLeastSwing = 0.005, kKeptShare = 0.7;
constexpr int kHalfSwings = 6;
/** A command jumps that moves by more in a tick than this many times what the joint can; or by this, where it has no limit
[rad, m]. It rested before, for longer than from one sample of a stream to the next [s]. */
constexpr double kFastestSpeeds = 2.0, kJump = 0.05, kLongestPeriod_s = 0.11;
/** An arm is held off by what is no farther away than this beyond the safety distance: references rest 2 mm before the filter's
aim, which is 5 mm beyond it [m]. */
constexpr double kHeldOff_m = 0.008;
/** Among the kinds of limits that act: something is so near. */
constexpr unsigned kNear = 1u << 31;
/** Less is not judged [s]. */
constexpr double kLeastJudged_s = 0.5;
/** A tool is no nearer to the base than this, for the speeds that joints give it [m]. */
constexpr double kLeastLever_m = 0.1;
/** A torque that changes by as much as it may, less this share, is held back by that. */
constexpr double kLeastCut = 1e-6;
/** Of the motor's torque limit: the robust loop's torque that counts as a push to one side. */
constexpr double kPushShare = 0.2;

/** Of the joint that can least. */
static Pace findPace(const JointLimits& limits, double lever) {
    const auto least = [&](const JointBounds& bounds) {
        return lever * bounds.upper.cwiseMin(-bounds.lower).minCoeff();
    };
    return {least(limits.velocity), least(limits.acceleration), least(limits.jerk)};
}

static Pace findJointPace(const JointLimits& limits, int i) {
    const auto least = [&](const JointBounds& bounds) { return std::min(-bounds.lower[i], bounds.upper[i]); };
    return {least(limits.velocity), least(limits.acceleration), least(limits.jerk)};
}

static Following::Point makePoint(double x) {
    return {x, 0.0, 0.0, 0.0};
}

Summary::Summary(std::vector<std::string> jointNames, JointLimits limits, bool hasRealPlant, RealArmReference reference)
    : jointNames_(std::move(jointNames)),
      slides_(jointNames_.size(), false),
      bounds_(std::move(limits)),
      hasRealPlant_(hasRealPlant),
      reference_(std::move(reference)) {
    for (auto& records : limits_) records.resize(jointNames_.size());
    for (int k = 0; k < 2; ++k) {
        real_[k].resize(jointNames_.size());
        realStop_[k].resize(jointNames_.size());
        boundShare_[k].setZero(size());
    }
    motors_.resize(jointNames_.size());
    peaks_.resize(jointNames_.size());
    acting_.resize(jointNames_.size());
    rests_.assign(jointNames_.size(), {kNan, kNan, 0.0});
    following_.resize(jointNames_.size());
    realFollowing_.resize(jointNames_.size());
    squaredError_.setZero(size());
    largestError_.setZero(size());
    worstMargin_.value = kInfinity;
}

void Summary::setSliding(std::vector<bool> slides) {
    slides.resize(jointNames_.size(), false);
    slides_ = std::move(slides);
}

double Pace::stop(double from) const {
    const double a = std::min(acceleration, std::sqrt(from * jerk));
    const auto divide = [](double x, double y) { return std::isfinite(y) && y > 0.0 ? x / y : 0.0; };
    return divide(from, a) + divide(a, jerk);
}

double Pace::duration(double way) const {
    if (!(way > 0.0)) return 0.0;
    // A start to v and a stop take the way v (v / a + a / jerk), with the largest a that the way leaves time for.
    const double most = std::min(acceleration, std::cbrt(way * jerk * jerk / 2.0));
    const double rise = std::isfinite(jerk) ? most * most / jerk : 0.0;
    const double v =
        std::isfinite(most) ? std::min(speed, (std::sqrt(rise * rise + 4.0 * most * way) - rise) / 2.0) : speed;
    return (std::isfinite(v) && v > 0.0 ? way / v : 0.0) + stop(v);
}

double Following::Judged::rms(double tick_s) const {
    return static_cast<double>(ticks) * tick_s >= kLeastJudged_s - 0.5 * tick_s ? calcRms(squared, ticks) : kNan;
}

void Following::add(const Point& at, const Point& target, double error, const Pace& pace, unsigned acting,
                    double tick_s) {
    const bool isFirst = std::exchange(isFirst_, false);
    if (ticks_ == 0) {
        first_ = target;
        firstAt_ = at;
    }
    moved_ = std::max(moved_, (at - firstAt_).norm());
    if (isFirst) {
        lastTarget_ = target;
        lastAt_ = at;
    }
    const double move = (target - lastTarget_).norm(), speed = pace.speed;
    const double most = (std::isfinite(speed) ? kFastestSpeeds * speed * tick_s : kJump) + kOutsideShare;
    const double has = tick_s > 0.0 ? (at - lastAt_).norm() / tick_s : 0.0;
    patience_s_ -= tick_s;
    arrival_s_ -= tick_s;
    const bool isJump = isFirst ? ticks_ == 0 && error > kJump
                                : (rested_s_ > kLongestPeriod_s || (moves_ == 0 && jumps_ <= 1)) && move > most;
    if (isJump) {
        jump_ = std::max(jump_, error);
        if (jumps_++ == 0 && moves_ == 0) judged_ = atRest_ = {};  // nothing was asked for before
    } else if (move > 0.0) {
        ++moves_;
    }
    // Where it is taken back at once the arm may still go, by its delay and its acceleration.
    if (isFirst || move > 0.0) arrival_s_ = pace.patience(std::max(error, move), has);
    if (isFirst || isJump || (jumps() && move > most)) patience_s_ = arrival_s_;
    const double period_s = rested_s_ > kLongestPeriod_s ? tick_s : rested_s_ + tick_s;  // of the samples
    rested_s_ = move > 0.0 ? 0.0 : rested_s_ + tick_s;
    if (tick_s > 0.0 && !isFirst) {
        squaredSpeed_ += (at - lastAt_).squaredNorm() / (tick_s * tick_s);
        squaredTargetSpeed_ += move * move / (tick_s * period_s);
    }
    addSwing(at[0] - target[0], move == 0.0);
    lastTarget_ = target;
    lastAt_ = at;
    sum_ += target - first_;  // small numbers, so that their squares are no differences of large ones
    squared_ += (target - first_).squaredNorm();
    squaredError_ += error * error;
    largest_ = std::max(largest_, error);
    ++ticks_;
    for (auto [account, wait_s] : {std::pair{&judged_, patience_s_}, std::pair{&atRest_, arrival_s_}}) {
        if (wait_s > 0.0 || (account == &atRest_ && rested_s_ <= kLongestPeriod_s)) continue;
        account->squared += error * error;
        ++account->ticks;
    }
    addCauses(error * error, acting, tick_s);
}

void Following::addCauses(double squaredError, unsigned acting, double tick_s) {
    constexpr unsigned kHeldOff = 1u << static_cast<unsigned>(LimitKind::Clearance);
    heldOff_s_ = acting & kHeldOff ? kWayBack_s : heldOff_s_ - tick_s;
    if (heldOff_s_ > 0.0 || (acting & kNear)) acting |= kHeldOff;
    for (std::size_t k = 0; k < squaredBy_.size(); ++k)
        if (acting >> k & 1u) squaredBy_[k] += squaredError;
}

double Following::share(LimitKind kind) const {
    return squaredError_ > 0.0 ? squaredBy_[static_cast<std::size_t>(kind)] / squaredError_ : 0.0;
}

void Following::addSwing(double error, bool isAtRest) {
    if (!isAtRest) {
        side_ = peak_ = lastPeak_ = 0.0;
        halfSwings_ = 0;
    }
    const double size = std::abs(error);
    if (side_ * error < 0.0 && size >= kLeastSwing) {  // the next half-swing
        halfSwings_ = lastPeak_ > 0.0 && peak_ >= kKeptShare * lastPeak_ ? halfSwings_ + 1 : 0;
        if (halfSwings_ >= kHalfSwings) swing_ = std::max(swing_, peak_);
        lastPeak_ = peak_;
        peak_ = 0.0;
        side_ = error;
    }
    if (side_ == 0.0 && size >= kLeastSwing) side_ = error;
    if (side_ * error > 0.0) peak_ = std::max(peak_, size);
}

double Following::errorRms(const std::vector<Following>& joints) {
    double squared = 0.0;
    std::int64_t ticks = 0;
    for (const Following& joint : joints) {
        squared += joint.squaredError_;
        ticks += joint.ticks_;
    }
    return calcRms(squared, ticks);
}

double Following::spread() const {
    if (ticks_ == 0) return 0.0;
    const double count = static_cast<double>(ticks_);
    return std::sqrt(std::max(0.0, squared_ / count - (sum_ / count).squaredNorm()));
}

bool Summary::check(std::vector<LimitRecord>& records, LimitKind kind, const JointBounds& bounds,
                    const JointVector& values, double time_s) const {
    bool outside = false;
    for (int i = 0; i < static_cast<int>(records.size()); ++i)
        outside |= records[i].add(kind, bounds.lower[i], bounds.upper[i], values[i], time_s, isRecovering_);
    return outside;
}

void Summary::addEnd(const MotionState& nominal, double time_s) {
    bool outside = check(limits_[0], LimitKind::Position, bounds_.position, nominal.q, time_s);
    outside |= check(limits_[1], LimitKind::Velocity, bounds_.velocity, nominal.qd, time_s);
    outside |= check(limits_[2], LimitKind::Acceleration, bounds_.acceleration, nominal.qdd, time_s);
    broken_ |= outside && !isRecovering_;
}

void Summary::addIntervention(int i, const TickRecord& record) {
    const JointIntervention& joint = record.joints[i];
    Acting& acting = acting_[i];
    const bool goesOn = joint.limit == acting.last.limit && joint.side == acting.last.side;
    acting.episodeTicks = goesOn ? acting.episodeTicks + 1 : 1;
    acting.last = joint;
    if (joint.limit == LimitKind::None) return;
    InterventionRecord& r =
        acting.records[static_cast<std::size_t>(joint.limit)][joint.side == LimitSide::Upper ? 1 : 0];
    const double torque = std::abs(record.removedTorque[i]);
    ++r.ticks;
    if (!goesOn) ++r.episodes;
    r.longestTicks = std::max(r.longestTicks, acting.episodeTicks);
    r.largestTorque = std::max(r.largestTorque, torque);
    r.squaredTorque += torque * torque;
}

void Summary::addStops(const TickRecord& record) {
    if (record.missed) ++missed_;
    if (record.verdict == StopVerdict::Recovering) ++recovering_;
    if (record.verdict == StopVerdict::NoStop && unviable_++ == 0) firstUnviable_s_ = record.time_s;
    for (int i = 0; i < size(); ++i) {
        const TickRecord::Stop& stop = record.stops[i];
        if (stop.margin < worstMargin_.value) worstMargin_ = {stop.margin, i, record.time_s};
        if (stop.duration_s > longestStop_.value) longestStop_ = {stop.duration_s, i, record.time_s};
    }
}

bool Summary::hasJointCommand(const TickRecord& record) const {
    return record.command.space == MotionCommand::Space::Joint && record.command.q.size() == size();
}

void Summary::addCommand(int i, const TickRecord& record) {
    if (!hasJointCommand(record)) return;
    if (record.paused || record.touch.isOn) return following_[i].skip();
    const double target = std::max(bounds_.position.lower[i], std::min(record.command.q[i], bounds_.position.upper[i]));
    const auto add = [&](std::vector<Following>& joints, double q) {
        joints[i].add(makePoint(q), makePoint(target), std::abs(q - target), findJointPace(bounds_, i), actingKinds_,
                      tick_s_);
    };
    add(following_, record.nominal.q[i]);
    if (hasRealPlant_ && record.hasReading) add(realFollowing_, record.actual.q[i]);
}

/** The pose that is asked of a tool: the commanded one, moved up to the surface that holds it. */
Pose Summary::findAsked(const TickRecord& record, const Pose& tool) const {
    Pose asked = record.command.tool;
    asked.orientation.normalize();
    if (task_.isRelative)
        asked = {toolOrigin_.position + asked.position - commandOrigin_.position,
                 asked.orientation * commandOrigin_.orientation.conjugate() * toolOrigin_.orientation};
    const TickRecord::Touch& touch = record.touch;
    if (touch.isOn) asked.position += std::max(0.0, touch.normal.dot(tool.position - asked.position)) * touch.normal;
    return asked;
}

void Summary::addTool(const TickRecord& record) {
    if (record.command.space != MotionCommand::Space::Tool) return;
    if (record.paused) {
        tool_.skip();
        return turn_.skip();
    }
    if (tool_.ticks() == 0) {
        commandOrigin_ = record.command.tool;
        commandOrigin_.orientation.normalize();
        toolOrigin_ = record.tool;
    }
    const Pace pace = findPace(bounds_, std::max(kLeastLever_m, record.tool.position.norm()));
    const auto add = [&](Following& place, Following& turn, const Pose& tool) {
        const Pose asked = findAsked(record, tool);
        const auto point = [&](const Pose& pose) {
            const Eigen::Vector3d p = task_.ways * pose.position;
            return Following::Point(p.x(), p.y(), p.z(), 0.0);
        };
        place.add(point(tool), point(asked), (task_.ways * (tool.position - asked.position)).norm(), pace, actingKinds_,
                  tick_s_);
        const auto twice = [](const Pose& pose, const Following::Point& near) -> Following::Point {
            const Following::Point q = 2.0 * pose.orientation.coeffs();
            return q.dot(near) < 0.0 ? -q : q;
        };
        const Following::Point target = twice(asked, turn.lastTarget());
        turn.add(twice(tool, turn.lastAt()), target, tool.orientation.angularDistance(asked.orientation),
                 findPace(bounds_, 1.0), actingKinds_, tick_s_);
    };
    add(tool_, turn_, record.tool);
    if (hasRealPlant_ && record.hasReading && reference_.calcTool)
        add(realTool_, realTurn_, reference_.calcTool(record.actual.q));
}

void Summary::addRest(int i, const TickRecord& record) {
    const double lower = bounds_.position.lower[i], upper = bounds_.position.upper[i];
    const double q = record.nominal.q[i], range = upper - lower;
    const double jerkLimit = std::max(-bounds_.jerk.lower[i], bounds_.jerk.upper[i]);
    RestPeriod& rest = rests_[i];
    if (!hasJointCommand(record) || !std::isfinite(range) || !std::isfinite(jerkLimit)) return;
    const double near = kNearShare * range, target = record.command.q[i];
    if (!(std::abs(q - rest.q) <= 0.5 * kRestShare * range) || target != rest.target) rest = {q, target, record.time_s};
    const bool isPressed = (target <= lower && q - lower <= near) || (target >= upper && upper - q <= near);
    if (!isPressed || record.time_s - rest.since_s < kRest_s) return;
    const double share = record.nominal.jerk[i] / jerkLimit;
    squaredRestJerk_ += share * share;
    ++restTicks_;
    rested_s_ += tick_s_;
}

void Summary::addReading(const TickRecord& record) {
    ++readings_;
    const JointLimits& limits = reference_.limits ? *reference_.limits : bounds_;
    const JointVector& q = record.actual.q;
    const JointVector& qd = record.actual.qd;
    check(real_[0], LimitKind::Position, limits.position, q, record.time_s);
    check(real_[1], LimitKind::Velocity, limits.velocity, qd, record.time_s);
    realEndSpeed_ = qd.lpNorm<Eigen::Infinity>();
    if (reference_.bound) {
        const TrackingBound& bound = *reference_.bound;
        const JointVector error = record.real.q - record.nominal.q;
        const int lost = trip_ ? -1 : detail::findFarthestBeyond(error, bound.measured);
        if (lost >= 0) trip_ = {lost, record.time_s, std::abs(error[lost]), bound.measured[lost]};
        const auto addShares = [](JointVector& shares, const JointVector& difference, const JointVector& size) {
            for (Eigen::Index i = 0; i < shares.size(); ++i)
                if (difference[i] != 0.0) shares[i] = std::max(shares[i], std::abs(difference[i]) / size[i]);
        };
        addShares(boundShare_[0], q - record.nominal.q, bound.position);
        addShares(boundShare_[1], qd - record.nominal.qd, bound.velocity);
    }
    if (trip_) {
        check(realStop_[0], LimitKind::Position, limits.position, q, record.time_s);
        check(realStop_[1], LimitKind::Velocity, limits.velocity, qd, record.time_s);
    }
}

void Summary::addContact(const TickRecord& record) {
    Touching& t = *touching_;
    const ContactReport& now = record.contact;
    if (now.contacts > 0) {
        if (t.ticks++ == 0) t.first_s = record.time_s;
        t.touches += !isTouching_;
    }
    isTouching_ = now.contacts > 0;
    t.last = now.pressing;
    if (!(now.pressing > t.peak.pressing)) return;
    t.peak = now;
    t.peak_s = record.time_s;
}

void Summary::addWaiting(const TickRecord& record) {
    Waiting& w = *waiting_;
    if (w.ticks++ == 0) w.first_s = record.time_s;
    if (record.touch.felt > 0.5 * record.touch.asked) {
        ++w.pressed;
        w.sum += record.touch.felt;
    }
    w.leastAsked = std::min(w.leastAsked, record.touch.asked);
}

void Summary::addMotors(const TickRecord& record) {
    for (int i = 0; i < reference_.torqueLimit.size(); ++i) addMotor(i, record);
    if (record.externalTorque.hasNaN()) ++externalTorqueMissing_;
}

/** The limit of a weaker motor is not known here. It shows as a torque that comes again to the last digit while more is
asked for; a delay between asking and giving, which is not known either, moves a peak but does not cut it. */
void Summary::addMotor(int i, const TickRecord& record) {
    const auto at = static_cast<std::size_t>(i);
    const double given = std::abs(record.motorTorque[i]);
    double asked = record.filterTorque[i] + record.robustTorque[i];
    if (record.externalTorque.size() > 0) asked -= record.externalTorque[i];
    MotorRecord& motor = motors_[at];
    const double use = given / reference_.torqueLimit[i];
    if (use > motor.worstUse) {
        motor.worstUse = use;
        motor.worstTime_s = record.time_s;
    }
    MotorPeak& peak = peaks_[at];
    if (reference_.torqueRate.size() > i && ticks_ > 0 &&
        std::abs(record.motorTorque[i] - peak.last) >= reference_.torqueRate[i] * tick_s_ * (1.0 - kLeastCut))
        ++motor.ticksRateLimited;
    peak.last = record.motorTorque[i];
    const double push = record.robustTorque[i] / reference_.torqueLimit[i];
    motor.worstAdded = std::max(motor.worstAdded, std::abs(push));
    // Beyond its limit the nominal torque is cut by the robust loop's.
    const bool isWithin = std::abs(asked - record.robustTorque[i]) < reference_.torqueLimit[i];
    if (isWithin && std::abs(push) >= kPushShare) {
        const int side = push > 0.0 ? 1 : -1;
        if (side == -peak.pushedTo) ++motor.reversals;
        peak.pushedTo = side;
    }
    peak.asked = std::max(peak.asked, std::abs(asked));
    if (given > peak.given * (1.0 + kOutsideShare)) {
        peak.given = given;
        peak.ticks = 0;
    }
    const bool isAtPeak = given >= peak.given * (1.0 - kOutsideShare);
    if (isAtPeak) ++peak.ticks;
    if (use >= 1.0 - kOutsideShare) ++peak.ticksAtLimit;
    if (peak.ticksAtLimit > 0)
        motor.ticksSaturated = peak.ticksAtLimit;
    else if (isAtPeak)
        motor.ticksSaturated = peak.asked > peak.given * (1.0 + kOutsideShare) ? peak.ticks : 0;
}

bool Summary::anyRealLimitBroken() const {
    for (std::size_t k = 0; k < real_.size(); ++k)
        for (std::size_t i = 0; i < real_[k].size(); ++i)
            if (real_[k][i].ticksOutside > realStop_[k][i].ticksOutside) return true;
    return false;
}

int Summary::worstBoundJoint(LimitKind kind) const {
    Eigen::Index worst = 0;
    boundShare_[findReal(kind)].maxCoeff(&worst);
    return static_cast<int>(worst);
}

/** At rest is slower than this share of the velocity limit, of joints without one of 1 rad/s or m/s. */
constexpr double kStandingShare = 1e-4;

void Summary::addStandstill(const TickRecord& record) {
    LimitKind held = LimitKind::None;
    bool isStanding = record.status == FilterStatus::StoppedByPlan && !record.missed && !record.braking;
    for (int i = 0; isStanding && i < size(); ++i) {
        const double v = record.nominal.qd[i];
        const double limit = v < 0.0 ? -bounds_.velocity.lower[i] : bounds_.velocity.upper[i];
        isStanding = std::abs(v) <= kStandingShare * (std::isfinite(limit) ? limit : 1.0);
        // Of the kinds that hold a whole arm one is named before those of a joint.
        const LimitKind own = record.joints[i].limit;
        if (own != LimitKind::None && (held == LimitKind::None || own >= LimitKind::Torque)) held = own;
    }
    if (!isStanding || held == LimitKind::None) {
        standingTicks_ = 0;
        return;
    }
    if (standingTicks_++ == 0) standingSince_s_ = record.time_s;
    const double time_s = static_cast<double>(standingTicks_) * tick_s_;
    if (time_s < kLongStandstill_s - tick_s_ / 2.0) return;
    const bool hasJustBegun = time_s < kLongStandstill_s + tick_s_ / 2.0;
    standstill_.total_s += hasJustBegun ? time_s : tick_s_;
    if (time_s <= standstill_.longest_s) return;
    standstill_.longest_s = time_s;
    standstill_.begin_s = standingSince_s_;
    standstill_.limit = held;
    standstill_.nearest = record.reports[LimitKind::Clearance];
}

void Summary::add(const TickRecord& record) {
    const int n = size();
    if (ticks_ > 0) tick_s_ = record.time_s - lastTime_s_;
    lastTime_s_ = record.time_s;
    bounds_ = record.limits;
    isRecovering_ = record.verdict == StopVerdict::Recovering;
    addEnd({record.nominal.q, record.nominal.qd, record.nominal.qdd}, record.time_s);
    const bool outside = check(limits_[3], LimitKind::Jerk, bounds_.jerk, record.nominal.jerk, record.time_s);
    broken_ |= outside && !isRecovering_;
    if (hasRealPlant_ && record.hasReading) addReading(record);
    if (hasRealPlant_) addMotors(record);
    if (touching_ && record.hasReading) addContact(record);
    if (waiting_ && record.touch.isOn) addWaiting(record);
    actingKinds_ = 0;
    for (int i = 0; i < n; ++i) actingKinds_ |= 1u << static_cast<unsigned>(record.joints[i].limit);
    // A controller that knows what is near leads no joint into it, and the filter has nothing to do.
    if (const LimitReport& near = record.reports[LimitKind::Clearance];
        actingKinds_ == 1u << static_cast<unsigned>(LimitKind::None) && near.isKnown &&
        near.margin < safetyDistance_m_ + kHeldOff_m)
        actingKinds_ |= kNear;
    for (int i = 0; i < n; ++i) {
        addIntervention(i, record);
        addCommand(i, record);
        addRest(i, record);
        if (hasRealPlant_ && record.hasReading) {
            const double e = record.actual.q[i] - record.nominal.q[i];
            squaredError_[i] += e * e;
            largestError_[i] = std::max(largestError_[i], std::abs(e));
        }
    }
    addTool(record);
    addStops(record);
    addStandstill(record);
    squaredJerk_ += record.nominal.jerk.squaredNorm();
    ++ticks_;
    if (statusTicks_[static_cast<int>(record.status)]++ == 0 && record.status == FilterStatus::Infeasible)
        firstInfeasible_s_ = record.time_s;
    substituted_ = record.substituted;
    tickTime_.add_us(record.compute_us);
    for (int s = 0; s < kStageCount; ++s) stageTimes_[s].add_us(record.stage_us[s]);
}

int Summary::worstJoint(LimitKind kind) const {
    const std::vector<LimitRecord>& records = limit(kind);
    return static_cast<int>(
        std::max_element(records.begin(), records.end(),
                         [](const LimitRecord& a, const LimitRecord& b) { return a.worstUse < b.worstUse; }) -
        records.begin());
}

std::int64_t Summary::ticksOutside(LimitKind kind) const {
    std::int64_t sum = 0;
    for (const LimitRecord& record : limit(kind)) sum += record.ticksOutside;
    return sum;
}

bool Summary::endsOutside() const {
    for (const std::vector<LimitRecord>& records : limits_)
        for (const LimitRecord& record : records)
            if (record.lastExcess > 0.0) return true;
    return false;
}

const LimitAccount* Summary::account(LimitKind kind) const {
    for (const LimitAccount& account : accounts_)
        if (account.kind == kind) return &account;
    return nullptr;
}

std::map<std::pair<std::string, std::string>, InterventionRecord> Summary::interventions() const {
    std::map<std::pair<std::string, std::string>, InterventionRecord> all;
    for (std::size_t i = 0; i < acting_.size(); ++i)
        for (int k = 1; k < kMostLimitKinds; ++k)
            for (int side = 0; side < 2; ++side)
                if (acting_[i].records[k][side].ticks > 0)
                    all[{jointNames_[i],
                         getName(static_cast<LimitKind>(k), side ? LimitSide::Upper : LimitSide::Lower)}] =
                        acting_[i].records[k][side];
    return all;
}

double Summary::changedShare() const {
    if (ticks_ == 0) return 0.0;
    const std::int64_t changed =
        ticksWith(FilterStatus::Modified) + ticksWith(FilterStatus::Infeasible) + ticksWith(FilterStatus::Recovering);
    return static_cast<double>(changed) / static_cast<double>(ticks_);
}

double Summary::jerkRms() const {
    const double count = static_cast<double>(ticks_) * static_cast<double>(jointNames_.size());
    return count > 0.0 ? std::sqrt(squaredJerk_ / count) : 0.0;
}

double Summary::chatter() const {
    return rested_s_ >= kLeastRest_s - 0.5 * tick_s_ ? std::sqrt(squaredRestJerk_ / static_cast<double>(restTicks_))
                                                     : kNan;
}

double Summary::trackingRms(int joint) const {
    return readings_ ? std::sqrt(squaredError_[joint] / static_cast<double>(readings_)) : 0.0;
}

double Summary::trackingRms() const {
    return readings_ ? std::sqrt(squaredError_.mean() / static_cast<double>(readings_)) : 0.0;
}

}  // namespace viable
