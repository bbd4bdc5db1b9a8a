#include "MujocoPlant.h"

#include <algorithm>
#include <cmath>

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

struct MujocoPlantOptions {
    ArmHardwareOptions hardware;
    MotorRateOptions motorRate;
    ContactOptions contact;

    template <class V>
    void describe(V& v) {
        hardware.describe(v);
        motorRate.describe(v);
        contact.describe(v);
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
/** MuJoCo's softest constraint. Its force is that of the spring and damper within this share of the net force there. */
constexpr double kSoftest = 1e-4;
/** Along the surface it is hard, with this share of creep instead. */
constexpr double kSlipSoftness = 1e-4;
/** Friction stops what slides below its force with this time constant, or as many sub-steps [s]. */
constexpr double kSlipTime_s = 1e-3, kSlipSteps = 2.0;
constexpr double kLeastMobility = 1e-6;  // [1/kg]

}  // namespace

void MujocoPlant::configure(const RunSetup& setup, const Parameters& parameters) {
    n_ = setup.size();
    const auto [hardware, motorRate, contact] = parameters.get<MujocoPlantOptions>();
    hardware_.configure(setup, hardware, parameters);
    motorRate_.configure(setup, motorRate, hardware.torqueLimitFactor);
    const RobotDescription& robot = hardware_.robot();
    const std::string source = robot.folder.empty() ? robot.name : (robot.folder / (robot.name + ".urdf")).string();
    const std::string urdf = findUrdf(setup.robot);  // the nominal one: masses are changed below
    try {
        mujoco_ = std::make_unique<MujocoModel>(urdf, listShapes(setup, contact, parameters));
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
    m.opt.jacobian = mjJAC_DENSE;
    m.opt.solver = mjSOL_NEWTON;
    m.opt.iterations = kSolverRounds;
    m.opt.tolerance = kSolverTolerance;
    configureFriction(parameters, setup.tick_s);
    mujoco_->update();
    if (!carriers_.empty()) configureContact(setup, contact, parameters);
    reset(setup.start);
}

std::vector<MujocoShape> MujocoPlant::listShapes(const RunSetup& setup, const ContactOptions& options,
                                                 const Parameters& parameters) {
    carriers_.clear();
    solids_.clear();
    spheres_.clear();
    if (!ArmContact::isWanted(setup, options, parameters)) return {};
    const Environment& environment = *setup.environment;
    if (options.law != ContactLaw::Spring)
        throw badInput(parameters.place("contact_law"), "MuJoCo's contact is a spring and a damper",
                       "Write contact_law: spring, or use the plant simbody.");
    if (environment.map)
        throw badInput(parameters.place("contact"),
                       "MuJoCo would take each cell of the map `" + environment.map->name +
                           "` for a solid of its own, and several would press where there is one wall",
                       "Use the plant simbody, or give solids in the place of the map.");
    std::vector<MujocoShape> shapes;
    solids_ = environment.solids;
    for (const Solid& solid : solids_) {
        if (solid.kind == Solid::Kind::Cylinder && options.parts == ContactParts::Arm)
            throw badInput(parameters.place("contact"),
                           "MuJoCo finds only roughly how deep a capsule is in the cylinder `" + solid.name + "`",
                           "Write contact: tool, use the plant simbody, or give a box in its place.");
        MujocoShape shape{"", mjGEOM_BOX, 0.5 * solid.size, solid.pose};
        if (solid.kind != Solid::Kind::Box) shape.size = {solid.radius, 0.5 * solid.length, 0.0};
        if (solid.kind == Solid::Kind::Sphere) shape.type = mjGEOM_SPHERE;
        if (solid.kind == Solid::Kind::Cylinder) shape.type = mjGEOM_CYLINDER;
        if (solid.kind == Solid::Kind::HalfSpace) shape.type = mjGEOM_PLANE;
        shapes.push_back(shape);
    }
    spheres_ = environment.spheres;
    for (const MovingSphere& sphere : spheres_) shapes.push_back({"", mjGEOM_SPHERE, {sphere.radius, 0.0, 0.0}});

    const RobotDescription& robot = hardware_.robot();
    const auto add = [&](int carrier, mjtGeom type, double radius, double half, const Eigen::Isometry3d& pose) {
        carriers_.push_back(carrier);
        shapes.push_back({robot.joints[carrier].childLink, type, {radius, half, 0.0}, pose});
    };
    add(robot.toolParent, mjGEOM_SPHERE, options.toolRadius, 0.0, robot.toolPlacement);
    if (options.parts != ContactParts::Arm || !setup.geometry) return shapes;
    for (const LinkCapsule& capsule : setup.geometry->capsules) {
        if (capsule.carrier < 0) continue;
        const Eigen::Vector3d along = capsule.b - capsule.a;
        Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
        pose.translate(0.5 * (capsule.a + capsule.b));
        pose.rotate(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), along));
        const bool isBall = along.isZero(0.0);
        add(capsule.carrier, isBall ? mjGEOM_SPHERE : mjGEOM_CAPSULE, capsule.radius, 0.5 * along.norm(), pose);
    }
    return shapes;
}

// Where R >> A the contact is a spring, see the class. A is put to what it is at most, and so R too.
void MujocoPlant::configureContact(const RunSetup& setup, const ContactOptions& options, const Parameters& parameters) {
    mjModel& m = mujoco_->model();
    const std::vector<int>& geoms = mujoco_->geoms();
    shapes_.assign(geoms.size(), 0);
    for (std::size_t k = 0; k < geoms.size(); ++k) shapes_[geoms[k]] = k;
    std::vector<ArmContact::Point> ends;  // two of each shape of the arm
    const auto ofArm = [&](std::size_t k) { return geoms[geoms.size() - carriers_.size() + k]; };
    for (std::size_t k = 0; k < carriers_.size(); ++k) {
        const int geom = ofArm(k);
        const double* w = m.geom_quat + 4 * geom;
        const Eigen::Vector3d centre(m.geom_pos[3 * geom], m.geom_pos[3 * geom + 1], m.geom_pos[3 * geom + 2]);
        const Eigen::Vector3d half =
            Eigen::Quaterniond(w[0], w[1], w[2], w[3]) * Eigen::Vector3d(0.0, 0.0, m.geom_size[3 * geom + 1]);
        ends.push_back({carriers_[k], centre + half});
        ends.push_back({carriers_[k], centre - half});
    }
    const std::vector<double> mobility = ArmContact::findMobility(hardware_.robot(), ends);
    double fastest = 0.0;
    for (std::size_t k = 0; k < carriers_.size(); ++k) {
        const int geom = ofArm(k);
        const double most = std::max({mobility[2 * k], mobility[2 * k + 1], kLeastMobility});
        fastest = std::max(fastest, (m.geom_type[geom] == mjGEOM_CAPSULE ? 2.0 : 1.0) * options.stiffness * most);
        m.body_invweight0[2 * m.geom_bodyid[geom]] = most;
        m.geom_priority[geom] = 1;
        m.geom_condim[geom] = options.friction > 0.0 ? 3 : 1;
        m.geom_friction[3 * geom] = options.friction;
        mjtNum* const solref = m.geom_solref + mjNREF * geom;
        mjtNum* const solimp = m.geom_solimp + mjNIMP * geom;
        solref[0] = -options.stiffness * (1.0 - kSoftest) * most;
        solref[1] = 0.0;  // see accelerate()
        solimp[0] = solimp[1] = kSoftest;
    }
    ArmContact::checkSteps(fastest, setup.tick_s, hardware_.substeps(), parameters);
    m.opt.cone = mjCONE_ELLIPTIC;
    m.opt.impratio = (1.0 - kSoftest) / (kSoftest * kSlipSoftness);
    dissipation_ = options.dissipation;
    slipRate_ = 1.0 / std::max(kSlipTime_s, kSlipSteps * hardware_.substep_s());
}

void MujocoPlant::findJoints(const std::string& source) {
    const mjModel& m = mujoco_->model();
    const std::vector<std::string> names = hardware_.robot().jointNames();
    for (int i = 0; i < n_; ++i) {
        const std::string& name = names[i];
        const int joint = mj_name2id(&m, mjOBJ_JOINT, name.c_str());
        if (joint < 0 || m.nv != n_ || m.nq != n_)
            throw badInput(source,
                           "MuJoCo finds " + std::to_string(m.njnt) + " joints with " + std::to_string(m.nv) +
                               " degrees of freedom" + (joint < 0 ? " and no `" + name + "`" : "") + "; there are " +
                               std::to_string(n_),
                           "Use the plant simbody for this robot.");
        dof_[i] = m.jnt_dofadr[joint];
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
    d.warning[mjWARN_CONTACTFULL].number = 0;
    for (int i = 0; i < n_; ++i) load_[i] = d.qfrc_bias[dof_[i]];
    hardware_.reset(actual_);
    motorRate_.reset(start.q);
    time_s_ = 0.0;
    report_ = {};
    external_ = hardware_.externalTorque();
}

// MuJoCo 2.2.2 takes a ball whose centre is inside a box for one whose centre is on its surface; its point is right. Out
// of a cylinder it finds any way (MPR), near the edges one several times too long.
void MujocoPlant::correctDepths() {
    const mjModel& m = mujoco_->model();
    mjData& d = mujoco_->data();
    using Vector = Eigen::Map<Eigen::Vector3d>;
    using Axes = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>;
    for (int i = 0; i < d.ncon; ++i) {
        mjContact& contact = d.contact[i];
        const int ball = contact.geom1, solid = contact.geom2;  // MuJoCo's order is that of its types
        const double radius = m.geom_size[3 * ball];
        const Axes axes(d.geom_xmat + 9 * solid);
        const Vector place(d.geom_xpos + 3 * solid);
        Vector point(contact.pos), in(contact.frame);
        if (m.geom_type[solid] == mjGEOM_CYLINDER) {
            const Vector centre(d.geom_xpos + 3 * ball);
            const Solid& cylinder = solids_[shapes_[solid]];
            const ArmContact::Shortest way = ArmContact::findShortest(cylinder, axes.transpose() * (centre - place));
            contact.dist = way.distance - radius;
            in = -(axes * way.normal);
            Vector(contact.frame + 3) = in.unitOrthogonal();
            Vector(contact.frame + 6) = in.cross(Vector(contact.frame + 3));
            point = centre + (radius + 0.5 * contact.dist) * in;
        } else if (m.geom_type[solid] == mjGEOM_BOX && contact.dist < -(1.0 - 1e-9) * radius) {
            Eigen::Index face = 0;
            (axes.transpose() * in).cwiseAbs().maxCoeff(&face);
            contact.dist = -2.0 * (m.geom_size[3 * solid + face] + in.dot(point - place));
        }
    }
}

MujocoPlant::Touch MujocoPlant::readTouch(const mjContact& contact) const {
    const std::size_t first = shapes_[contact.geom1], second = shapes_[contact.geom2],
                      obstacles = shapes_.size() - carriers_.size();
    const bool isSecondOfArm = second >= obstacles;
    return {isSecondOfArm ? first : second, carriers_[(isSecondOfArm ? second : first) - obstacles],
            isSecondOfArm ? 1.0 : -1.0};
}

void MujocoPlant::accelerate(double time_s) {
    mjModel& m = mujoco_->model();
    mjData& d = mujoco_->data();
    for (std::size_t k = 0; k < spheres_.size(); ++k)
        Eigen::Map<Eigen::Vector3d>(m.geom_pos + 3 * mujoco_->geoms()[solids_.size() + k]) =
            spheres_[k].calcCentre(time_s);
    mj_kinematics(&m, &d);
    mj_comPos(&m, &d);
    mj_crb(&m, &d);
    mj_factorM(&m, &d);
    mj_collision(&m, &d);
    correctDepths();
    mj_makeConstraint(&m, &d);
    mj_fwdVelocity(&m, &d);
    for (int i = 0; i < d.ncon; ++i) {  // Hunt and Crossley's damping, friction's, and the velocity of what is touched
        const mjContact& contact = d.contact[i];
        const int row = contact.efc_address;
        if (row < 0) continue;
        const Touch touch = readTouch(contact);
        Eigen::Vector3d ofObstacle = Eigen::Vector3d::Zero();
        if (touch.obstacle >= solids_.size())
            ofObstacle = ArmContact::calcVelocity(spheres_[touch.obstacle - solids_.size()], time_s);
        for (int axis = 0; axis < contact.dim; ++axis) {
            const Eigen::Map<const Eigen::Vector3d> direction(contact.frame + 3 * axis);
            const double velocity = d.efc_vel[row + axis] - touch.side * direction.dot(ofObstacle);
            const double damping = 1.5 * dissipation_ * -contact.solref[0] / kSoftest * -contact.dist;
            d.efc_aref[row + axis] -= (axis == 0 ? damping : slipRate_) * velocity;
        }
    }
    mj_fwdAcceleration(&m, &d);
    mj_fwdConstraint(&m, &d);
}

JointVector MujocoPlant::calcContactTorque() const {
    const mjData& d = mujoco_->data();
    JointVector torque = JointVector::Zero(n_);
    for (int row = 0; row < d.nefc; ++row)
        if (d.efc_type[row] >= mjCNSTR_CONTACT_FRICTIONLESS)
            for (int i = 0; i < n_; ++i) torque[i] += d.efc_force[row] * d.efc_J[row * n_ + dof_[i]];
    return torque;
}

void MujocoPlant::reportContacts() {
    const mjData& d = mujoco_->data();
    report_ = {};
    for (int i = 0; i < d.ncon; ++i) {
        const mjContact& contact = d.contact[i];
        if (!(contact.dist < 0.0)) continue;
        mjtNum force[6];
        mj_contactForce(&mujoco_->model(), &d, i, force);
        const Touch touch = readTouch(contact);
        ++report_.contacts;
        for (int axis = 0; axis < 3; ++axis)
            report_.force += touch.side * force[axis] * Eigen::Map<const Eigen::Vector3d>(contact.frame + 3 * axis);
        report_.pressing += force[0];
        if (!(-contact.dist > report_.depth)) continue;
        report_.depth = -contact.dist;
        report_.point = Eigen::Map<const Eigen::Vector3d>(contact.pos);
        report_.carrier = touch.carrier;
        report_.obstacle = static_cast<int>(touch.obstacle);
    }
}

void MujocoPlant::step(const JointVector& applied, double time_s) {
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
    const double h = hardware_.substep_s();
    Eigen::Map<Eigen::VectorXd> q(d.qpos, n_), v(d.qvel, n_);
    const Eigen::Map<const Eigen::VectorXd> a(d.qacc, n_);
    const JointVector q0 = q, v0 = v;
    JointVector way = JointVector::Zero(n_), change = way;
    const double after[] = {0.0, 0.5 * h, 0.5 * h, h}, share[] = {h / 6.0, h / 3.0, h / 3.0, h / 6.0};
    for (int stage = 0; stage < 4; ++stage) {
        if (stage > 0) {
            q = q0 + after[stage] * v;
            v = v0 + after[stage] * a;
        }
        accelerate(time_s + after[stage]);
        way += share[stage] * v;
        change += share[stage] * a;
    }
    q = q0 + way;
    v = v0 + change;
    const JointVector contact = calcContactTorque();
    for (int i = 0; i < n_; ++i)
        nextLoad_[i] = motor[i] + d.qfrc_constraint[dof_[i]] - contact[i] + d.qfrc_passive[dof_[i]];
}

TickStatus MujocoPlant::advance(const JointVector& torque, JointVector& applied) {
    if (!isFinite(torque, n_)) return TickStatus::InvalidInput;
    hardware_.calcApplied(torque, applied);
    motorRate_.limit(applied);
    putState(actual_);
    nextLoad_ = load_;
    mjData& d = mujoco_->data();
    double time_s = time_s_;
    try {
        for (int i = 0; i < hardware_.substeps(); ++i, time_s += hardware_.substep_s()) step(applied, time_s);
        if (!carriers_.empty()) accelerate(time_s);  // for the report
    } catch (const std::exception&) {                // MuJoCo's own error, see MujocoModel
        d.pstack = 0;
        return TickStatus::Faulted;
    }
    const JointState next = readState();
    int& withoutRoom = d.warning[mjWARN_CONTACTFULL].number;
    if (std::exchange(withoutRoom, 0) > 0 || !isFinite(next, n_)) return TickStatus::Faulted;
    actual_ = next;
    load_ = nextLoad_;
    time_s_ = time_s;
    if (!carriers_.empty()) reportContacts();
    hardware_.endTick(torque, actual_);
    motorRate_.endTick(applied);
    external_ = hardware_.externalTorque();
    if (!carriers_.empty()) external_ += calcContactTorque();
    return TickStatus::Ok;
}

}  // namespace viable

VIABLE_PLUGIN(
    viable::RealPlant, viable::MujocoPlant, "mujoco",
    "The arm in simulation by another engine: MuJoCo, with its own reading of the URDF and its own dry friction.",
    viable::MujocoPlantOptions)
