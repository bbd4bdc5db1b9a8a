#include "experiment/NominalLoop.h"

#include "experiment/TrialTick.h"
#include "host/PythonClass.h"
#include "summary/Summary.h"

namespace viable::detail {

namespace {

/** Displacement of a joint [rad, m], and how long its decay is followed. */
constexpr double kDisplacement = 0.005, kFollowed_s = 20.0;
/** JointFollowing tells swings from 5 mrad on: here those that are half as large as the displacement. */
constexpr double kScale = 2.0;
/** A displacement that has grown so much has no rest to come to; one that has shrunk so much has come to it. */
constexpr double kGrown = 100.0, kRest = 1e-6;
/** RMS jerk over the last quarter, as a share of the limit, from which on it is none of a decay. */
constexpr double kChatter = 0.1;
/** Steps of the difference quotients [rad, rad/s]. */
constexpr double kPositionStep = 1e-6, kVelocityStep = 1e-4;

/** Accelerations of the nominal arm under its controller's torque. */
class Feedback {
public:
    explicit Feedback(const ConfiguredCase& configured)
        : start_(configured.plan.start.q),
          controller_(*configured.plugins.controller),
          watch_(configured.plugins.watches[static_cast<std::size_t>(PluginKind::NominalController)]),
          model_(configured.plan.robot) {
        command_.space = configured.plugins.command->traits().space;
        command_.q = start_;
        command_.qd.setZero(start_.size());
        command_.tool = configured.setup.startTool;
    }

    /** False: there is none to be had. */
    bool calc(const JointVector& q, const JointVector& qd, JointVector& qdd) {
        const JointVector still = JointVector::Zero(start_.size());
        resetPlugin(controller_, PluginKind::NominalController, watch_, {start_, still, still});
        model_.calcDynamics(q, qd, dynamics_);
        const MotionState nominal{q, qd, still};
        ControllerOutput output;
        const auto compute = [&] { return controller_.compute({command_, nominal, dynamics_}, output); };
        if (tryTick(PluginKind::NominalController, watch_, "compute", compute) != TickStatus::Ok) return false;
        return !output.hasAccelerationRate && isFinite(output.torque, static_cast<int>(q.size())) &&
               calcForwardDynamics(dynamics_, output.torque, qdd);
    }

    /** How much less acceleration comes of a larger position or velocity: column by column. */
    bool calcQuotients(JointMatrix& stiffness, JointMatrix& damping) {
        const Eigen::Index n = start_.size();
        stiffness.resize(n, n);
        damping.resize(n, n);
        const JointVector still = JointVector::Zero(n);
        JointVector more, less;
        for (Eigen::Index i = 0; i < n; ++i) {
            const JointVector axis = JointVector::Unit(n, i);
            if (!calc(start_ + kPositionStep * axis, still, more) || !calc(start_ - kPositionStep * axis, still, less))
                return false;
            stiffness.col(i) = (less - more) / (2.0 * kPositionStep);
            if (!calc(start_, kVelocityStep * axis, more) || !calc(start_, -kVelocityStep * axis, less)) return false;
            damping.col(i) = (less - more) / (2.0 * kVelocityStep);
        }
        return true;
    }

private:
    const JointVector start_;
    NominalController& controller_;
    PluginWatch* const watch_;
    RobotModel model_;
    Dynamics dynamics_;
    MotionCommand command_;
};

struct Loop {
    JointMatrix stiffness, damping;
    JointVector jerk, acceleration;  ///< limits to either side
    double gamma = 0.0;              ///< [1/s]; 0: the desired acceleration is taken at once
    double tick_s = 0.0;
};

/** The joint that a displacement of `displaced` does not die out in; -1: none. */
int findRestless(const Loop& loop, int displaced) {
    const auto n = static_cast<int>(loop.jerk.size());
    const double dt = loop.tick_s;
    const auto ticks = static_cast<std::int64_t>(kFollowed_s / dt), lastQuarter = 3 * ticks / 4;
    const JointVector still = JointVector::Zero(n);
    MotionState arm{kDisplacement * JointVector::Unit(n, displaced), still, still};
    JointVector squared = still;  // jerks
    const bool holdsJerk = loop.gamma > 0.0;
    DesiredJerk law;
    if (holdsJerk) law.configure(loop.gamma, dt);
    FilterDecision decision;
    std::vector<Following> following(static_cast<std::size_t>(n));
    for (std::int64_t k = 0; k < ticks; ++k) {
        const JointVector desired = -(loop.stiffness.lazyProduct(arm.q) + loop.damping.lazyProduct(arm.qd));
        if (holdsJerk) {
            law.calc(arm.qdd, desired, nullptr, decision.value);
            for (int i = 0; i < n; ++i) {
                const double most = loop.acceleration[i];
                double& jerk = decision.value[i];
                jerk = std::clamp(jerk, -loop.jerk[i], loop.jerk[i]);
                jerk = std::clamp(arm.qdd[i] + jerk * dt, -most, most) / dt - arm.qdd[i] / dt;
                if (k >= lastQuarter) squared[i] += jerk * jerk;
            }
        } else {
            decision.holdAcceleration(desired.cwiseMax(-loop.acceleration).cwiseMin(loop.acceleration));
        }
        advanceNominal(decision, dt, arm);
        for (int i = 0; i < n; ++i) {
            const Following::Point at(kScale * arm.q[i], 0.0, 0.0, 0.0);
            following[i].add(at, Following::Point::Zero(), at.norm(), {}, 0, dt);
        }
        Eigen::Index farthest = 0;
        const double size = arm.q.cwiseAbs().maxCoeff(&farthest);
        if (!(size < kGrown * kDisplacement)) return static_cast<int>(farthest);
        const bool rests = size < kRest * kDisplacement &&
                           (arm.qd.cwiseAbs().array() * dt < kRest * kDisplacement).all() &&
                           (arm.qdd.cwiseAbs().array() <= kRest * loop.acceleration.array().min(1.0)).all();
        if (rests) return -1;
    }
    int worst = -1;
    double most = 0.0;
    for (int i = 0; i < n; ++i) {
        const double swing = following[i].swing();
        if (swing > most) worst = i;
        most = std::max(most, swing);
    }
    if (worst >= 0) return worst;
    for (int i = 0; i < n; ++i) {
        const double share = std::sqrt(squared[i] / static_cast<double>(ticks - lastQuarter)) / loop.jerk[i];
        if (share > std::max(kChatter, most)) worst = i;
        most = std::max(most, share);
    }
    return worst;
}

}  // namespace

std::optional<NominalSwing> findNominalSwing(const ConfiguredCase& configured) {
    const RunSetup& setup = configured.setup;
    Loop loop;
    loop.tick_s = setup.tick_s;
    if (!Feedback(configured).calcQuotients(loop.stiffness, loop.damping)) return {};
    const auto findSmaller = [](const JointBounds& bounds) {
        return JointVector(bounds.upper.cwiseMin(-bounds.lower).cwiseMax(0.0));
    };
    loop.jerk = findSmaller(setup.limits.jerk);
    loop.acceleration = findSmaller(setup.limits.acceleration);
    for (const PluginChoice& filter : configured.plan.filters)
        if (const ConfigNode* gamma = filter.parameters.resolved().find("gamma"); gamma && !isPython(filter.plugin))
            loop.gamma = toNumber(*gamma);
    for (int i = 0; i < setup.size(); ++i) {
        const int joint = findRestless(loop, i);
        if (joint < 0) continue;
        NominalSwing swing{joint, loop.stiffness(joint, joint), loop.damping(joint, joint), false, loop.jerk[joint]};
        Loop unlimited = loop;
        unlimited.jerk.setConstant(kInfinity);
        unlimited.acceleration.setConstant(kInfinity);
        swing.needsJerk = std::isfinite(swing.jerk) && loop.gamma > 0.0 && findRestless(unlimited, i) < 0;
        return swing;
    }
    return {};
}

}  // namespace viable::detail
