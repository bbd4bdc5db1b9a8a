#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>

#include "viable/loop/GuardSummary.h"
#include "viable/loop/ReferenceGuard.h"

using namespace viable;

/** A planner, a policy, a hand: 30 targets a second, late by up to 10 ms, one in twenty lost. Every joint swings about
the middle of its range. Yours goes here. */
class Sender {
public:
    explicit Sender(const JointLimits& limits) : limits_(limits) {}

    JointVector calcWanted(double t) const {
        JointVector target(limits_.size());
        for (int i = 0; i < limits_.size(); ++i) {
            const AxisLimits l = limits_.axis(i);
            const bool hasRange = std::isfinite(l.positionLower) && std::isfinite(l.positionUpper);
            const double middle = hasRange ? 0.5 * (l.positionLower + l.positionUpper) : 0.0;
            const double half = hasRange ? 0.5 * (l.positionUpper - l.positionLower) : 1.0;
            const double speed = std::isfinite(l.velocityUpper) ? l.velocityUpper : 1.0;
            // A tenth of the acceleration and jerk that the joint has.
            const double rate = std::min({0.8 * (1.0 + 0.1 * i), 0.1 * l.accelerationUpper / (0.3 * speed),
                                          std::sqrt(0.1 * l.jerkUpper / (0.3 * speed))});  // [rad/s]
            target[i] = middle + std::min(0.8 * half, 0.3 * speed / rate) * std::sin(rate * t);
        }
        return target;
    }
    /** True when a target comes in the tick at `t`. */
    bool receive(double t, JointVector& target) {
        const auto draw = [this] { return std::uniform_real_distribution<double>(0.0, 1.0)(random_); };
        if (t >= next_) {
            onItsWay_ = calcWanted(t);
            arrival_ = t + 0.010 * draw();
            next_ += 1.0 / 30.0;
            isOnItsWay_ = draw() >= 0.05;
        }
        if (!isOnItsWay_ || t < arrival_) return false;
        isOnItsWay_ = false;
        target = onItsWay_;
        return true;
    }

private:
    JointLimits limits_;
    std::mt19937_64 random_{1};  // this seed
    JointVector onItsWay_;
    double next_ = 0.0, arrival_ = 0.0;
    bool isOnItsWay_ = false;
};

int main(int argc, char** argv) try {
    if (argc < 3) {
        std::fprintf(stderr, "usage: reference_stream ROBOT_FOLDER SECONDS [TRAJECTORY.csv]\n");
        return 2;
    }
    const RobotDescription robot = loadRobot(argv[1]);
    const double duration_s = std::atof(argv[2]);
    if (!(duration_s > 0.0)) {
        std::fprintf(stderr, "reference_stream: SECONDS is `%s`, not a number above 0\n", argv[2]);
        return 2;
    }
    std::ofstream file;
    if (argc > 3) {
        file.open(argv[3]);
        file << "time_s";
        for (const char* quantity : {"position", "velocity"})
            for (const std::string& joint : robot.jointNames()) file << ',' << quantity << '.' << joint;
        file << '\n';
        file.precision(12);
    }

    // [the loop]
    const double tick_s = 0.001;
    ReferenceGuard guard(robot, tick_s);  // throws viable::Error: place, cause, remedy
    Sender sender(guard.limits());
    GuardSummary summary(robot.size());
    const JointVector zero = JointVector::Zero(robot.size());
    guard.start({robot.home, zero, zero});  // where the robot is

    JointVector target;
    double sum = 0.0;
    long long count = 0, targets = 0;
    GuardStatus status = GuardStatus::NotStarted;
    for (double t = 0.0; status != GuardStatus::Stopped && status != GuardStatus::Failed; t += tick_s) {
        if (t >= duration_s) guard.requestStop();
        const bool isNew = sender.receive(t, target);
        const GuardedReference& next = isNew ? guard.step(target) : guard.step();  // throws and allocates nothing
        // To the robot goes here: next.state.q, next.state.qd, next.state.qdd, for the end of this tick.
        status = next.status;
        // [the loop]
        targets += isNew;
        summary.add(guard.record());
        summary.addEnd(next.state, t + tick_s);
        if (file.is_open()) {
            file << t + tick_s;
            for (const JointVector* values : {&next.state.q, &next.state.qd})
                for (int i = 0; i < robot.size(); ++i) file << ',' << (*values)[i];
            file << '\n';
        }
        if (t < 6.0 || t >= duration_s) continue;  // on the way to the first targets, and braking
        for (int i = 0; i < robot.size(); ++i) {
            const AxisLimits l = guard.limits().axis(i);
            const double wanted = std::min(std::max(sender.calcWanted(t)[i], l.positionLower), l.positionUpper);
            sum += std::pow(next.state.q[i] - wanted, 2);
            ++count;
        }
    }

    for (const LimitKind kind : {LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Jerk}) {
        const int joint = summary.worstJoint(kind);
        const LimitRecord& worst = summary.limit(kind)[joint];
        std::printf("%-13s worst use %6.2f %% (%s), outside in %lld joint-ticks\n", getName(kind, LimitSide::Neither),
                    100.0 * worst.worstUse, robot.jointNames()[joint].c_str(),
                    static_cast<long long>(summary.ticksOutside(kind)));
    }
    if (count > 0)
        std::printf("reference     %.1f mrad RMS from what was wanted, within the position limits\n",
                    1000.0 * std::sqrt(sum / static_cast<double>(count)));
    std::printf("ticks         %lld, targets %lld\n", static_cast<long long>(summary.ticks()), targets);
    if (argc > 3 && !file.flush()) {
        std::fprintf(stderr, "reference_stream: %s could not be written\n", argv[3]);
        return 2;
    }
    if (guard.stopReason() != GuardStop::Requested) std::printf("stopped       %s\n", guard.stopMessage());
    return !summary.anyLimitBroken() && guard.stopReason() == GuardStop::Requested ? 0 : 1;
} catch (const Error& e) {
    std::fprintf(stderr, "reference_stream: %s\n", e.what());
    return 2;
}
