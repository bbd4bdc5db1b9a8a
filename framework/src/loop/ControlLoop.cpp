#include "loop/ControlLoop.h"

#include <Eigen/Cholesky>

#include "core/FarthestJoint.h"
#include "core/Text.h"

namespace viable {

/** An arm that rests at a limit is measured beyond it by no more [counts]. */
constexpr double kOutsideCounts = 4.0, kOutside = 1e-4;  // [rad, m]

/** How far a joint that reads the same must be implied to have moved before it is stuck or held, whatever its friction. */
constexpr double kVisible_rad = 0.02, kVisible_m = 0.01;

/** Without a figure of friction: it stops a joint at once that moved by so many times SensorCheck::moving(). */
constexpr double kSlow = 2.5;

/** A share that is smaller is nothing. */
constexpr double kRounding = 1e-9;

// What the author of a plugin can do about its failures.

constexpr char kOnJump[] =
    "Check the encoder and its wiring: a wrap, a lost count, swapped channels. The robust loop was not given it.";
constexpr char kOnStillness[] =
    "Check the encoder, its wiring and the brake, or see what the joint ran against. Where it only sticks, give its "
    "dry friction and its encoder's counts in actuation.yaml. The robust loop was not given its readings any more.";
constexpr char kOnKnownStillness[] =
    "Check the encoder, its wiring and the brake, or see what the joint ran against. Where it only sticks, its dry "
    "friction is larger than actuation.yaml says. The robust loop was not given its readings any more.";
static const char* explainStillness(const RunSetup& setup, int joint) {
    return setup.robot.actuation.friction.coulomb[joint] > 0.0 ? kOnKnownStillness : kOnStillness;
}
constexpr char kOnLostTracking[] =
    "Find what acted on the arm then: a push, a payload, a failed sensor. State what belongs to the task in "
    "`disturbance_set`, which widens the bound.";

constexpr char kOnOscillation[] =
    "The robust loop is too strong for this arm, its delay or its sensors, or the arm is lighter than its model. "
    "Nric's gains follow from the model where they are left out; give the true masses, inertias and the delay, or "
    "smaller gains.";
constexpr char kOnSaturation[] =
    "The motors cannot carry this motion with what acts on the arm: lower the limits of acceleration and jerk, use "
    "whole_arm_braking, which knows the motors (torque_share), or see whether a joint is blocked or a payload too "
    "heavy.";
constexpr char kOnWeakness[] =
    "It gives less than actuation.yaml says, perhaps less than holding the arm takes: find out why, or correct the "
    "torque limit there and lower the limits of acceleration and jerk.";
constexpr char kOnDrift[] =
    "Something acts on the arm that the robust loop, if there is one, cannot make up for: friction, a payload, a push, "
    "a joint that blocks, a wrong sign. Nric's gains are as large as the model carries where they are left out; rotor "
    "inertias that are missing in actuation.yaml make them small. To run it all the same: `accept_unstable: true` in "
    "the block robust_loop.";

constexpr char kOnWithheld[] =
    "Something holds the arm, pushes it or loads it more than the robust loop may make up for (`viable gains` tells "
    "how much): a quarter of the motor, or what a `disturbance_set` with that payload or push asks for.";

constexpr char kOnLeftLimits[] =
    "The bound holds while the nominal arm keeps the limits: use a filter that guarantees them, such as "
    "certified_braking.";

static bool areWithin(const JointBounds& bounds, const JointVector& values) {
    for (Eigen::Index i = 0; i < values.size(); ++i) {
        const double lower = bounds.lower[i], upper = bounds.upper[i];
        const double tolerance = kOutsideShare * calcLimitScale(lower, upper);
        if (!(values[i] >= lower - tolerance && values[i] <= upper + tolerance)) return false;
    }
    return true;
}

static const char* getJointName(const RobotDescription& robot, int joint) {
    return robot.joints[joint].name.c_str();
}

ControlLoop::ControlLoop(const RunSetup& setup, LoopPlugins plugins, const RealArmOptions& options)
    : setup_(setup),
      plugins_(std::move(plugins)),
      options_(options),
      n_(setup.size()),
      loop_(setup.tick_s, plugins_.watches),
      nominalArm_(setup, plugins_, loop_, options.fixesLimits, options.contactForce > 0.0) {
    VIABLE_CHECK(!options_.bound || options_.bound->measured.size() == n_, "a tracking bound of another arm");
    if (plugins_.robustLoop && options_.limitsAuthority) {
        const std::optional<LinearErrorLoop> law = plugins_.robustLoop->traits().errorLoop;
        authority_ = detail::Authority(setup, detail::calcAuthority(setup, law ? &*law : nullptr, options_.bound));
        if (options_.contactForce > 0.0)
            touch_ = std::make_unique<detail::ToolTouch>(setup, options_.contactForce, law ? &*law : nullptr);
    }
    reset();
}

ControlLoop::~ControlLoop() {
    destroyPlugins(plugins_);
}

void ControlLoop::reset() {
    loop_.reset();
    MotionState start = setup_.start;
    const auto resetOne = [&](auto& plugin, PluginKind kind) {
        if (plugin) resetPlugin(*plugin, kind, loop_.findWatch(kind), start);
    };
    hasClock_ = plugins_.realPlant && plugins_.realPlant->traits().hasClock;
    if (hasClock_) {
        resetOne(plugins_.realPlant, PluginKind::RealPlant);
        moveToReal(start);
    }
    nominalArm_.reset(start);
    resetOne(plugins_.robustLoop, PluginKind::RobustLoop);
    if (!hasClock_) resetOne(plugins_.realPlant, PluginKind::RealPlant);
    real_ = actual_ = plausible_ = {start.q, start.qd};
    isPlausible_.fill(true);
    missingExternalTorques_ = missedInRow_ = releaseTicks_ = 0;
    ownTorque_.resize(0);
    isTrackingLost_ = isIntegralHeld_ = hasLeftLimits_ = robustLoopEnded_ = drifts_ = isWithheld_ = false;
    isLoopAsked_ = true;
    externalTorque_.setZero(options_.feedsExternalTorque ? n_ : 0);
    if (touch_) touch_->reset();
    contact_ = {};
    authority_.reset();
    following_.begin(setup_);
    SensorCheck::Policy policy;
    policy.largestChange = calcLargestChange(setup_, setup_.limits, options_.bound, authority_);
    policy.largestSpeed = policy.largestDeviation = JointVector::Constant(n_, kInfinity);
    SensorCheck::setMotion(setup_, policy);
    for (int i = 0; i < n_ && !options_.bound; ++i) policy.largestGrowth[i] = calcLeastJump(setup_.robot, i);
    sensors_.begin(policy, start.q);
    for (JointVector* v : {&robustTorque_, &motorTorque_, &appliedTorque_, &releasedTorque_}) v->setZero(n_);
    ticksToMiss_ = 0;
    ticksSinceReading_ = 1;
    isRead_ = hasReading_ = hasDriven_ = false;
}

/** At rest where the plant measures the real arm; at a position limit where that is a little beyond it. */
void ControlLoop::moveToReal(MotionState& start) const {
    const JointState& measured = plugins_.realPlant->measured();
    if (!isFinite(measured, n_)) return;  // the first tick says so
    const JointBounds& bounds = setup_.limits.position;
    const bool recovers = plugins_.filter->traits().recovers;
    for (int i = 0; i < n_; ++i) {
        const double q = measured.q[i], inside = std::clamp(q, bounds.lower[i], bounds.upper[i]);
        start.q[i] = recovers ? q : inside;
        if (recovers || std::abs(q - inside) <= std::max(kOutsideCounts * setup_.robot.encoderStep(i), kOutside))
            continue;
        throw badInput("the robot",
                       getJointName(setup_.robot, i) + std::string(" stands at ") + detail::formatNumber(q) +
                           ", beyond the nominal arm's position limit " + detail::formatNumber(inside) + " by " +
                           detail::formatNumber(std::abs(q - inside)),
                       "Move it inside, widen the limits, or use the filter certified_braking with `recovery: true`.");
    }
    start.qd.setZero(n_);
    start.qdd.setZero(n_);
}

void ControlLoop::releasePlant() noexcept {
    const PluginCall call(loop_.findWatch(PluginKind::RealPlant), kAfterLastTick);
    plugins_.realPlant.reset();
}

void ControlLoop::readPlant(bool isRead) {
    readState();
    if (options_.feedsExternalTorque) readExternalTorque();
    const std::int64_t elapsedTicks = ticksSinceReading_;
    if (isRead) {
        checkReading();  // a jump says more than that the error is large
        checkAnswers();
    } else {
        passReading();
    }
    if (touch_) feelTouch();
    checkTracking();
    checkFollowing(elapsedTicks);
}

void ControlLoop::readState() {
    const TickStatus status = loop_.contain(PluginKind::RealPlant, [&] {
        const JointState& measured = plugins_.realPlant->measured();
        const JointState& actual = plugins_.realPlant->actual();
        if (!isFinite(measured, n_) || !isFinite(actual, n_)) return TickStatus::Faulted;
        real_ = measured;
        actual_ = actual;
        if (const ContactReport* contact = plugins_.realPlant->contact()) contact_ = *contact;
        return TickStatus::Ok;
    });
    if (status == TickStatus::Ok) return;
    loop_.end(StopReason::PlantFailed, "the state that it reports has the wrong size or is not finite", kOnValues);
}

/** Null: it is unusable in this tick. Where that lasts the arm is stopped. */
const JointVector* ControlLoop::findExternalTorque() {
    const JointVector* torque = nullptr;
    const TickStatus status = loop_.contain(PluginKind::RealPlant, [&] {
        torque = plugins_.realPlant->externalTorque();
        return torque && isBounded(*torque, n_) ? TickStatus::Ok : TickStatus::Faulted;
    });
    missingExternalTorques_ = status == TickStatus::Ok ? 0 : missingExternalTorques_ + 1;
    if (missingExternalTorques_ > kMaxSubstitutedTicks)
        loop_.beginStop(StopReason::SensorFailed,
                        "the external torque that it reports has the wrong size, is not finite or beyond 1e9",
                        kOnValues);
    return status == TickStatus::Ok ? torque : nullptr;
}

/** An unusable value is replaced by the last good one, for a while. */
void ControlLoop::readExternalTorque() {
    if (const JointVector* torque = findExternalTorque())
        externalTorque_ = *torque;
    else if (missingExternalTorques_ > kMaxSubstitutedTicks)
        externalTorque_.setZero();
}

/** Nothing is known of where the joint is from here on. */
void ControlLoop::dropReading(int joint, bool isInVain) {
    isPlausible_[joint] = false;
    if (authority_.limits(joint)) authority_.open(joint, isInVain);
}

/** True if the reading of a joint that is beyond its bound stays exactly what it is while the nominal joint goes on: the sensor is
stuck, or the joint blocked. It is not taken as plausible any more, or the robust loop would push in vain. */
bool ControlLoop::replaceStillReading(int joint) {
    if (!options_.judgesReadings || !isPlausible_[joint]) return false;
    if (!(std::abs(sensors_.deviation()[joint]) > options_.bound->measured[joint])) return false;
    if (!(sensors_.findStillTravel(joint) > kJumpCounts * sensors_.count(joint))) return false;
    dropReading(joint, true);
    sensors_.disownStill(joint, std::max(1, static_cast<int>(kRelease_s / setup_.tick_s)));
    sensors_.standIn(joint, nominal(), plausible_);
    return true;
}

/** The robust loop pushes it by what its readings say. */
bool ControlLoop::isDriven(int joint) const {
    return isLoopAsked_ && isPlausible_[joint] && authority_.limits(joint) && authority_.hasAdded(joint);
}

/** Lets the nominal arm wait where the real tool is held, and the robust loop see no more of it than it shall. */
void ControlLoop::feelTouch() {
    const JointVector* torque = findExternalTorque();
    const Dynamics& dynamics = nominalArm_.dynamics();
    const bool isPlausible = std::all_of(isPlausible_.begin(), isPlausible_.begin() + n_, [](bool is) { return is; });
    if (missingExternalTorques_ > kMaxSubstitutedTicks || !isPlausible || dynamics.J.cols() != n_) return touch_->end();
    JointVector rest(n_);
    const JointVector& driving = nominalArm_.motion().torque;
    if (driving.size() != n_) return;  // before its first tick
    for (int i = 0; i < n_; ++i) rest[i] = authority_.limits(i) ? authority_.calcRest(i) : kInfinity;
    touch_->update(plausible_, torque ? *torque : touch_->external(), rest, driving);
    const detail::ToolSurface surface = touch_->surface();
    const double above = surface.normal.dot(dynamics.tool.position) - surface.offset;
    if (touch_->isOn() && touch_->hasLost()) {
        if (above > 2.0 * touch_->kLead && nominalArm_.waits()) nominalArm_.endWait();
        if (above >= touch_->kLead && !nominalArm_.waits())
            touch_->end();  // else the tool would be thrown back to the nominal one
    }
    if (!touch_->isOn()) return;
    if (!loop_.isStopping() && (nominalArm_.waits() || above < 0.0)) nominalArm_.wait(surface);
    touch_->see(nominal(), dynamics, nominalArm_.wantedTool(), plausible_);
}

/** Brakes an arm with a joint that does not answer its motor. Its readings are not taken as plausible any more, and what it was
pushed with in vain is taken back. */
void ControlLoop::checkAnswers() {
    if (hasFailed() || !isLoopAsked_) return;
    const JointMatrix& M = nominalArm_.dynamics().M;
    for (int i = 0; i < n_; ++i) {
        if (!isDriven(i)) continue;
        const double coulomb = setup_.robot.actuation.friction.coulomb[i];
        const double inertia = M.rows() == n_ ? M(i, i) : 0.0;
        // Friction may stop a joint that is slow as well.
        const double slow = coulomb > 0.0 && inertia > 0.0
                                ? authority_.calcHold(i) / inertia * setup_.tick_s * setup_.tick_s
                                : kSlow * sensors_.moving(i);
        const bool isLong = sensors_.stillTicks(i) >= kStillTicks;
        const double implied = options_.bound ? 0.0 : std::abs(authority_.impliedTravel(i));
        const double travel = sensors_.findStillTravel(i);
        const double count = calcCounts(setup_.robot, i);
        // Without a figure of dry friction nobody knows what a joint that stands takes. One that sticks reads exactly the same
        // where the encoder has counts; then the nominal joint must go on, too.
        const bool isImplied = coulomb > 0.0
                                   ? implied > count
                                   : (setup_.robot.encoderStep(i) > 0.0 ? std::min(implied, travel) : implied) >
                                         (setup_.robot.slides(i) ? kVisible_m : kVisible_rad);
        const bool isPressed = authority_.isPressed(i) && (!options_.bound || travel > kJumpCounts * sensors_.count(i));
        const bool isStill = isLong && ((isSuspect(i) && sensors_.lastStep(i) > slow) || isPressed || isImplied);
        if (!isStill) continue;
        const double added = authority_.added(i);
        if (touch_ && touch_->explains(i, added)) continue;
        dropReading(i, true);
        sensors_.disown(i, sensors_.changedDeviation(i));
        sensors_.standIn(i, nominal(), plausible_);
        char message[LoopStatus::kMessageSize];
        std::snprintf(message, sizeof message,
                      "%.60s does not answer its motor (%.3g %s were added): its reading stands still, so its encoder "
                      "is stuck or the joint is held",
                      getJointName(setup_.robot, i), added, setup_.robot.slides(i) ? "N" : "Nm");
        loop_.beginStop(StopReason::NotFollowing, message, explainStillness(setup_, i));
        holdIntegral();
    }
}

/** Brakes an arm that does not follow, and keeps the robust loop from pressing it harder and harder. */
void ControlLoop::checkTracking() {
    if (!options_.bound || hasFailed()) return;
    if (isTrackingLost_) {
        for (int i = 0; i < n_; ++i) replaceStillReading(i);
        const JointVector error = plausible_.q - nominal().q;
        if (detail::findFarthestBeyond(error, detail::FollowingWatch::kRunaway * lostError_) >= 0) releaseToRobot();
        return;
    }
    watchNominal();
    const JointVector error = real_.q - nominal().q;
    const int i = detail::findFarthestBeyond(error, options_.bound->measured);
    if (i < 0) return;
    isTrackingLost_ = true;
    lostError_ = error.cwiseAbs().cwiseMax(options_.bound->measured);
    const char* const unit = getUnit(LimitKind::Position, setup_.robot.slides(i));
    char message[LoopStatus::kMessageSize];
    char cause[160] = "what acts on the arm, or the sensor's error, has left the stated disturbance set";
    if (hasLeftLimits_)
        std::snprintf(cause, sizeof cause, "the nominal arm had left the limits that the bound is for, first at %.4f s",
                      leftLimits_s_);
    bool standsStill = false;
    for (int k = 0; k < n_; ++k) standsStill |= replaceStillReading(k) && k == i;
    if (standsStill)
        std::snprintf(cause, sizeof cause, "its reading stands still: the sensor is stuck or the joint blocked");
    std::snprintf(message, sizeof message,
                  "%.60s was measured %.4g %s from its nominal place, beyond its bound of %.4g %s: %s",
                  getJointName(setup_.robot, i), std::abs(error[i]), unit, options_.bound->measured[i], unit, cause);
    loop_.beginStop(StopReason::TrackingLost, message,
                    standsStill      ? explainStillness(setup_, i)
                    : hasLeftLimits_ ? kOnLeftLimits
                                     : kOnLostTracking);
    holdIntegral();
}

/** The same where there is no bound. */
void ControlLoop::checkFollowing(std::int64_t elapsedTicks) {
    using Cause = detail::FollowingWatch::Cause;
    if (!options_.watchesFollowing || options_.bound || hasFailed() || stopReason() == StopReason::SensorFailed) return;
    if (isTrackingLost_) {  // a loop that acts on wrong readings must not drive the arm on
        const detail::FollowingWatch::Torques torques{motorTorque_, robustTorque_, appliedTorque_, authority_};
        if (isWithheld_ && following_.update(plausible_, nominal(), torques, elapsedTicks).cause == Cause::Oscillation)
            endRobustLoop(true);
        if (!following_.runsAway(plausible_, nominal())) return;
        if (drifts_) endRobustLoop(false);
        return releaseToRobot();
    }
    if (touch_ && touch_->isSettling()) return;  // a tool that bounces swings, too
    const detail::FollowingWatch::Violation found = following_.update(
        plausible_, nominal(), {motorTorque_, robustTorque_, appliedTorque_, authority_}, elapsedTicks);
    if (found.cause == Cause::None) return;
    drifts_ = found.cause == Cause::Drift;
    isWithheld_ = found.cause == Cause::Withheld;
    isTrackingLost_ = true;
    const char* const joint = getJointName(setup_.robot, found.joint);
    const char* const unit = getUnit(LimitKind::Position, setup_.robot.slides(found.joint));
    char message[LoopStatus::kMessageSize];
    if (found.cause == Cause::Oscillation && found.motor >= 0) {
        std::snprintf(message, sizeof message,
                      "the real arm oscillates: the robust loop drives the motor of %.60s %s and back, and its torque "
                      "changes sign every %.3g ms or faster",
                      getJointName(setup_.robot, found.motor),
                      found.isWithheld ? "to the most that it may add" : "into its torque limit",
                      1e3 * following_.halfPeriod());
        endRobustLoop(true);
    } else if (found.cause == Cause::Oscillation) {
        std::snprintf(message, sizeof message,
                      "the real arm oscillates: the velocity of %.60s swings by %.3g %s/s about the nominal one and "
                      "changes sign every %.3g ms or faster",
                      joint, found.error, unit, 1e3 * following_.halfPeriod());
        endRobustLoop(true);
    } else {
        char motor[180];
        std::snprintf(motor, sizeof motor, "%s",
                      setup_.robot.actuation.torqueLimit.array().isInf().any()
                          ? "no torque limit is known of some motors"
                      : setup_.delayTicks > 0 ? "no motor is at its torque limit (with a delay it is not known whether "
                                                "one gives less than is asked of it)"
                                              : "no motor is at its torque limit");
        if (found.motor >= 0)
            std::snprintf(motor, sizeof motor, "the motor of %.60s %s", getJointName(setup_.robot, found.motor),
                          found.cause == Cause::Saturation ? "is at its torque limit"
                          : found.cause == Cause::Withheld ? "gets the most that the robust loop may add"
                                                           : "gives less torque than is asked of it");
        std::snprintf(message, sizeof message,
                      "the real arm does not follow: %.60s is %.4g %s from its nominal place (at most %.4g %s), and %s",
                      joint, found.error, unit, found.allowed, unit, motor);
    }
    loop_.beginStop(StopReason::NotFollowing, message,
                    found.cause == Cause::Oscillation  ? kOnOscillation
                    : found.cause == Cause::Saturation ? kOnSaturation
                    : found.cause == Cause::Weakness   ? kOnWeakness
                    : found.cause == Cause::Withheld   ? kOnWithheld
                                                       : kOnDrift);
    holdIntegral();
    if (drifts_) releaseToRobot();
}

/** Beyond the limits that it is for the bound says nothing, and a trip nothing of the disturbances. */
void ControlLoop::watchNominal() {
    if (hasLeftLimits_) return;
    const JointLimits& limits = setup_.limits;
    hasLeftLimits_ = !areWithin(limits.position, nominal().q) || !areWithin(limits.velocity, nominal().qd) ||
                     !areWithin(limits.acceleration, nominal().qdd) ||
                     !areWithin(limits.jerk, nominalArm_.motion().jerk);  // none before the first tick
    leftLimits_s_ = time();
}

void ControlLoop::holdIntegral() {
    if (isIntegralHeld_) return;
    isIntegralHeld_ = true;
    loop_.contain(PluginKind::RobustLoop, [&] { plugins_.robustLoop->holdIntegral(); });
}

/** A joint's reading that no motion explains is not taken as plausible, nor is any after it; the other joints keep theirs. */
void ControlLoop::checkReading() {
    // The first reading may be anywhere: there is none before it.
    const bool judges = options_.judgesReadings && hasReading_ && !hasFailed();
    hasReading_ = true;
    sensors_.miss(ticksSinceReading_ - 1);
    ticksSinceReading_ = 1;
    std::array<bool, kMaxJoints> isExplained{};
    for (int i = 0; i < n_; ++i) isExplained[i] = sensors_.isPlausible(i, real_, nominal());
    for (int i = 0; i < n_; ++i) {
        if (judges && isPlausible_[i] && !isExplained[i]) {
            dropReading(i, false);
            const char* const unit = getUnit(LimitKind::Position, setup_.robot.slides(i));
            char message[LoopStatus::kMessageSize];
            std::snprintf(message, sizeof message,
                          "the position that it reports of %.60s jumped by %.4g %s between two readings, where %.4g %s "
                          "would be more than any motion of it",
                          getJointName(setup_.robot, i), sensors_.calcChange(i, real_, nominal()), unit,
                          sensors_.largestChange(i), unit);
            loop_.beginStop(StopReason::SensorFailed, message, kOnJump);
            holdIntegral();
        }
        if (isPlausible_[i]) sensors_.take(i, real_, nominal());
        seeJoint(i);
    }
}

/** What the robust loop sees of a joint: what the plant reports, or what stands for it. */
void ControlLoop::seeJoint(int joint) {
    if (!isPlausible_[joint]) return sensors_.standIn(joint, nominal(), plausible_);
    plausible_.q[joint] = real_.q[joint];
    plausible_.qd[joint] = real_.qd[joint];
    if (!isSuspect(joint) || sensors_.stillTicks(joint) >= kStillTicks) return;
    // Until it is known whether it is stuck, it is not pushed, nor in ticks without a reading.
    plausible_.q[joint] = nominal().q[joint] + sensors_.changedDeviation(joint);
    plausible_.qd[joint] = nominal().qd[joint];
}

/** What stands for a reading is what the robust loop sees, but says nothing of the arm. */
void ControlLoop::passReading() {
    sensors_.miss(ticksSinceReading_);
    ticksSinceReading_ = 1;
    for (int i = 0; i < n_; ++i) seeJoint(i);
}

/** @param isAsked  its answers are still of use while its torque goes to zero */
void ControlLoop::endRobustLoop(bool isAsked) {
    if (robustLoopEnded_ && (isAsked || !isLoopAsked_)) return;
    robustLoopEnded_ = true;
    isLoopAsked_ = isAsked;
    releaseTicks_ = 0;
    releasedTorque_ = robustTorque_;
}

/** A joint that nobody measures gives way to what the loop does to the others: their loop would be too strong for the arm if it
took the joint to stay. Its velocity follows from its row of M de = 0. */
void ControlLoop::predictOpenJoints() {
    const JointMatrix& M = nominalArm_.dynamics().M;
    std::array<int, kMaxJoints> open{};
    int count = 0;
    for (int i = 0; i < n_; ++i)
        if (authority_.isOpen(i)) open[count++] = i;
    if (count == 0 || M.rows() != n_) return;
    JointMatrix own(count, count);
    JointVector pull(count);
    const JointVector error = plausible_.qd - nominal().qd;
    for (int a = 0; a < count; ++a) {
        const int row = open[a];
        pull[a] = 0.0;
        for (int k = 0; k < n_; ++k)
            if (!authority_.isOpen(k)) pull[a] -= M(row, k) * error[k];
        for (int b = 0; b < count; ++b) own(a, b) = M(row, open[b]);
    }
    Eigen::LLT<JointMatrix>(own).solveInPlace(pull);
    if (!pull.allFinite()) return;
    for (int a = 0; a < count; ++a) {
        const int row = open[a];
        plausible_.qd[row] = nominal().qd[row] + pull[a];
    }
}

/** False: it failed, and robustTorque_ is of no use. */
bool ControlLoop::askRobustLoop() {
    predictOpenJoints();
    authority_.update(nominal(), plausible_);
    const JointVector lastRobust = robustTorque_;
    const bool hadPush = ownTorque_.size() == n_;
    if (hadPush) robustTorque_ = ownTorque_;
    const TickStatus status = loop_.contain(PluginKind::RobustLoop, [&] {
        return plugins_.robustLoop->compute(plausible_, nominal(), motorTorque_, robustTorque_);
    });
    if (status == TickStatus::Ok && isBounded(robustTorque_, n_)) {
        const bool isCut = authority_.cut(motorTorque_, robustTorque_);
        const bool hasPush = touch_ && touch_->isOn() && isBounded(touch_->push(), n_);
        ownTorque_ = robustTorque_;
        if (hasPush) authority_.add(touch_->push(), robustTorque_);
        const JointVector asked = robustTorque_;
        if (isCut || hasPush || hadPush) limitRates(lastRobust, lastMotorTorque_);
        ownTorque_ += robustTorque_ - asked;
        if (!hasPush) ownTorque_.resize(0);
        return true;
    }
    loop_.beginStop(StopReason::RobustLoopFailed,
                    "it gave no usable torque (wrong size, not finite, beyond 1e9 or not Ok)", kOnValues);
    return false;
}

void ControlLoop::calcMotorTorque() {
    const JointVector lastRobust = robustTorque_;
    lastMotorTorque_ = motorTorque_;
    motorTorque_ = nominalArm_.motion().torque;  // the motors' share of what moves the nominal arm
    if (externalTorque_.size() > 0) motorTorque_ -= externalTorque_;
    if (isLoopAsked_ && !askRobustLoop()) {
        robustTorque_ = lastRobust;
        endRobustLoop(false);
    }
    if (!robustLoopEnded_) return;
    const double share = 1.0 - (releaseTicks_ + 1) * setup_.tick_s / kRelease_s;
    if (!isLoopAsked_) robustTorque_ = releasedTorque_;
    if (share > kRounding) {
        robustTorque_ *= share;
        ++releaseTicks_;
    } else {
        robustTorque_.setZero(n_);
        isLoopAsked_ = false;
    }
    limitRates(lastRobust, lastMotorTorque_);
}

/** Makes the robust loop's torque change no faster than the stated rates. */
void ControlLoop::limitRates(const JointVector& lastRobust, const JointVector& lastMotor) {
    if (options_.robustRate.size() == n_) {
        const JointVector step = options_.robustRate * setup_.tick_s;
        robustTorque_ = robustTorque_.cwiseMax(lastRobust - step).cwiseMin(lastRobust + step);
    }
    if (options_.motorRate.size() != n_ || !hasDriven_) return;  // what the motors gave before is not known
    detail::limitMotorStep(motorTorque_, lastMotor, options_.motorRate * setup_.tick_s, robustTorque_);
}

/** Tells the authority what comes of its cut. */
void ControlLoop::takeRobustTorque() {
    std::array<bool, kMaxJoints> isStill{};
    for (int i = 0; i < n_; ++i) isStill[i] = sensors_.isStill(i);
    const JointMatrix& M = nominalArm_.dynamics().M;
    if (M.rows() == n_) authority_.take(robustTorque_, isStill, M.diagonal());
}

void ControlLoop::drivePlant() {
    motorTorque_ += robustTorque_;
    hasDriven_ = true;
    const TickStatus status =
        loop_.contain(PluginKind::RealPlant, [&] { return plugins_.realPlant->advance(motorTorque_, appliedTorque_); });
    if (status == TickStatus::Ok && isFinite(appliedTorque_, n_)) return;
    loop_.end(StopReason::PlantFailed, "it could not advance (its state would not be finite)", kOnGivingUp);
    appliedTorque_.setZero(n_);
}

/** What is known of the real arm before its motors are told anything. */
void ControlLoop::fillRecord(TickRecord& record, bool hasReading) const {
    record.real = real_;
    record.actual = actual_;
    record.hasReading = hasReading;
    record.contact = contact_;
    if (touch_) touch_->fill(record.touch);
    record.externalTorque = externalTorque_;
    if (missingExternalTorques_ > 0) record.externalTorque.setConstant(std::numeric_limits<double>::quiet_NaN());
    record.missed = missedInRow_ > 0;
}

/** The tick's decision stands: what fails from here on brakes the arm from the next tick on. */
void ControlLoop::finishTick(TickRecord& record, StageTimer& timer, bool drives) {
    nominalArm_.fillRecord(record);
    fillRecord(record, drives);
    if (plugins_.realPlant && !hasFailed() && drives) {
        calcMotorTorque();
        takeRobustTorque();
        timer.mark(Stage::Robust);
        drivePlant();
        timer.mark(Stage::Plant);
    } else if (hasFailed()) {
        appliedTorque_.setZero(n_);  // nothing was sent any more
    }
    record.robustTorque = robustTorque_;
    record.motorTorque = appliedTorque_;

    nominalArm_.advance();
    loop_.nextTick();
    timer.finish();
}

/** Of a plant with a clock: what its ticks say, and how many of them were missed. */
void ControlLoop::awaitPlant() {
    std::int64_t passed = 0;
    const TickStatus status = loop_.contain(PluginKind::RealPlant, [&] { return plugins_.realPlant->read(passed); });
    if (status != TickStatus::Ok || passed < 1)
        return loop_.end(StopReason::PlantFailed, "its clock gave no tick (not Ok, or less than one tick passed)",
                         kOnGivingUp);
    ticksToMiss_ = std::min<std::int64_t>(passed - 1, kMaxMissedTicks + 1);  // more is not told apart
    ticksSinceReading_ = ticksToMiss_ + 1;
}

void ControlLoop::tick(TickRecord& record, bool isRead) noexcept {
    if (hasClock_ && ticksToMiss_ == 0 && !isRead_ && !hasFailed()) awaitPlant();
    isRead_ = ticksToMiss_ > 0;  // the reading is for the tick after those
    if (ticksToMiss_ > 0) {
        --ticksToMiss_;
        return passTick(record, false, isRead);
    }
    StageTimer timer(record);
    if (plugins_.realPlant) readPlant(isRead);
    timer.mark(Stage::Plant);
    missedInRow_ = 0;
    nominalArm_.decide(externalTorque_, timer);
    if (nominalArm_.hasNewLimits()) {
        sensors_.widen(calcLargestChange(setup_, nominalArm_.limits(), options_.bound, authority_));
        authority_.widen(nominalArm_.limits());
        following_.widen(nominalArm_.limits());
    }
    finishTick(record, timer, true);
}

/** A tick without command, controller and filter. @param hasPlant  the plant is still to be read and driven in it */
void ControlLoop::passTick(TickRecord& record, bool hasPlant, bool isRead) noexcept {
    if (++missedInRow_ > kMaxMissedTicks)
        loop_.beginStop(StopReason::TicksMissed, "more than 1000 ticks in a row were missed");
    StageTimer timer(record);
    if (plugins_.realPlant && hasPlant) readPlant(isRead);
    timer.mark(Stage::Plant);
    nominalArm_.missTick(hasPlant, timer);
    finishTick(record, timer, hasPlant);
}

}  // namespace viable
