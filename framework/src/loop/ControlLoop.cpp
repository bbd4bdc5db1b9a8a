#include "loop/ControlLoop.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>

#include "core/FarthestJoint.h"
#include "core/Text.h"
#include "plugin/FaultExplanation.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

using Clock = std::chrono::steady_clock;

bool isUsable(const MotionCommand& command, int n) {
    if (command.space == MotionCommand::Space::Joint) return isFinite(command.q, n) && isFinite(command.qd, n);
    return command.tool.position.allFinite() && command.tool.orientation.coeffs().allFinite() &&
           command.toolTwist.allFinite();
}

/** Accelerations [rad/s^2] and torques [Nm] beyond this are no arm's: a few ticks later the arithmetic itself
would overflow. */
constexpr double kLargestDecision = 1e9;
bool isBounded(const JointVector& v, int n) {
    return isFinite(v, n) && v.lpNorm<Eigen::Infinity>() <= kLargestDecision;
}

/** What the plugin wrote is one of the words that the log and the summary know. */
bool areKnown(FilterStatus status, const FilterDecision& d, int n) {
    if (status > FilterStatus::Ended || d.held > HeldQuantity::Acceleration) return false;
    for (int i = 0; i < n; ++i)
        if (static_cast<int>(d.joints[i].limit) >= countLimitKinds() || d.joints[i].side < LimitSide::Lower ||
            d.joints[i].side > LimitSide::Upper)
            return false;
    return true;
}

constexpr const char* kTooLarge = "its decision is beyond 1e9";

/** What is wrong with a decision and the motion that it gives, or null. */
const char* findFault(const FilterDecision& d, const HeldMotion& motion, double tick_s, int n) {
    if (!isFinite(d.value, n)) return "its decision has the wrong size or is not finite";
    if (!isBounded(motion.torque, n) || !isBounded(motion.acceleration, n) || !isBounded(motion.jerk * tick_s, n))
        return kTooLarge;
    return nullptr;
}

/** An arm that rests at a limit is measured beyond it by no more [counts]. */
constexpr double kOutsideCounts = 4.0, kOutside = 1e-4;  // [rad, m]

/** A share that is smaller is nothing. */
constexpr double kRounding = 1e-9;

// What the author of a plugin can do about its failures.
constexpr char kOnGivingUp[] = "The plugin reports this itself: see its README, or its checks if it is yours.";
constexpr char kOnGuarantee[] = "The decision was not applied. Fix the filter, or let its traits() guarantee nothing.";
constexpr char kOnFixedLimits[] = "Use `hold_on: nominal`, or a command that leaves the limits alone.";
constexpr char kOnLimits[] =
    "Give limits for every joint, the lower below the upper, zero between those of velocity, acceleration and jerk; or "
    "use a "
    "filter that can change them, such as certified_braking.";

constexpr char kOnJump[] =
    "Check the encoder and its wiring: a wrap, a lost count, swapped channels. The robust loop was not given it.";
constexpr char kOnStillness[] =
    "Check the encoder, its wiring and the brake, or see what the joint ran against. The robust loop was not given its "
    "readings any more.";
constexpr char kOnLostTracking[] =
    "Find what acted on the arm then: a push, a payload, a failed sensor. State what belongs to the task in "
    "`disturbance_set`, which widens the bound.";

constexpr char kOnDivergence[] =
    "Controller and nominal arm diverge: lower its gains or the tick, or use a filter that keeps the limits.";
constexpr char kOnOscillation[] =
    "The robust loop is too strong for this arm, its delay or its sensors, or the arm is lighter than its model. "
    "Nric's "
    "gains follow from the model where they are left out; give the true masses, inertias and the delay, or smaller "
    "gains.";
constexpr char kOnSaturation[] =
    "The motors cannot carry this motion with what acts on the arm: lower the limits of acceleration and jerk, use "
    "whole_arm_braking, which knows the motors (torque_share), or see whether a joint is blocked or a payload too "
    "heavy.";
constexpr char kOnWeakness[] =
    "It gives less than actuation.yaml says, perhaps less than holding the arm takes: find out why, or correct the "
    "torque "
    "limit there and lower the limits of acceleration and jerk.";
constexpr char kOnDrift[] =
    "Something acts on the arm that the robust loop, if there is one, cannot make up for: friction, a payload, a push, "
    "a "
    "joint that blocks, a wrong sign. Nric's gains are as large as the model carries where they are left out; rotor "
    "inertias "
    "that are missing in actuation.yaml make them small. To run it all the same: `accept_unstable: true` in the block "
    "robust_loop.";

constexpr char kOnLeftLimits[] =
    "The bound holds while the nominal arm keeps the limits: use a filter that guarantees them, such as "
    "certified_braking.";

bool areWithin(const JointBounds& bounds, const JointVector& values) {
    for (Eigen::Index i = 0; i < values.size(); ++i) {
        const double lower = bounds.lower[i], upper = bounds.upper[i];
        const double tolerance = kOutsideShare * calcLimitScale(lower, upper);
        if (!(values[i] >= lower - tolerance && values[i] <= upper + tolerance)) return false;
    }
    return true;
}

/** Why the arm is braked when a plugin of the kind fails. */
StopReason getReason(PluginKind kind) {
    switch (kind) {
        case PluginKind::CommandSource:
            return StopReason::CommandFailed;
        case PluginKind::NominalController:
            return StopReason::ControllerFailed;
        case PluginKind::SafetyFilter:
            return StopReason::FilterFailed;
        case PluginKind::RobustLoop:
            return StopReason::RobustLoopFailed;
        case PluginKind::RealPlant:
            return StopReason::PlantFailed;
    }
    return StopReason::None;
}

}  // namespace

void destroyPlugins(LoopPlugins& plugins) noexcept {
    const auto destroy = [&](auto& plugin, PluginKind kind) {
        const PluginCall call(plugins.watches[static_cast<std::size_t>(kind)], kAfterLastTick);
        plugin.reset();
    };
    destroy(plugins.realPlant, PluginKind::RealPlant);
    destroy(plugins.robustLoop, PluginKind::RobustLoop);
    destroy(plugins.filter, PluginKind::SafetyFilter);
    destroy(plugins.controller, PluginKind::NominalController);
    destroy(plugins.command, PluginKind::CommandSource);
}

/** Splits a tick's time between its stages. */
class StageTimer {
public:
    explicit StageTimer(TickRecord& record) : record_(record), begin_(Clock::now()), last_(begin_) {
        for (int i = 0; i < kStageCount; ++i) record_.stage_us[i] = 0.0;
    }
    void mark(Stage stage) {
        const Clock::time_point now = Clock::now();
        record_.stage_us[static_cast<int>(stage)] += std::chrono::duration<double, std::micro>(now - last_).count();
        last_ = now;
    }
    void finish() { record_.compute_us = std::chrono::duration<double, std::micro>(Clock::now() - begin_).count(); }

private:
    TickRecord& record_;
    Clock::time_point begin_, last_;
};

ControlLoop::ControlLoop(const RunSetup& setup, LoopPlugins plugins, const RealArmOptions& options)
    : setup_(setup), plugins_(std::move(plugins)), options_(options), model_(setup.robot), n_(setup.size()) {
    VIABLE_CHECK(!options_.bound || options_.bound->measured.size() == n_, "a tracking bound of another arm");
    reset();
}

ControlLoop::~ControlLoop() {
    destroyPlugins(plugins_);
}

void ControlLoop::reset() {
    tickIndex_ = 0;
    nominal_ = setup_.start;
    const auto resetOne = [&](auto& plugin, PluginKind kind) {
        if (plugin) resetPlugin(*plugin, kind, findWatch(kind), nominal_);
    };
    hasClock_ = plugins_.realPlant && plugins_.realPlant->traits().hasClock;
    if (hasClock_) {
        resetOne(plugins_.realPlant, PluginKind::RealPlant);
        startAtReal();
    }
    real_ = actual_ = plausible_ = {nominal_.q, nominal_.qd};
    isPlausible_.fill(true);
    hasTorque_ = false;
    missingCommands_ = missingTorques_ = missingExternalTorques_ = 0;
    isTrackingLost_ = isIntegralHeld_ = hasLeftLimits_ = false;
    externalTorque_.setZero(options_.feedsExternalTorque ? n_ : 0);
    substituted_ = 0;
    stopReason_ = StopReason::None;
    stopTime_ = 0.0;
    stopMessage_[0] = '\0';
    stopRemedy_ = "";
    stopBegun_ = ended_ = robustLoopEnded_ = drifts_ = false;
    isLoopAsked_ = true;
    releaseTicks_ = 0;
    missedInRow_ = 0;
    skippedTicks_ = pausedTicks_ = 0;
    isPaused_ = holdBegun_ = false;
    limits_ = setup_.limits;
    const JointVector any = JointVector::Constant(n_, std::numeric_limits<double>::infinity());
    following_.begin(setup_);
    sensors_.begin({SensorCheck::Reference::LastReading, calcLargestChange(setup_, limits_, options_.bound), any, any},
                   nominal_.q);
    for (JointVector* v : {&desiredTorque_, &robustTorque_, &motorTorque_, &appliedTorque_, &releasedTorque_})
        v->setZero(n_);
    output_ = {};
    decision_ = {};
    motion_ = {};
    ticksToMiss_ = 0;
    ticksSinceReading_ = 1;
    isRead_ = hasReading_ = hasDriven_ = false;
    command_ = {};
    command_.q = nominal_.q;
    command_.qd.setZero(n_);
    command_.tool = setup_.startTool;
    command_.space = plugins_.command->traits().space;
    if (plugins_.stream) plugins_.stream->reset(command_);
    resetOne(plugins_.command, PluginKind::CommandSource);
    resetOne(plugins_.controller, PluginKind::NominalController);
    resetOne(plugins_.filter, PluginKind::SafetyFilter);
    resetOne(plugins_.robustLoop, PluginKind::RobustLoop);
    if (!hasClock_) resetOne(plugins_.realPlant, PluginKind::RealPlant);
    const FilterTraits traits = plugins_.filter->traits();
    guarantees_ = traits.guarantees.hasJoints();
    monitor_.reset(nominal_, limits_, setup_.tick_s, guarantees_, traits.recovers);
}

void ControlLoop::startAtReal() {
    const JointState& measured = plugins_.realPlant->measured();
    if (!isFinite(measured, n_)) return;  // the first tick says so
    const JointBounds& bounds = setup_.limits.position;
    const bool recovers = plugins_.filter->traits().recovers;
    for (int i = 0; i < n_; ++i) {
        const double q = measured.q[i], inside = std::clamp(q, bounds.lower[i], bounds.upper[i]);
        nominal_.q[i] = recovers ? q : inside;
        if (recovers || std::abs(q - inside) <= std::max(kOutsideCounts * setup_.robot.encoderStep(i), kOutside))
            continue;
        const JointDescription& joint = setup_.robot.joints[static_cast<std::size_t>(i)];
        throw badInput("the robot",
                       joint.name + " stands at " + detail::formatNumber(q) +
                           ", beyond the nominal arm's position limit " + detail::formatNumber(inside) + " by " +
                           detail::formatNumber(std::abs(q - inside)),
                       "Move it inside, widen the limits, or use the filter certified_braking with `recovery: true`.");
    }
    nominal_.qd.setZero(n_);
    nominal_.qdd.setZero(n_);
}

void ControlLoop::letGoOfPlant() noexcept {
    const PluginCall call(findWatch(PluginKind::RealPlant), kAfterLastTick);
    plugins_.realPlant.reset();
}

double ControlLoop::time() const {
    return static_cast<double>(tickIndex_) * setup_.tick_s;
}

double ControlLoop::commandTime() const {
    return static_cast<double>(tickIndex_ - pausedTicks_) * setup_.tick_s;
}

bool ControlLoop::hasStopped() const {
    return ended_ || (stopBegun_ && monitor_.atRest(nominal_));
}

void ControlLoop::beginStop(StopReason reason, const char* message, const char* remedy) noexcept {
    if (stopReason_ != StopReason::None && !(stopReason_ == StopReason::Requested && reason != StopReason::Requested))
        return;
    stopReason_ = reason;
    stopTime_ = time();
    std::snprintf(stopMessage_, sizeof stopMessage_, "%s", message);
    stopRemedy_ = remedy;
}

template <class Status, class Call>
Status ControlLoop::contain(PluginKind kind, Status faulted, const Call& call) noexcept {
    PluginCall mark(findWatch(kind), tickIndex_);
    char message[sizeof stopMessage_] = "";
    const char* remedy = kOnThrow;
    Status status = faulted;
    detail::takeFaultExplanation();  // none is left of an earlier call
    try {
        status = call();
        const char* const explanation = detail::takeFaultExplanation();
        if (kind == PluginKind::RealPlant && status == faulted && *explanation) {
            std::snprintf(message, sizeof message, "%s", explanation);
            remedy = kOnGivingUp;
        }
    } catch (const PluginFault& e) {
        std::snprintf(message, sizeof message, "%s", e.what());
        remedy = e.remedy();
    } catch (const std::exception& e) {
        std::snprintf(message, sizeof message, "it threw: %s", e.what());
    } catch (...) {
        std::snprintf(message, sizeof message, "it threw something other than a std::exception");
    }
    if (const char* change = mark.undoArithmeticChange(); change && !*message) {
        std::snprintf(message, sizeof message, kArithmeticChange, change);
        remedy = kOnArithmeticChange;
        status = faulted;
    }
    if (*message) {
        mark.forgetAllocations();
        beginStop(getReason(kind), message, remedy);
    }
    return status;
}

void ControlLoop::lookAtPlant() {
    readState();
    if (options_.feedsExternalTorque) readExternalTorque();
    const std::int64_t elapsedTicks = ticksSinceReading_;
    judgeReading();  // a jump says more than that the error is large
    checkTracking();
    checkFollowing(elapsedTicks);
}

void ControlLoop::readState() {
    const TickStatus status = contain(PluginKind::RealPlant, TickStatus::Faulted, [&] {
        const JointState& measured = plugins_.realPlant->measured();
        const JointState& actual = plugins_.realPlant->actual();
        if (!isFinite(measured, n_) || !isFinite(actual, n_)) return TickStatus::Faulted;
        real_ = measured;
        actual_ = actual;
        return TickStatus::Ok;
    });
    if (status == TickStatus::Ok) return;
    beginStop(StopReason::PlantFailed, "the state that it reports has the wrong size or is not finite", kOnValues);
    ended_ = true;
}

/** An unusable value is replaced by the last good one, for a while. */
void ControlLoop::readExternalTorque() {
    const TickStatus status = contain(PluginKind::RealPlant, TickStatus::Faulted, [&] {
        const JointVector* torque = plugins_.realPlant->externalTorque();
        if (!torque || !isBounded(*torque, n_)) return TickStatus::Faulted;
        externalTorque_ = *torque;
        return TickStatus::Ok;
    });
    if (status == TickStatus::Ok) {
        missingExternalTorques_ = 0;
        return;
    }
    if (++missingExternalTorques_ <= kMaxSubstitutedTicks) return;
    externalTorque_.setZero();
    beginStop(StopReason::SensorFailed,
              "the external torque that it reports has the wrong size, is not finite or beyond 1e9", kOnValues);
}

/** True if the reading of a joint that is beyond its bound stays exactly what it is while the nominal joint goes on: the sensor is
stuck, or the joint blocked. It is not taken as plausible any more, or the robust loop would push in vain. */
bool ControlLoop::replaceStillReading(int joint) {
    const auto at = static_cast<std::size_t>(joint);
    if (!options_.judgesReadings || !isPlausible_[at]) return false;
    if (!(std::abs(sensors_.deviation()[joint]) > options_.bound->measured[joint])) return false;
    if (!(sensors_.findStillTravel(joint) > kJumpCounts * setup_.robot.encoderStep(joint))) return false;
    isPlausible_[at] = false;
    sensors_.disownStill(joint, std::max(1, static_cast<int>(kRelease_s / setup_.tick_s)));
    sensors_.standIn(joint, nominal_, plausible_);
    return true;
}

/** Brakes an arm that does not follow, and keeps the robust loop from pressing it harder and harder. */
void ControlLoop::checkTracking() {
    if (!options_.bound || ended_) return;
    if (isTrackingLost_) {
        for (int i = 0; i < n_; ++i) replaceStillReading(i);
        const JointVector error = plausible_.q - nominal_.q;
        if (detail::findFarthestBeyond(error, detail::FollowingWatch::kRunaway * lostError_) >= 0) leaveToRobot();
        return;
    }
    watchNominal();
    const JointVector error = real_.q - nominal_.q;
    const int i = detail::findFarthestBeyond(error, options_.bound->measured);
    if (i < 0) return;
    isTrackingLost_ = true;
    lostError_ = error.cwiseAbs().cwiseMax(options_.bound->measured);
    const JointDescription& joint = setup_.robot.joints[static_cast<std::size_t>(i)];
    const char* const unit = joint.type == JointType::Prismatic ? "m" : "rad";
    char message[sizeof stopMessage_];
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
                  joint.name.c_str(), std::abs(error[i]), unit, options_.bound->measured[i], unit, cause);
    beginStop(StopReason::TrackingLost, message,
              standsStill      ? kOnStillness
              : hasLeftLimits_ ? kOnLeftLimits
                               : kOnLostTracking);
    holdIntegral();
}

/** The same where there is no bound. */
void ControlLoop::checkFollowing(std::int64_t elapsedTicks) {
    using Cause = detail::FollowingWatch::Cause;
    if (!options_.watchesFollowing || options_.bound || ended_ || stopReason_ == StopReason::SensorFailed) return;
    if (isTrackingLost_) {  // a loop that acts on wrong readings must not drive the arm on
        if (!following_.runsAway(plausible_, nominal_)) return;
        if (drifts_) endRobustLoop(false);
        leaveToRobot();
        return;
    }
    const detail::FollowingWatch::Finding found =
        following_.update(plausible_, nominal_, {motorTorque_, robustTorque_, appliedTorque_}, elapsedTicks);
    if (found.cause == Cause::None) return;
    drifts_ = found.cause == Cause::Drift;
    isTrackingLost_ = true;
    const auto getName = [&](int joint) { return setup_.robot.joints[static_cast<std::size_t>(joint)].name.c_str(); };
    const JointDescription& joint = setup_.robot.joints[static_cast<std::size_t>(found.joint)];
    const char* const unit = joint.type == JointType::Prismatic ? "m" : "rad";
    char message[sizeof stopMessage_];
    if (found.cause == Cause::Oscillation && found.motor >= 0) {
        std::snprintf(
            message, sizeof message,
            "the real arm oscillates: the robust loop drives the motor of %.60s into its torque limit and back, "
            "and its torque changes sign every %.3g ms or faster",
            getName(found.motor), 1e3 * following_.halfPeriod());
        endRobustLoop(true);
    } else if (found.cause == Cause::Oscillation) {
        std::snprintf(message, sizeof message,
                      "the real arm oscillates: the velocity of %.60s swings by %.3g %s/s about the nominal one and "
                      "changes sign every %.3g ms or faster",
                      getName(found.joint), found.error, unit, 1e3 * following_.halfPeriod());
        endRobustLoop(true);
    } else {
        char motor[160];
        std::snprintf(motor, sizeof motor, "%s",
                      setup_.robot.actuation.torqueLimit.array().isInf().any()
                          ? "no torque limit is known of some motors"
                      : setup_.delayTicks > 0
                          ? "no motor is at its torque limit (with a delay it is not known whether one gives less than "
                            "is asked of it)"
                          : "no motor is at its torque limit");
        if (found.motor >= 0)
            std::snprintf(
                motor, sizeof motor, "the motor of %.60s %s", getName(found.motor),
                found.cause == Cause::Saturation ? "is at its torque limit" : "gives less torque than is asked of it");
        std::snprintf(message, sizeof message,
                      "the real arm does not follow: %.60s is %.4g %s from its nominal place (at most %.4g %s), and %s",
                      getName(found.joint), found.error, unit, found.allowed, unit, motor);
    }
    beginStop(StopReason::NotFollowing, message,
              found.cause == Cause::Oscillation  ? kOnOscillation
              : found.cause == Cause::Saturation ? kOnSaturation
              : found.cause == Cause::Weakness   ? kOnWeakness
                                                 : kOnDrift);
    holdIntegral();
    if (drifts_) leaveToRobot();
}

/** Beyond the limits that it is for the bound says nothing, and a trip nothing of the disturbances. */
void ControlLoop::watchNominal() {
    if (hasLeftLimits_) return;
    const JointLimits& limits = setup_.limits;
    hasLeftLimits_ = !areWithin(limits.position, nominal_.q) || !areWithin(limits.velocity, nominal_.qd) ||
                     !areWithin(limits.acceleration, nominal_.qdd) ||
                     !areWithin(limits.jerk, motion_.jerk);  // none before the first tick
    leftLimits_s_ = time();
}

/** A robot that does not take torques for what they are goes on though it is told to brake: its own stop is better. */
void ControlLoop::leaveToRobot() {
    if (hasClock_) ended_ = true;
}

void ControlLoop::holdIntegral() {
    if (isIntegralHeld_) return;
    isIntegralHeld_ = true;
    contain(PluginKind::RobustLoop, TickStatus::Faulted, [&] {
        plugins_.robustLoop->holdIntegral();
        return TickStatus::Ok;
    });
}

/** A joint's reading that no motion explains is not taken as plausible, nor is any after it; the other joints keep theirs. */
void ControlLoop::judgeReading() {
    // The first reading may be anywhere: there is none before it.
    const bool judges = options_.judgesReadings && hasReading_ && !ended_;
    hasReading_ = true;
    sensors_.miss(ticksSinceReading_ - 1);
    ticksSinceReading_ = 1;
    std::array<bool, kMaxJoints> isExplained{};
    for (int i = 0; i < n_; ++i) isExplained[static_cast<std::size_t>(i)] = sensors_.isPlausible(i, real_, nominal_);
    for (int i = 0; i < n_; ++i) {
        const auto at = static_cast<std::size_t>(i);
        if (judges && isPlausible_[at] && !isExplained[at]) {
            isPlausible_[at] = false;
            const JointDescription& joint = setup_.robot.joints[at];
            const char* const unit = joint.type == JointType::Prismatic ? "m" : "rad";
            char message[sizeof stopMessage_];
            std::snprintf(message, sizeof message,
                          "the position that it reports of %.60s jumped by %.4g %s in a tick, in which %.4g "
                          "%s would be more than any motion of it",
                          joint.name.c_str(), sensors_.calcChange(i, real_, nominal_), unit, sensors_.largestChange(i),
                          unit);
            beginStop(StopReason::SensorFailed, message, kOnJump);
            holdIntegral();
        }
        if (isPlausible_[at]) {
            sensors_.take(i, real_, nominal_);
            plausible_.q[i] = real_.q[i];
            plausible_.qd[i] = real_.qd[i];
        } else {
            sensors_.standIn(i, nominal_, plausible_);
        }
    }
}

void ControlLoop::takeCommand(double t) {
    const TickStatus status = contain(PluginKind::CommandSource, TickStatus::Faulted,
                                      [&] { return plugins_.command->sample(t, newCommand_); });
    if (status == TickStatus::Ok && newCommand_.space == command_.space && isUsable(newCommand_, n_)) {
        command_ = newCommand_;
        missingCommands_ = 0;
    } else if (++missingCommands_ > kMaxSubstitutedTicks) {
        beginStop(StopReason::CommandFailed, "it gave no usable command (wrong size, not finite or not Ok)", kOnValues);
    }
    if (plugins_.stream) plugins_.stream->pass(t, command_, received_);
}

void ControlLoop::takeTorque(std::int64_t missed) {
    output_.hasAccelerationRate = false;
    const MotionCommand& command = plugins_.stream ? received_ : command_;
    const TickStatus status = contain(PluginKind::NominalController, TickStatus::Faulted, [&] {
        return plugins_.controller->compute({command, nominal_, dynamics_, {time(), missed}}, output_);
    });
    if (status == TickStatus::Ok && isFinite(output_.torque, n_) &&
        (!output_.hasAccelerationRate || isFinite(output_.accelerationRate, n_))) {
        desiredTorque_ = output_.torque;
        hasTorque_ = true;
        missingTorques_ = 0;
        return;
    }
    output_.hasAccelerationRate = false;  // it is not that of the torque that stands in
    // Before the first good torque, gravity compensation is the harmless stand-in.
    if (!hasTorque_) desiredTorque_ = dynamics_.gravity;
    ++substituted_;
    if (++missingTorques_ > kMaxSubstitutedTicks)
        beginStop(StopReason::ControllerFailed, "it gave no usable torque (wrong size, not finite or not Ok)",
                  kOnValues);
}

void ControlLoop::takeLimits(double t) {
    const JointLimits* limits = nullptr;
    contain(PluginKind::CommandSource, TickStatus::Faulted, [&] {
        limits = plugins_.command->sampleLimits(t);
        return TickStatus::Ok;
    });
    if (!limits) return;
    if (options_.fixesLimits) {
        beginStop(StopReason::CommandFailed,
                  "it changed the limits, which hold_on: real has made tighter for the whole run", kOnFixedLimits);
        return;
    }
    if (!areUsable(*limits, n_, setup_.tick_s)) {
        beginStop(StopReason::CommandFailed,
                  "the limits that it gave are not usable at this tick (size, sign, order or window)", kOnLimits);
        return;
    }
    const FilterStatus status = contain(PluginKind::SafetyFilter, FilterStatus::Faulted, [&] {
        return plugins_.filter->changeLimits(*limits) ? FilterStatus::Passed : FilterStatus::Faulted;
    });
    if (status == FilterStatus::Faulted) {
        beginStop(StopReason::FilterFailed, "the command changed the limits, and it cannot change its own during a run",
                  kOnLimits);
        return;
    }
    limits_ = *limits;
    sensors_.widen(calcLargestChange(setup_, limits_, options_.bound));
    following_.widen(limits_);
    monitor_.changeLimits(limits_, nominal_);
}

void ControlLoop::tellSkippedTicks() {
    if (skippedTicks_ == 0) return;
    contain(PluginKind::SafetyFilter, FilterStatus::Faulted, [&] {
        plugins_.filter->skipTicks(skippedTicks_);
        return FilterStatus::Passed;
    });
    skippedTicks_ = 0;
}

bool ControlLoop::takeDecision() {
    decision_.clearReports();
    wantedTorque_ = desiredTorque_;
    if (externalTorque_.size() > 0) wantedTorque_ += externalTorque_;
    // How a push changes nobody knows: its own rate counts as zero.
    const JointVector* rate = output_.hasAccelerationRate ? &output_.accelerationRate : nullptr;
    const FilterInput input{nominal_, wantedTorque_, dynamics_, rate};
    status_ = contain(PluginKind::SafetyFilter, FilterStatus::Faulted,
                      [&] { return plugins_.filter->filter(input, decision_); });
    if (status_ == FilterStatus::Ended && !guarantees_) {
        beginStop(StopReason::FilterEnded, "it had no admissible choice and does not continue");
        return false;
    }
    if (isFinite(decision_.value, n_)) calcHeldMotion(input, status_, decision_, setup_.tick_s, motion_);
    const char* fault = status_ == FilterStatus::Faulted        ? "it reported that it cannot go on"
                        : status_ == FilterStatus::Ended        ? "it guarantees all limits, but ended the case"
                        : status_ == FilterStatus::InvalidInput ? "it refused its input as invalid"
                        : !areKnown(status_, decision_, n_)     ? "its status or an acting limit is not a known value"
                                                                : findFault(decision_, motion_, setup_.tick_s, n_);
    const bool gaveUp =
        status_ == FilterStatus::Faulted || status_ == FilterStatus::Ended || status_ == FilterStatus::InvalidInput;
    if (fault) {
        // A filter that passes what it is asked for is not the one to blame for its size.
        const bool isPassedOn = status_ == FilterStatus::Passed && isFinite(decision_.value, n_) && fault == kTooLarge;
        if (isPassedOn)
            beginStop(StopReason::ControllerFailed,
                      "the torque that it asks for, which the filter passed on, is beyond 1e9", kOnDivergence);
        else
            beginStop(StopReason::FilterFailed, fault, gaveUp ? kOnGivingUp : kOnValues);
    }
    return !fault && passMonitor();
}

/** False: the decision must not be applied. */
bool ControlLoop::passMonitor() {
    const StopMonitor::Finding& finding = monitor_.examine(nominal_, decision_);
    verdict_ = finding.verdict;
    if (verdict_ != StopVerdict::NoStop || !guarantees_) {
        monitor_.accept();
        return true;
    }
    char what[256];
    monitor_.describe(finding, setup_.robot, what, sizeof what);
    char message[sizeof stopMessage_];
    std::snprintf(message, sizeof message, "it guarantees all limits, but %s", what);
    beginStop(StopReason::GuaranteeBroken, message, kOnGuarantee);
    return false;
}

void ControlLoop::followStop() {
    if ((stopBegun_ || holdBegun_) &&
        monitor_.atRest(nominal_)) {  // what rounding has left of the motion must not carry the arm away
        nominal_.qd.setZero();
        nominal_.qdd.setZero();
    }
    decision_.clearReports();
    verdict_ = monitor_.followStop(nominal_, decision_).verdict;
    status_ = FilterStatus::StoppedByPlan;
    calcHeldMotion({nominal_, desiredTorque_, dynamics_}, status_, decision_, setup_.tick_s, motion_);
    if (!findFault(decision_, motion_, setup_.tick_s, n_)) return;
    beginStop(StopReason::FilterFailed, "the nominal state has diverged");
    // The nominal state itself is beyond all arithmetic.
    for (JointVector* v : {&decision_.value, &motion_.jerk, &motion_.acceleration, &motion_.torque}) v->setZero(n_);
    ended_ = true;
}

/** @param isAsked  its answers are still of use while its torque goes to zero */
void ControlLoop::endRobustLoop(bool isAsked) {
    if (robustLoopEnded_ && (isAsked || !isLoopAsked_)) return;
    robustLoopEnded_ = true;
    isLoopAsked_ = isAsked;
    releaseTicks_ = 0;
    releasedTorque_ = robustTorque_;
}

/** False: it failed, and robustTorque_ is of no use. */
bool ControlLoop::askRobustLoop() {
    const TickStatus status = contain(PluginKind::RobustLoop, TickStatus::Faulted, [&] {
        return plugins_.robustLoop->compute(plausible_, nominal_, motorTorque_, robustTorque_);
    });
    if (status == TickStatus::Ok && isBounded(robustTorque_, n_)) return true;
    beginStop(StopReason::RobustLoopFailed, "it gave no usable torque (wrong size, not finite, beyond 1e9 or not Ok)",
              kOnValues);
    return false;
}

void ControlLoop::takeRobustTorque() {
    const JointVector lastRobust = robustTorque_, lastMotor = motorTorque_;
    motorTorque_ = motion_.torque;  // the motors' share of what moves the nominal arm
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
    limitRelease(lastRobust, lastMotor);
}

/** Makes what is left of the robust loop's torque change no faster than the stated rates. */
void ControlLoop::limitRelease(const JointVector& lastRobust, const JointVector& lastMotor) {
    for (int i = 0; i < n_; ++i) {
        double& robust = robustTorque_[i];
        if (options_.robustRate.size() == n_) {
            const double step = options_.robustRate[i] * setup_.tick_s;
            robust = std::clamp(robust, lastRobust[i] - step, lastRobust[i] + step);
        }
        if (options_.motorRate.size() != n_ || !hasDriven_) continue;  // what the motors gave before is not known
        const double step = options_.motorRate[i] * setup_.tick_s;
        const double total = std::clamp(motorTorque_[i] + robust, lastMotor[i] - step, lastMotor[i] + step);
        if (total != motorTorque_[i] + robust) robust = total - motorTorque_[i];
    }
}

void ControlLoop::drivePlant() {
    motorTorque_ += robustTorque_;
    hasDriven_ = true;
    const TickStatus status = contain(PluginKind::RealPlant, TickStatus::Faulted,
                                      [&] { return plugins_.realPlant->advance(motorTorque_, appliedTorque_); });
    if (status == TickStatus::Ok && isFinite(appliedTorque_, n_)) return;
    beginStop(StopReason::PlantFailed, "it could not advance (its state would not be finite)", kOnGivingUp);
    appliedTorque_.setZero(n_);
    ended_ = true;
}

void ControlLoop::fillRecord(TickRecord& record, bool decided) const {
    record.time_s = time();
    record.command = command_;
    record.nominal.q = nominal_.q;
    record.nominal.qd = nominal_.qd;
    record.nominal.qdd = nominal_.qdd;
    record.nominal.jerk = motion_.jerk;
    record.tool = dynamics_.tool;
    record.real = real_;
    record.actual = actual_;
    record.hasReading = true;
    record.desiredTorque = desiredTorque_;
    record.filterTorque = motion_.torque;
    record.externalTorque = externalTorque_;
    record.removedTorque.setZero(n_);
    if (decided) {
        record.removedTorque = desiredTorque_ - motion_.torque;
        if (externalTorque_.size() > 0) record.removedTorque += externalTorque_;
    }
    if (missingExternalTorques_ > 0) record.externalTorque.setConstant(std::numeric_limits<double>::quiet_NaN());
    record.status = status_;
    record.joints = decision_.joints;
    for (int i = 0; i < n_; ++i) record.stops[i] = monitor_.stop(i);
    record.verdict = verdict_;
    record.reports = decision_.reports;
    record.peopleFaults = decision_.peopleFaults;
    record.limits = limits_;
    record.braking = isStopping();
    record.missed = missedInRow_ > 0;
    record.paused = isPaused_;
    record.substituted = substituted_;
}

/** The tick's decision stands: what fails from here on brakes the arm from the next tick on. */
void ControlLoop::finishTick(TickRecord& record, StageTimer& timer, bool drives) {
    if (plugins_.realPlant && !ended_ && drives) {
        takeRobustTorque();
        timer.mark(Stage::Robust);
        drivePlant();
        timer.mark(Stage::Plant);
    } else if (ended_) {
        appliedTorque_.setZero(n_);  // nothing was sent any more
    }
    record.robustTorque = robustTorque_;
    record.motorTorque = appliedTorque_;

    advanceNominal(decision_, setup_.tick_s, nominal_);
    ++tickIndex_;
    timer.finish();
}

/** Of a plant with a clock: what its ticks say, and how many of them were missed. */
void ControlLoop::awaitPlant() {
    std::int64_t passed = 0;
    const TickStatus status =
        contain(PluginKind::RealPlant, TickStatus::Faulted, [&] { return plugins_.realPlant->read(passed); });
    if (status == TickStatus::Ok && passed >= 1) {
        ticksToMiss_ = std::min<std::int64_t>(passed - 1, kMaxMissedTicks + 1);  // more is not told apart
        ticksSinceReading_ = ticksToMiss_ + 1;
        return;
    }
    beginStop(StopReason::PlantFailed, "its clock gave no tick (not Ok, or less than one tick passed)", kOnGivingUp);
    ended_ = true;
}

void ControlLoop::tick(TickRecord& record) noexcept {
    if (hasClock_ && ticksToMiss_ == 0 && !isRead_ && !ended_) awaitPlant();
    isRead_ = ticksToMiss_ > 0;  // the reading is for the tick after those
    if (ticksToMiss_ > 0) {
        --ticksToMiss_;
        passTick(record, false);
        return;
    }
    StageTimer timer(record);
    if (plugins_.realPlant) lookAtPlant();
    timer.mark(Stage::Plant);
    missedInRow_ = 0;
    holdBegun_ = isPaused_;
    decide(record, timer);
    finishTick(record, timer, true);
}

/** The command's time stands still. */
void ControlLoop::countPause() {
    if (isPaused_) ++pausedTicks_;
}

/** What the nominal arm does in this tick. */
void ControlLoop::decide(TickRecord& record, StageTimer& timer) {
    const bool asks = !isPaused_;
    const double t = commandTime();
    if (asks && !isStopping()) takeCommand(t);
    const std::int64_t skipped = skippedTicks_;
    if (asks && !isStopping()) tellSkippedTicks();
    if (asks && !isStopping()) takeLimits(t);
    timer.mark(Stage::Command);
    model_.calcDynamics(nominal_.q, nominal_.qd, dynamics_);
    timer.mark(Stage::Dynamics);
    if (asks && !isStopping()) takeTorque(skipped);
    timer.mark(Stage::Controller);
    const bool decided = asks && !isStopping() && takeDecision();
    if (!decided) {
        stopBegun_ = isStopping();
        followStop();
    }
    if (!asks) ++skippedTicks_;
    countPause();
    timer.mark(Stage::Filter);
    fillRecord(record, decided);
}

void ControlLoop::missTick(TickRecord& record) noexcept {
    passTick(record, true);
}

/** A tick without command, controller and filter. @param hasPlant  the plant is still to be read and driven in it */
void ControlLoop::passTick(TickRecord& record, bool hasPlant) noexcept {
    ++skippedTicks_;
    if (++missedInRow_ > kMaxMissedTicks)
        beginStop(StopReason::TicksMissed, "more than 1000 ticks in a row were missed");
    StageTimer timer(record);
    if (plugins_.realPlant && hasPlant) lookAtPlant();
    timer.mark(Stage::Plant);
    model_.calcDynamics(nominal_.q, nominal_.qd, dynamics_);
    timer.mark(Stage::Dynamics);
    holdBegun_ = isPaused_;
    stopBegun_ = hasPlant && isStopping();  // only a tick that reaches the motors belongs to the stop
    followStop();
    timer.mark(Stage::Filter);
    countPause();
    fillRecord(record, false);
    record.hasReading = hasPlant;
    finishTick(record, timer, hasPlant);
}

}  // namespace viable
