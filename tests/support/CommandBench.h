#pragma once

#include <algorithm>
#include <cmath>

#include "Complaint.h"
#include "Paths.h"
#include "core/RotationVector.h"
#include "host/PluginLoader.h"
#include "viable/testing/AllocationCounter.h"
#include "viable/testing/PluginBench.h"

namespace viable {

using test::expectContains;
using test::expectError;

/** What a command source needs to be configured outside a run: a robot with three joints that has
a name only, a start away from zero, and parameters from YAML text. */
class CommandBench {
public:
    explicit CommandBench(double duration = 30.0) : duration_s(duration), robot_(makeRobot()) {
        start.q.resize(3);
        start.q << 0.1, -0.2, 0.3;
        start.qd.setZero(3);
        start.qdd.setZero(3);
        tool.position = {0.35, -0.19, 0.52};
        tool.orientation = Eigen::Quaterniond(0.5, -0.5, 0.1, 0.7).normalized();
    }

    RunSetup setup() const { return {robot_, JointLimits::unlimited(3), 0.001, duration_s, start, tool}; }

    /** Parameters from the inside of a flow map: `points: [[0, 1, 2, 3]], repeat_s: 2`. */
    Parameters read(const std::string& text) const {
        const ConfigNode root = parseConfig("command: {" + text + "}\n", file);
        const PluginEntry& entry = testing::openOwnPlugin();
        return readParameters(*root.find("command"), entry.parameters, entry.parameterCount, 3);
    }

    void configure(CommandSource& source, const std::string& text) const { source.configure(setup(), read(text)); }

    /** What configure() complains about; empty when it does not. */
    template <class Source>
    std::string findComplaint(const std::string& text) const {
        Source source;
        return test::findComplaint([&] { configure(source, text); });
    }

    MotionState start;
    Pose tool;
    double duration_s;
    std::string file = "experiment.yaml";

private:
    static RobotDescription makeRobot() {
        RobotDescription robot;
        robot.name = "bench";
        robot.joints.resize(3);
        return robot;
    }
    RobotDescription robot_;
};

/** A command source that a bench has configured. */
template <class Source>
struct Configured : Source {
    Configured(const CommandBench& bench, const std::string& text) { bench.configure(*this, text); }
};

inline MotionCommand sampleAt(CommandSource& source, double t) {
    MotionCommand command;
    EXPECT_EQ(source.sample(t, command), TickStatus::Ok) << "t = " << t;
    return command;
}

/** The rotation that leads from `a` to `b`, as rotation vector in the base frame. */
inline Eigen::Vector3d calcTurn(const Pose& a, const Pose& b) {
    return calcRotationVector(b.orientation * a.orientation.conjugate());
}

inline void expectSame(const MotionCommand& a, const MotionCommand& b) {
    EXPECT_EQ(a.space, b.space);
    EXPECT_EQ(a.tool.position, b.tool.position);
    EXPECT_EQ(a.tool.orientation.coeffs(), b.tool.orientation.coeffs());
    EXPECT_EQ(a.toolTwist, b.toolTwist);
    ASSERT_EQ(a.q.size(), b.q.size());
    ASSERT_EQ(a.qd.size(), b.qd.size());
    EXPECT_EQ(a.q, b.q);
    EXPECT_EQ(a.qd, b.qd);
}

/** What expectSmoothMotion() found. */
struct MotionExtremes {
    double reach = 0.0;         ///< from the start [m]
    double turn = 0.0;          ///< from the start [rad]
    double speed = 0.0;         ///< [m/s]
    double turnRate = 0.0;      ///< [rad/s]
    double speedJump = 0.0;     ///< largest change of linear velocity per millisecond [m/s]
    double turnRateJump = 0.0;  ///< the same, angular [rad/s]
};

/** Walks through `source` in ticks of 1 ms. Checks in each: everything finite, unit quaternion,
pose steps that agree with the mean of the twists at both ends up to `bend` ms^2/2 (the trapezoidal
rule: bend bounds how unevenly the velocity changes within a tick), and in every 37th tick the twist
against the pose's central difference over +-10 us. */
inline MotionExtremes expectSmoothMotion(CommandSource& source, double duration_s, double bend) {
    constexpr double dt = 1e-3;
    MotionExtremes found;
    const MotionCommand start = sampleAt(source, 0.0);
    MotionCommand last = start;
    const int ticks = static_cast<int>(std::lround(duration_s / dt));
    for (int k = 1; k <= ticks && !::testing::Test::HasFailure(); ++k) {
        const double t = k * dt;
        const MotionCommand now = sampleAt(source, t);
        EXPECT_EQ(now.space, MotionCommand::Space::Tool);
        EXPECT_TRUE(now.tool.position.allFinite() && now.toolTwist.allFinite()) << "t = " << t;
        EXPECT_NEAR(now.tool.orientation.norm(), 1.0, 1e-12) << "t = " << t;

        const Eigen::Vector3d step = now.tool.position - last.tool.position;
        const Eigen::Vector3d turn = calcTurn(last.tool, now.tool);
        const Vector6 mean = 0.5 * (now.toolTwist + last.toolTwist);
        EXPECT_LE((step - dt * mean.head<3>()).norm(), bend * dt * dt / 2.0) << "t = " << t;
        EXPECT_LE((turn - dt * mean.tail<3>()).norm(), bend * dt * dt / 2.0) << "t = " << t;

        if (k % 37 == 0) {
            const double h = 1e-5;
            const MotionCommand before = sampleAt(source, t - h);
            const MotionCommand after = sampleAt(source, t + h);
            const Eigen::Vector3d v = (after.tool.position - before.tool.position) / (2.0 * h);
            const Eigen::Vector3d w = calcTurn(before.tool, after.tool) / (2.0 * h);
            // A corner of the velocity inside the stencil costs (change of acceleration) h / 2.
            EXPECT_LE((v - now.toolTwist.head<3>()).norm(), 1e-9 + bend * h) << "t = " << t;
            EXPECT_LE((w - now.toolTwist.tail<3>()).norm(), 1e-9 + bend * h) << "t = " << t;
        }

        const Vector6 jump = now.toolTwist - last.toolTwist;
        found.reach = std::max(found.reach, (now.tool.position - start.tool.position).norm());
        found.turn = std::max(found.turn, calcTurn(start.tool, now.tool).norm());
        found.speed = std::max(found.speed, now.toolTwist.head<3>().norm());
        found.turnRate = std::max(found.turnRate, now.toolTwist.tail<3>().norm());
        found.speedJump = std::max(found.speedJump, jump.head<3>().norm());
        found.turnRateJump = std::max(found.turnRateJump, jump.tail<3>().norm());
        last = now;
    }
    return found;
}

/** The command source `name` as the program gets it: through the loader. */
inline PluginPtr<CommandSource> loadCommandSource(const char* name) {
    const PluginLoader loader({VIABLE_PLUGIN_DIR});
    const PluginInfo info = loader.find(PluginKind::CommandSource, name, "test", {});
    EXPECT_EQ(info.name, name);
    EXPECT_FALSE(info.summary.empty());
    return PluginLoader::create<CommandSource>(info);
}

/** The library's own object gives the same commands as the class linked into the test, before and after a reset.
@param configure  does so with either */
template <class Source, class Configure>
void expectSameAsLibrary(const CommandBench& bench, const char* name, double duration_s, const Configure& configure) {
    const PluginPtr<CommandSource> loaded = loadCommandSource(name);
    Source linked;
    configure(*loaded);
    configure(linked);
    linked.reset(bench.start);
    for (int round = 0; round < 2; ++round) {
        loaded->reset(bench.start);
        for (double t = 0.0; t < duration_s; t += 0.01) expectSame(sampleAt(*loaded, t), sampleAt(linked, t));
    }
}

/** A configured source takes no memory in its reset and its ticks. */
inline void expectNoAllocation(const CommandBench& bench, CommandSource& source, int ticks) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    MotionCommand command;
    const testing::AllocationCounter counter;
    source.reset(bench.start);
    for (int k = 0; k < ticks; ++k) source.sample(k * 1e-3, command);
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace viable
