#include "Paths.h"
#include "robot/ArmRecursion.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <random>

#include "viable/robot/RobotModel.h"
#ifdef VIABLE_HAS_KDL
#include "KdlArm.h"
#endif
#ifdef VIABLE_HAS_MUJOCO
#include "MujocoModel.h"
#endif

namespace viable {
namespace {

constexpr int kStates = 64;

/** Indy7 for six joints, Panda for seven; else a chain of so many joints that turn about any axes. */
RobotDescription makeArm(int n) {
    if (n == 6) return loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    if (n == 7) return loadRobot(VIABLE_SOURCE_DIR "/robots/panda");
    std::mt19937_64 random(static_cast<std::uint64_t>(n));
    std::uniform_real_distribution<> uniform(-1.0, 1.0);
    const auto draw = [&](double size) {
        return Eigen::Vector3d(size * Eigen::Vector3d::NullaryExpr([&] { return uniform(random); }));
    };
    RobotDescription robot;
    robot.name = "chain";
    for (int i = 0; i < n; ++i) {
        JointDescription joint;
        joint.name = "joint" + std::to_string(i);
        joint.childLink = "link" + std::to_string(i);
        joint.parent = i - 1;
        joint.placement =
            Eigen::Translation3d(draw(0.3)) * Eigen::AngleAxisd(EIGEN_PI * uniform(random), draw(1.0).normalized());
        joint.axis = draw(1.0).normalized();
        joint.body.mass = 3.0 + 2.0 * uniform(random);
        joint.body.com = draw(0.1);
        joint.body.inertia = Eigen::Vector3d(0.02, 0.025, 0.03).asDiagonal();
        robot.joints.push_back(joint);
    }
    robot.toolParent = n - 1;
    robot.toolLink = robot.joints.back().childLink;
    robot.toolPlacement = Eigen::Translation3d(draw(0.2)) * Eigen::AngleAxisd(1.0, draw(1.0).normalized());
    robot.actuation.rotorInertia.setConstant(n, 0.1);
    return robot;
}

/** An arm at random states, by whoever computes it. */
struct Arm {
    explicit Arm(int n) : robot(makeArm(n)) {
        std::mt19937_64 random(1);
        std::uniform_real_distribution<> uniform(-EIGEN_PI, EIGEN_PI);
        const auto draw = [&] {
            JointVector v(robot.size());
            for (double& x : v) x = uniform(random);
            return v;
        };
        for (int k = 0; k < kStates; ++k) states.push_back({draw(), draw(), draw()});
    }

    RobotDescription robot;
    ArmRecursion recursion{robot};
    RobotModel model{robot};
    RobotModel simbody{robot, DynamicsEngine::Simbody};
#ifdef VIABLE_HAS_KDL
    KdlArm kdl{robot};
#endif
#ifdef VIABLE_HAS_MUJOCO
    MujocoModel mujoco{findUrdf(robot)};
    int tool = findBody();
#endif
    std::vector<MotionState> states;
    std::size_t next = 0;

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
#ifdef VIABLE_HAS_KDL
    void calcByKdl() {
        const MotionState& s = take();
        kdl.calc(s.q, s.qd, dynamics);
        benchmark::DoNotOptimize(dynamics);
    }
    /** Does KDL compute the same arm? */
    bool kdlAgrees() {
        Dynamics other;
        for (const MotionState& s : states) {
            model.calcDynamics(s.q, s.qd, dynamics);
            kdl.calc(s.q, s.qd, other);
            const double size = dynamics.M.norm() + dynamics.b.norm() + dynamics.J.norm();
            const double difference = (dynamics.M - other.M).norm() + (dynamics.b - other.b).norm() +
                                      (dynamics.gravity - other.gravity).norm() + (dynamics.J - other.J).norm() +
                                      (dynamics.tool.position - other.tool.position).norm();
            if (!(difference < 1e-10 * size)) return false;
        }
        return true;
    }
#endif
#ifdef VIABLE_HAS_MUJOCO
    /** The tool's link, or the one that MuJoCo made of it and the link that it is fixed to. */
    int findBody() {
        const int found = mj_name2id(&mujoco.model(), mjOBJ_BODY, robot.toolLink.c_str());
        return found >= 0 ? found : mujoco.model().nbody - 1;
    }
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
    double fastest = kInfinity;
    for (int series = 0; series < kSeries; ++series) {
        const Clock::time_point begin = Clock::now();
        for (int k = 0; k < kStates; ++k) (arm.*work)();
        fastest = std::min(fastest, std::chrono::duration<double, std::nano>(Clock::now() - begin).count());
    }
    return fastest / kStates;
}

void run(benchmark::State& state, Work work, int n) {
    Arm arm(n);
#ifdef VIABLE_HAS_KDL
    if (work == &Arm::calcByKdl && !arm.kdlAgrees()) return state.SkipWithError("KDL computes another arm");
#endif
    for (auto _ : state) (arm.*work)();
    state.counters["n"] = n;
    if (work != &Arm::calcDynamics) return;
    // Against the others, by the same clock.
    const double own = measure(arm, work);
    state.counters["this_over_simbody"] = own / measure(arm, &Arm::calcBySimbody);
#ifdef VIABLE_HAS_KDL
    state.counters["this_over_kdl"] = own / measure(arm, &Arm::calcByKdl);
#endif
#ifdef VIABLE_HAS_MUJOCO
    state.counters["this_over_mujoco"] = own / measure(arm, &Arm::calcByMujoco<true>);
    state.counters["this_over_mujoco_without_gravity"] = own / measure(arm, &Arm::calcByMujoco<false>);
#endif
}

bool registerAll() {
    const auto add = [](const char* name, Work work, int n) {
        benchmark::RegisterBenchmark((std::string(name) + "/n:" + std::to_string(n)).c_str(), run, work, n);
    };
    add("arm_recursion_torque", &Arm::calcTorque, 6);
    add("arm_recursion_inertia", &Arm::calcInertia, 6);
    add("arm_recursion_frames", &Arm::calcFrames, 6);
    for (int n = 1; n <= kMaxJoints; ++n) add("dynamics", &Arm::calcDynamics, n);
    for (const int n : {6, 7}) {
        add("dynamics_simbody", &Arm::calcBySimbody, n);
#ifdef VIABLE_HAS_KDL
        add("dynamics_kdl", &Arm::calcByKdl, n);
#endif
#ifdef VIABLE_HAS_MUJOCO
        add("dynamics_mujoco", &Arm::calcByMujoco<true>, n);
        add("dynamics_mujoco_without_gravity", &Arm::calcByMujoco<false>, n);
#endif
    }
    return true;
}

const bool registered = registerAll();

}  // namespace
}  // namespace viable
