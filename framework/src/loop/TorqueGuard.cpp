#include "viable/loop/TorqueGuard.h"

#include <algorithm>

#include "core/FarthestJoint.h"
#include "core/Text.h"
#include "loop/GuardSetup.h"
#include "robot/InertiaModes.h"
#include "viable/tracking/LoopStability.h"

namespace viable {

namespace {

using detail::formatNumber;
using detail::lend;
using detail::quoteJoint;

/** A reading may be off by so many encoder counts. */
constexpr double kCounts = 2.0;
/** External torques beyond this are none [Nm]. */
constexpr double kLargestExternalTorque = 1e9;

/** Below this speed a joint is as good as at rest, and dry friction holds it [rad/s, m/s]. */
constexpr double kStandstill = 0.02;

/** The sampled velocity loop of NRIC becomes unstable from K_r dt = 2 x inertia on. */
constexpr double kUnstable = 2.0;

static_assert(kMaxSubstitutedTicks == 10 && kMaxMissedTicks == 1000, "the header says so");

const char* const kTorqueGuard = "TorqueGuard";

void checkPositive(const PerJoint& values, const char* name, const RobotDescription& robot) {
    const std::string place = std::string("TorqueGuardOptions::") + name;
    if (!values.fits(robot.size()))
        throw badInput(
            place,
            std::to_string(values.count()) + " numbers; the robot has " + std::to_string(robot.size()) + " joints",
            "Give one number for all joints, or one each.");
    for (int i = 0; i < robot.size(); ++i)
        if (!(values[i] > 0.0))
            throw badInput(
                place, formatNumber(values[i]) + " for " + quoteJoint(robot, i) + "; allowed is above 0, or infinity",
                "Without this check: infinity.");
}

/** Refuses gains of the robust loop with which the sampled velocity loop of the arm, v+ = v - M^-1 K_r dt v, becomes unstable. */
void checkRobustGains(const NricOptions& gains, const JointMatrix& M, double tick_s, const RobotDescription& robot) {
    const int n = robot.size();
    const auto modes = detail::findModes(M, gains.kr.expand(n), Eigen::ComputeEigenvectors);
    const double fastest = modes.eigenvalues()[n - 1] * tick_s;
    if (fastest < kUnstable) return;
    Eigen::Index worst = 0;
    modes.eigenvectors().col(n - 1).cwiseAbs().maxCoeff(&worst);
    const int joint = static_cast<int>(worst);
    throw badInput("NricOptions::kr",
                   "in this pose kr * tick_s is " + formatNumber(fastest) + " times the inertia that " +
                       quoteJoint(robot, joint) +
                       " moves; allowed is below 2, where the sampled loop starts to become unstable",
                   "Lower kr of that joint from " + formatNumber(gains.kr[joint]) + " to " +
                       formatNumber(gains.kr[joint] / fastest) +
                       " or less, or give its rotor's inertia in RobotDescription::actuation.");
}

/** What friction takes from a joint at speed `qd` by the robot's description [Nm]. */
double calcFriction(const JointFriction& friction, int joint, double qd) {
    const double speed = std::abs(qd);
    return friction.coulomb[joint] * std::tanh(speed / kStandstill) + friction.calcViscous(joint, speed);
}

/** The robot as it shows itself; what is not complete is for makeGuardSetup() to say. */
RobotDescription prepare(RobotDescription robot, const TorqueConvention& convention) {
    const Actuation& actuation = robot.actuation;
    for (const JointVector* figures :
         {&actuation.torqueLimit, &actuation.friction.coulomb, &actuation.friction.viscous})
        if (figures->size() != robot.size()) return robot;
    return withConvention(std::move(robot), convention);
}

/** What gives no command: the law knows by itself what it wants. */
class NoCommand : public CommandSource {
public:
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    CommandTraits traits() const override { return {MotionCommand::Space::Tool}; }
    TickStatus sample(double, MotionCommand& out) override {
        out.space = MotionCommand::Space::Tool;
        return TickStatus::Ok;
    }
};

}  // namespace

/** The user's law as a controller. */
class TorqueGuard::LawController : public NominalController {
public:
    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState&) override {}
    ControllerTraits traits() const override { return {true, true}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        output.torque.setConstant(input.nominal.q.size(), kNan);  // what the law does not write is no torque
        law.call(law.law, input.nominal, input.dynamics, output.torque);
        return TickStatus::Ok;
    }

    LawCall law{};
};

/** The user's arm as a plant: what it reads, and what its motors get. */
class TorqueGuard::Arm : public RealPlant {
public:
    /** From a start on; one entry per joint. @param deviation, speed  see TorqueGuardOptions */
    void begin(const RunSetup& setup, const JointVector& deviation, const JointVector& speed, TorqueSender& sender) {
        const RobotDescription& robot = setup.robot;
        const double tick_s = setup.tick_s;
        n_ = robot.size();
        sender_ = &sender;
        torqueLimit_ = robot.actuation.torqueLimit;
        policy_ = {SensorCheck::Reference::NominalMotion, {}, speed, deviation, {}, {}, {}};
        for (int i = 0; i < n_; ++i) policy_.largestSpeed[i] += kCounts * robot.encoderStep(i) / tick_s;
        policy_.largestChange = policy_.largestSpeed * tick_s;
        SensorCheck::setMotion(setup, policy_);
    }

    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override {
        state_ = actual_ = {start.q, start.qd};
        sensors_.begin(policy_, start.q);
        external_.setZero(n_);
        motors_.setZero(n_);
        sent_.setZero(n_);
        sender_->reset(start.q);
        isTrusted_ = true;
        isReleased_ = false;
    }
    const JointState& measured() const override { return state_; }
    const JointState& actual() const override { return actual_; }
    const JointVector* externalTorque() const override { return &external_; }
    TickStatus advance(const JointVector& torque, JointVector& applied) override {
        motors_ = torque.cwiseMax(-torqueLimit_).cwiseMin(torqueLimit_);
        // In a missed tick nothing is sent: the robot holds what it has.
        if (!isMissing_) sent_ = sender_->send(state_.q, motors_);
        wasDriven_ = true;
        applied = motors_;
        return TickStatus::Ok;
    }
    /** Nothing is known of what the motors should give: what is sent goes to zero in kRelease_s, each joint by the same
    step a tick, and by `largestStep` at most [Nm]. */
    void release(const JointVector& largestStep, double tick_s) {
        if (!isReleased_) releaseStep_ = (sent_ * std::min(1.0, tick_s / kRelease_s)).cwiseAbs().cwiseMin(largestStep);
        isReleased_ = true;
        for (int i = 0; i < n_; ++i) sent_[i] -= std::clamp(sent_[i], -releaseStep_[i], releaseStep_[i]);
    }
    /** Whether ticks pass in which nothing can be sent. */
    void setMissing(bool isMissing) { isMissing_ = isMissing; }

    /** The reading of this tick, or what stands for it. */
    ReadingFault take(const JointState& reading, const JointVector* external, const MotionState& nominal) {
        wasDriven_ = hasReading_ = false;
        ReadingFault fault = checkReading(reading, nominal);
        if (external && (!isFinite(*external, n_) || external->lpNorm<Eigen::Infinity>() > kLargestExternalTorque))
            fault = ReadingFault::Malformed;
        if (fault != ReadingFault::None || !isTrusted_) {
            // A jump is no news of where the joint is; without any reading it may move on.
            if (fault == ReadingFault::Malformed) sensors_.miss();
            standIn(nominal);
            return fault;
        }
        hasReading_ = true;
        external_ = external ? *external : JointVector(JointVector::Zero(n_));
        state_ = actual_ = reading;
        for (int i = 0; i < n_; ++i) {
            sensors_.take(i, reading, nominal);
            // A joint far away is not to be pulled back all the harder.
            const double deviation = sensors_.deviation()[i], largest = policy_.largestDeviation[i];
            if (std::abs(deviation) > largest) state_.q[i] = nominal.q[i] + std::copysign(largest, deviation);
        }
        return fault;
    }
    /** A tick without a reading. */
    void miss(const MotionState& nominal) {
        sensors_.miss();
        hasReading_ = false;
        standIn(nominal);
    }
    /** measured() is a reading of this tick, and nothing that stands for one. */
    bool hasReading() const { return hasReading_; }
    /** From here on no reading is used. */
    void distrust() {
        isTrusted_ = false;
        external_.setZero();
    }

    /** The joint farthest beyond its largest deviation; -1: none is. */
    int findFar() const { return detail::findFarthestBeyond(sensors_.deviation(), policy_.largestDeviation); }
    double deviation(int joint) const { return sensors_.deviation()[joint]; }

    bool wasDriven() const { return wasDriven_; }
    const JointVector& sent() const { return sent_; }
    bool isRateLimited() const { return sender_->isRateLimited(); }
    bool isSaturated() const { return (motors_.cwiseAbs().array() >= torqueLimit_.array()).any(); }

private:
    ReadingFault checkReading(const JointState& reading, const MotionState& nominal) const {
        if (!isFinite(reading, n_)) return ReadingFault::Malformed;
        for (int i = 0; i < n_; ++i)
            if (!sensors_.isPlausible(i, reading, nominal)) return ReadingFault::Jumped;
        return ReadingFault::None;
    }
    /** The last deviation goes on: nothing is known of a change. */
    void standIn(const MotionState& nominal) {
        for (int i = 0; i < n_; ++i) sensors_.standIn(i, nominal, state_);
        actual_ = state_;
    }

    int n_ = 0;
    SensorCheck::Policy policy_;
    SensorCheck sensors_;
    JointVector torqueLimit_;
    JointState state_;      // for the robust loop
    JointState actual_;     // as read, where it was of use
    JointVector external_;  // of the last good reading [Nm]
    JointVector motors_;    // what they give, with what the robot adds
    JointVector sent_;      // to the robot
    JointVector releaseStep_;
    TorqueSender* sender_ = nullptr;
    bool isMissing_ = false, isReleased_ = false;
    bool isTrusted_ = true, wasDriven_ = false, hasReading_ = false;
};

/** Makes the real arm follow the nominal one: by Nric where there is a reading, else by what it last gave. */
class TorqueGuard::HeldRobustLoop : public RobustLoop {
public:
    /** @param nric  configured; null: no torque at all */
    HeldRobustLoop(const Arm& arm, const JointFriction& friction, Nric* nric)
        : arm_(arm), friction_(friction), nric_(nric) {}

    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override {
        if (nric_) nric_->reset(start);
        isHolding_ = false;
        last_.setZero(start.q.size());
        lastSpeed_.setZero(start.q.size());
    }
    TickStatus compute(const JointState& real, const MotionState& nominal, const JointVector& filterTorque,
                       JointVector& torque) override {
        if (!nric_ || !arm_.hasReading()) {
            if (!isHolding_) given_ = torque;
            isHolding_ = true;
            hold(nominal, torque);
            return TickStatus::Ok;
        }
        if (isHolding_) torque = given_;  // to Nric the ticks between are none
        isHolding_ = false;
        const TickStatus status = nric_->compute(real, nominal, filterTorque, torque);
        if (status == TickStatus::Ok) {
            last_ = torque;
            lastSpeed_ = nominal.qd;
        }
        return status;
    }
    void holdIntegral() override {
        if (nric_) nric_->holdIntegral();
    }
    RobustTraits traits() const override { return nric_ ? nric_->traits() : RobustTraits(); }

private:
    /** The last torque, less what friction no longer takes now that the nominal joint is slower; never
    more than that torque, nor to the other side of zero. Arm keeps the sum within the motors' limits. */
    void hold(const MotionState& nominal, JointVector& torque) const {
        torque = last_;
        for (Eigen::Index i = 0; i < torque.size(); ++i) {
            const int joint = static_cast<int>(i);
            const double side = lastSpeed_[i] < 0.0 ? -1.0 : 1.0;
            const double less = calcFriction(friction_, joint, lastSpeed_[i]) -
                                calcFriction(friction_, joint, std::max(0.0, side * nominal.qd[i]));
            torque[i] -= side * std::clamp(less, 0.0, std::max(0.0, side * last_[i]));
        }
    }

    const Arm& arm_;
    const JointFriction& friction_;
    Nric* nric_;
    JointVector last_;       // asked for by the last reading
    JointVector given_;      // what the host gave of it
    JointVector lastSpeed_;  // of the nominal arm then
    bool isHolding_ = false;
};

struct TorqueGuard::Inside {
    Inside(RobotDescription description, double tick_s, TorqueGuardOptions given)
        : options(std::move(given)),
          robot(prepare(std::move(description), options.convention)),
          setup(detail::makeGuardSetup(kTorqueGuard, robot, tick_s, options.limits)) {
        requireDynamics(robot, kTorqueGuard, "a guard of torques");
        options.limits.reset();  // setup has them
        sender.emplace(robot, options.convention, tick_s);
        checkPositive(options.largestDeviation, "largestDeviation", robot);
        if (options.largestSpeed) checkPositive(*options.largestSpeed, "largestSpeed", robot);
        filter.configure(setup, options.filter);
        if (options.hasRobustLoop) {
            if (!options.robustGains) {
                const LinearErrorLoop gains = scaleGains(robot, setup.limits, tick_s);
                options.robustGains = NricOptions{gains.kr, gains.kp, gains.ki};
                options.robustGains->inertiaRate = gains.inertiaRate;
            }
            NricOptions& gains = *options.robustGains;
            if (gains.motorRate.fits(robot.size()))  // else configure() says so
                gains.motorRate = JointVector(
                    gains.motorRate.expand(robot.size()).cwiseMin(options.convention.torqueRate.expand(robot.size())));
            nric.configure(setup, gains);
        } else {
            options.robustGains.reset();
        }
        const JointVector unlimited = JointVector::Constant(robot.size(), kInfinity);
        arm.begin(setup, unlimited, unlimited, *sender);
        LoopPlugins plugins;
        plugins.command = lend<CommandSource>(noCommand);
        plugins.controller = lend<NominalController>(law);
        plugins.filter = lend<SafetyFilter>(filter);
        plugins.robustLoop = lend<RobustLoop>(robustLoop);
        plugins.realPlant = lend<RealPlant>(arm);
        RealArmOptions real{nullptr, true, false};
        real.limitsAuthority = options.limitsAuthority && options.hasRobustLoop;
        JointVector slowest = options.convention.torqueRate.expand(robot.size());
        if (options.robustGains) {
            real.motorRate = options.robustGains->motorRate.expand(robot.size());
            real.robustRate = options.robustGains->torqueRate.expand(robot.size());
            slowest = slowest.cwiseMin(real.motorRate);
        }
        largestReleaseStep = slowest * tick_s;
        loop.emplace(setup, std::move(plugins), real);
        output.torque.setZero(robot.size());
    }

    void start(const JointState& measured);
    void readMeasured(const JointState& measured, const JointVector* external) noexcept;
    void stop(GuardStop reason, StopReason loopReason, const char* message) noexcept;
    void answer() noexcept;

    TorqueGuardOptions options;
    const RobotDescription robot;  // as the robot shows it
    RunSetup setup;
    std::optional<TorqueSender> sender;
    NoCommand noCommand;
    LawController law;
    CertifiedBrakingFilter filter;
    Nric nric;
    Arm arm;
    HeldRobustLoop robustLoop{arm, robot.actuation.friction, options.hasRobustLoop ? &nric : nullptr};
    std::optional<ControlLoop> loop;  // last: it uses all of the above
    TickRecord record;
    GuardedTorque output;
    std::atomic<bool> stopRequest{false};
    static_assert(std::atomic<bool>::is_always_lock_free, "signal handlers may set it");
    GuardStop ownReason = GuardStop::None;  // where the loop's own word says less
    int useless = 0;                        // readings in a row
    std::int64_t substituted = 0;           // torques, up to the step before
    JointVector largestReleaseStep;         // where nothing gives numbers any more [Nm]
    bool isStarted = false, waits = false;
};

void TorqueGuard::Inside::start(const JointState& measured) {
    isStarted = false;
    output = {};
    output.torque.setZero(robot.size());
    detail::refuseSpeedLimits(kTorqueGuard, robot);
    const int n = robot.size();
    const Dynamics dynamics =
        detail::checkGuardStart(kTorqueGuard, {measured.q, measured.qd, JointVector::Zero(n)}, setup);
    filter.configure(setup, options.filter);  // refuses what cannot be kept
    if (options.robustGains && std::isinf(options.robustGains->inertiaRate))
        checkRobustGains(*options.robustGains, dynamics.M, setup.tick_s, robot);
    JointVector speed(n);
    for (int i = 0; i < n; ++i) {
        const AxisLimits axis = setup.limits.axis(i);
        speed[i] = options.largestSpeed
                       ? (*options.largestSpeed)[i]
                       : 2.0 * std::max({-axis.velocityLower, axis.velocityUpper, std::abs(measured.qd[i])});
    }
    arm.begin(setup, options.largestDeviation.expand(n), speed, *sender);
    loop->reset();
    record = {};
    ownReason = GuardStop::None;
    useless = 0;
    substituted = 0;
    waits = false;
    isStarted = true;
}

void TorqueGuard::Inside::stop(GuardStop reason, StopReason loopReason, const char* message) noexcept {
    const bool isFirst =
        !loop->isStopping() || (loop->stopReason() == StopReason::Requested && loopReason != StopReason::Requested);
    if (isFirst) ownReason = reason;
    loop->requestStop(loopReason, message);
}

/** Takes the reading, and stops the arm for what it shows. */
void TorqueGuard::Inside::readMeasured(const JointState& measured, const JointVector* external) noexcept {
    output.readingFault = arm.take(measured, external, loop->nominal());
    char message[400];
    if (output.readingFault != ReadingFault::None) {
        if (++useless <= kMaxSubstitutedTicks) return;
        arm.distrust();
        std::snprintf(message, sizeof message,
                      "the last %d readings %s; the arm is braked without any: engage the brakes", useless,
                      output.readingFault == ReadingFault::Malformed
                          ? "were of the wrong size or not finite"
                          : "jumped: they are not taken as plausible (see TorqueGuardOptions::largestSpeed)");
        return stop(GuardStop::NoReadings, StopReason::PlantFailed, message);
    }
    useless = 0;
    const int far = arm.findFar();
    if (far < 0) return;
    robustLoop.holdIntegral();
    if (ownReason == GuardStop::TooFar) return;
    const JointDescription& joint = robot.joints[far];
    const char* const unit = joint.type == JointType::Prismatic ? "m" : "rad";
    std::snprintf(
        message, sizeof message,
        "joint `%.60s` is %.3g %s from its nominal place, allowed is %.3g %s. Find what blocks, pushes or loads it "
        "(friction, a payload, a sign or a gravity that is another%s), or raise TorqueGuardOptions::largestDeviation",
        joint.name.c_str(), arm.deviation(far), unit, options.largestDeviation[far], unit,
        output.motorsSaturated ? "; its motors are at their limits: lower those of acceleration and jerk"
        : output.rateLimited   ? "; the torque changes as fast as the robot accepts: lower the jerk limits"
                               : "");
    stop(GuardStop::TooFar, StopReason::PlantFailed, message);
}

/** From what the loop has done. */
void TorqueGuard::Inside::answer() noexcept {
    output.acting = record.joints;
    output.lawFailed = record.substituted > substituted;
    substituted = record.substituted;
    const bool isDriven = arm.wasDriven();  // else neither filter nor stop gave numbers
    if (!isDriven) arm.release(largestReleaseStep, setup.tick_s);
    output.torque = arm.sent();
    output.motorsSaturated = isDriven && arm.isSaturated();
    output.rateLimited = isDriven && arm.isRateLimited();
    output.status = isDriven ? detail::findStatus(*loop, record) : GuardStatus::Failed;
    if (waits && isDriven && output.status != GuardStatus::Stopped && output.status != GuardStatus::Stopping)
        output.status = GuardStatus::Waiting;
}

TorqueGuard::TorqueGuard(RobotDescription robot, double tick_s, TorqueGuardOptions options)
    : inside_(std::make_unique<Inside>(std::move(robot), tick_s, std::move(options))) {}
TorqueGuard::~TorqueGuard() = default;
TorqueGuard::TorqueGuard(TorqueGuard&&) noexcept = default;
TorqueGuard& TorqueGuard::operator=(TorqueGuard&&) noexcept = default;

void TorqueGuard::start(const JointState& measured) {
    inside_->start(measured);
}

const GuardedTorque& TorqueGuard::runStep(const JointState& measured, const JointVector* external,
                                          const LawCall& law) noexcept {
    Inside& in = *inside_;
    if (!in.isStarted) return in.output;
    if (in.stopRequest.exchange(false, std::memory_order_relaxed))
        in.stop(GuardStop::Requested, StopReason::Requested, "requestStop() was called");
    in.readMeasured(measured, external);
    in.waits = in.output.readingFault != ReadingFault::None && !in.loop->isStopping();
    in.law.law = law;
    if (in.waits)
        in.loop->missTick(in.record, in.arm.hasReading());
    else
        in.loop->tick(in.record, in.arm.hasReading());
    in.law.law = {};
    in.answer();
    return in.output;
}

void TorqueGuard::missTicks(std::int64_t ticks) noexcept {
    Inside& in = *inside_;
    if (!in.isStarted) return;
    TickRecord missed;  // record() stays that of the last step
    in.arm.setMissing(true);
    for (; ticks > 0 && !in.loop->hasStopped(); --ticks) {
        in.arm.miss(in.loop->nominal());
        in.loop->missTick(missed, false);
    }
    in.arm.setMissing(false);
}

void TorqueGuard::requestStop() noexcept {
    inside_->stopRequest.store(true, std::memory_order_relaxed);
}

GuardStop TorqueGuard::stopReason() const {
    const StopReason reason = inside_->loop->stopReason();
    const bool isOwn = reason == StopReason::PlantFailed && inside_->ownReason != GuardStop::None;
    return isOwn ? inside_->ownReason : detail::toGuardStop(reason);
}

const char* TorqueGuard::stopMessage() const {
    return inside_->loop->stopMessage();
}
int TorqueGuard::size() const {
    return inside_->robot.size();
}
const JointLimits& TorqueGuard::limits() const {
    return inside_->setup.limits;
}
const std::optional<NricOptions>& TorqueGuard::robustGains() const {
    return inside_->options.robustGains;
}
const MotionState& TorqueGuard::nominal() const {
    return inside_->loop->nominal();
}
const TickRecord& TorqueGuard::record() const {
    return inside_->record;
}

}  // namespace viable
