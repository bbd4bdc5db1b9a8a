#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

#include "Properties.h"
#include "PushedArm.h"
#include "Random.h"
#include "environment/CollisionChecker.h"
#include "filter/WholeArmBrakingFilter.h"
#include "viable/core/Error.h"
#include "viable/environment/Surroundings.h"
#include "viable/loop/NominalPlant.h"

namespace viable {

namespace {

constexpr double kTick_s = 1e-3;
constexpr int kTicksPerArm = 4000;
/** Poses that are judged in a tick where something is near; elsewhere its beginning. */
constexpr int kDensePoses = 10;
/** Nothing on an arm moves farther in a tick [m]: 10 m/s. */
constexpr double kFarthestInTick_m = 0.01;
/** One tick in so many has its whole stop judged. */
constexpr int kTicksPerStop = 200;
/** The judge's accuracy and rounding of poses [m]; rounding of torques, as a share of their limits. */
constexpr double kAllowed_m = 1e-8, kAllowedTorque = 1e-8, kAllowedLimit = 1e-9;
constexpr double kHorizon_m = 0.15;

Eigen::Isometry3d drawPose(Random& random, double reach) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = random.uniform(0.25, 1.0) * reach * random.direction();
    pose.linear() = Eigen::AngleAxisd(random.uniform(0.0, kPi), random.direction()).toRotationMatrix();
    return pose;
}

/** One arm among obstacles, with its filter, and how it is pushed. */
class ObstacleCase {
public:
    ObstacleCase(Robot& robot, Random& random) : robot_(robot), random_(random) {
        const RobotDescription& d = robot.description;
        const int n = d.size();
        const double reach = 1.0;
        environment_.safetyDistance_m = random.logUniform(0.005, 0.05);
        const int solids = random.integer(2, 8);
        for (int k = 0; k < solids; ++k) environment_.solids.push_back(drawSolid(k, reach));
        if (random.chance(0.6)) environment_.spheres.push_back(drawSphere(reach));
        start_.q = d.home;
        start_.qd.setZero(n);
        start_.qdd.setZero(n);
        if (random.chance(0.7))
            for (int i = 0; i < n; ++i)
                start_.q[i] = random.uniform(std::max(d.limits.position.lower[i], -kPi),
                                             std::min(d.limits.position.upper[i], kPi));
        robot.model.calcDynamics(start_.q, start_.qd, dynamics_);
        options_.joints.kAlpha =
            random.chance(0.5) ? std::numeric_limits<double>::infinity() : random.logUniform(2.0, 500.0);
        options_.joints.gamma = random.logUniform(5.0, 500.0);
        options_.steers = random.chance(0.8);
        if (random.chance(0.5)) options_.torqueShare = random.uniform(0.4, 1.0);
        if (random.chance(0.1)) options_.torqueRate = JointVector(random.uniform(3.0, 30.0) * d.actuation.torqueLimit);
        if (random.chance(0.3)) {
            const double size = random.logUniform(0.01, 1.0);
            for (int i = 0; i < n; ++i) {
                start_.qd[i] = size * random.uniform(-1.0, 1.0);
                start_.qdd[i] = 3.0 * size * random.uniform(-1.0, 1.0);
            }
        }
        putsAgain_ = random.chance(0.2) ? random.logUniform(0.003, 1.0) : 0.0;
        misses_ = random.chance(0.3) ? random.logUniform(0.001, 0.1) : 0.0;
    }

    /** False: there is no such start. */
    bool begin() {
        const Eigen::Vector3d far = Eigen::Vector3d::Constant(2.5);
        surroundings_ = std::make_shared<Surroundings>(environment_, -far, far, 0.5);
        feed_ = std::make_unique<SurroundingsFeed>(surroundings_);
        const RobotDescription& d = robot_.description;
        setup_.emplace(RunSetup{d, d.limits, kTick_s, kTicksPerArm * kTick_s, start_, dynamics_.tool, &robot_.geometry,
                                feed_.get()});
        try {
            filter_.configure(*setup_, options_);
        } catch (const Error&) {
            return false;
        }
        checker_ = std::make_unique<CollisionChecker>(d, robot_.geometry, environment_);
        state_ = start_;
        torque_ = lastTorque_ = dynamics_.gravity;
        knowsTorque_ = false;
        return true;
    }

    /** One tick; what was wrong in it. */
    Violation tick(int number) {
        const double t = number * kTick_s;
        if (random_.chance(putsAgain_)) feed_->put(surroundings_, t);  // nothing has changed
        if (number > 0 && random_.chance(misses_)) return miss(t);
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        torque_ = dynamics_.M * pusher_.want(state_, dynamics_) + dynamics_.b;
        const FilterStatus status = filter_.filter({state_, torque_, dynamics_}, decision_);
        if (status == FilterStatus::Passed)
            ++passed;
        else if (status == FilterStatus::Modified)
            ++modified;
        else if (status == FilterStatus::StoppedByPlan)
            ++stopped;
        else
            return {"no decision", 1.0};
        const JointVector motors = findTorque(state_, dynamics_, decision_);
        Violation violation = checkTorque(motors);
        if (!violation.what) violation = checkTorqueChange(motors);
        if (!violation.what) violation = checkTick(state_, decision_.value, t);
        near += least_ < environment_.safetyDistance_m + 0.02;
        if (!violation.what && random_.integer(1, kTicksPerStop) == 1) violation = checkStop(t);
        advanceNominal(decision_, kTick_s, state_);
        if (!violation.what) violation = checkLimits(state_, robot_.description.limits, kAllowedLimit);
        return violation;
    }

    std::int64_t passed = 0, modified = 0, stopped = 0, near = 0, missed = 0;
    const RunSetup& setup() const { return *setup_; }

private:
    Solid drawSolid(int k, double reach) {
        Solid solid;
        solid.name = "solid" + std::to_string(k);
        solid.pose = drawPose(random_, reach);
        switch (random_.integer(0, 3)) {
            case 0:
                solid.kind = Solid::Kind::Box;
                for (double& edge : solid.size) edge = random_.logUniform(0.002, 0.8);  // also thin
                break;
            case 1:
                solid.kind = Solid::Kind::Sphere;
                solid.radius = random_.logUniform(0.01, 0.3);
                break;
            case 2:
                solid.kind = Solid::Kind::Cylinder;
                solid.radius = random_.logUniform(0.005, 0.2);
                solid.length = random_.logUniform(0.05, 1.5);
                break;
            default:
                solid.kind = Solid::Kind::HalfSpace;
                solid.pose.linear() =
                    Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -solid.pose.translation())
                        .toRotationMatrix();
                break;
        }
        return solid;
    }

    MovingSphere drawSphere(double reach) {
        MovingSphere sphere;
        sphere.name = "ball";
        sphere.radius = random_.uniform(0.03, 0.15);
        sphere.repeats = random_.chance(0.5);
        const int waypoints = random_.integer(2, 4);
        double t = random_.uniform(0.0, 1.0);
        for (int k = 0; k < waypoints; ++k) {
            sphere.waypoints.push_back({t, drawPose(random_, 1.2 * reach).translation()});
            t += random_.logUniform(0.1, 3.0);
        }
        if (sphere.repeats) sphere.waypoints.back().position = sphere.waypoints.front().position;
        return sphere;
    }

    Violation checkPose(const JointVector& q, double t) {
        const double distance = checker_->findContact(q, t, kHorizon_m).distance;
        least_ = std::min(least_, distance);
        const double missing = environment_.safetyDistance_m - distance;
        return missing > kAllowed_m ? Violation{"nearer than the safety distance", missing} : Violation{};
    }

    Violation checkTick(const MotionState& from, const JointVector& jerk, double t) {
        least_ = kHorizon_m;
        const Violation violation = checkPose(from.q, t);
        if (violation.what || least_ > environment_.safetyDistance_m + kFarthestInTick_m) return violation;
        for (int k = 1; k < kDensePoses; ++k) {
            const double s = kTick_s * k / kDensePoses;
            JointVector q(from.q.size());
            for (Eigen::Index i = 0; i < q.size(); ++i)
                q[i] = advance({from.q[i], from.qd[i], from.qdd[i]}, jerk[i], s).p;
            if (const Violation dense = checkPose(q, t + s); dense.what) return dense;
        }
        return {};
    }

    /** A tick in which the filter is not asked: the arm goes on along its stop. */
    Violation miss(double t) {
        ++missed;
        JointVector jerk(state_.q.size());
        for (Eigen::Index i = 0; i < jerk.size(); ++i) jerk[i] = decision_.stops[static_cast<std::size_t>(i)].popJerk();
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        const std::array<GridStop, kMaxJoints> stops = decision_.stops;
        decision_.holdJerk(jerk);
        decision_.stops = stops;
        filter_.skipTicks(1);
        const JointVector motors = findTorque(state_, dynamics_, decision_);
        Violation violation = checkTorque(motors);
        if (!violation.what) violation = checkTorqueChange(motors);
        if (!violation.what) violation = checkTick(state_, jerk, t);
        advanceNominal(decision_, kTick_s, state_);
        return violation.what ? violation : checkLimits(state_, robot_.description.limits, kAllowedLimit);
    }

    static JointVector findTorque(const MotionState& state, const Dynamics& dynamics, const FilterDecision& decision) {
        HeldMotion motion;
        calcHeldMotion({state, dynamics.gravity, dynamics}, FilterStatus::Modified, decision, kTick_s, motion);
        return motion.torque;
    }

    Violation checkTorqueChange(const JointVector& torque) {
        Violation violation;
        for (int i = 0; knowsTorque_ && i < torque.size(); ++i) {
            const double change = std::abs(torque[i] - lastTorque_[i]);
            const double most = options_.torqueRate[i] * kTick_s;
            if (change > most * (1.0 + kAllowedTorque) + 1e-7) violation = {"torque changes too fast", change - most};
        }
        lastTorque_ = torque;
        knowsTorque_ = true;
        return violation;
    }

    Violation checkTorque(const JointVector& torque) const {
        for (Eigen::Index i = 0; i < torque.size(); ++i) {
            const double limit = options_.torqueShare * robot_.description.actuation.torqueLimit[i];
            if (std::abs(torque[i]) > limit * (1.0 + kAllowedTorque))
                return {"torque beyond its limit", std::abs(torque[i]) - limit};
        }
        return {};
    }

    /** The stop of this tick's decision, followed to its end. */
    Violation checkStop(double t) {
        MotionState s = state_;
        advanceNominal(decision_, kTick_s, s);
        std::array<GridStop, kMaxJoints> stops = decision_.stops;
        const int n = static_cast<int>(s.q.size());
        for (bool moves = true; moves;) {
            t += kTick_s;
            FilterDecision next;
            JointVector jerk(n);
            moves = false;
            for (int i = 0; i < n; ++i) {
                moves |= !stops[static_cast<std::size_t>(i)].atRest();
                jerk[i] = stops[static_cast<std::size_t>(i)].popJerk();
            }
            Dynamics dynamics;
            robot_.model.calcDynamics(s.q, s.qd, dynamics);
            next.holdJerk(jerk);
            if (const Violation violation = checkTorque(findTorque(s, dynamics, next)); violation.what)
                return violation;
            if (const Violation violation = checkTick(s, jerk, t); violation.what) return violation;
            advanceNominal(next, kTick_s, s);
        }
        return {};
    }

    Robot& robot_;
    Random& random_;
    Pusher pusher_{random_};
    Environment environment_;
    WholeArmBrakingOptions options_;
    std::shared_ptr<const Surroundings> surroundings_;
    std::unique_ptr<SurroundingsFeed> feed_;
    std::unique_ptr<CollisionChecker> checker_;
    std::optional<RunSetup> setup_;
    WholeArmBrakingFilter filter_;
    MotionState start_, state_;
    Dynamics dynamics_;
    FilterDecision decision_;
    JointVector torque_, lastTorque_;
    bool knowsTorque_ = false;
    double putsAgain_ = 0.0, misses_ = 0.0;  ///< share of ticks
    double least_ = 0.0;
};

}  // namespace

bool checkObstacles(const Options& options) {
    Robot robots[] = {Robot("indy7"), Robot("panda"), Robot("ur5e")};
    Run run("obstacles", options);
    std::int64_t ticks = 0, near = 0, passed = 0, stopped = 0, missed = 0;
    while (run.nextArm()) {
        Random random(run.seed(), run.arm());
        Robot& robot = robots[random.integer(0, 2)];
        std::unique_ptr<ObstacleCase> arm;
        do arm = std::make_unique<ObstacleCase>(robot, random);
        while (!arm->begin());
        for (int tick = 0; tick < kTicksPerArm; ++tick) {
            const Violation violation = arm->tick(tick);
            run.addSteps(robot.description.size());
            ++ticks;
            if (!violation.what) continue;
            run.fail((robot.description.name + " at tick " + std::to_string(tick) + ": " + violation.what).c_str(),
                     violation.excess);
            break;
        }
        near += arm->near;
        passed += arm->passed;
        stopped += arm->stopped;
        missed += arm->missed;
    }
    run.print();
    run.expectShare("ticks within 2 cm of the safety distance", near, ticks, 0.05);
    run.expectShare("ticks as desired", passed, ticks, 0.002);
    run.expectShare("ticks missed", missed, ticks, 0.001);
    std::printf("  ticks on a backup stop: %.3g %%\n",
                100.0 * static_cast<double>(stopped) / static_cast<double>(ticks));
    return run.isGood();
}

}  // namespace viable
