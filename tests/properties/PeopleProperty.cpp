#include <cstdio>

#include "Properties.h"
#include "PushedArm.h"
#include "Walkers.h"
#include "limits/SeparationLimit.h"

namespace viable {

namespace {

constexpr int kTicksPerArm = 3000;
/** States that are judged in a tick: its beginning and some in it. */
constexpr int kLooks = 3;
/** One tick in so many has its whole stop judged. */
constexpr int kTicksPerStop = 50;
/** One tick in so many changes the joints' limits, on arms whose limits change. */
constexpr int kTicksPerChange = 300;
constexpr double kMoves = 0.02;  ///< [rad/s]

/** One arm among random people. */
class PeopleCase : public PushedArm {
public:
    PeopleCase(Robot& robot, Random& random) : PushedArm(robot, random) {
        const double jerk = random.logUniform(0.1, 10.0), acceleration = random.logUniform(0.3, 3.0);
        scaleLimits(jerk, acceleration);
        if (random.chance(0.3)) description_.speedLimits.arm = random.logUniform(0.1, 2.0);
        drawStart(0.2, 0.5, 0.0);
        drawOptions(0.2, 0.5);
        hasGeometry_ = random.chance(0.3);
        changes_ = random.chance(0.2);
        Walkers::Habits habits;
        if (random.chance(0.4)) habits.jumpChance = random.logUniform(1e-4, 3e-3);
        if (random.chance(0.3)) habits.loseChance = random.logUniform(1e-4, 3e-3);
        walkers_.emplace(random, habits, kTick_s);
    }

    bool begin() {
        peopleFeed_ = std::make_unique<PeopleFeed>(walkers_->people());
        see();
        if (!configure(kTicksPerArm, hasGeometry_ ? &robot_.geometry : nullptr)) return false;
        if (!filter_.traits().guarantees.has(LimitKind::Separation)) return false;
        checker_.emplace(description_, robot_.geometry, walkers_->people());
        return true;
    }

    /** One tick; what was wrong in it. */
    Violation tick(int number) {
        if (number > 0) see();
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        Violation violation;
        if (number > 0 && misses()) {
            followStop();
            violation = checkTick(*walkers_, state_, decision_.value, false);
        } else {
            if (changes_ && random_.integer(1, kTicksPerChange) == 1) changeLimits();
            violation = checkDecision();
        }
        moving += state_.qd.cwiseAbs().maxCoeff() > kMoves;
        advanceArm();
        walkers_->walk(dynamics_.tool.position);
        if (!violation.what && !hasChanged_) violation = checkLimits(state_, description_.limits, kAllowed);
        return violation;
    }

    std::int64_t moving = 0, near = 0, exempt = 0, unkept = 0, changes = 0;
    double least = kInfinity;  ///< gap to what was too fast to be touched
    const Walkers& walkers() const { return *walkers_; }
    const PeopleFaults& faults() const { return decision_.peopleFaults; }

private:
    void see() {
        walkers_->observe(seen_);
        peopleFeed_->put(seen_);
    }

    Violation checkDecision() {
        const FilterStatus status = decide();
        if (status > FilterStatus::Recovering) return {"no decision", 1.0};
        acting += acts(LimitKind::Separation);
        const LimitReport& told = decision_.reports[LimitKind::Separation];
        if (!told.isKnown) return {"the filter told no separation", 1.0};
        if (told.isKept)
            walkers_->forgive();
        else
            ++unkept;
        if (!told.isKept && status != FilterStatus::StoppedByPlan) return {"not braked although too near", 1.0};
        Violation violation = checkTorque(findTorque(state_, dynamics_, decision_));
        if (!violation.what) violation = checkTick(*walkers_, state_, decision_.value, true);
        if (violation.what || random_.integer(1, kTicksPerStop) != 1) return violation;
        Walkers running = *walkers_;  // all of them at the tool
        return checkStop([&](const MotionState& s, const Dynamics& dynamics, const FilterDecision& next) {
            running.run(dynamics.tool.position);
            const Violation found = checkTick(running, s, next.value, false);
            return found.what ? Violation{"somebody is touched too fast along a stop", found.excess} : found;
        });
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

    Violation checkTick(const Walkers& walkers, const MotionState& from, const JointVector& jerk, bool counts) {
        if (walkers_->hasUnseenJump() || walkers_->hasSeenJump()) {
            exempt += counts;
            return {};
        }
        double nearest = kInfinity;
        for (int k = 0; k < kLooks; ++k) {
            const double t = kTick_s * k / kLooks;
            const MotionState s = calcState(from, jerk, t);
            walkers.place(t, places_);
            const detail::SeparationLimit::Sample found = checker_->find(s.q, s.qd, places_, kNominalRest);
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

    std::optional<Walkers> walkers_;
    std::optional<detail::SeparationLimit> checker_;
    PeopleObservation seen_, places_;
    bool hasGeometry_ = false, changes_ = false, hasChanged_ = false;
};

}  // namespace

bool checkPeople(const Options& options) {
    Run run("people", options);
    PushedArms all;
    std::int64_t moving = 0, near = 0, exempt = 0, unkept = 0, jumps = 0, losses = 0, changes = 0, faster = 0, lost = 0;
    double least = kInfinity;
    all.push<PeopleCase>(run, kTicksPerArm, [&](const PeopleCase& arm) {
        moving += arm.moving;
        near += arm.near;
        exempt += arm.exempt;
        unkept += arm.unkept;
        changes += arm.changes;
        jumps += arm.walkers().jumps;
        losses += arm.walkers().losses;
        faster += arm.faults().faster;
        lost += arm.faults().lost;
        least = std::min(least, arm.least);
    });
    run.expectShare("ticks in which people act", all.acting, all.ticks, 0.1);
    run.expectShare("ticks in which the arm moves", moving, all.ticks, 0.2);
    run.expectShare("ticks with somebody within 0.3 m of what is too fast to be touched", near, all.ticks, 0.01);
    run.expectShare("starts that are not refused", all.begun, all.begun + all.refused, 0.3);
    run.expectShare("ticks missed", all.missed, all.ticks, 0.001);
    run.expectShare("jumps that the filter named", faster, jumps, 0.05);
    run.expectShare("losses that the filter named", lost, losses, 0.5);
    std::printf(
        "  least gap to what was too fast to be touched: %.3g m; stops followed to their ends, everybody running at "
        "the tool: %lld; ticks on a backup stop: %.3g %%\n"
        "  jumps: %lld, losses: %lld, changes of limits: %lld; ticks not proven after a jump: %lld, not judged: %lld\n",
        least, static_cast<long long>(all.stops), all.stoppedPercent(), static_cast<long long>(jumps),
        static_cast<long long>(losses), static_cast<long long>(changes), static_cast<long long>(unkept),
        static_cast<long long>(exempt));
    return run.isGood();
}

}  // namespace viable
