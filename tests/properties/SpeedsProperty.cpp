#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "Properties.h"
#include "PushedArm.h"
#include "Random.h"
#include "filter/WholeArmBrakingFilter.h"
#include "limits/PointSpeedLimit.h"
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
/** Rounding, as a share of a limit. */
constexpr double kAllowed = 1e-9, kAllowedTorque = 1e-8;

/** One arm with random limits of its joints and of its points, its filter, and how it is pushed. */
class SpeedCase {
public:
    SpeedCase(Robot& robot, Random& random) : robot_(robot), random_(random), description_(robot.description) {
        const int n = description_.size();
        JointLimits& limits = description_.limits;
        const double jerk = random.logUniform(0.03, 3.0), acceleration = random.logUniform(0.1, 3.0);
        for (double side : {0.0, 1.0}) {
            (side > 0.0 ? limits.jerk.upper : limits.jerk.lower) *= jerk;
            (side > 0.0 ? limits.acceleration.upper : limits.acceleration.lower) *= acceleration;
        }
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
        state_.q = description_.home;
        state_.qd.setZero(n);
        state_.qdd.setZero(n);
        if (random.chance(0.7))
            for (int i = 0; i < n; ++i)
                state_.q[i] =
                    random.uniform(std::max(limits.position.lower[i], -kPi), std::min(limits.position.upper[i], kPi));
        if (random.chance(0.3)) {
            const double size = random.logUniform(0.01, 1.0);
            for (int i = 0; i < n; ++i) {
                state_.qd[i] = size * random.uniform(-1.0, 1.0);
                state_.qdd[i] = 3.0 * size * random.uniform(-1.0, 1.0);
            }
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
        if (random.chance(0.3)) options_.torqueShare = random.uniform(0.5, 1.0);
        misses_ = random.chance(0.3) ? random.logUniform(0.001, 0.1) : 0.0;
        hasGeometry_ = random.chance(0.5);
    }

    /** False: there is no such start. */
    bool begin() {
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        setup_.emplace(RunSetup{description_, description_.limits, kTick_s, kTicksPerArm * kTick_s, state_,
                                dynamics_.tool, hasGeometry_ ? &robot_.geometry : nullptr});
        try {
            filter_.configure(*setup_, options_);
        } catch (const Error&) {
            isRefusedAtRest = state_.qd.isZero(0.0) && !hasGeometry_ && std::isinf(options_.torqueShare);
            return false;
        }
        checker_.emplace(description_, &robot_.geometry);
        torque_ = dynamics_.gravity;
        return true;
    }

    /** One tick; what was wrong in it. */
    Violation tick(int number) {
        if (number > 0 && random_.chance(misses_)) return miss();
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        torque_ = dynamics_.M * pusher_.want(state_, dynamics_) + dynamics_.b;
        const FilterStatus status = filter_.filter({state_, torque_, dynamics_}, decision_);
        passed += status == FilterStatus::Passed;
        stopped += status == FilterStatus::StoppedByPlan;
        if (status > FilterStatus::StoppedByPlan) return {"no decision", 1.0};
        bool acts = false;
        for (int i = 0; i < description_.size(); ++i) acts |= decision_.joints[i].limit == LimitKind::Speed;
        acting += acts;
        use_ = 0.0;
        Violation violation = checkTorque(decision_);
        if (!violation.what) violation = checkTick(state_, decision_.value);
        atLimit += acts && use_ > 0.9;
        // What the filter tells is true of the tick.
        if (!violation.what && !decision_.reports[LimitKind::Speed].isKnown)
            violation = {"the filter told no speed", 1.0};
        if (!violation.what &&
            use_ > decision_.reports[LimitKind::Speed].value / decision_.reports[LimitKind::Speed].limit + kAllowed)
            violation = {"the filter told less than there was", use_};
        if (!violation.what && random_.integer(1, kTicksPerStop) == 1) violation = checkStop();
        advanceNominal(decision_, kTick_s, state_);
        if (!violation.what) violation = checkLimits(state_, description_.limits, kAllowed);
        return violation;
    }

    std::int64_t passed = 0, stopped = 0, missed = 0, acting = 0, atLimit = 0, stops = 0;
    double worst = 0.0;            ///< largest share of a limit
    bool isRefusedAtRest = false;  ///< a start in which nothing moves and nothing else was in its way
    const RobotDescription& robot() const { return description_; }

private:
    /** Changes its mind now and then: to and fro, towards a pose, at random, or the tool along a direction. */
    Violation checkTick(const MotionState& from, const JointVector& jerk) {
        for (int k = 0; k < kLooks; ++k) {
            JointVector q(from.q.size()), qd(from.q.size());
            for (Eigen::Index i = 0; i < q.size(); ++i) {
                const AxisState s = advance({from.q[i], from.qd[i], from.qdd[i]}, jerk[i], kTick_s * k / kLooks);
                q[i] = s.p;
                qd[i] = s.v;
            }
            const double use = checker_->find(q, qd).use;
            use_ = std::max(use_, use);
            worst = std::max(worst, use);
            if (use > 1.0 + kAllowed) return {"a point is too fast", use - 1.0};
        }
        return {};
    }

    /** A tick in which the filter is not asked: the arm goes on along its stop. */
    Violation miss() {
        ++missed;
        JointVector jerk(state_.q.size());
        for (Eigen::Index i = 0; i < jerk.size(); ++i) jerk[i] = decision_.stops[static_cast<std::size_t>(i)].popJerk();
        decision_.holdJerk(jerk);
        filter_.skipTicks(1);
        const Violation violation = checkTick(state_, jerk);
        advanceNominal(decision_, kTick_s, state_);
        return violation.what ? violation : checkLimits(state_, description_.limits, kAllowed);
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

    /** The stop of this tick's decision, followed to its end. */
    Violation checkStop() {
        ++stops;
        MotionState s = state_;
        advanceNominal(decision_, kTick_s, s);
        std::array<GridStop, kMaxJoints> left = decision_.stops;
        FilterDecision next;
        JointVector jerk(s.q.size());
        for (bool moves = true; moves;) {
            moves = false;
            for (std::size_t i = 0; i < static_cast<std::size_t>(jerk.size()); ++i) {
                moves |= !left[i].atRest();
                jerk[static_cast<Eigen::Index>(i)] = left[i].popJerk();
            }
            next.holdJerk(jerk);
            if (Violation violation = checkTick(s, jerk); violation.what) {
                violation.what = "a point is too fast along a stop";
                return violation;
            }
            advanceNominal(next, kTick_s, s);
        }
        return {};
    }

    Robot& robot_;
    Random& random_;
    Pusher pusher_{random_};
    RobotDescription description_;
    WholeArmBrakingOptions options_;
    std::optional<RunSetup> setup_;
    std::optional<detail::PointSpeedLimit> checker_;
    WholeArmBrakingFilter filter_;
    MotionState state_;
    Dynamics dynamics_;
    FilterDecision decision_;
    JointVector torque_;
    double misses_ = 0.0, use_ = 0.0;
    bool hasGeometry_ = false;
};

}  // namespace

bool checkSpeeds(const Options& options) {
    Robot robots[] = {Robot("indy7"), Robot("panda"), Robot("ur5e")};
    Run run("speeds", options);
    std::int64_t ticks = 0, passed = 0, stopped = 0, missed = 0, acting = 0, atLimit = 0, stops = 0, begun = 0,
                 refused = 0;
    double worst = 0.0;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        Robot& robot = robots[random.integer(0, 2)];
        std::unique_ptr<SpeedCase> arm;
        while (true) {
            arm = std::make_unique<SpeedCase>(robot, random);
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
        passed += arm->passed;
        stopped += arm->stopped;
        missed += arm->missed;
        acting += arm->acting;
        atLimit += arm->atLimit;
        stops += arm->stops;
        worst = std::max(worst, arm->worst);
    }
    run.print();
    run.expectShare("ticks in which a speed limit acts", acting, ticks, 0.2);
    run.expectShare("of these above 90 % of it", atLimit, acting, 0.5);
    run.expectShare("ticks as desired", passed, ticks, 0.002);
    run.expectShare("starts that are not refused", begun, begun + refused, 0.3);
    run.expectShare("ticks missed", missed, ticks, 0.001);
    std::printf(
        "  largest share of a limit: 1 %+.2g; stops followed to their ends: %lld; ticks on a backup stop: %.3g %%\n",
        worst - 1.0, static_cast<long long>(stops), 100.0 * static_cast<double>(stopped) / static_cast<double>(ticks));
    return run.isGood();
}

}  // namespace viable
