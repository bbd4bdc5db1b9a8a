#include "robot/SimbodyModel.h"

#include <array>

#include "robot/RigidBody.h"
#include "robot/SimbodyHeaders.h"

namespace viable {

namespace {

using detail::calcPointInertia;
using Eigen::Matrix3d;
using Eigen::Vector3d;

SimTK::Vec3 toSimbody(const Vector3d& v) {
    return {v.x(), v.y(), v.z()};
}

SimTK::Transform toSimbody(const Eigen::Isometry3d& x) {
    const Matrix3d R = x.linear();
    const SimTK::Mat33 copy(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2));
    const bool isOrthonormal = true;  // as it stands: re-orthonormalising would only add rounding
    return {SimTK::Rotation(copy, isOrthonormal), toSimbody(Vector3d(x.translation()))};
}

Vector3d toEigen(const SimTK::Vec3& v) {
    return {v[0], v[1], v[2]};
}

Matrix3d toEigen(const SimTK::Rotation& R) {
    const SimTK::Mat33& from = R.asMat33();
    Matrix3d m;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) m(i, j) = from(i, j);
    return m;
}

/** Simbody wants the tensor about the body's origin. */
SimTK::MassProperties makeMassProperties(const BodyInertia& body) {
    const Matrix3d I = body.inertia + body.mass * calcPointInertia(body.com);
    return {body.mass, toSimbody(body.com), SimTK::Inertia(I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2))};
}

/** Mass, first moment and inertia of a set of bodies, all about the base origin in base axes: in
this form the members of different bodies simply add up. */
struct CompositeInertia {
    double mass;
    Vector3d moment;
    Matrix3d inertia;
};

/** What moves or acts in space: angular part and linear part, taken at the base origin. */
struct Spatial {
    Vector3d angular;
    Vector3d linear;
};

}  // namespace

/** The Simbody system of one arm and the figures of it that Simbody does not keep. */
struct SimbodyModel::Simulation {
    struct Joint {
        SimTK::MobilizedBodyIndex index;
        const SimTK::MobilizedBody* body;  // kept because looking it up costs a dynamic_cast
        int parent;
        bool isPrismatic;
        double mass;
        Vector3d axis;  // body frame
        Vector3d com;   // body frame
        Matrix3d comInertia;
    };

    SimTK::MultibodySystem system;
    SimTK::SimbodyMatterSubsystem matter{system};
    SimTK::GeneralForceSubsystem forces{system};
    SimTK::Force::Gravity gravityForce;
    SimTK::Force::DiscreteForces jointForces{forces, matter};
    SimTK::State state;

    int n;
    std::array<Joint, kMaxJoints> joints;
    JointVector rotorInertia;
    Vector3d gravity;
    int toolParent;
    Eigen::Isometry3d toolPlacement;

    explicit Simulation(const RobotDescription& robot)
        : gravityForce(forces, matter, toSimbody(robot.gravity)),
          n(robot.size()),
          rotorInertia(robot.actuation.rotorInertia),
          gravity(robot.gravity),
          toolParent(robot.toolParent),
          toolPlacement(robot.toolPlacement) {
        VIABLE_CHECK(n >= 1 && n <= kMaxJoints, "a robot has 1 to kMaxJoints joints");
        VIABLE_CHECK(rotorInertia.size() == n, "one rotor inertia per joint");
        VIABLE_CHECK(toolParent >= 0 && toolParent < n, "the tool hangs on a joint");
        for (int i = 0; i < n; ++i) {
            const JointDescription& from = robot.joints[i];
            VIABLE_CHECK(from.parent >= -1 && from.parent < i, "parents come before children");
            SimTK::MobilizedBody& parent =
                from.parent < 0 ? matter.updGround() : matter.updMobilizedBody(joints[from.parent].index);
            // Simbody's pins turn about z and its sliders move along x.
            const bool isPrismatic = from.type == JointType::Prismatic;
            Eigen::Isometry3d axisFrame = Eigen::Isometry3d::Identity();
            axisFrame.linear() = detail::makeAxisFrame(from.axis);
            if (isPrismatic) axisFrame.rotate(Eigen::AngleAxisd(-EIGEN_PI / 2.0, Vector3d::UnitY()));
            const SimTK::Transform inParent = toSimbody(from.placement * axisFrame);
            const SimTK::Transform inBody = toSimbody(axisFrame);
            const SimTK::Body::Rigid body(makeMassProperties(from.body));
            Joint& joint = joints[i];
            joint.index = isPrismatic
                              ? SimTK::MobilizedBody::Slider(parent, inParent, body, inBody).getMobilizedBodyIndex()
                              : SimTK::MobilizedBody::Pin(parent, inParent, body, inBody).getMobilizedBodyIndex();
            joint.body = &matter.getMobilizedBody(joint.index);
            joint.parent = from.parent;
            joint.isPrismatic = isPrismatic;
            joint.mass = from.body.mass;
            joint.axis = from.axis;
            joint.com = from.body.com;
            joint.comInertia = from.body.inertia;
        }
        state = system.realizeTopology();
        system.realizeModel(state);
        // The first pass through the stages sizes the caches: later ones find them ready.
        setState(JointVector::Zero(n), JointVector::Zero(n));
        system.realize(state, SimTK::Stage::Velocity);
    }

    void setState(const JointVector& q, const JointVector& qd) {
        VIABLE_CHECK(q.size() == n && qd.size() == n, "q and qd have one entry per joint");
        SimTK::Vector& stateQ = state.updQ();
        SimTK::Vector& stateU = state.updU();
        for (int i = 0; i < n; ++i) {
            stateQ[i] = q[i];
            stateU[i] = qd[i];
        }
    }

    void calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out);
};

void SimbodyModel::Simulation::calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out) {
    setState(q, qd);
    system.realize(state, SimTK::Stage::Velocity);

    // Everything is taken at the base origin, so that motions, forces and inertias of different
    // bodies can be added without shifting (Featherstone's spatial vectors).
    Spatial axis[kMaxJoints];
    Spatial bias[kMaxJoints];  // force that keeps the body on its path when qdd = 0
    CompositeInertia composite[kMaxJoints];
    for (int i = 0; i < n; ++i) {
        const Joint& joint = joints[i];
        const SimTK::Transform& pose = joint.body->getBodyTransform(state);
        const Matrix3d R = toEigen(pose.R());
        const Vector3d origin = toEigen(pose.p());

        const Vector3d direction = R * joint.axis;
        if (joint.isPrismatic)
            axis[i] = {Vector3d::Zero(), direction};
        else
            axis[i] = {direction, origin.cross(direction)};

        const Vector3d arm = R * joint.com;  // from the body's origin
        const Vector3d com = origin + arm;
        const Matrix3d comInertia = R * joint.comInertia * R.transpose();
        composite[i] = {joint.mass, joint.mass * com, comInertia + joint.mass * calcPointInertia(com)};

        const SimTK::SpatialVec& coriolis = matter.getTotalCoriolisAcceleration(state, joint.index);
        const Vector3d omega = toEigen(joint.body->getBodyAngularVelocity(state));
        const Vector3d alpha = toEigen(coriolis[0]);
        const Vector3d comAcceleration = toEigen(coriolis[1]) + alpha.cross(arm) + omega.cross(omega.cross(arm));
        const Vector3d force = joint.mass * comAcceleration;
        bias[i] = {comInertia * alpha + omega.cross(comInertia * omega) + com.cross(force), force};
    }

    out.M.setZero(n, n);
    out.b.resize(n);
    out.gravity.resize(n);
    // From the tips inwards: whatever a joint carries is complete when its turn comes.
    for (int j = n - 1; j >= 0; --j) {
        const CompositeInertia& carried = composite[j];
        const Spatial& s = axis[j];
        out.gravity[j] = -(s.angular.dot(carried.moment.cross(gravity)) + carried.mass * s.linear.dot(gravity));
        out.b[j] = s.angular.dot(bias[j].angular) + s.linear.dot(bias[j].linear) + out.gravity[j];

        const Spatial momentum{carried.inertia * s.angular + carried.moment.cross(s.linear),
                               carried.mass * s.linear + s.angular.cross(carried.moment)};
        for (int i = j; i >= 0; i = joints[i].parent)
            out.M(i, j) = out.M(j, i) = axis[i].angular.dot(momentum.angular) + axis[i].linear.dot(momentum.linear);
        out.M(j, j) += rotorInertia[j];

        const int parent = joints[j].parent;
        if (parent < 0) continue;
        composite[parent].mass += carried.mass;
        composite[parent].moment += carried.moment;
        composite[parent].inertia += carried.inertia;
        bias[parent].angular += bias[j].angular;
        bias[parent].linear += bias[j].linear;
    }

    const SimTK::Transform& carrier = joints[toolParent].body->getBodyTransform(state);
    const Matrix3d R = toEigen(carrier.R());
    out.tool.position = toEigen(carrier.p()) + R * toolPlacement.translation();
    out.tool.orientation = Eigen::Quaterniond(Matrix3d(R * toolPlacement.linear()));
    out.J.setZero(6, n);
    for (int i = toolParent; i >= 0; i = joints[i].parent) {
        out.J.col(i).head<3>() = axis[i].linear + axis[i].angular.cross(out.tool.position);
        out.J.col(i).tail<3>() = axis[i].angular;
    }
}

SimbodyModel::SimbodyModel(const RobotDescription& robot) : simulation_(std::make_unique<Simulation>(robot)) {}
SimbodyModel::~SimbodyModel() = default;

void SimbodyModel::calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out) {
    simulation_->calcDynamics(q, qd, out);
}

double SimbodyModel::calcEnergy(const JointVector& q, const JointVector& qd) {
    Simulation& s = *simulation_;
    s.setState(q, qd);
    s.system.realize(s.state, SimTK::Stage::Dynamics);
    double energy = s.system.calcEnergy(s.state);
    for (int i = 0; i < s.n; ++i) energy += 0.5 * s.rotorInertia[i] * qd[i] * qd[i];
    return energy;
}

JointVector SimbodyModel::calcLinkForwardDynamics(const JointVector& q, const JointVector& qd, const JointVector& tau) {
    Simulation& s = *simulation_;
    VIABLE_CHECK(tau.size() == s.n, "tau has one entry per joint");
    SimTK::State state = s.state;  // leaves the applied torques out of the tick's own state
    SimTK::Vector torque(s.n);
    for (int i = 0; i < s.n; ++i) {
        state.updQ()[i] = q[i];
        state.updU()[i] = qd[i];
        torque[i] = tau[i];
    }
    s.jointForces.setAllMobilityForces(state, torque);
    s.system.realize(state, SimTK::Stage::Acceleration);
    JointVector qdd(s.n);
    for (int i = 0; i < s.n; ++i) qdd[i] = state.getUDot()[i];
    return qdd;
}

}  // namespace viable
