#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>
#include <thread>

#include "SimulatedRobot.h"
#include "viable/loop/GuardLog.h"
#include "viable/loop/GuardSummary.h"
#include "viable/loop/TorqueGuard.h"

using namespace viable;

/** What came of it: the nominal arm's worst use of each limit, and how far the real one was from it. */
bool print(const RobotDescription& robot, const GuardSummary& summary, const TorqueGuard& guard, long long missed) {
    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk}) {
        const int joint = summary.worstJoint(kind);
        const LimitRecord& worst = summary.limit(kind)[joint];
        std::printf("%-13s worst use %6.2f %% (%s), outside in %lld joint-ticks\n", getName(kind, LimitSide::Neither),
                    100.0 * worst.worstUse, robot.jointNames()[joint].c_str(),
                    static_cast<long long>(summary.ticksOutside(kind)));
    }
    std::printf("real arm      at most %.1f mrad from the nominal one\n", 1000.0 * summary.trackingMax());
    std::printf("ticks         %lld, and %lld missed\n", static_cast<long long>(summary.ticks()), missed);
    if (guard.stopReason() != GuardStop::Requested) std::printf("stopped       %s\n", guard.stopMessage());
    return !summary.anyLimitBroken() && guard.stopReason() == GuardStop::Requested;
}

int main(int argc, char** argv) try {
    if (argc < 3) {
        std::fprintf(stderr, "usage: own_loop ROBOT_FOLDER SECONDS [simulated_time|clock] [FOLDER/LOG.mcap]\n");
        return 2;
    }
    const RobotDescription robot = loadRobot(argv[1]);
    const double duration_s = std::atof(argv[2]);
    if (!(duration_s > 0.0)) {
        std::fprintf(stderr, "own_loop: SECONDS is `%s`, not a number above 0\n", argv[2]);
        return 2;
    }
    const bool isSimulatedTime = argc > 3 && std::strcmp(argv[3], "simulated_time") == 0;

    std::optional<GuardLog> log;  // for `viable report`, `viable export` and `viable verify`
    if (argc > 4) log.emplace(argv[4], robot, true);

    // [the loop]
    const double tick_s = 0.001;
    SimulatedRobot arm(robot, tick_s, isSimulatedTime);  // yours goes here
    TorqueGuard guard(robot, tick_s);                    // throws viable::Error: place, cause, remedy
    GuardSummary summary(robot.size());
    guard.start(arm.read());

    long long missed = 0;
    for (double t = 0.0; !arm.brakesHold(); t += tick_s) {
        const long long late = arm.waitForTick();  // ticks that the clock says have passed unseen
        guard.missTicks(late);
        if (t >= duration_s) guard.requestStop();

        // A target far beyond the position limits, on the other side every 2 s.
        const double side = static_cast<int>(t / 2.0) % 2 == 0 ? 5.0 : -5.0;
        const JointVector target = robot.home + JointVector::Constant(robot.size(), side);

        // Any torque law: here inverse dynamics with a spring and a damper, on the nominal arm.
        const auto law = [&](const MotionState& nominal, const Dynamics& dynamics, JointVector& tau_d) {
            tau_d = dynamics.M * (100.0 * (target - nominal.q) - 20.0 * nominal.qd) + dynamics.b;
        };
        const GuardedTorque& motors = guard.step(arm.read(), law);  // throws and allocates nothing
        arm.drive(motors.torque);
        const bool hasFailed = motors.status == GuardStatus::Failed;  // the torque goes to zero
        if (hasFailed || motors.status == GuardStatus::Stopped) arm.engageBrakes();
        if (hasFailed) break;  // else the motors hold the arm until the brakes do

        // A robot that takes positions gets where the nominal arm is at the end of this tick, within all limits:
        arm.stream(guard.nominal());

        summary.add(guard.record());
        while (log && !log->append(guard.record()) && isSimulatedTime) std::this_thread::yield();  // by the clock: lost
        t += tick_s * static_cast<double>(late);
        missed += late;
    }
    // [the loop]
    if (const std::string trouble = log ? log->finish() : ""; !trouble.empty()) {
        std::fprintf(stderr, "own_loop: %s could not be written to its end: %s\n", argv[4], trouble.c_str());
        return 2;
    }
    return print(robot, summary, guard, missed) ? 0 : 1;
} catch (const Error& e) {
    std::fprintf(stderr, "own_loop: %s\n", e.what());
    return 2;
}
