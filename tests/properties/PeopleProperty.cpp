#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <optional>

#include "Properties.h"
#include "PushedArm.h"
#include "Random.h"
#include "Walkers.h"
#include "filter/WholeArmBrakingFilter.h"
#include "limits/SeparationLimit.h"
#include "viable/core/Error.h"
#include "viable/loop/NominalPlant.h"

namespace viable {

namespace {

constexpr double kTick_s = 1e-3;
constexpr int kTicksPerArm = 3000;
/** States that are judged in a tick: its beginning and some in it. */
constexpr int kLooks = 3;
/** One tick in so many has its whole stop judged. */
constexpr int kTicksPerStop = 50;
/** One tick in so many changes the joints' limits, on arms whose limits change. */
constexpr int kTicksPerChange = 300;
constexpr double kAllowed = 1e-9, kAllowedTorque = 1e-8;
constexpr double kMoves = 0.02;  ///< [rad/s]

/** One arm with random limits among random people, its filter, and how it is pushed. */
class PeopleCase {
public:
    PeopleCase(Robot& robot, Random& random)
        : robot_(robot), random_(random), description_(robot.description), pusher_(random) {
        const int n = description_.size();
        JointLimits& limits = description_.limits;
        const double jerk = random.logUniform(0.1, 10.0), acceleration = random.logUniform(0.3, 3.0);
        for (double side : {0.0, 1.0}) {
            (side > 0.0 ? limits.jerk.upper : limits.jerk.lower) *= jerk;
            (side > 0.0 ? limits.acceleration.upper : limits.acceleration.lower) *= acceleration;
        }
        if (random.chance(0.3)) description_.speedLimits.arm = random.logUniform(0.1, 2.0);
        state_.q = description_.home;
        state_.qd.setZero(n);
        state_.qdd.setZero(n);
        if (random.chance(0.7))
            for (int i = 0; i < n; ++i)
                state_.q[i] =
                    random.uniform(std::max(limits.position.lower[i], -kPi), std::min(limits.position.upper[i], kPi));
        if (random.chance(0.2)) {
            const double size = random.logUniform(0.01, 0.5);
            for (int i = 0; i < n; ++i) state_.qd[i] = size * random.uniform(-1.0, 1.0);
        }
        options_.joints.kAlpha =
            random.chance(0.7) ? std::numeric_limits<double>::infinity() : random.logUniform(2.0, 500.0);
        options_.joints.gamma = random.logUniform(5.0, 500.0);
        const int objective = random.integer(0, 3);
        options_.joints.objective = objective == 0   ? Objective::Torque
                                    : objective == 1 ? Objective::Tool
                                    : objective == 2 ? Objective::Joint
                                                     : Objective::Path;
        options_.steers = random.chance(0.8);
        if (random.chance(0.2)) options_.torqueShare = random.uniform(0.5, 1.0);
        misses_ = random.chance(0.3) ? random.logUniform(0.001, 0.1) : 0.0;
        hasGeometry_ = random.chance(0.3);
        changes_ = random.chance(0.2);
        Walkers::Habits habits;
        if (random.chance(0.4)) habits.jumpChance = random.logUniform(1e-4, 3e-3);
        if (random.chance(0.3)) habits.loseChance = random.logUniform(1e-4, 3e-3);
        walkers_.emplace(random, habits, kTick_s);
    }

    /** False: there is no such start. */
    bool begin() {
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        feed_ = std::make_unique<PeopleFeed>(walkers_->people());
        see();
        setup_.emplace(RunSetup{description_, description_.limits, kTick_s, kTicksPerArm * kTick_s, state_,
                                dynamics_.tool, hasGeometry_ ? &robot_.geometry : nullptr});
        setup_->people = feed_.get();
        try {
            filter_.configure(*setup_, options_);
        } catch (const Error&) {
            isRefusedAtRest = state_.qd.isZero(0.0) && !hasGeometry_ && std::isinf(options_.torqueShare);
            return false;
        }
        if (!filter_.traits().guarantees.has(LimitKind::Separation)) return false;
        checker_.emplace(description_, robot_.geometry, walkers_->people());
        return true;
    }

    /** One tick; what was wrong in it. */
    Violation tick(int number) {
        if (number > 0) see();
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        Violation violation;
        if (number > 0 && random_.chance(misses_)) {
            violation = miss();
        } else {
            if (changes_ && random_.integer(1, kTicksPerChange) == 1) changeLimits();
            violation = decide();
        }
        const Eigen::Vector3d target = dynamics_.tool.position;
        moving += state_.qd.cwiseAbs().maxCoeff() > kMoves;
        advanceNominal(decision_, kTick_s, state_);
        walkers_->walk(target);
        if (!violation.what && !hasChanged_) violation = checkLimits(state_, description_.limits, kAllowed);
        return violation;
    }

    std::int64_t passed = 0, stopped = 0, missed = 0, acting = 0, moving = 0, near = 0, stops = 0, exempt = 0,
                 unkept = 0, changes = 0;
    double least = std::numeric_limits<double>::infinity();  ///< gap to what was too fast to be touched
    bool isRefusedAtRest = false;  ///< a start in which nothing moves and nothing else was in its way
    const Walkers& walkers() const { return *walkers_; }
    const PeopleFaults& faults() const { return decision_.peopleFaults; }

private:
    void see() {
        walkers_->observe(seen_);
        feed_->put(seen_);
    }

    Violation decide() {
        torque_ = dynamics_.M * pusher_.want(state_, dynamics_) + dynamics_.b;
        const FilterStatus status = filter_.filter({state_, torque_, dynamics_}, decision_);
        passed += status == FilterStatus::Passed;
        stopped += status == FilterStatus::StoppedByPlan;
        if (status > FilterStatus::Recovering) return {"no decision", 1.0};
        bool acts = false;
        for (int i = 0; i < description_.size(); ++i) acts |= decision_.joints[i].limit == LimitKind::Separation;
        acting += acts;
        const LimitReport& told = decision_.reports[LimitKind::Separation];
        if (!told.isKnown) return {"the filter told no separation", 1.0};
        if (told.isKept)
            walkers_->forgive();
        else
            ++unkept;
        if (!told.isKept && status != FilterStatus::StoppedByPlan) return {"not braked although too near", 1.0};
        Violation violation = checkTorque(decision_);
        if (!violation.what) violation = checkTick(*walkers_, state_, decision_.value, true);
        if (!violation.what && random_.integer(1, kTicksPerStop) == 1) violation = checkStop();
        return violation;
    }

    /** New velocity limits of the joints, around those that were drawn. */
    void changeLimits() {
        JointLimits limits = setup_->limits;
        const double share = random_.uniform(0.3, 1.0);
        limits.velocity.lower *= share;
        limits.velocity.upper *= share;
        if (!filter_.changeLimits(limits)) return;
        hasChanged_ = true;
        ++changes;
    }

    bool isExcused() const { return walkers_->hasUnseenJump() || walkers_->hasSeenJump(); }

    Violation checkTick(const Walkers& walkers, const MotionState& from, const JointVector& jerk, bool counts) {
        if (isExcused()) {
            exempt += counts;
            return {};
        }
        double nearest = std::numeric_limits<double>::infinity();
        for (int k = 0; k < kLooks; ++k) {
            const double t = kTick_s * k / kLooks;
            JointVector q(from.q.size()), qd(from.q.size());
            for (Eigen::Index i = 0; i < q.size(); ++i) {
                const AxisState s = advance({from.q[i], from.qd[i], from.qdd[i]}, jerk[i], t);
                q[i] = s.p;
                qd[i] = s.v;
            }
            walkers.place(t, places_);
            const detail::SeparationLimit::Sample found = checker_->find(q, qd, places_, kNominalRest);
            nearest = std::min(nearest, found.protective);
            if (found.isTooFast) return {"somebody is touched too fast", -found.protective};
        }
        least = std::min(least, nearest);
        if (counts) near += nearest < 0.3;
        // What the filter tells is a bound of the tick. (A stop that goes on was told of when it was chosen.)
        const LimitReport& told = decision_.reports[LimitKind::Separation];
        if (counts && told.isKept && nearest < told.margin - kAllowed)
            return {"the filter told more than there was", told.margin - nearest};
        return {};
    }

    /** A tick in which the filter is not asked: the arm goes on along its stop. */
    Violation miss() {
        ++missed;
        JointVector jerk(state_.q.size());
        for (Eigen::Index i = 0; i < jerk.size(); ++i) jerk[i] = decision_.stops[static_cast<std::size_t>(i)].popJerk();
        decision_.holdJerk(jerk);
        filter_.skipTicks(1);
        return checkTick(*walkers_, state_, jerk, false);
    }

    Violation checkTorque(const FilterDecision& decision) const {
        HeldMotion motion;
        calcHeldMotion({state_, torque_, dynamics_}, FilterStatus::Modified, decision, kTick_s, motion);
        for (Eigen::Index i = 0; i < motion.torque.size(); ++i) {
            const double limit = options_.torqueShare * description_.actuation.torqueLimit[i];
            if (std::abs(motion.torque[i]) > limit * (1.0 + kAllowedTorque))
                return {"torque beyond its limit", std::abs(motion.torque[i]) - limit};
        }
        return {};
    }

    /** The stop of this tick's decision, followed to its end, while everybody runs at the tool. */
    Violation checkStop() {
        ++stops;
        Walkers walkers = *walkers_;
        MotionState s = state_;
        advanceNominal(decision_, kTick_s, s);
        std::array<GridStop, kMaxJoints> left = decision_.stops;
        FilterDecision next;
        JointVector jerk(s.q.size());
        Dynamics dynamics;
        for (bool moves = true; moves;) {
            robot_.model.calcDynamics(s.q, s.qd, dynamics);
            walkers.run(dynamics.tool.position);
            moves = false;
            for (std::size_t i = 0; i < static_cast<std::size_t>(jerk.size()); ++i) {
                moves |= !left[i].atRest();
                jerk[static_cast<Eigen::Index>(i)] = left[i].popJerk();
            }
            next.holdJerk(jerk);
            if (Violation violation = checkTick(walkers, s, jerk, false); violation.what) {
                violation.what = "somebody is touched too fast along a stop";
                return violation;
            }
            advanceNominal(next, kTick_s, s);
        }
        return {};
    }

    Robot& robot_;
    Random& random_;
    RobotDescription description_;
    Pusher pusher_;
    WholeArmBrakingOptions options_;
    std::optional<Walkers> walkers_;
    std::unique_ptr<PeopleFeed> feed_;
    std::optional<RunSetup> setup_;
    std::optional<detail::SeparationLimit> checker_;
    WholeArmBrakingFilter filter_;
    PeopleObservation seen_, places_;
    MotionState state_;
    Dynamics dynamics_;
    FilterDecision decision_;
    JointVector torque_;
    double misses_ = 0.0;
    bool hasGeometry_ = false, changes_ = false, hasChanged_ = false;
};

}  // namespace

bool checkPeople(const Options& options) {
    Robot robots[] = {Robot("indy7"), Robot("panda"), Robot("ur5e")};
    Run run("people", options);
    std::int64_t ticks = 0, stopped = 0, missed = 0, acting = 0, moving = 0, near = 0, stops = 0, begun = 0,
                 refused = 0, exempt = 0, unkept = 0, jumps = 0, losses = 0, changes = 0, appeared = 0, faster = 0,
                 lost = 0;
    double least = std::numeric_limits<double>::infinity();
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        Robot& robot = robots[random.integer(0, 2)];
        std::unique_ptr<PeopleCase> arm;
        while (true) {
            arm = std::make_unique<PeopleCase>(robot, random);
            if (arm->begin()) break;
            ++refused;
            if (arm->isRefusedAtRest) run.fail((robot.description.name + " at rest is refused").c_str(), 1.0);
        }
        ++begun;
        for (int tick = 0; tick < kTicksPerArm; ++tick) {
            const Violation violation = arm->tick(tick);
            run.addSteps(robot.description.size());
            ++ticks;
            if (!violation.what) continue;
            run.fail((robot.description.name + " at tick " + std::to_string(tick) + ": " + violation.what).c_str(),
                     violation.excess);
            break;
        }
        stopped += arm->stopped;
        missed += arm->missed;
        acting += arm->acting;
        moving += arm->moving;
        near += arm->near;
        stops += arm->stops;
        exempt += arm->exempt;
        unkept += arm->unkept;
        changes += arm->changes;
        jumps += arm->walkers().jumps;
        losses += arm->walkers().losses;
        appeared += arm->faults().appeared;
        faster += arm->faults().faster;
        lost += arm->faults().lost;
        least = std::min(least, arm->least);
    }
    run.print();
    run.expectShare("ticks in which people act", acting, ticks, 0.1);
    run.expectShare("ticks in which the arm moves", moving, ticks, 0.2);
    run.expectShare("ticks with somebody within 0.3 m of what is too fast to be touched", near, ticks, 0.01);
    run.expectShare("starts that are not refused", begun, begun + refused, 0.3);
    run.expectShare("ticks missed", missed, ticks, 0.001);
    run.expectShare("jumps that the filter named", faster, jumps, 0.05);
    run.expectShare("losses that the filter named", lost, losses, 0.5);
    std::printf(
        "  least gap to what was too fast to be touched: %.3g m; stops followed to their ends, everybody running at "
        "the "
        "tool: %lld; ticks on a backup stop: %.3g %%\n"
        "  jumps: %lld, losses: %lld, changes of limits: %lld; ticks not proven after a jump: %lld, not judged: %lld\n",
        least, static_cast<long long>(stops), 100.0 * static_cast<double>(stopped) / static_cast<double>(ticks),
        static_cast<long long>(jumps), static_cast<long long>(losses), static_cast<long long>(changes),
        static_cast<long long>(unkept), static_cast<long long>(exempt));
    return run.isGood();
}

}  // namespace viable
