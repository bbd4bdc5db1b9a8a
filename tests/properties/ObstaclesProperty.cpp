#include <cstdio>

#include "Properties.h"
#include "PushedArm.h"
#include "environment/CollisionChecker.h"

namespace viable {

namespace {

constexpr int kTicksPerArm = 4000;
/** Poses that are judged in a tick where something is near; elsewhere its beginning. */
constexpr int kDensePoses = 10;
/** Nothing on an arm moves farther in a tick [m]: 10 m/s. */
constexpr double kFarthestInTick_m = 0.01;
/** One tick in so many has its whole stop judged. */
constexpr int kTicksPerStop = 200;
/** The judge's accuracy and rounding of poses [m]. */
constexpr double kAllowed_m = 1e-8;
constexpr double kHorizon_m = 0.15;

Eigen::Isometry3d drawPose(Random& random, double reach) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = random.uniform(0.25, 1.0) * reach * random.direction();
    pose.linear() = Eigen::AngleAxisd(random.uniform(0.0, kPi), random.direction()).toRotationMatrix();
    return pose;
}

/** One arm among obstacles. */
class ObstacleCase : public PushedArm {
public:
    ObstacleCase(Robot& robot, Random& random) : PushedArm(robot, random) {
        constexpr double kReach_m = 1.0;
        environment_.safetyDistance_m = random.logUniform(0.005, 0.05);
        const int solids = random.integer(2, 8);
        for (int k = 0; k < solids; ++k) environment_.solids.push_back(drawSolid(k, kReach_m));
        if (random.chance(0.6)) environment_.spheres.push_back(drawSphere(kReach_m));
        drawStart(0.3, 1.0, 3.0);
        drawOptions(0.5, 0.4);
        if (random.chance(0.5)) options_.joints.objective = Objective::Torque;
        if (random.chance(0.1))
            options_.torqueRate = JointVector(random.uniform(3.0, 30.0) * description_.actuation.torqueLimit);
        putsAgain_ = random.chance(0.2) ? random.logUniform(0.003, 1.0) : 0.0;
    }

    bool begin() {
        const Eigen::Vector3d far = Eigen::Vector3d::Constant(2.5);
        surroundings_ = std::make_shared<Surroundings>(environment_, -far, far, 0.5);
        surroundingsFeed_ = std::make_unique<SurroundingsFeed>(surroundings_);
        checker_ = std::make_unique<CollisionChecker>(description_, robot_.geometry, environment_);
        return configure(kTicksPerArm, &robot_.geometry);
    }

    /** One tick; what was wrong in it. */
    Violation tick(int number) {
        const double t = number * kTick_s;
        if (random_.chance(putsAgain_)) surroundingsFeed_->put(surroundings_, t);  // nothing has changed
        robot_.model.calcDynamics(state_.q, state_.qd, dynamics_);
        const bool isMissed = number > 0 && misses();
        if (isMissed)
            followStop();
        else if (decide() > FilterStatus::StoppedByPlan)
            return {"no decision", 1.0};
        const JointVector motors = findTorque(state_, dynamics_, decision_);
        Violation violation = checkTorque(motors);
        if (!violation.what) violation = checkTorqueChange(motors);
        if (!violation.what) violation = checkTick(state_, decision_.value, t);
        near += !isMissed && least_ < environment_.safetyDistance_m + 0.02;
        if (!violation.what && !isMissed && random_.integer(1, kTicksPerStop) == 1)
            violation =
                checkStop([&, at = t](const MotionState& s, const Dynamics& d, const FilterDecision& next) mutable {
                    const Violation found = checkTorque(findTorque(s, d, next));
                    return found.what ? found : checkTick(s, next.value, at += kTick_s);
                });
        advanceArm();
        return violation.what ? violation : checkLimits(state_, description_.limits, kAllowed);
    }

    std::int64_t near = 0;

private:
    Solid drawSolid(int k, double reach) {
        Solid solid;
        solid.name = "solid" + std::to_string(k);
        solid.pose = drawPose(random_, reach);
        using Kind = Solid::Kind;
        constexpr Kind kKinds[] = {Kind::Box, Kind::Sphere, Kind::Cylinder, Kind::HalfSpace};
        solid.kind = kKinds[random_.integer(0, 3)];
        if (solid.kind == Kind::Box) {
            for (double& edge : solid.size) edge = random_.logUniform(0.002, 0.8);  // also thin
        } else if (solid.kind == Kind::Sphere) {
            solid.radius = random_.logUniform(0.01, 0.3);
        } else if (solid.kind == Kind::Cylinder) {
            solid.radius = random_.logUniform(0.005, 0.2);
            solid.length = random_.logUniform(0.05, 1.5);
        } else {
            solid.pose.linear() =
                Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), -solid.pose.translation())
                    .toRotationMatrix();
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
            if (const Violation dense = checkPose(calcState(from, jerk, s).q, t + s); dense.what) return dense;
        }
        return {};
    }

    Violation checkTorqueChange(const JointVector& torque) {
        Violation violation;
        for (int i = 0; i < lastTorque_.size(); ++i) {  // none before the first tick
            const double change = std::abs(torque[i] - lastTorque_[i]), most = options_.torqueRate[i] * kTick_s;
            if (change > most * (1.0 + kAllowedTorque) + 1e-7) violation = {"torque changes too fast", change - most};
        }
        lastTorque_ = torque;
        return violation;
    }

    Environment environment_;
    std::shared_ptr<const Surroundings> surroundings_;
    std::unique_ptr<CollisionChecker> checker_;
    JointVector lastTorque_;
    double putsAgain_ = 0.0;  ///< share of ticks
    double least_ = 0.0;
};

}  // namespace

bool checkObstacles(const Options& options) {
    Run run("obstacles", options);
    PushedArms all;
    std::int64_t near = 0;
    all.push<ObstacleCase>(run, kTicksPerArm, [&](const ObstacleCase& arm) { near += arm.near; });
    run.expectShare("ticks within 2 cm of the safety distance", near, all.ticks, 0.05);
    run.expectShare("ticks as desired", all.passed, all.ticks, 0.002);
    run.expectShare("ticks missed", all.missed, all.ticks, 0.001);
    std::printf("  ticks on a backup stop: %.3g %%\n", all.stoppedPercent());
    return run.isGood();
}

}  // namespace viable
