#include "viable/experiment/ControlLoop.h"

#include <chrono>
#include <cstdio>
#include <exception>

namespace viable {

namespace {

using Clock = std::chrono::steady_clock;

/** Splits a tick's time between its stages. */
class StageTimer {
public:
    explicit StageTimer(TickRecord& record) : record_(record), begin_(Clock::now()), last_(begin_) {
        for (int i = 0; i < kStageCount; ++i) record_.stage_us[i] = 0.0;
    }
    void mark(Stage stage) {
        const Clock::time_point now = Clock::now();
        record_.stage_us[static_cast<int>(stage)] +=
            std::chrono::duration<double, std::micro>(now - last_).count();
        last_ = now;
    }
    void finish() {
        record_.compute_us =
            std::chrono::duration<double, std::micro>(Clock::now() - begin_).count();
    }

private:
    TickRecord& record_;
    Clock::time_point begin_, last_;
};

bool isUsable(const MotionCommand& command, int n) {
    if (command.space == MotionCommand::Space::Joint)
        return isFinite(command.q, n) && isFinite(command.qd, n);
    return command.tool.position.allFinite() && command.tool.orientation.coeffs().allFinite() &&
           command.toolTwist.allFinite();
}

/** Accelerations [rad/s^2] and torques [Nm] beyond this are no arm's: a few ticks later the
arithmetic itself would overflow. */
constexpr double kLargestDecision = 1e9;

bool isUsable(const FilterDecision& decision, int n) {
    return isFinite(decision.torque, n) && isFinite(decision.acceleration, n) &&
           isFinite(decision.jerk, n) &&
           decision.torque.lpNorm<Eigen::Infinity>() <= kLargestDecision &&
           decision.acceleration.lpNorm<Eigen::Infinity>() <= kLargestDecision;
}

}  // namespace

ControlLoop::ControlLoop(const RunSetup& setup, LoopPlugins plugins)
    : setup_(setup), plugins_(std::move(plugins)), model_(setup.robot), n_(setup.size()) {
    reset();
}

ControlLoop::~ControlLoop() = default;

void ControlLoop::reset() {
    tickIndex_ = 0;
    nominal_ = setup_.start;
    hasTorque_ = false;
    missingCommands_ = missingTorques_ = 0;
    substituted_ = 0;
    braking_ = robustLoopFailed_ = plantFailed_ = false;
    stopReason_ = StopReason::None;
    stopTime_ = 0.0;
    stopMessage_[0] = '\0';
    for (JointVector* v :
         {&desiredTorque_, &newTorque_, &robustTorque_, &motorTorque_, &appliedTorque_, &stopJerk_})
        v->setZero(n_);
    command_ = {};
    command_.q = setup_.start.q;
    command_.qd.setZero(n_);
    command_.tool = setup_.startTool;
    command_.space = plugins_.command->space();
    plugins_.command->reset(nominal_);
    plugins_.controller->reset(nominal_);
    plugins_.filter->reset(nominal_);
    if (plugins_.robustLoop) plugins_.robustLoop->reset(nominal_);
    if (plugins_.realPlant) plugins_.realPlant->reset(nominal_);
}

double ControlLoop::time() const {
    return static_cast<double>(tickIndex_) * setup_.tick_s;
}

bool ControlLoop::hasStopped() const {
    if (plantFailed_) return true;
    if (!braking_) return false;
    for (int i = 0; i < n_; ++i)
        if (!stops_[i].atRest()) return false;
    return true;
}

void ControlLoop::beginStop(StopReason reason, const char* message) noexcept {
    if (braking_) return;
    braking_ = true;
    stopReason_ = reason;
    stopTime_ = time();
    std::snprintf(stopMessage_, sizeof stopMessage_, "%s", message);
    for (int i = 0; i < n_; ++i)
        stops_[i].plan(nominal_.qd[i], nominal_.qdd[i], setup_.limits.axis(i), setup_.tick_s);
}

template <class Status, class Call>
Status ControlLoop::contain(Status faulted, StopReason reason, const Call& call) noexcept {
    try {
        return call();
    } catch (const std::exception& e) {
        char message[sizeof stopMessage_];
        std::snprintf(message, sizeof message, "it threw: %s", e.what());
        beginStop(reason, message);
    } catch (...) {
        beginStop(reason, "it threw something that is no std::exception");
    }
    return faulted;
}

void ControlLoop::takeCommand(double t) {
    const TickStatus status = contain(TickStatus::Faulted, StopReason::CommandFailed,
                                      [&] { return plugins_.command->sample(t, newCommand_); });
    if (status == TickStatus::Ok && newCommand_.space == command_.space &&
        isUsable(newCommand_, n_)) {
        command_ = newCommand_;
        missingCommands_ = 0;
        return;
    }
    if (++missingCommands_ > kMaxSubstitutedTicks)
        beginStop(StopReason::CommandFailed,
                  "it gave no usable command (wrong size, not finite or not Ok)");
}

void ControlLoop::takeTorque() {
    const TickStatus status = contain(TickStatus::Faulted, StopReason::ControllerFailed, [&] {
        return plugins_.controller->compute(command_, nominal_, dynamics_, newTorque_);
    });
    if (status == TickStatus::Ok && isFinite(newTorque_, n_)) {
        desiredTorque_ = newTorque_;
        hasTorque_ = true;
        missingTorques_ = 0;
        return;
    }
    // Before the first good torque, gravity compensation is the harmless stand-in.
    if (!hasTorque_) desiredTorque_ = dynamics_.gravity;
    ++substituted_;
    if (++missingTorques_ > kMaxSubstitutedTicks)
        beginStop(StopReason::ControllerFailed,
                  "it gave no usable torque (wrong size, not finite or not Ok)");
}

bool ControlLoop::takeDecision() {
    status_ = contain(FilterStatus::Faulted, StopReason::FilterFailed, [&] {
        return plugins_.filter->filter(nominal_, desiredTorque_, dynamics_, decision_);
    });
    if (braking_) return false;
    if (status_ == FilterStatus::InvalidInput || status_ == FilterStatus::Faulted) {
        beginStop(StopReason::FilterFailed, status_ == FilterStatus::Faulted
                                                ? "it reported that it cannot go on"
                                                : "it refused its input as invalid");
        return false;
    }
    if (!isUsable(decision_, n_)) {
        beginStop(StopReason::FilterFailed,
                  "its decision has the wrong size, is not finite or beyond 1e9");
        return false;
    }
    return true;
}

void ControlLoop::followStop() {
    for (int i = 0; i < n_; ++i) stopJerk_[i] = stops_[i].takeJerk();
    holdJerk(nominal_, dynamics_, stopJerk_, setup_.tick_s, decision_);
    decision_.joints.fill({});
    status_ = FilterStatus::StoppedByPlan;
}

void ControlLoop::takeRobustTorque() {
    if (robustLoopFailed_) {
        robustTorque_.setZero(n_);
        return;
    }
    const TickStatus status = contain(TickStatus::Faulted, StopReason::RobustLoopFailed, [&] {
        return plugins_.robustLoop->compute(plugins_.realPlant->measured(), nominal_,
                                            decision_.torque, robustTorque_);
    });
    if (status == TickStatus::Ok && isFinite(robustTorque_, n_)) return;
    beginStop(StopReason::RobustLoopFailed,
              "it gave no usable torque (wrong size, not finite or not Ok)");
    robustLoopFailed_ = true;
    robustTorque_.setZero(n_);
}

void ControlLoop::tick(TickRecord& record) noexcept {
    StageTimer timer(record);
    const double t = time();

    if (!braking_) takeCommand(t);
    timer.mark(Stage::Command);
    model_.calcDynamics(nominal_.q, nominal_.qd, dynamics_);
    timer.mark(Stage::Dynamics);
    if (!braking_) takeTorque();
    timer.mark(Stage::Controller);
    if (braking_ || !takeDecision()) followStop();
    timer.mark(Stage::Filter);

    record.time_s = t;
    record.command = command_;
    record.nominal.q = nominal_.q;
    record.nominal.qd = nominal_.qd;
    record.nominal.qdd = nominal_.qdd;
    record.nominal.jerk = decision_.jerk;
    record.tool = dynamics_.tool;
    record.desiredTorque = desiredTorque_;
    record.filterTorque = decision_.torque;
    record.status = status_;
    record.joints = decision_.joints;

    if (plugins_.realPlant) {
        takeRobustTorque();
        timer.mark(Stage::Robust);
        record.real = plugins_.realPlant->measured();
        record.actual = plugins_.realPlant->actual();
        motorTorque_ = decision_.torque + robustTorque_;
        const TickStatus status = contain(TickStatus::Faulted, StopReason::PlantFailed, [&] {
            return plugins_.realPlant->advance(motorTorque_, appliedTorque_);
        });
        if (status != TickStatus::Ok || !isFinite(appliedTorque_, n_) ||
            !isFinite(plugins_.realPlant->measured(), n_)) {
            beginStop(StopReason::PlantFailed,
                      "it could not advance (its state would not be finite)");
            plantFailed_ = true;
            appliedTorque_.setZero(n_);
        }
        timer.mark(Stage::Plant);
    }
    record.robustTorque = robustTorque_;
    record.motorTorque = appliedTorque_;
    record.braking = braking_;
    record.substituted = substituted_;

    advanceNominal(decision_, setup_.tick_s, nominal_);
    ++tickIndex_;
    timer.finish();
}

}  // namespace viable
