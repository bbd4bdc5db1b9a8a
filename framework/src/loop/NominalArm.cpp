#include "loop/NominalArm.h"

namespace viable {

constexpr double kLargestDecision = 1e9;
constexpr const char* kTooLarge = "its decision is beyond 1e9";

// What the author of a plugin can do about its failures.
constexpr char kOnGuarantee[] = "The decision was not applied. Fix the filter, or let its traits() guarantee nothing.";
constexpr char kOnFixedLimits[] = "Use `hold_on: nominal`, or a command that leaves the limits alone.";
constexpr char kOnLimits[] =
    "Give limits for every joint, the lower below the upper, zero between those of velocity, acceleration and jerk; or "
    "use a filter that can change them, such as certified_braking.";
constexpr char kOnDivergence[] =
    "Controller and nominal arm diverge: lower its gains or the tick, or use a filter that keeps the limits.";

static bool isUsable(const MotionCommand& command, int n) {
    if (command.space == MotionCommand::Space::Joint) return isFinite(command.q, n) && isFinite(command.qd, n);
    return command.tool.position.allFinite() && command.tool.orientation.coeffs().allFinite() &&
           command.toolTwist.allFinite();
}

/** What the plugin wrote is one of the words that the log and the summary know. */
static bool areKnown(FilterStatus status, const FilterDecision& d, int n) {
    if (status > FilterStatus::Ended || d.held > HeldQuantity::Acceleration) return false;
    for (int i = 0; i < n; ++i)
        if (static_cast<int>(d.joints[i].limit) >= countLimitKinds() || d.joints[i].side < LimitSide::Lower ||
            d.joints[i].side > LimitSide::Upper)
            return false;
    return true;
}

/** What is wrong with a decision and the motion that it gives, or null. */
static const char* findFault(const FilterDecision& d, const HeldMotion& motion, double tick_s, int n) {
    if (!isFinite(d.value, n)) return "its decision has the wrong size or is not finite";
    if (!isBounded(motion.torque, n) || !isBounded(motion.acceleration, n) || !isBounded(motion.jerk * tick_s, n))
        return kTooLarge;
    return nullptr;
}

bool isBounded(const JointVector& v, int n) {
    return isFinite(v, n) && v.lpNorm<Eigen::Infinity>() <= kLargestDecision;
}

NominalArm::NominalArm(const RunSetup& setup, const LoopPlugins& plugins, LoopStatus& loop, bool fixesLimits,
                       bool canWait)
    : setup_(setup), plugins_(plugins), loop_(loop), fixesLimits_(fixesLimits), model_(setup.robot), n_(setup.size()) {
    if (canWait) freeArm_ = std::make_unique<detail::FreeArm>(setup);
}

void NominalArm::reset(const MotionState& start) {
    state_ = start;
    limits_ = setup_.limits;
    hasNewLimits_ = hasTorque_ = false;
    missingCommands_ = missingTorques_ = 0;
    substituted_ = skippedTicks_ = pausedTicks_ = 0;
    isPaused_ = holdBegun_ = stopBegun_ = false;
    if (freeArm_) freeArm_->end();
    desiredTorque_.setZero(n_);
    output_ = {};
    decision_ = {};
    motion_ = {};
    command_ = {};
    command_.q = state_.q;
    command_.qd.setZero(n_);
    command_.tool = setup_.startTool;
    command_.space = plugins_.command->traits().space;
    if (plugins_.stream) plugins_.stream->reset(command_);
    const auto resetOne = [&](auto& plugin, PluginKind kind) {
        resetPlugin(*plugin, kind, loop_.findWatch(kind), state_);
    };
    resetOne(plugins_.command, PluginKind::CommandSource);
    resetOne(plugins_.controller, PluginKind::NominalController);
    resetOne(plugins_.filter, PluginKind::SafetyFilter);
    const FilterTraits traits = plugins_.filter->traits();
    guarantees_ = traits.guarantees.hasJoints();
    monitor_.reset(state_, limits_, setup_.tick_s, guarantees_, traits.recovers);
}

void NominalArm::readCommand(double t) {
    const TickStatus status =
        loop_.contain(PluginKind::CommandSource, [&] { return plugins_.command->sample(t, newCommand_); });
    if (status == TickStatus::Ok && newCommand_.space == command_.space && isUsable(newCommand_, n_)) {
        command_ = newCommand_;
        missingCommands_ = 0;
    } else if (++missingCommands_ > kMaxSubstitutedTicks) {
        loop_.beginStop(StopReason::CommandFailed, "it gave no usable command (wrong size, not finite or not Ok)",
                        kOnValues);
    }
    if (plugins_.stream) plugins_.stream->pass(t, command_, received_);
}

void NominalArm::readLimits(double t) {
    const JointLimits* limits = nullptr;
    loop_.contain(PluginKind::CommandSource, [&] { limits = plugins_.command->sampleLimits(t); });
    if (!limits) return;
    if (fixesLimits_)
        return loop_.beginStop(StopReason::CommandFailed,
                               "it changed the limits, which hold_on: real has made tighter for the whole run",
                               kOnFixedLimits);
    if (!areUsable(*limits, n_, setup_.tick_s))
        return loop_.beginStop(StopReason::CommandFailed,
                               "the limits that it gave are not usable at this tick (size, sign, order or window)",
                               kOnLimits);
    const FilterStatus status = loop_.contain(PluginKind::SafetyFilter, [&] {
        return plugins_.filter->changeLimits(*limits) ? FilterStatus::Passed : FilterStatus::Faulted;
    });
    if (status == FilterStatus::Faulted)
        return loop_.beginStop(StopReason::FilterFailed,
                               "the command changed the limits, and it cannot change its own during a run", kOnLimits);
    limits_ = *limits;
    hasNewLimits_ = true;
    if (freeArm_) freeArm_->changeLimits(limits_);
    monitor_.changeLimits(limits_, state_);
}

void NominalArm::readTorque(std::int64_t missed) {
    output_.hasAccelerationRate = false;
    const MotionCommand& command = plugins_.stream ? received_ : command_;
    const MotionState& led = waits() ? freeArm_->state() : state_;
    const Dynamics& dynamics = waits() ? freeArm_->updateDynamics() : dynamics_;
    const TickStatus status = loop_.contain(PluginKind::NominalController, [&] {
        return plugins_.controller->compute({command, led, dynamics, {loop_.time(), missed}}, output_);
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
    if (!hasTorque_) desiredTorque_ = dynamics.gravity;
    ++substituted_;
    if (++missingTorques_ > kMaxSubstitutedTicks)
        loop_.beginStop(StopReason::ControllerFailed, "it gave no usable torque (wrong size, not finite or not Ok)",
                        kOnValues);
}

void NominalArm::tellSkippedTicks() {
    if (skippedTicks_ == 0) return;
    loop_.contain(PluginKind::SafetyFilter, [&] { plugins_.filter->skipTicks(skippedTicks_); });
    skippedTicks_ = 0;
}

/** The free arm has no controller in this tick. */
void NominalArm::rest() {
    loop_.isStopping() ? freeArm_->end() : freeArm_->pause();
}

/** The controller has moved the free arm; the torque that is asked for is that of following it. */
void NominalArm::followFreeArm() {
    output_.torque = desiredTorque_;
    if (!freeArm_->move(output_)) return freeArm_->end();
    freeArm_->lead(state_, dynamics_, output_.accelerationRate);
    output_.hasAccelerationRate = true;
    calcInverseDynamics(dynamics_, state_.qdd, desiredTorque_);
}

bool NominalArm::askFilter(const JointVector& external) {
    decision_.clearReports();
    wantedTorque_ = desiredTorque_;
    if (external.size() > 0) wantedTorque_ += external;
    // How a push changes nobody knows: its own rate counts as zero.
    const JointVector* rate = output_.hasAccelerationRate ? &output_.accelerationRate : nullptr;
    const FilterInput input{state_, wantedTorque_, dynamics_, rate};
    status_ = loop_.contain(PluginKind::SafetyFilter, [&] { return plugins_.filter->filter(input, decision_); });
    if (status_ == FilterStatus::Ended && !guarantees_) {
        loop_.beginStop(StopReason::FilterEnded, "it had no admissible choice and does not continue");
        return false;
    }
    if (isFinite(decision_.value, n_)) calcHeldMotion(input, status_, decision_, setup_.tick_s, motion_);
    const char* fault = status_ == FilterStatus::Faulted        ? "it reported that it cannot go on"
                        : status_ == FilterStatus::Ended        ? "it guarantees all limits, but ended the case"
                        : status_ == FilterStatus::InvalidInput ? "it refused its input as invalid"
                        : !areKnown(status_, decision_, n_)     ? "its status or an acting limit is not a known value"
                                                                : findFault(decision_, motion_, setup_.tick_s, n_);
    if (!fault) return passMonitor();
    const bool gaveUp =
        status_ == FilterStatus::Faulted || status_ == FilterStatus::Ended || status_ == FilterStatus::InvalidInput;
    // A filter that passes what it is asked for is not the one to blame for its size.
    if (status_ == FilterStatus::Passed && isFinite(decision_.value, n_) && fault == kTooLarge)
        loop_.beginStop(StopReason::ControllerFailed,
                        "the torque that it asks for, which the filter passed on, is beyond 1e9", kOnDivergence);
    else
        loop_.beginStop(StopReason::FilterFailed, fault, gaveUp ? kOnGivingUp : kOnValues);
    return false;
}

/** False: the decision must not be applied. */
bool NominalArm::passMonitor() {
    const StopMonitor::Violation& violation = monitor_.examine(state_, decision_);
    verdict_ = violation.verdict;
    if (verdict_ != StopVerdict::NoStop || !guarantees_) {
        monitor_.accept();
        return true;
    }
    char what[256];
    monitor_.describe(violation, setup_.robot, what, sizeof what);
    char message[LoopStatus::kMessageSize];
    std::snprintf(message, sizeof message, "it guarantees all limits, but %s", what);
    loop_.beginStop(StopReason::GuaranteeBroken, message, kOnGuarantee);
    return false;
}

void NominalArm::followStop() {
    if ((stopBegun_ || holdBegun_) &&
        monitor_.atRest(state_)) {  // what rounding has left of the motion must not carry the arm away
        state_.qd.setZero();
        state_.qdd.setZero();
    }
    decision_.clearReports();
    verdict_ = monitor_.followStop(state_, decision_).verdict;
    status_ = FilterStatus::StoppedByPlan;
    calcHeldMotion({state_, desiredTorque_, dynamics_}, status_, decision_, setup_.tick_s, motion_);
    removedTorque_.setZero(n_);
    if (!findFault(decision_, motion_, setup_.tick_s, n_)) return;
    // The nominal state itself is beyond all arithmetic.
    loop_.end(StopReason::FilterFailed, "the nominal state has diverged");
    for (JointVector* v : {&decision_.value, &motion_.jerk, &motion_.acceleration, &motion_.torque}) v->setZero(n_);
}

void NominalArm::decide(const JointVector& external, StageTimer& timer) {
    holdBegun_ = isPaused_;
    hasNewLimits_ = false;
    const std::int64_t skipped = skippedTicks_;
    const double t = commandTime();
    if (asksPlugins()) readCommand(t);
    if (asksPlugins()) tellSkippedTicks();
    if (asksPlugins()) readLimits(t);
    timer.mark(Stage::Command);
    model_.calcDynamics(state_.q, state_.qd, dynamics_);
    timer.mark(Stage::Dynamics);
    if (waits() && !asksPlugins()) rest();
    if (asksPlugins()) readTorque(skipped);
    if (waits() && asksPlugins()) followFreeArm();
    timer.mark(Stage::Controller);
    if (asksPlugins() && askFilter(external)) {
        removedTorque_ = desiredTorque_ - motion_.torque;
        if (external.size() > 0) removedTorque_ += external;
    } else {
        stopBegun_ = loop_.isStopping();
        followStop();
    }
    if (isPaused_) {
        ++skippedTicks_;
        ++pausedTicks_;
    }
    timer.mark(Stage::Filter);
}

void NominalArm::missTick(bool reachesMotors, StageTimer& timer) {
    holdBegun_ = isPaused_;
    hasNewLimits_ = false;
    stopBegun_ = reachesMotors && loop_.isStopping();
    model_.calcDynamics(state_.q, state_.qd, dynamics_);
    if (waits()) rest();
    timer.mark(Stage::Dynamics);
    followStop();
    ++skippedTicks_;
    if (isPaused_) ++pausedTicks_;
    timer.mark(Stage::Filter);
}

void NominalArm::fillRecord(TickRecord& record) const {
    record.time_s = loop_.time();
    record.command = command_;
    record.nominal = {state_.q, state_.qd, state_.qdd, motion_.jerk};
    record.tool = dynamics_.tool;
    record.desiredTorque = desiredTorque_;
    record.filterTorque = motion_.torque;
    record.removedTorque = removedTorque_;
    record.status = status_;
    record.joints = decision_.joints;
    for (int i = 0; i < n_; ++i) record.stops[i] = monitor_.stop(i);
    record.verdict = verdict_;
    record.reports = decision_.reports;
    record.peopleFaults = decision_.peopleFaults;
    record.limits = limits_;
    record.braking = loop_.isStopping();
    record.paused = isPaused_;
    record.substituted = substituted_;
}

}  // namespace viable
