#include <cstdio>

#include "ArmProperty.h"
#include "viable/loop/ReferenceGuard.h"

namespace viable {

namespace {

/** As of the limits property: rounding that does not count, relative to calcSize(). */
constexpr double kAllowed = 1e-12;
/** A joint is on its target when no more than this share of its range is left. */
constexpr double kArrived = 1e-9;
/** The shares that must be reached at least. */
constexpr double kLeastMotion = 0.2, kLeastArrived = 0.95;

/** A chain of joints without masses: nothing but its limits counts. */
RobotDescription makeChain(int n, const JointLimits& limits) {
    RobotDescription robot;
    robot.name = "chain";
    for (int i = 0; i < n; ++i) {
        JointDescription joint;
        joint.name = "joint" + std::to_string(i);
        joint.childLink = "link" + std::to_string(i);
        joint.parent = i - 1;
        joint.placement = Eigen::Isometry3d::Identity();
        joint.placement.translation() = Eigen::Vector3d(0.2, 0.0, 0.1);
        joint.axis = i % 2 == 0 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
        robot.joints.push_back(joint);
    }
    robot.toolParent = n - 1;
    robot.toolLink = "tool";
    robot.toolPlacement = Eigen::Isometry3d::Identity();
    robot.limits = limits;
    robot.allowLargeAngles = true;
    robot.home.setZero(n);
    return robot;
}

/** What a joint is sent: jumps, ramps, waves, noise, nonsense. */
class Targets {
public:
    enum Kind { Jumps, Resting, Ramp, Wave, Noise, Beyond, kKinds };

    Targets(Random& random, const AxisLimits& finite)
        : random_(random), l_(finite), kind_(static_cast<Kind>(random.integer(0, kKinds - 1))) {
        rest_ = random.uniform(l_.positionLower, l_.positionUpper);
        phase_ = random.uniform(0.0, 6.3);
        rate_ = random.logUniform(0.1, 3.0) * l_.velocityUpper / (l_.positionUpper - l_.positionLower);
    }
    Kind kind() const { return kind_; }
    double rest() const { return rest_; }

    double at(double t) {
        const double middle = (l_.positionLower + l_.positionUpper) / 2.0, half = l_.positionUpper - middle;
        if (kind_ == Ramp) return middle + half * (2.0 * std::abs(std::fmod(rate_ * t, 2.0) - 1.0) - 1.0) * 1.2;
        if (kind_ == Wave) return middle + half * 1.2 * std::sin(3.0 * rate_ * t + phase_);
        if (kind_ == Noise) return random_.uniform(l_.positionLower, l_.positionUpper);
        if (kind_ == Beyond) return random_.chance(0.5) ? 1e7 : -1e7;
        if (kind_ == Jumps && random_.chance(0.05))
            rest_ = random_.uniform(l_.positionLower - half, l_.positionUpper + half);
        return rest_;
    }

private:
    Random& random_;
    AxisLimits l_;
    Kind kind_;
    double rest_, phase_, rate_;
};

class ReferencesProperty : public ArmProperty {
public:
    explicit ReferencesProperty(const Options& options) : ArmProperty("references", options) {}

private:
    void followArm() override {
        Random random(run_.seed(), run_.arm());
        Arm arm(random);
        limits_ = arm.limits;
        tick_s_ = arm.tick_s;
        ReferenceGuardOptions options;
        options.between = static_cast<BetweenSamples>(random.integer(0, 2));
        options.share = random.chance(0.5) ? 1.0 : random.uniform(0.2, 1.0);
        options.recovery = random.chance(0.3);
        std::vector<Targets> targets;
        for (int i = 0; i < arm.n; ++i) targets.emplace_back(random, arm.now[i].finite);
        const bool changes = options.recovery && random.chance(0.5);
        const double rate_hz = random.logUniform(5.0, 500.0);

        ReferenceGuard guard(makeChain(arm.n, limits_), tick_s_, options);
        state_ = arm.state;
        guard.start(state_);
        sizes_.assign(static_cast<std::size_t>(arm.n), {0.0, 0.0, 0.0});
        for (int i = 0; i < arm.n; ++i) sizes_[i][0] = std::abs(state_.q[i]);
        isLoose_ = false;
        const int ticks = random.integer(1000, 6000);
        JointVector target(arm.n);
        double next = 0.0;
        for (int k = 0; k < ticks; ++k) {
            if (random.chance(0.001)) missTicks(guard, random.integer(1, 100));
            if (changes && random.chance(0.0005)) changeLimits(guard, random, arm);
            const double t = k * tick_s_;
            const bool isNew = t >= next;
            if (isNew) {
                next += random.uniform(0.7, 1.3) / rate_hz;
                for (int i = 0; i < arm.n; ++i) target[i] = targets[i].at(t);
                if (random.chance(0.01)) target[random.integer(0, arm.n - 1)] = kNan;
            }
            checkTick(guard, isNew ? guard.step(target) : guard.step());
        }
        if (guard.stopReason() != GuardStop::None) run_.fail(guard.stopMessage(), 0);
        run_.addSteps(std::int64_t(ticks) * arm.n);
        countArrivals(targets);
    }

    /** Whoever is at rest at the end is where it was sent. */
    void countArrivals(const std::vector<Targets>& targets) {
        for (std::size_t i = 0; i < targets.size(); ++i) {
            if (targets[i].kind() != Targets::Resting) continue;
            const auto joint = static_cast<int>(i);
            const AxisLimits l = limits_.axis(joint);
            const double wanted = std::clamp(targets[i].rest(), l.positionLower, l.positionUpper);
            const double slow = 1e-6 * std::min({-l.velocityLower, l.velocityUpper, 1.0});
            if (std::abs(state_.qd[joint]) > slow || std::abs(state_.qdd[joint]) * tick_s_ > slow) continue;
            ++resting_;
            const double size = calcSize(l.positionLower, l.positionUpper, sizes_[i][0]);
            const double off = std::abs(state_.q[joint] - wanted);
            arrived_ += off <= kArrived * size;
            if (off > kArrived * size) blame("a joint rests off its target", off, joint);
        }
    }

    void missTicks(ReferenceGuard& guard, int missed) {
        MotionState end;
        for (int k = 1; k <= missed; ++k) {
            guard.calcStop(k * tick_s_, end);
            for (int i = 0; i < guard.size() && !isLoose_; ++i)
                seePath(i, PathRange({end.q[i], end.qd[i], end.qdd[i]}));
        }
        guard.missTicks(missed);
        missed_ += missed;
        // Where calcStop() says; the state is the guard's from here on.
        MotionState there;
        guard.calcStop(0.0, there);
        for (int i = 0; i < guard.size(); ++i) {
            const double scale = calcSize(limits_.position.lower[i], limits_.position.upper[i], std::abs(end.q[i]));
            // Tick by tick rounding adds up.
            if (!(std::abs(there.q[i] - end.q[i]) <= 1e-11 * scale))
                blame("missed ticks lead elsewhere than calcStop()", there.q[i] - end.q[i], i);
        }
        state_ = there;
    }

    void changeLimits(ReferenceGuard& guard, Random& random, Arm& arm) {
        arm.changeLimits(random);
        limits_ = arm.limits;
        if (!guard.changeLimits(limits_)) run_.fail("usable limits were refused", 0);
        isLoose_ = true;
        ++changes_;
    }

    void checkTick(const ReferenceGuard& guard, const GuardedReference& next) {
        ++ticks_;
        passed_ += next.status == GuardStatus::Passed;
        if (isLoose_ && next.status != GuardStatus::Recovering) isLoose_ = false;
        if (!isLoose_ && next.status == GuardStatus::Recovering && !isRounding(guard)) run_.fail("a stop was lost", 0);
        for (int i = 0; i < guard.size(); ++i) {
            const AxisLimits l = limits_.axis(i);
            const PathRange tick = walkTick({state_.q[i], state_.qd[i], state_.qdd[i]}, next.jerk[i], tick_s_);
            seePath(i, tick);
            if (!isLoose_) see(i, 3, {next.jerk[i], next.jerk[i]}, 0.0);
            const AxisState end = advance({state_.q[i], state_.qd[i], state_.qdd[i]}, next.jerk[i], tick_s_);
            // At the end of a stop what rounding has left of the motion is taken away.
            const double jump =
                std::max({std::abs(end.p - next.state.q[i]), std::abs(end.v - next.state.qd[i]) * tick_s_,
                          std::abs(end.a - next.state.qdd[i]) * tick_s_ * tick_s_});
            if (!(jump <= kAllowed * calcSize(l.positionLower, l.positionUpper, sizes_[i][0])))
                blame("the reference is not what its jerk makes of the one before", jump, i);
            moving_ += std::abs(end.v) > 0.01 * std::min({-l.velocityLower, l.velocityUpper, 1.0});
        }
        state_ = next.state;
    }

    /** What rounding leaves of a stop may be reported as recovering. */
    bool isRounding(const ReferenceGuard& guard) const { return guard.record().verdict != StopVerdict::NoStop; }

    void seePath(int i, const PathRange& path) {
        for (int q = 0; q < 3; ++q) {
            sizes_[i][q] = std::max(sizes_[i][q], static_cast<double>(getRange(path, q).size()));
            if (!isLoose_) see(i, q, getRange(path, q), sizes_[i][q]);
        }
    }

    void see(int i, int quantity, const Range& x, double seen) {
        const Sides limit = getSides(limits_.axis(i), quantity);
        Real beyond = std::max(x.largest - limit.upper, limit.lower - x.least);
        if (beyond != 0) beyond /= calcSize(limit.lower, limit.upper, seen);
        worst_ = std::max(worst_, beyond);
        if (!(beyond <= kAllowed)) blame("a limit is passed (relative)", static_cast<double>(beyond), i);
    }

    /** A violation of the guard's reference. */
    void blame(const char* what, double excess, int i) {
        run_.fail(what, excess, i, {state_.q[i], state_.qd[i], state_.qdd[i]}, limits_.axis(i), tick_s_);
    }

    void report() override {
        std::printf("  missed ticks %lld, changes of limits %lld; worst beyond a limit (relative) %.2Lg\n",
                    static_cast<long long>(missed_), static_cast<long long>(changes_), worst_);
        run_.expectShare("joint steps in motion", moving_, run_.steps(), kLeastMotion);
        run_.expectShare("ticks passed as the servo asked", passed_, ticks_, kLeastPassed);
        run_.expectShare("of joints at rest, on their target", arrived_, resting_, kLeastArrived);
    }

    static constexpr double kLeastPassed = 0.9;

    JointLimits limits_;
    double tick_s_ = 0.0;
    MotionState state_;
    std::vector<std::array<double, 3>> sizes_;
    bool isLoose_ = false;
    Real worst_ = -1;
    std::int64_t ticks_ = 0, passed_ = 0, moving_ = 0, missed_ = 0, changes_ = 0, resting_ = 0, arrived_ = 0;
};

}  // namespace

bool checkReferences(const Options& options) {
    return ReferencesProperty(options).check();
}

}  // namespace viable
