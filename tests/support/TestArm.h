#pragma once

#include <algorithm>
#include <cmath>
#include <random>

#include "Complaint.h"
#include "Paths.h"
#include "host/PluginLoader.h"
#include "viable/loop/NominalPlant.h"
#include "viable/robot/RobotModel.h"

namespace viable {

/** The plugin `name` as the program finds it: its library, its declaration. */
inline PluginInfo findPlugin(PluginKind kind, const std::string& name) {
    static const PluginLoader loader({VIABLE_PLUGIN_DIR});
    return loader.find(kind, name, "test", {});
}

/** A robot of the project with all that a plugin is told before a run. Change the public members
before setup() is called; the plugin's RunSetup refers to this object. */
class TestArm {
public:
    /** @param name  folder in robots/ */
    explicit TestArm(const std::string& name, double tickLength_s = 1e-3)
        : robot(loadRobot(std::string(VIABLE_SOURCE_DIR "/robots/") + name)),
          limits(robot.limits),
          tick_s(tickLength_s),
          model_(robot) {
        start.q = robot.home;
        start.qd.setZero(robot.size());
        start.qdd.setZero(robot.size());
    }
    TestArm(const TestArm&) = delete;
    TestArm& operator=(const TestArm&) = delete;

    int size() const { return robot.size(); }

    RunSetup setup() { return {robot, limits, tick_s, 30.0, start, calcDynamics(start.q, start.qd).tool}; }

    /** Of the robot as it was loaded, or since the last rebuildModel(). */
    Dynamics calcDynamics(const JointVector& q, const JointVector& qd) {
        Dynamics dynamics;
        model_.calcDynamics(q, qd, dynamics);
        return dynamics;
    }
    Dynamics calcDynamics(const MotionState& state) { return calcDynamics(state.q, state.qd); }

    RobotModel& model() { return model_; }
    /** To be called after `robot` was changed. */
    void rebuildModel() { model_ = RobotModel(robot); }

    /** Parameters from the inside of a flow map, `gamma: 20, k_alpha: 5`, by the declaration that
    the plugin's library shows. */
    Parameters read(PluginKind kind, const std::string& name, const std::string& text) const {
        const PluginInfo info = findPlugin(kind, name);
        const ConfigNode root = parseConfig("plugin_block: {" + text + "}\n", "experiment.yaml");
        return readParameters(*root.find("plugin_block"), info.entry->parameters, info.entry->parameterCount, size());
    }

    /** Configured by such parameters, and reset. */
    void configure(Plugin& plugin, PluginKind kind, const std::string& name, const std::string& text = "") {
        plugin.configure(setup(), read(kind, name, text));
        plugin.reset(start);
    }
    /** The library's own object, likewise. */
    template <class Interface>
    PluginPtr<Interface> load(PluginKind kind, const std::string& name, const std::string& text = "") {
        PluginPtr<Interface> plugin = PluginLoader::create<Interface>(findPlugin(kind, name));
        configure(*plugin, kind, name, text);
        return plugin;
    }

    RobotDescription robot;
    JointLimits limits;
    double tick_s;
    MotionState start;

private:
    RobotModel model_;
};

using test::expectContains;
using test::expectError;
using test::findComplaint;

/** The limits of the paper's teleoperation experiment (30), for the robot indy7. */
inline void setPaperLimits(TestArm& arm) {
    const auto both = [](double x) { return JointBounds{JointVector::Constant(6, -x), JointVector::Constant(6, x)}; };
    arm.limits.velocity = both(2 * kPi / 3);
    arm.limits.acceleration = both(4 * kPi);
    arm.limits.jerk = both(12 * kPi);
    JointVector range(6);
    range << kPi / 6, kPi / 12, kPi / 6, kPi / 12, kPi / 6, kPi / 3;
    arm.limits.position = {arm.robot.home - range, arm.robot.home + range};
}

inline JointVector makeRandomVector(int n, double size, std::mt19937& random) {
    std::uniform_real_distribution<double> number(-size, size);
    JointVector v(n);
    for (int i = 0; i < n; ++i) v[i] = number(random);
    return v;
}

/** A state near the start of an arm: each number differs by up to these. */
inline MotionState makeRandomState(const TestArm& arm, double q, double qd, double qdd, std::mt19937& random) {
    const int n = arm.size();
    return {arm.start.q + makeRandomVector(n, q, random), makeRandomVector(n, qd, random),
            makeRandomVector(n, qdd, random)};
}

/** Dynamics of `n` unit masses that know nothing of each other: tau = qdd. */
inline Dynamics makeUnitDynamics(int n) {
    Dynamics dynamics;
    dynamics.M.setIdentity(n, n);
    dynamics.b.setZero(n);
    dynamics.gravity.setZero(n);
    dynamics.J.setZero(6, n);
    return dynamics;
}

/** Moves an arm through one tick of this jerk. */
inline void advanceArm(MotionState& state, const JointVector& jerk, double tick_s) {
    for (int i = 0; i < state.q.size(); ++i) {
        const AxisState next = advance({state.q[i], state.qd[i], state.qdd[i]}, jerk[i], tick_s);
        state.q[i] = next.p, state.qd[i] = next.v, state.qdd[i] = next.a;
    }
}

/** The jerk of a decision for a tick that begins with the acceleration `qdd`. */
inline JointVector calcJerk(const FilterDecision& decision, const JointVector& qdd, double tick_s) {
    return decision.held == HeldQuantity::Jerk ? decision.value : JointVector((decision.value - qdd) / tick_s);
}

/** The torque that the host makes of a decision. */
inline JointVector calcTorque(const FilterInput& input, FilterStatus status, const FilterDecision& decision,
                              double tick_s = 1e-3) {
    HeldMotion motion;
    calcHeldMotion(input, status, decision, tick_s, motion);
    return motion.torque;
}

/** How far outside each limit a nominal motion came, largest over joints and ticks; 0: never.
Velocity, acceleration and jerk relative to max(1, limit); position in rad. */
struct LimitExcess {
    double position = 0.0;
    double velocity = 0.0;
    double acceleration = 0.0;
    double jerk = 0.0;

    /** @param after  the nominal state at the end of the tick */
    void observe(const JointVector& heldJerk, const MotionState& after, const JointLimits& limits) {
        for (int i = 0; i < limits.size(); ++i) {
            const AxisLimits l = limits.axis(i);
            keep(position, after.q[i] - l.positionUpper);
            keep(position, l.positionLower - after.q[i]);
            keepRelative(velocity, after.qd[i], l.velocityLower, l.velocityUpper);
            keepRelative(acceleration, after.qdd[i], l.accelerationLower, l.accelerationUpper);
            keepRelative(jerk, heldJerk[i], l.jerkLower, l.jerkUpper);
        }
    }

private:
    // A NaN counts as infinitely far outside.
    static void keep(double& worst, double excess) {
        if (std::isnan(excess)) worst = kInfinity;
        worst = std::max(worst, excess);
    }
    static void keepRelative(double& worst, double value, double lower, double upper) {
        if (std::isfinite(upper)) keep(worst, (value - upper) / std::max(1.0, upper));
        if (std::isfinite(lower)) keep(worst, (lower - value) / std::max(1.0, -lower));
        if (!std::isfinite(value)) keep(worst, kInfinity);
    }
};

/** Desired accelerations that push at the limits: each joint holds a value for a random number of
ticks, then takes another; `bangBang` only the two extremes. */
class PushingCommand {
public:
    PushingCommand(int n, double size, bool bangBang, unsigned seed) : size_(size), bangBang_(bangBang), random_(seed) {
        value_.setZero(n);
        left_.setZero(n);
    }

    const JointVector& next() {
        for (int i = 0; i < value_.size(); ++i) {
            if (left_[i] <= 0.0) {
                left_[i] = std::uniform_int_distribution<int>(1, 2000)(random_);
                const double x = std::uniform_real_distribution<double>(-size_, size_)(random_);
                value_[i] = bangBang_ ? std::copysign(size_, x) : x;
            }
            left_[i] -= 1.0;
        }
        return value_;
    }

private:
    double size_;
    bool bangBang_;
    std::mt19937 random_;
    JointVector value_, left_;
};

/** Huge, tiny and alternating torques [Nm], 20000 ticks of them. */
class AbsurdTorques {
public:
    static constexpr int kTicks = 20000;
    explicit AbsurdTorques(int n) : torque_(n) {}

    const JointVector& next() {
        const double sizes[] = {1e300, std::numeric_limits<double>::max(), std::numeric_limits<double>::denorm_min(),
                                1e150};
        for (int i = 0; i < torque_.size(); ++i)
            torque_[i] = sizes[(tick_ / 1000 + i) % 4] * ((tick_ + i) % 2 ? 1.0 : -1.0) *
                         ((tick_ / 500) % 2 && random_() % 2 ? -1.0 : 1.0);
        ++tick_;
        return torque_;
    }

private:
    std::mt19937 random_{6};
    int tick_ = 0;
    JointVector torque_;
};

/** The torques of joint_pd for set points that jump from one side of the home pose to the other every two seconds. */
class JumpingSetPoint {
public:
    /** @param size  [rad] */
    JumpingSetPoint(TestArm& arm, double size)
        : home_(arm.robot.home),
          size_(size),
          controller_(arm.load<NominalController>(PluginKind::NominalController, "joint_pd")) {}

    JointVector next(const MotionState& nominal, const Dynamics& dynamics) {
        MotionCommand command;
        const double side = (tick_++ / 2000) % 2 ? -1.0 : 1.0;
        command.q = home_ + JointVector::Constant(home_.size(), side * size_);
        command.qd.setZero(home_.size());
        ControllerOutput output;
        EXPECT_EQ(controller_->compute({command, nominal, dynamics}, output), TickStatus::Ok);
        return output.torque;
    }

private:
    JointVector home_;
    double size_;
    int tick_ = 0;
    PluginPtr<NominalController> controller_;
};

/** After reset() a configured filter answers 2000 pushing ticks as it did before. */
inline void expectSameAnswersAfterReset(SafetyFilter& filter, TestArm& arm) {
    const auto play = [&] {
        filter.reset(arm.start);
        MotionState state = arm.start;
        PushingCommand push(arm.size(), 40.0, true, 9);
        FilterDecision decision;
        for (int k = 0; k < 2000; ++k) {
            const Dynamics dynamics = arm.calcDynamics(state);
            JointVector torque;
            calcInverseDynamics(dynamics, push.next(), torque);
            filter.filter({state, torque, dynamics}, decision);
            advanceNominal(decision, arm.tick_s, state);
        }
        return state;
    };
    const MotionState first = play(), second = play();
    EXPECT_EQ(first.q, second.q);
    EXPECT_EQ(first.qdd, second.qdd);
}

/** Inputs that are not finite or of the wrong size, and an inertia that cannot be, are refused. They change neither the
decision nor the filter's next answer, before its first good tick or behind it.
@param make  gives a filter, configured and reset */
template <class Make>
void expectNoTraceOfBadInput(TestArm& arm, Make make) {
    const int n = arm.size();
    const Dynamics dynamics = arm.calcDynamics(arm.start);
    const JointVector& torque = dynamics.gravity;
    const auto play = [&](bool hasBegun, bool disturbed) {
        const auto filter = make();
        FilterDecision decision;
        decision.value.setConstant(n, 123.25);
        if (hasBegun) filter->filter({arm.start, torque, dynamics}, decision);
        const JointVector before = decision.value;
        const bool hadStops = decision.hasStops;
        const auto expectRefused = [&](const MotionState& s, const JointVector& tau, const Dynamics& d,
                                       FilterStatus status = FilterStatus::InvalidInput) {
            EXPECT_EQ(filter->filter({s, tau, d}, decision), status);
            EXPECT_EQ(decision.value, before);
            EXPECT_EQ(decision.hasStops, hadStops);
        };
        if (disturbed) {
            for (const double bad : {kNan, kInfinity, -kInfinity}) {
                JointVector badTorque = torque;
                badTorque[n / 2] = bad;
                expectRefused(arm.start, badTorque, dynamics);
                expectRefused(arm.start, JointVector::Constant(n, bad), dynamics);
                for (JointVector MotionState::*part : {&MotionState::q, &MotionState::qd, &MotionState::qdd}) {
                    MotionState badState = arm.start;
                    (badState.*part)[n - 1] = bad;
                    expectRefused(badState, torque, dynamics);
                }
                Dynamics broken = dynamics;
                broken.M(n / 3, n / 4) = bad;
                expectRefused(arm.start, torque, broken);
            }
            for (const int size : {0, n - 1, n + 1}) expectRefused(arm.start, JointVector::Zero(size), dynamics);
            Dynamics indefinite = dynamics;
            indefinite.M *= -1.0;
            expectRefused(arm.start, torque, indefinite, FilterStatus::Faulted);
        }
        EXPECT_LE(filter->filter({arm.start, torque + JointVector::Constant(n, 0.01), dynamics}, decision),
                  FilterStatus::Infeasible);
        return decision.value;
    };
    for (const bool hasBegun : {false, true}) EXPECT_EQ(play(hasBegun, true), play(hasBegun, false));
}

}  // namespace viable
