#include "Paths.h"
#include "robot/ArmRecursion.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <random>
#include <string>

#include "viable/robot/RobotModel.h"
#ifdef VIABLE_HAS_MUJOCO
#include "MujocoModel.h"
#endif

namespace viable {
namespace {

constexpr int kStates = 64;

/** The robot indy7 at random states. */
struct Arm {
    RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    ArmRecursion recursion{robot};
    RobotModel model{robot};
    RobotModel simbody{robot, DynamicsEngine::Simbody};
#ifdef VIABLE_HAS_MUJOCO
    MujocoModel mujoco{findUrdf(robot)};
    int tool = mj_name2id(&mujoco.model(), mjOBJ_BODY, robot.toolLink.c_str());
#endif
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
    void calcDynamics() {
        const MotionState& s = take();
        model.calcDynamics(s.q, s.qd, dynamics);
        benchmark::DoNotOptimize(dynamics);
    }
    void calcBySimbody() {
        const MotionState& s = take();
        simbody.calcDynamics(s.q, s.qd, dynamics);
        benchmark::DoNotOptimize(dynamics);
    }
#ifdef VIABLE_HAS_MUJOCO
    /** Only what the same figures need of a step: places, M, b, gravity where asked for, and the Jacobian of the tool. */
    template <bool kWithGravity>
    void calcByMujoco() {
        const MotionState& s = take();
        mjModel* const m = &mujoco.model();
        mjData* const d = &mujoco.data();
        const auto n = static_cast<std::size_t>(robot.size());
        mjtNum full[kMaxJoints * kMaxJoints], linear[3 * kMaxJoints], angular[3 * kMaxJoints];
        mjtNum gravity[kMaxJoints], bias[kMaxJoints];
        const auto calcForces = [&](mjtNum* forces) {
            mj_comVel(m, d);
            mj_rne(m, d, 0, forces);
            benchmark::DoNotOptimize(forces);
        };
        std::copy_n(s.q.data(), n, d->qpos);
        mj_kinematics(m, d);
        mj_comPos(m, d);
        mj_crb(m, d);
        mj_fullM(m, full, d->qM);
        if (kWithGravity) {
            std::fill_n(d->qvel, n, 0.0);
            calcForces(gravity);
        }
        std::copy_n(s.qd.data(), n, d->qvel);
        calcForces(bias);
        mj_jacBody(m, d, linear, angular, tool);
        benchmark::DoNotOptimize(full);
        benchmark::DoNotOptimize(linear);
    }
#endif
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
    // Against the others, by the same clock.
    const double own = measure(arm, work);
    if (work != &Arm::calcBySimbody) state.counters["simbody_over_this"] = measure(arm, &Arm::calcBySimbody) / own;
#ifdef VIABLE_HAS_MUJOCO
    if (work == &Arm::calcDynamics) {
        state.counters["this_over_mujoco"] = own / measure(arm, &Arm::calcByMujoco<true>);
        state.counters["this_over_mujoco_without_gravity"] = own / measure(arm, &Arm::calcByMujoco<false>);
    }
#endif
}

bool registerAll() {
    const auto add = [](const char* name, Work work) { benchmark::RegisterBenchmark(name, run, work); };
    add("arm_recursion_torque/n:6", &Arm::calcTorque);
    add("arm_recursion_inertia/n:6", &Arm::calcInertia);
    add("arm_recursion_frames/n:6", &Arm::calcFrames);
    add("dynamics/n:6", &Arm::calcDynamics);
    add("dynamics_simbody/n:6", &Arm::calcBySimbody);
#ifdef VIABLE_HAS_MUJOCO
    add("dynamics_mujoco/n:6", &Arm::calcByMujoco<true>);
    add("dynamics_mujoco_without_gravity/n:6", &Arm::calcByMujoco<false>);
#endif
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
