#include "MujocoPlant.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>

#include "viable/core/Error.h"
#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct MujocoPlantOptions {
    ArmHardwareOptions hardware;
    MotorRateOptions motorRate;

    template <class V>
    void describe(V& v) {
        hardware.describe(v);
        motorRate.describe(v);
    }
};

/** MuJoCo's hardest constraint: of the force that holds a joint, all but this part. */
constexpr double kHardest = 0.9999;
/** MuJoCo lengthens shorter time constants to it itself [sub-steps]. */
constexpr double kTimeConstant = 2.0;
/** The bound of a constraint that has none [Nm]. */
constexpr double kBlockingTorque = 1e9;
/** Longest sub-step times the fastest rate of viscous friction; Runge-Kutta of order 4 is stable to 2.8. */
constexpr double kViscousStep = 2.0;
constexpr double kSolverTolerance = 1e-15;
constexpr int kSolverRounds = 50;  // Newton's method needs a few

}  // namespace

void MujocoPlant::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    const auto [hardware, motorRate] = parameters.get<MujocoPlantOptions>();
    hardware_.configure(setup, hardware, parameters);
    motorRate_.configure(setup, motorRate, hardware.torqueLimitFactor);
    const RobotDescription& robot = hardware_.robot();
    const std::string source = robot.folder.empty() ? robot.name : (robot.folder / (robot.name + ".urdf")).string();
    const std::string urdf = findUrdf(setup.robot);  // the nominal one: masses are changed below
    try {
        mujoco_ = std::make_unique<MujocoModel>(urdf);
        mujoco_->sharpenInertia();
        findJoints(source);
        scaleMasses(hardware.massFactor.expand(n_));
        mujoco_->addPointMass(robot.toolLink, hardware.payload_kg, hardware.payloadOffset);
    } catch (const Error&) {
        throw;
    } catch (const std::exception& e) {
        throw badInput(source, e.what(),
                       "MuJoCo must be able to read the URDF, too; the plant simbody does without it.");
    }
    mjModel& m = mujoco_->model();
    for (int i = 0; i < n_; ++i) m.dof_armature[dof_[i]] = robot.actuation.rotorInertia[i];
    std::copy(robot.gravity.data(), robot.gravity.data() + 3, m.opt.gravity);
    m.opt.timestep = hardware_.substep_s();
    m.opt.integrator = mjINT_RK4;
    m.opt.solver = mjSOL_NEWTON;
    m.opt.iterations = kSolverRounds;
    m.opt.tolerance = kSolverTolerance;
    configureFriction(parameters, setup.tick_s);
    mujoco_->update();
    reset(setup.start);
}

void MujocoPlant::findJoints(const std::string& source) {
    const mjModel& m = mujoco_->model();
    const std::vector<std::string> names = hardware_.robot().jointNames();
    for (int i = 0; i < n_; ++i) {
        const std::string& name = names[static_cast<std::size_t>(i)];
        const int joint = mj_name2id(&m, mjOBJ_JOINT, name.c_str());
        if (joint < 0 || m.nv != n_ || m.nq != n_)
            throw badInput(source,
                           "MuJoCo finds " + std::to_string(m.njnt) + " joints with " + std::to_string(m.nv) +
                               " degrees of freedom" + (joint < 0 ? " and no `" + name + "`" : "") + "; there are " +
                               std::to_string(n_),
                           "Use the plant simbody for this robot.");
        dof_[static_cast<std::size_t>(i)] = m.jnt_dofadr[joint];
    }
}

void MujocoPlant::scaleMasses(const JointVector& factor) {
    mjModel& m = mujoco_->model();
    for (int body = 1; body < m.nbody; ++body) {
        int carrier = body;  // what it is fixed to
        while (carrier > 0 && m.body_jntnum[carrier] == 0) carrier = m.body_parentid[carrier];
        if (carrier == 0) continue;  // part of the base
        const int dof = m.body_dofadr[carrier];
        const double by = factor[std::find(dof_.begin(), dof_.begin() + n_, dof) - dof_.begin()];
        m.body_mass[body] *= by;
        for (int axis = 0; axis < 3; ++axis) m.body_inertia[3 * body + axis] *= by;
    }
}

void MujocoPlant::configureFriction(const Parameters& parameters, double tick_s) {
    mjModel& m = mujoco_->model();
    const double timeConstant = kTimeConstant * hardware_.substep_s();
    JointVector damping(n_);
    for (int i = 0; i < n_; ++i) {
        mjtNum* const solref = m.dof_solref + mjNREF * dof_[i];
        mjtNum* const solimp = m.dof_solimp + mjNIMP * dof_[i];
        solref[0] = timeConstant;
        solref[1] = 1.0;
        solimp[0] = solimp[1] = kHardest;
        damping[i] = hardware_.friction(i).calcDamping(0.0);
    }
    if (!hardware_.hasFriction()) return;
    const double rate = findFastestMode(hardware_.robot(), damping);
    const double needed = std::ceil(tick_s * rate / kViscousStep);
    if (hardware_.substeps() < needed)
        throw badInput(parameters.place("substeps"),
                       std::to_string(hardware_.substeps()) +
                           " is too few for the viscous friction, which brakes with up to " +
                           std::to_string(std::lround(rate)) + " 1/s",
                       "Write substeps: " + std::to_string(std::lround(needed)) + " or more.");
}

void MujocoPlant::putState(const JointState& state) {
    mjData& d = mujoco_->data();
    for (int i = 0; i < n_; ++i) {
        d.qpos[dof_[i]] = state.q[i];
        d.qvel[dof_[i]] = state.qd[i];
    }
}

JointState MujocoPlant::readState() const {
    const mjData& d = mujoco_->data();
    JointState state{JointVector(n_), JointVector(n_)};
    for (int i = 0; i < n_; ++i) {
        state.q[i] = d.qpos[dof_[i]];
        state.qd[i] = d.qvel[dof_[i]];
    }
    return state;
}

void MujocoPlant::reset(const MotionState& start) {
    actual_ = {start.q, start.qd};
    putState(actual_);
    mjModel& m = mujoco_->model();
    mjData& d = mujoco_->data();
    load_.setZero(n_);
    mj_fwdPosition(&m, &d);
    mj_fwdVelocity(&m, &d);
    for (int i = 0; i < n_; ++i) load_[i] = d.qfrc_bias[dof_[i]];
    hardware_.reset(actual_);
    motorRate_.reset(start.q);
}

void MujocoPlant::step(const JointVector& applied) {
    mjModel& m = mujoco_->model();
    mjData& d = mujoco_->data();
    const JointState state = readState();
    const JointVector motor = hardware_.calcMotorTorque(applied, state.q);
    for (int i = 0; i < n_; ++i) {
        const int k = dof_[i];
        d.qfrc_applied[k] = motor[i] + hardware_.externalTorque()[i];
        const FrictionLaw& law = hardware_.friction(i);
        const bool rubs = hardware_.hasFriction();
        m.dof_damping[k] = rubs ? law.calcDamping(state.qd[i]) : 0.0;
        m.dof_frictionloss[k] = i == hardware_.blockedJoint() ? kBlockingTorque
                                : rubs                        ? law.calcDry(state.qd[i], nextLoad_[i])
                                                              : 0.0;
    }
    mj_forward(&m, &d);
    mj_RungeKutta(&m, &d, 4);
    for (int i = 0; i < n_; ++i) nextLoad_[i] = motor[i] + d.qfrc_constraint[dof_[i]] + d.qfrc_passive[dof_[i]];
}

TickStatus MujocoPlant::advance(const JointVector& torque, JointVector& applied) {
    if (!isFinite(torque, n_)) return TickStatus::InvalidInput;
    hardware_.calcApplied(torque, applied);
    motorRate_.limit(applied);
    putState(actual_);
    nextLoad_ = load_;
    try {
        for (int i = 0; i < hardware_.substeps(); ++i) step(applied);
    } catch (const std::exception&) {  // MuJoCo's own error, see MujocoModel
        mujoco_->data().pstack = 0;
        return TickStatus::Faulted;
    }
    const JointState next = readState();
    if (!isFinite(next, n_)) return TickStatus::Faulted;
    actual_ = next;
    load_ = nextLoad_;
    hardware_.endTick(torque, actual_);
    motorRate_.endTick(applied);
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(viable::RealPlant, viable::MujocoPlant, "mujoco",
              "The arm in simulation by another engine: MuJoCo, with its own reading of the URDF "
              "and its own dry "
              "friction.",
              viable::MujocoPlantOptions)
