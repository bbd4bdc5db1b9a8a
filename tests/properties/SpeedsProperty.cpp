#include <cstdio>

#include "Properties.h"
#include "PushedArm.h"
#include "limits/PointSpeedLimit.h"

namespace viable {

namespace {

constexpr int kTicksPerArm = 3000;
/** States that are judged in a tick: its beginning and some in it. */
constexpr int kLooks = 3;
/** One tick in so many has its whole stop judged. */
constexpr int kTicksPerStop = 50;

/** One arm with random limits of its points. */
class SpeedCase : public PushedArm {
public:
    SpeedCase(Robot& robot, Random& random) : PushedArm(robot, random) {
        const double jerk = random.logUniform(0.03, 3.0), acceleration = random.logUniform(0.1, 3.0);
        scaleLimits(jerk, acceleration);
        SpeedLimits& speeds = description_.speedLimits;
        if (random.chance(0.8)) speeds.arm = random.logUniform(0.02, 2.0);
        if (random.chance(0.3)) speeds.tool = random.logUniform(0.02, 2.0);
        const int regions = random.chance(0.5) ? random.integer(1, 2) : 0;
        for (int k = 0; k < regions; ++k) {
            const Eigen::Vector3d centre = random.uniform(0.3, 1.0) * random.direction();
            const Eigen::Vector3d half(random.logUniform(0.05, 0.6), random.logUniform(0.05, 0.6),
                                       random.logUniform(0.05, 0.6));
            speeds.regions.push_back(
                {"region" + std::to_string(k), centre - half, centre + half, random.logUniform(0.02, 0.5)});
        }
        if (!speeds.isAny()) speeds.arm = 0.25;
        drawStart(0.3, 1.0, 3.0);
        drawOptions(0.3, 0.5);
        hasGeometry_ = random.chance(0.5);
    }

    bool begin() {
        checker_.emplace(description_, &robot_.geometry);
        return configure(kTicksPerArm, hasGeometry_ ? &robot_.geometry : nullptr);
    }

    /** One tick; what was wrong in it. */
    Violation tick(int number) {
        const bool isMissed = number > 0 && misses();
        Violation violation;
        if (isMissed) {
            followStop();
            violation = checkTick(state_, decision_.value);
        } else {
            robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
            violation = checkDecision();
        }
        advanceArm();
        return violation.what ? violation : checkLimits(state_, description_.limits, kAllowed);
    }

    std::int64_t atLimit = 0;
    double worst = 0.0;  ///< largest share of a limit

private:
    Violation checkDecision() {
        if (decide() > FilterStatus::StoppedByPlan) return {"no decision", 1.0};
        const bool isActing = acts(LimitKind::Speed);
        acting += isActing;
        use_ = 0.0;
        Violation violation = checkTorque(findTorque(state_, dynamics_, decision_));
        if (!violation.what) violation = checkTick(state_, decision_.value);
        atLimit += isActing && use_ > 0.9;
        // What the filter tells is true of the tick.
        const LimitReport& told = decision_.reports[LimitKind::Speed];
        if (!violation.what && !told.isKnown) violation = {"the filter told no speed", 1.0};
        if (!violation.what && use_ > told.value / told.limit + kAllowed)
            violation = {"the filter told less than there was", use_};
        if (violation.what || random_.integer(1, kTicksPerStop) != 1) return violation;
        return checkStop([&](const MotionState& s, const Dynamics&, const FilterDecision& next) {
            const Violation found = checkTick(s, next.value);
            return found.what ? Violation{"a point is too fast along a stop", found.excess} : found;
        });
    }

    Violation checkTick(const MotionState& from, const JointVector& jerk) {
        for (int k = 0; k < kLooks; ++k) {
            const MotionState s = calcState(from, jerk, kTick_s * k / kLooks);
            const double use = checker_->find(s.q, s.qd).use;
            use_ = std::max(use_, use);
            worst = std::max(worst, use);
            if (use > 1.0 + kAllowed) return {"a point is too fast", use - 1.0};
        }
        return {};
    }

    std::optional<detail::PointSpeedLimit> checker_;
    double use_ = 0.0;
    bool hasGeometry_ = false;
};

}  // namespace

bool checkSpeeds(const Options& options) {
    Run run("speeds", options);
    PushedArms all;
    std::int64_t atLimit = 0;
    double worst = 0.0;
    all.push<SpeedCase>(run, kTicksPerArm, [&](const SpeedCase& arm) {
        atLimit += arm.atLimit;
        worst = std::max(worst, arm.worst);
    });
    run.expectShare("ticks in which a speed limit acts", all.acting, all.ticks, 0.2);
    run.expectShare("of these above 90 % of it", atLimit, all.acting, 0.5);
    run.expectShare("ticks as desired", all.passed, all.ticks, 0.002);
    run.expectShare("starts that are not refused", all.begun, all.begun + all.refused, 0.3);
    run.expectShare("ticks missed", all.missed, all.ticks, 0.001);
    std::printf(
        "  largest share of a limit: 1 %+.2g; stops followed to their ends: %lld; ticks on a backup stop: %.3g %%\n",
        worst - 1.0, static_cast<long long>(all.stops), all.stoppedPercent());
    return run.isGood();
}

}  // namespace viable
