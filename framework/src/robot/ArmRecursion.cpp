#include "robot/ArmRecursion.h"

#include <cmath>

#include "robot/RigidBody.h"
#include "viable/core/Error.h"

namespace viable {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/** Numbers of two vectors side by side: what turns both costs as much as what turns one. Of the compiler's own kind (GCC,
Clang), which stays in registers where Eigen's goes through memory. */
using Pair = double __attribute__((vector_size(16)));

template <class T>
struct Triple {
    T x, y, z;
};

/** Cosine and sine of a joint's angle. */
struct Angle {
    double c = 1.0, s = 0.0;
};

Angle calcAngle(double q) {
    return {std::cos(q), std::sin(q)};
}

/** A vector of the frame before the joint in the joint's own: Rz^T R^T v. */
template <class T>
Triple<T> turnInwards(const Matrix3d& R, const Angle& angle, const Triple<T>& v) {
    const T x = R(0, 0) * v.x + R(1, 0) * v.y + R(2, 0) * v.z;
    const T y = R(0, 1) * v.x + R(1, 1) * v.y + R(2, 1) * v.z;
    const T z = R(0, 2) * v.x + R(1, 2) * v.y + R(2, 2) * v.z;
    return {angle.c * x + angle.s * y, angle.c * y - angle.s * x, z};
}

/** And back: R Rz v. */
template <class T>
Triple<T> turnOutwards(const Matrix3d& R, const Angle& angle, const Triple<T>& v) {
    const T x = angle.c * v.x - angle.s * v.y;
    const T y = angle.s * v.x + angle.c * v.y;
    return {R(0, 0) * x + R(0, 1) * y + R(0, 2) * v.z, R(1, 0) * x + R(1, 1) * y + R(1, 2) * v.z,
            R(2, 0) * x + R(2, 1) * y + R(2, 2) * v.z};
}

/** How points of a body accelerate against its origin: U r = alpha x r + omega x (omega x r). */
struct Swing {
    double xx, xy, xz, yx, yy, yz, zx, zy, zz;

    Swing() = default;
    explicit Swing(const Triple<Pair>& spin) {
        const double wx = spin.x[0], wy = spin.y[0], wz = spin.z[0];
        const double x2 = wx * wx, y2 = wy * wy, z2 = wz * wz;
        const double wxy = wx * wy, wxz = wx * wz, wyz = wy * wz;
        xx = -(y2 + z2);
        yy = -(x2 + z2);
        zz = -(x2 + y2);
        xy = wxy - spin.z[1];
        yx = wxy + spin.z[1];
        xz = wxz + spin.y[1];
        zx = wxz - spin.y[1];
        yz = wyz - spin.x[1];
        zy = wyz + spin.x[1];
    }
};

Matrix3d makeCross(const Vector3d& v) {
    Matrix3d m;
    m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
    return m;
}

}  // namespace

ArmRecursion::ArmRecursion(const RobotDescription& robot) : n_(robot.size()), gravity_(robot.gravity) {
    VIABLE_CHECK(n_ >= 1 && n_ <= kMaxJoints, "a robot has 1 to kMaxJoints joints");
    VIABLE_CHECK(robot.actuation.rotorInertia.size() == n_, "one rotor inertia per joint");
    std::array<Matrix3d, kMaxJoints> axisFrame;
    for (int i = 0; i < n_; ++i) {
        const JointDescription& from = robot.joints[index(i)];
        VIABLE_CHECK(from.parent >= -1 && from.parent < i, "parents come before children");
        movers_[index(i)] = 1u << i | (from.parent < 0 ? 0u : movers_[index(from.parent)]);

        const Matrix3d placed = from.placement.linear();
        const bool isPrismatic = from.type == JointType::Prismatic;
        FramePlacement& placement = placements_[index(i)];
        const Matrix3d alongAxis = from.axis * from.axis.transpose();  // Rodrigues
        placement.fixed = isPrismatic ? placed : placed * alongAxis;
        placement.cosine = placed * (Matrix3d::Identity() - alongAxis);
        placement.sine = placed * makeCross(from.axis);
        placement.origin = from.placement.translation();
        placement.axis = placed * from.axis;

        Matrix3d& own = axisFrame[index(i)];
        own = detail::makeAxisFrame(from.axis);
        const Matrix3d before = from.parent < 0 ? Matrix3d::Identity() : axisFrame[index(from.parent)];
        Joint& joint = joints_[index(i)];
        joint.rotation = before.transpose() * placed * own;
        joint.origin = before.transpose() * placement.origin;
        joint.parent = from.parent;
        joint.isPrismatic = isPrismatic;
        joint.rotorInertia = robot.actuation.rotorInertia[i];
        joint.mass = from.body.mass;
        const Vector3d com = own.transpose() * from.body.com;
        const Matrix3d inertia = own.transpose() * from.body.inertia * own;
        joint.moment = joint.mass * com;
        joint.second = 0.5 * inertia.trace() * Matrix3d::Identity() - inertia + joint.mass * com * com.transpose();
    }
    // From the tips inwards: mass on a revolute joint's axis moves with the link before it.
    for (int i = n_ - 1; i >= 0; --i) {
        Joint& joint = joints_[index(i)];
        if (joint.isPrismatic) continue;
        if (joint.parent >= 0) {
            Joint& before = joints_[index(joint.parent)];
            const Vector3d& p = joint.origin;
            const Vector3d e = joint.rotation.col(2);
            before.mass += joint.mass;
            before.moment += joint.mass * p + joint.moment.z() * e;
            before.second += joint.mass * p * p.transpose() + joint.second(2, 2) * e * e.transpose();
            before.second += joint.moment.z() * (p * e.transpose() + e * p.transpose());
        }
        joint.mass = joint.moment.z() = joint.second(2, 2) = 0.0;
    }
}

void ArmRecursion::calcFrames(const JointVector& q, Frames& frames) const {
    VIABLE_CHECK(q.size() == n_, "q has one entry per joint");
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[index(i)];
        const FramePlacement& from = placements_[index(i)];
        Matrix3d turned = from.fixed;
        Vector3d place = from.origin;
        if (joint.isPrismatic) {
            place += q[i] * from.axis;
        } else {
            const Angle angle = calcAngle(q[i]);
            turned += angle.c * from.cosine + angle.s * from.sine;
        }
        Matrix3d& rotation = frames.rotation[index(i)];
        Vector3d& origin = frames.origin[index(i)];
        Vector3d& axis = frames.axis[index(i)];
        if (joint.parent < 0) {
            rotation = turned;
            origin = place;
            axis = from.axis;
        } else {
            const Matrix3d& before = frames.rotation[index(joint.parent)];
            rotation.noalias() = before * turned;
            origin.noalias() = before * place;
            origin += frames.origin[index(joint.parent)];
            axis.noalias() = before * from.axis;
        }
    }
}

void ArmRecursion::calcTorque(const JointVector& q, const JointVector& qd, const JointVector& qdd,
                              JointVector& tau) const {
    VIABLE_CHECK(q.size() == n_ && qd.size() == n_ && qdd.size() == n_, "q, qd and qdd have one entry per joint");
    struct Motion {
        Angle angle;
        Triple<Pair> spin;            // angular velocity, angular acceleration
        Triple<double> acceleration;  // of the frame's origin, gravity taken off
        Swing swing;
    };
    std::array<Motion, kMaxJoints> motions;
    std::array<Triple<Pair>, kMaxJoints> loads;  // force, moment about the frame's origin

    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[index(i)];
        const Matrix3d& R = joint.rotation;
        Motion& motion = motions[index(i)];
        if (!joint.isPrismatic) motion.angle = calcAngle(q[i]);
        const Angle angle = motion.angle;

        Triple<Pair> spin;
        Triple<double> a;
        if (joint.parent < 0) {
            spin = {Pair{0.0, 0.0}, Pair{0.0, 0.0}, Pair{0.0, 0.0}};
            a = {-gravity_.x(), -gravity_.y(), -gravity_.z()};
        } else {
            const Motion& before = motions[index(joint.parent)];
            spin = turnInwards(R, angle, before.spin);
            double px = joint.origin.x(), py = joint.origin.y(), pz = joint.origin.z();
            if (joint.isPrismatic) {
                px += q[i] * R(0, 2);
                py += q[i] * R(1, 2);
                pz += q[i] * R(2, 2);
            }
            const Swing& U = before.swing;
            a = {before.acceleration.x + U.xx * px + U.xy * py + U.xz * pz,
                 before.acceleration.y + U.yx * px + U.yy * py + U.yz * pz,
                 before.acceleration.z + U.zx * px + U.zy * py + U.zz * pz};
        }
        a = turnInwards(R, angle, a);

        const Vector3d& h = joint.moment;
        const Matrix3d& E = joint.second;
        if (joint.isPrismatic) {
            a.x += 2.0 * qd[i] * spin.y[0];
            a.y -= 2.0 * qd[i] * spin.x[0];
            a.z += qdd[i];
            const Swing U(spin);
            const double m = joint.mass;
            loads[index(i)] = {Pair{m * a.x + U.xx * h.x() + U.xy * h.y() + U.xz * h.z(),
                                    h.y() * a.z - h.z() * a.y + U.zx * E(0, 1) + U.zy * E(1, 1) + U.zz * E(2, 1) -
                                        U.yx * E(0, 2) - U.yy * E(1, 2) - U.yz * E(2, 2)},
                               Pair{m * a.y + U.yx * h.x() + U.yy * h.y() + U.yz * h.z(),
                                    h.z() * a.x - h.x() * a.z + U.xx * E(0, 2) + U.xy * E(1, 2) + U.xz * E(2, 2) -
                                        U.zx * E(0, 0) - U.zy * E(1, 0) - U.zz * E(2, 0)},
                               Pair{m * a.z + U.zx * h.x() + U.zy * h.y() + U.zz * h.z(),
                                    h.x() * a.y - h.y() * a.x + U.yx * E(0, 0) + U.yy * E(1, 0) + U.yz * E(2, 0) -
                                        U.xx * E(0, 1) - U.xy * E(1, 1) - U.xz * E(2, 1)}};
            motion.swing = U;
        } else {
            const double wx = spin.x[0], wy = spin.y[0];
            spin.x += Pair{0.0, qd[i] * wy};
            spin.y -= Pair{0.0, qd[i] * wx};
            spin.z += Pair{qd[i], qdd[i]};
            const Swing U(spin);
            // As above, where mass, h.z and E.zz of a revolute joint's link are zero.
            loads[index(i)] = {Pair{U.xx * h.x() + U.xy * h.y(), h.y() * a.z + U.zx * E(0, 1) + U.zy * E(1, 1) +
                                                                     U.zz * E(2, 1) - U.yx * E(0, 2) - U.yy * E(1, 2)},
                               Pair{U.yx * h.x() + U.yy * h.y(), -h.x() * a.z + U.xx * E(0, 2) + U.xy * E(1, 2) -
                                                                     U.zx * E(0, 0) - U.zy * E(1, 0) - U.zz * E(2, 0)},
                               Pair{U.zx * h.x() + U.zy * h.y(), h.x() * a.y - h.y() * a.x + U.yx * E(0, 0) +
                                                                     U.yy * E(1, 0) + U.yz * E(2, 0) - U.xx * E(0, 1) -
                                                                     U.xy * E(1, 1) - U.xz * E(2, 1)}};
            motion.swing = U;
        }
        motion.spin = spin;
        motion.acceleration = a;
    }

    tau.resize(n_);
    for (int i = n_ - 1; i >= 0; --i) {
        const Joint& joint = joints_[index(i)];
        tau[i] = loads[index(i)].z[joint.isPrismatic ? 0 : 1] + joint.rotorInertia * qdd[i];
        if (joint.parent < 0) continue;
        const Matrix3d& R = joint.rotation;
        const Triple<Pair> load = turnOutwards(R, motions[index(i)].angle, loads[index(i)]);
        double px = joint.origin.x(), py = joint.origin.y(), pz = joint.origin.z();
        if (joint.isPrismatic) {
            px += q[i] * R(0, 2);
            py += q[i] * R(1, 2);
            pz += q[i] * R(2, 2);
        }
        const double fx = load.x[0], fy = load.y[0], fz = load.z[0];
        Triple<Pair>& before = loads[index(joint.parent)];
        before.x += load.x + Pair{0.0, py * fz - pz * fy};
        before.y += load.y + Pair{0.0, pz * fx - px * fz};
        before.z += load.z + Pair{0.0, px * fy - py * fx};
    }
}

void ArmRecursion::calcInertia(const JointVector& q, JointMatrix& M) const {
    VIABLE_CHECK(q.size() == n_, "q has one entry per joint");
    struct Composite {
        Matrix3d rotation;  // seen from the joint before
        Vector3d origin;
        double mass;
        Vector3d moment;
        Matrix3d second;
    };
    std::array<Composite, kMaxJoints> composites;
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[index(i)];
        const Matrix3d& R = joint.rotation;
        Composite& own = composites[index(i)];
        own.origin = joint.origin;
        own.mass = joint.mass;
        own.moment = joint.moment;
        own.second = joint.second;
        if (joint.isPrismatic) {
            own.rotation = R;
            own.origin += q[i] * R.col(2);
        } else {
            const Angle angle = calcAngle(q[i]);
            own.rotation.col(0) = angle.c * R.col(0) + angle.s * R.col(1);
            own.rotation.col(1) = angle.c * R.col(1) - angle.s * R.col(0);
            own.rotation.col(2) = R.col(2);
        }
    }
    M.setZero(n_, n_);
    // From the tips inwards: whatever a joint carries is complete when its turn comes.
    for (int j = n_ - 1; j >= 0; --j) {
        const Joint& joint = joints_[index(j)];
        const Composite& carried = composites[index(j)];
        const Vector3d& h = carried.moment;
        const Matrix3d& E = carried.second;
        // What accelerates the composite body by 1 along the joint.
        Vector3d force(-h.y(), h.x(), 0.0);
        Vector3d moment(-E(0, 2), -E(1, 2), E(0, 0) + E(1, 1));
        if (joint.isPrismatic) {
            force = {0.0, 0.0, carried.mass};
            moment = {h.y(), -h.x(), 0.0};
        }
        M(j, j) = (joint.isPrismatic ? force.z() : moment.z()) + joint.rotorInertia;
        for (int i = j; joints_[index(i)].parent >= 0;) {
            const Composite& frame = composites[index(i)];
            const Vector3d turned = frame.rotation * force;
            moment = frame.rotation * moment + frame.origin.cross(turned);
            force = turned;
            i = joints_[index(i)].parent;
            M(i, j) = M(j, i) = joints_[index(i)].isPrismatic ? force.z() : moment.z();
        }
        if (joint.parent < 0) continue;
        Composite& before = composites[index(joint.parent)];
        const Matrix3d& R = carried.rotation;
        const Vector3d& p = carried.origin;
        const Vector3d turned = R * h;
        const Vector3d shifted = turned + 0.5 * carried.mass * p;
        const Matrix3d half = R * E;
        const Matrix3d shift = shifted * p.transpose();
        before.mass += carried.mass;
        before.moment += turned + carried.mass * p;
        before.second += half * R.transpose() + shift + shift.transpose();
    }
}

}  // namespace viable
