#include "viable/loop/ReferenceGuard.h"

#include "core/Text.h"
#include "environment/ArmSurroundings.h"
#include "filter/WholeArmBrakingFilter.h"
#include "loop/GuardSetup.h"
#include "viable/braking/Servo.h"

namespace viable {

using detail::lend;

const char* const kReferenceGuard = "ReferenceGuard";
const char* const kOptions = "ReferenceGuardOptions";

/** The targets as a command, and limits that change. */
class ReferenceGuard::Source : public CommandSource {
public:
    explicit Source(BetweenSamples between) : receiver_(between) {}

    void configure(const RunSetup&, const Parameters&) override {}
    void reset(const MotionState& start) override {
        target_.space = MotionCommand::Space::Joint;
        target_.q = start.q;
        target_.qd.setZero(start.q.size());
        receiver_.reset(target_);
        hasNew_ = hasLimits_ = false;
    }
    CommandTraits traits() const override { return {MotionCommand::Space::Joint}; }
    TickStatus sample(double t, MotionCommand& out) override {
        if (hasNew_) receiver_.take(t, target_);
        hasNew_ = false;
        receiver_.calc(t, out);
        return TickStatus::Ok;
    }
    const JointLimits* sampleLimits(double) override {
        const bool isNew = hasLimits_;
        hasLimits_ = false;
        return isNew ? &limits_ : nullptr;
    }

    void take(const JointVector& target) {
        target_.q = target;
        hasNew_ = true;
    }
    void change(const JointLimits& limits) {
        limits_ = limits;
        hasLimits_ = true;
    }

private:
    CommandReceiver receiver_;
    MotionCommand target_;
    JointLimits limits_;
    bool hasNew_ = false, hasLimits_ = false;
};

/** Servo as a controller. */
class ReferenceGuard::TargetController : public NominalController {
public:
    void configure(const RunSetup&, const Parameters&) override {}
    void configure(const JointLimits& limits, double tick_s, double share, double velocityFilter_s) {
        servo_.configure(limits, tick_s, share);
        velocity_.configure(limits, tick_s, velocityFilter_s);
    }
    void changeLimits(const JointLimits& limits) {
        servo_.changeLimits(limits);
        velocity_.changeLimits(limits);
    }
    void reset(const MotionState& start) override {
        servo_.reset(start);
        velocity_.reset(start.q);
        target_ = {start.q, JointVector::Zero(start.q.size()), JointVector::Zero(start.q.size())};
    }
    ControllerTraits traits() const override { return {true, false}; }
    TickStatus compute(const ControllerInput& input, ControllerOutput& output) override {
        if (input.tick.missed > 0) {
            servo_.skipTicks(input.tick.missed);
            velocity_.forget();
        }
        target_.q = input.command.q;
        target_.qd = velocity_.calc(target_.q);
        servo_.calc(input.nominal, target_, jerk_);
        askForJerk(input, jerk_, output);
        return TickStatus::Ok;
    }

private:
    Servo servo_;
    TargetVelocity velocity_;
    MotionState target_;
    JointVector jerk_;
};

struct ReferenceGuard::Inside {
    Inside(RobotDescription description, double tick_s, ReferenceGuardOptions given)
        : robot(withoutDynamics(std::move(description))),  // torques are made of jerks and back
          options(std::move(given)),
          setup(detail::makeGuardSetup(kReferenceGuard, robot, tick_s, options.limits)),
          source(options.between) {
        limits = reachLimits = setup.limits;
        requireJerkLimits(limits, kReferenceGuard, kReferenceGuard, "Set them in ReferenceGuardOptions::limits.");
        if (!(options.share > 0.0 && options.share <= 1.0))
            throw badInput("ReferenceGuardOptions::share",
                           detail::formatNumber(options.share) + "; allowed is above 0, up to 1",
                           "1 for targets that jump and rest.");
        if (options.environment) {
            detail::refusePeople("ReferenceGuardOptions::environment", *options.environment, "a reference guard keeps");
            geometry = loadArmGeometry(robot);
            surroundings = makeSurroundings(*options.environment, robot, *geometry, limits);
            feed = std::make_unique<SurroundingsFeed>(surroundings);
            if (!(options.maxAge_s > 0.0))
                throw badInput("ReferenceGuardOptions::maxAge_s",
                               detail::formatNumber(options.maxAge_s) + "; allowed is above 0, or infinity",
                               "Infinity: surroundings do not grow old.");
            setup.geometry = &*geometry;
        } else if (robot.speedLimits.needsCapsules()) {
            loadArmGeometry(robot);  // what is missing is told now, not at a start
        }
        if (!(options.velocityFilter_s >= 0.0))
            throw badInput("ReferenceGuardOptions::velocityFilter_s",
                           detail::formatNumber(options.velocityFilter_s) + "; allowed is 0 and above, or infinity",
                           "0 takes it from the limits.");
        targetController.configure(limits, tick_s, options.share, options.velocityFilter_s);
        output = makeNone();
    }

    /** What no driver takes for a position. */
    GuardedReference makeNone() const {
        const JointVector none = JointVector::Constant(robot.size(), kNan);
        return {{none, none, none}, none};
    }

    void start(const MotionState& state);
    const GuardedReference& step() noexcept;

    const RobotDescription robot;
    ReferenceGuardOptions options;
    RunSetup setup;
    JointLimits limits;       // in force
    JointLimits reachLimits;  // those at first: read by another thread
    std::optional<ArmGeometry> geometry;
    std::shared_ptr<const Surroundings> surroundings;  // the last ones
    double stamp_s = 0.0;                              // theirs, in the time of the loop
    std::unique_ptr<SurroundingsFeed> feed;
    Source source;
    TargetController targetController;
    std::unique_ptr<SafetyFilter> filter;
    std::optional<ControlLoop> loop;  // last: it uses all of the above
    TickRecord record;
    GuardedReference output;
    std::atomic<bool> stopRequest{false};
    static_assert(std::atomic<bool>::is_always_lock_free, "signal handlers may set it");
    bool isStarted = false;
};

void ReferenceGuard::Inside::start(const MotionState& state) {
    isStarted = false;
    if (loop) stamp_s -= loop->time();  // surroundings grow no younger
    loop.reset();
    setup.limits = limits;
    output = makeNone();
    detail::checkGuardStart(kReferenceGuard, state, setup);
    // Gains: the servo knows the jerk it wants, so that gamma does not count.
    CertifiedBrakingOptions joints;
    joints.recovery = options.recovery;
    joints.objective = Objective::Joint;
    joints.gamma = std::min(joints.gamma, 1.0 / setup.tick_s);
    filter.reset();
    if (feed) {
        feed = std::make_unique<SurroundingsFeed>(surroundings, stamp_s);  // time begins anew
        setup.surroundings = feed.get();
    }
    if (feed || robot.speedLimits.isAny()) {
        auto wholeArm = std::make_unique<WholeArmBrakingFilter>();
        WholeArmBrakingOptions arm;
        arm.joints = joints;
        arm.maxAge_s = options.maxAge_s;
        wholeArm->configure(setup, arm, kOptions);
        filter = std::move(wholeArm);
    } else {
        auto certified = std::make_unique<CertifiedBrakingFilter>();
        certified->configure(setup, joints, kOptions);
        filter = std::move(certified);
    }
    targetController.configure(limits, setup.tick_s, options.share, options.velocityFilter_s);
    LoopPlugins plugins;
    plugins.command = lend<CommandSource>(source);
    plugins.controller = lend<NominalController>(targetController);
    plugins.filter = lend<SafetyFilter>(*filter);
    loop.emplace(setup, std::move(plugins));
    record = {};
    output.state = state;
    output.jerk.setZero(robot.size());
    isStarted = true;
}

const GuardedReference& ReferenceGuard::Inside::step() noexcept {
    if (!isStarted) return output;
    if (stopRequest.exchange(false, std::memory_order_relaxed))
        loop->requestStop(StopReason::Requested, "requestStop() was called");
    loop->tick(record);
    if (!loop->hasFailed()) {  // else the last good one stands
        output.state = loop->nominal();
        output.jerk = record.nominal.jerk;
    }
    output.acting = record.joints;
    output.status = loop->hasFailed() ? GuardStatus::Failed : detail::findStatus(*loop, record);
    return output;
}

ReferenceGuard::ReferenceGuard(RobotDescription robot, double tick_s, ReferenceGuardOptions options)
    : inside_(std::make_unique<Inside>(std::move(robot), tick_s, std::move(options))) {}
ReferenceGuard::~ReferenceGuard() = default;
ReferenceGuard::ReferenceGuard(ReferenceGuard&&) noexcept = default;
ReferenceGuard& ReferenceGuard::operator=(ReferenceGuard&&) noexcept = default;

void ReferenceGuard::start(const MotionState& state) {
    inside_->start(state);
}

const GuardedReference& ReferenceGuard::step() noexcept {
    inside_->output.targetFailed = false;
    return inside_->step();
}

const GuardedReference& ReferenceGuard::step(const JointVector& target) noexcept {
    Inside& in = *inside_;
    in.output.targetFailed = !isFinite(target, in.robot.size()) || target.lpNorm<Eigen::Infinity>() > kLargestLimit;
    if (!in.output.targetFailed) in.source.take(target);
    return in.step();
}

void ReferenceGuard::calcStop(double after_s, MotionState& state) const noexcept {
    const Inside& in = *inside_;
    if (in.isStarted && after_s >= 0.0 && !in.loop->hasFailed())
        in.loop->calcStop(after_s, state);
    else
        state = in.output.state;
}

void ReferenceGuard::missTicks(std::int64_t ticks) noexcept {
    Inside& in = *inside_;
    if (!in.isStarted) return;
    TickRecord missed;  // record() stays that of the last step
    for (; ticks > 0 && !in.loop->hasStopped(); --ticks) in.loop->missTick(missed);
    if (!in.loop->hasFailed()) in.output.state = in.loop->nominal();
}

bool ReferenceGuard::changeLimits(const JointLimits& limits) noexcept {
    Inside& in = *inside_;
    const bool isRunning = in.isStarted && !in.loop->hasStopped();
    if (isRunning && (in.loop->isStopping() || in.stopRequest.load(std::memory_order_relaxed))) return false;
    if (!areUsable(limits, in.robot.size(), in.setup.tick_s) || !limits.hasJerkLimits()) return false;
    in.limits = limits;
    if (!isRunning) return true;  // for the next start
    in.source.change(limits);
    in.targetController.changeLimits(limits);
    return true;
}

void ReferenceGuard::requestStop() noexcept {
    inside_->stopRequest.store(true, std::memory_order_relaxed);
}

GuardStop ReferenceGuard::stopReason() const {
    if (!inside_->loop) return GuardStop::None;
    const GuardStop reason = detail::toGuardStop(inside_->loop->stopReason());
    return reason == GuardStop::LawFailed ? GuardStop::LibraryFailed : reason;  // TargetController is the library's
}

const char* ReferenceGuard::stopMessage() const {
    return inside_->loop ? inside_->loop->stopMessage() : "";
}
int ReferenceGuard::size() const {
    return inside_->robot.size();
}
const JointLimits& ReferenceGuard::limits() const {
    return inside_->limits;
}
void ReferenceGuard::changeEnvironment(const Environment& environment, double stamp_s) {
    Inside& in = *inside_;
    if (!in.feed)
        throw badInput("ReferenceGuard::changeEnvironment", "the guard was made without surroundings",
                       "Set ReferenceGuardOptions::environment, an empty one will do.");
    detail::refusePeople("ReferenceGuard::changeEnvironment", environment, "a reference guard keeps");
    in.surroundings = makeSurroundings(environment, in.robot, *in.geometry, in.reachLimits);
    in.stamp_s = stamp_s;
    in.feed->put(in.surroundings, stamp_s);
}
const TickRecord& ReferenceGuard::record() const {
    return inside_->record;
}

}  // namespace viable
