#include "Paths.h"
#include "robot/ArmRecursion.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <random>
#include <string>

#include "viable/robot/RobotModel.h"

namespace viable {
namespace {

constexpr int kStates = 64;

/** The robot indy7 at random states. */
struct Arm {
    RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    ArmRecursion recursion{robot};
    RobotModel model{robot};
    std::vector<MotionState> states;
    std::size_t next = 0;

    Arm() {
        std::mt19937_64 random(1);
        std::uniform_real_distribution<> uniform(-EIGEN_PI, EIGEN_PI);
        const auto draw = [&] {
            JointVector v(robot.size());
            for (double& x : v) x = uniform(random);
            return v;
        };
        for (int k = 0; k < kStates; ++k) states.push_back({draw(), draw(), draw()});
    }
    const MotionState& take() {
        next = (next + 1) % kStates;
        return states[next];
    }

    JointVector tau;
    JointMatrix M;
    Dynamics dynamics;
    ArmRecursion::Frames frames;

    void calcTorque() {
        const MotionState& s = take();
        recursion.calcTorque(s.q, s.qd, s.qdd, tau);
        benchmark::DoNotOptimize(tau.data());
    }
    void calcInertia() {
        recursion.calcInertia(take().q, M);
        benchmark::DoNotOptimize(M.data());
    }
    void calcFrames() {
        recursion.calcFrames(take().q, frames);
        benchmark::DoNotOptimize(frames);
    }
    void calcModelTorque() {
        const MotionState& s = take();
        model.calcDynamics(s.q, s.qd, dynamics);
        calcInverseDynamics(dynamics, s.qdd, tau);
        benchmark::DoNotOptimize(tau.data());
    }
};

using Work = void (Arm::*)();

/** Time of one call [ns]: the fastest of many short series, as other load only ever adds. */
double measure(Arm& arm, Work work) {
    using Clock = std::chrono::steady_clock;
    constexpr int kSeries = 200;
    double fastest = std::numeric_limits<double>::infinity();
    for (int series = 0; series < kSeries; ++series) {
        const Clock::time_point begin = Clock::now();
        for (int k = 0; k < kStates; ++k) (arm.*work)();
        fastest = std::min(fastest, std::chrono::duration<double, std::nano>(Clock::now() - begin).count());
    }
    return fastest / kStates;
}

void run(benchmark::State& state, Work work) {
    Arm arm;
    for (auto _ : state) (arm.*work)();
    state.counters["n"] = arm.robot.size();
    // Against Simbody's torque, by the same clock.
    if (work != &Arm::calcModelTorque)
        state.counters["robot_model_over_this"] = measure(arm, &Arm::calcModelTorque) / measure(arm, work);
}

bool registerAll() {
    const auto add = [](const char* name, Work work) { benchmark::RegisterBenchmark(name, run, work); };
    add("arm_recursion_torque/n:6", &Arm::calcTorque);
    add("arm_recursion_inertia/n:6", &Arm::calcInertia);
    add("arm_recursion_frames/n:6", &Arm::calcFrames);
    add("robot_model_torque/n:6", &Arm::calcModelTorque);
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
