#include "robot/ArmRecursion.h"

#include <cmath>

#include "robot/RigidBody.h"

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

    void operator+=(const Triple& other) {
        x += other.x;
        y += other.y;
        z += other.z;
    }
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

/** Force and moment about a point at -p, of those about the origin. */
Triple<Pair> shift(const Vector3d& p, const Triple<Pair>& load) {
    const double fx = load.x[0], fy = load.y[0], fz = load.z[0];
    return {load.x + Pair{0.0, p.y() * fz - p.z() * fy}, load.y + Pair{0.0, p.z() * fx - p.x() * fz},
            load.z + Pair{0.0, p.x() * fy - p.y() * fx}};
}

/** E^T v and E v. */
template <class T>
Triple<T> turnInwards(const Matrix3d& E, const Triple<T>& v) {
    return {E(0, 0) * v.x + E(1, 0) * v.y + E(2, 0) * v.z, E(0, 1) * v.x + E(1, 1) * v.y + E(2, 1) * v.z,
            E(0, 2) * v.x + E(1, 2) * v.y + E(2, 2) * v.z};
}
template <class T>
Triple<T> turnOutwards(const Matrix3d& E, const Triple<T>& v) {
    return {E(0, 0) * v.x + E(0, 1) * v.y + E(0, 2) * v.z, E(1, 0) * v.x + E(1, 1) * v.y + E(1, 2) * v.z,
            E(2, 0) * v.x + E(2, 1) * v.y + E(2, 2) * v.z};
}

/** Force and moment about its origin that move a link whose frame accelerates by `a`. */
Triple<Pair> calcSlidingLoad(double m, const Vector3d& h, const Matrix3d& E, const Swing& U, const Triple<double>& a) {
    return {Pair{m * a.x + U.xx * h.x() + U.xy * h.y() + U.xz * h.z(),
                 h.y() * a.z - h.z() * a.y + U.zx * E(0, 1) + U.zy * E(1, 1) + U.zz * E(2, 1) - U.yx * E(0, 2) -
                     U.yy * E(1, 2) - U.yz * E(2, 2)},
            Pair{m * a.y + U.yx * h.x() + U.yy * h.y() + U.yz * h.z(),
                 h.z() * a.x - h.x() * a.z + U.xx * E(0, 2) + U.xy * E(1, 2) + U.xz * E(2, 2) - U.zx * E(0, 0) -
                     U.zy * E(1, 0) - U.zz * E(2, 0)},
            Pair{m * a.z + U.zx * h.x() + U.zy * h.y() + U.zz * h.z(),
                 h.x() * a.y - h.y() * a.x + U.yx * E(0, 0) + U.yy * E(1, 0) + U.yz * E(2, 0) - U.xx * E(0, 1) -
                     U.xy * E(1, 1) - U.xz * E(2, 1)}};
}

/** The same where mass, h.z and E.zz are zero, as they are for a revolute joint's link. */
Triple<Pair> calcTurningLoad(const Vector3d& h, const Matrix3d& E, const Swing& U, const Triple<double>& a) {
    return {Pair{U.xx * h.x() + U.xy * h.y(),
                 h.y() * a.z + U.zx * E(0, 1) + U.zy * E(1, 1) + U.zz * E(2, 1) - U.yx * E(0, 2) - U.yy * E(1, 2)},
            Pair{U.yx * h.x() + U.yy * h.y(),
                 -h.x() * a.z + U.xx * E(0, 2) + U.xy * E(1, 2) - U.zx * E(0, 0) - U.zy * E(1, 0) - U.zz * E(2, 0)},
            Pair{U.zx * h.x() + U.zy * h.y(), h.x() * a.y - h.y() * a.x + U.yx * E(0, 0) + U.yy * E(1, 0) +
                                                  U.yz * E(2, 0) - U.xx * E(0, 1) - U.xy * E(1, 1) - U.xz * E(2, 1)}};
}

/** Mass and moments of all that a joint carries; `second` has its upper triangle only. */
struct Composite {
    double mass;
    double hx, hy, hz;
    double xx, xy, xz, yy, yz, zz;

    Composite() = default;
    Composite(double m, const Vector3d& h, const Matrix3d& E)
        : mass(m),
          hx(h.x()),
          hy(h.y()),
          hz(h.z()),
          xx(E(0, 0)),
          xy(E(0, 1)),
          xz(E(0, 2)),
          yy(E(1, 1)),
          yz(E(1, 2)),
          zz(E(2, 2)) {}

    /** Adds what another frame carries, seen from there. */
    void add(const Composite& other, const Matrix3d& E, const Vector3d& p) {
        const Pair e0 = {E(0, 0), E(1, 0)}, e1 = {E(0, 1), E(1, 1)}, e2 = {E(0, 2), E(1, 2)};
        // E C: its first two rows side by side, its third
        const Pair upperX = other.xx * e0 + other.xy * e1 + other.xz * e2;
        const Pair upperY = other.xy * e0 + other.yy * e1 + other.yz * e2;
        const Pair upperZ = other.xz * e0 + other.yz * e1 + other.zz * e2;
        const double lowerX = other.xx * E(2, 0) + other.xy * E(2, 1) + other.xz * E(2, 2);
        const double lowerY = other.xy * E(2, 0) + other.yy * E(2, 1) + other.yz * E(2, 2);
        const double lowerZ = other.xz * E(2, 0) + other.yz * E(2, 1) + other.zz * E(2, 2);
        const Pair first = upperX * E(0, 0) + upperY * E(0, 1) + upperZ * E(0, 2);
        const Pair third = lowerX * e0 + lowerY * e1 + lowerZ * e2;

        const Pair turned = other.hx * e0 + other.hy * e1 + other.hz * e2;
        const double tx = turned[0], ty = turned[1];
        const double tz = other.hx * E(2, 0) + other.hy * E(2, 1) + other.hz * E(2, 2);
        const double half = 0.5 * other.mass;
        const double sx = tx + half * p.x(), sy = ty + half * p.y(), sz = tz + half * p.z();
        mass += other.mass;
        hx += tx + other.mass * p.x();
        hy += ty + other.mass * p.y();
        hz += tz + other.mass * p.z();
        xx += first[0] + 2.0 * sx * p.x();
        xy += first[1] + sx * p.y() + sy * p.x();
        yy += upperX[1] * E(1, 0) + upperY[1] * E(1, 1) + upperZ[1] * E(1, 2) + 2.0 * sy * p.y();
        xz += third[0] + sx * p.z() + sz * p.x();
        yz += third[1] + sy * p.z() + sz * p.y();
        zz += lowerX * E(2, 0) + lowerY * E(2, 1) + lowerZ * E(2, 2) + 2.0 * sz * p.z();
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
        const JointDescription& from = robot.joints[i];
        VIABLE_CHECK(from.parent >= -1 && from.parent < i, "parents come before children");
        movers_[i] = 1u << i | (from.parent < 0 ? 0u : movers_[from.parent]);

        const Matrix3d placed = from.placement.linear();
        const bool isPrismatic = from.type == JointType::Prismatic;
        FramePlacement& placement = placements_[i];
        const Matrix3d alongAxis = from.axis * from.axis.transpose();  // Rodrigues
        placement.fixed = isPrismatic ? placed : placed * alongAxis;
        placement.cosine = placed * (Matrix3d::Identity() - alongAxis);
        placement.sine = placed * makeCross(from.axis);
        placement.origin = from.placement.translation();
        placement.axis = placed * from.axis;

        Matrix3d& own = axisFrame[i];
        own = detail::makeAxisFrame(from.axis);
        const Matrix3d before = from.parent < 0 ? Matrix3d::Identity() : axisFrame[from.parent];
        Joint& joint = joints_[i];
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
    toolParent_ = robot.toolParent;
    VIABLE_CHECK(toolParent_ < n_, "the tool hangs on a joint");
    if (toolParent_ >= 0) {
        const Matrix3d inward = axisFrame[toolParent_].transpose();
        toolRotation_ = inward * robot.toolPlacement.linear();
        toolOrigin_ = inward * robot.toolPlacement.translation();
    }
    // From the tips inwards: mass on a revolute joint's axis moves with the link before it.
    for (int i = n_ - 1; i >= 0; --i) {
        Joint& joint = joints_[i];
        if (joint.isPrismatic) continue;
        if (joint.parent >= 0) {
            Joint& before = joints_[joint.parent];
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
        const Joint& joint = joints_[i];
        const FramePlacement& from = placements_[i];
        Matrix3d turned = from.fixed;
        Vector3d place = from.origin;
        if (joint.isPrismatic) {
            place += q[i] * from.axis;
        } else {
            const Angle angle = calcAngle(q[i]);
            turned += angle.c * from.cosine + angle.s * from.sine;
        }
        Matrix3d& rotation = frames.rotation[i];
        Vector3d& origin = frames.origin[i];
        Vector3d& axis = frames.axis[i];
        if (joint.parent < 0) {
            rotation = turned;
            origin = place;
            axis = from.axis;
        } else {
            const Matrix3d& before = frames.rotation[joint.parent];
            rotation = before.lazyProduct(turned);
            origin = frames.origin[joint.parent] + before.lazyProduct(place);
            axis = before.lazyProduct(from.axis);
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
        const Joint& joint = joints_[i];
        const Matrix3d& R = joint.rotation;
        Motion& motion = motions[i];
        if (!joint.isPrismatic) motion.angle = calcAngle(q[i]);
        const Angle angle = motion.angle;

        Triple<Pair> spin;
        Triple<double> a;
        if (joint.parent < 0) {
            spin = {Pair{0.0, 0.0}, Pair{0.0, 0.0}, Pair{0.0, 0.0}};
            a = {-gravity_.x(), -gravity_.y(), -gravity_.z()};
        } else {
            const Motion& before = motions[joint.parent];
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
            loads[i] = calcSlidingLoad(joint.mass, h, E, U, a);
            motion.swing = U;
        } else {
            const double wx = spin.x[0], wy = spin.y[0];
            spin.x += Pair{0.0, qd[i] * wy};
            spin.y -= Pair{0.0, qd[i] * wx};
            spin.z += Pair{qd[i], qdd[i]};
            const Swing U(spin);
            loads[i] = calcTurningLoad(h, E, U, a);
            motion.swing = U;
        }
        motion.spin = spin;
        motion.acceleration = a;
    }

    tau.resize(n_);
    for (int i = n_ - 1; i >= 0; --i) {
        const Joint& joint = joints_[i];
        tau[i] = loads[i].z[joint.isPrismatic ? 0 : 1] + joint.rotorInertia * qdd[i];
        if (joint.parent < 0) continue;
        const Matrix3d& R = joint.rotation;
        const Triple<Pair> load = turnOutwards(R, motions[i].angle, loads[i]);
        Vector3d p = joint.origin;
        if (joint.isPrismatic) p += q[i] * R.col(2);
        loads[joint.parent] += shift(p, load);
    }
}

/** What is known of each joint in one state; entries from size() on are left alone. */
struct ArmRecursion::Pass {
    const ArmRecursion& arm;
    std::array<Matrix3d, kMaxJoints> rotation;  // of a joint's frame, seen from that of the joint before
    std::array<Vector3d, kMaxJoints> origin;    // [m]
    std::array<Composite, kMaxJoints> carried;
    std::array<Triple<Pair>, kMaxJoints> column;  // force and moment that accelerate what joint j carries by 1

    explicit Pass(const ArmRecursion& recursion) : arm(recursion) {}

    void place(int i, double q) {
        const Joint& joint = arm.joints_[i];
        const Matrix3d& R = joint.rotation;
        Matrix3d& E = rotation[i];
        origin[i] = joint.origin;
        carried[i] = Composite(joint.mass, joint.moment, joint.second);
        if (joint.isPrismatic) {
            E = R;
            origin[i] += q * R.col(2);
        } else {
            const Angle angle = calcAngle(q);
            E.col(0) = angle.c * R.col(0) + angle.s * R.col(1);
            E.col(1) = angle.c * R.col(1) - angle.s * R.col(0);
            E.col(2) = R.col(2);
        }
    }

    /** The row of joint i in M, left of and on the diagonal, once all that it carries is known; and what it carries goes to
    the joint before. */
    void addInertia(int i, JointMatrix& M) {
        const Joint& joint = arm.joints_[i];
        const Composite& own = carried[i];
        if (joint.isPrismatic) {
            column[i] = {Pair{0.0, own.hy}, Pair{0.0, -own.hx}, Pair{own.mass, 0.0}};
            M(i, i) = own.mass + joint.rotorInertia;
        } else {
            column[i] = {Pair{-own.hy, -own.xz}, Pair{own.hx, -own.yz}, Pair{0.0, own.xx + own.yy}};
            M(i, i) = own.xx + own.yy + joint.rotorInertia;
        }
        if (joint.parent < 0) return;
        const Joint& before = arm.joints_[joint.parent];
        const Matrix3d& E = rotation[i];
        const Vector3d& p = origin[i];
        carried[joint.parent].add(own, E, p);
        if (before.parent < 0) {  // the way ends there: only the part along that joint is asked for
            const int lane = before.isPrismatic ? 0 : 1;
            Triple<Pair> along;
            if (lane == 0)
                along = {Pair{E(2, 0), 0.0}, Pair{E(2, 1), 0.0}, Pair{E(2, 2), 0.0}};
            else
                along = {Pair{p.x() * E(1, 0) - p.y() * E(0, 0), E(2, 0)},
                         Pair{p.x() * E(1, 1) - p.y() * E(0, 1), E(2, 1)},
                         Pair{p.x() * E(1, 2) - p.y() * E(0, 2), E(2, 2)}};
            for (int j = i; j < arm.n_; ++j) {
                if (!arm.moves(i, j)) continue;
                const Triple<Pair>& load = column[j];
                const Pair sum = along.x * load.x + along.y * load.y + along.z * load.z;
                M(joint.parent, j) = M(j, joint.parent) = sum[0] + sum[1];
            }
            return;
        }
        for (int j = i; j < arm.n_; ++j) {
            if (!arm.moves(i, j)) continue;
            Triple<Pair>& load = column[j];
            load = shift(p, turnOutwards(E, load));
            M(joint.parent, j) = M(j, joint.parent) = load.z[before.isPrismatic ? 0 : 1];
        }
    }
};

void ArmRecursion::calcInertia(const JointVector& q, JointMatrix& M) const {
    VIABLE_CHECK(q.size() == n_, "q has one entry per joint");
    Pass pass(*this);
    for (int i = 0; i < n_; ++i) pass.place(i, q[i]);
    M.setZero(n_, n_);
    for (int i = n_ - 1; i >= 0; --i) pass.addInertia(i, M);  // from the tips inwards
}

void ArmRecursion::calcDynamics(const JointVector& q, const JointVector& qd, Dynamics& out) const {
    VIABLE_CHECK(q.size() == n_ && qd.size() == n_, "q and qd have one entry per joint");
    VIABLE_CHECK(toolParent_ >= 0, "the tool hangs on a joint");
    struct Motion {
        Triple<Pair> spin;          // angular velocity, angular acceleration
        Triple<Pair> acceleration;  // of the frame's origin; gravity's
        Swing swing;
    };
    struct Place {  // in the base frame
        Matrix3d rotation;
        Vector3d origin;
    };
    Pass pass(*this);
    std::array<Motion, kMaxJoints> motions;
    std::array<Place, kMaxJoints> places;        // of the joints that move the tool
    std::array<Triple<Pair>, kMaxJoints> loads;  // force, moment about the frame's origin; of the velocities

    for (int i = 0; i < n_; ++i) {
        pass.place(i, q[i]);
        const Joint& joint = joints_[i];
        const Matrix3d& E = pass.rotation[i];
        const Vector3d& p = pass.origin[i];
        const bool movesTool = moves(i, toolParent_);
        Place& place = places[i];
        Triple<Pair> spin, a;
        if (joint.parent < 0) {
            spin = {Pair{0.0, 0.0}, Pair{0.0, 0.0}, Pair{0.0, 0.0}};
            a = {Pair{0.0, gravity_.x()}, Pair{0.0, gravity_.y()}, Pair{0.0, gravity_.z()}};
            if (movesTool) place = {E, p};
        } else {
            const Motion& before = motions[joint.parent];
            const Swing& U = before.swing;
            spin = turnInwards(E, before.spin);
            a = before.acceleration;
            a.x += Pair{U.xx * p.x() + U.xy * p.y() + U.xz * p.z(), 0.0};
            a.y += Pair{U.yx * p.x() + U.yy * p.y() + U.yz * p.z(), 0.0};
            a.z += Pair{U.zx * p.x() + U.zy * p.y() + U.zz * p.z(), 0.0};
            if (movesTool) {
                const Place& from = places[joint.parent];
                place.rotation.noalias() = from.rotation * E;
                place.origin.noalias() = from.rotation * p;
                place.origin += from.origin;
            }
        }
        a = turnInwards(E, a);
        Motion& motion = motions[i];
        if (joint.isPrismatic) {
            a.x += Pair{2.0 * qd[i] * spin.y[0], 0.0};
            a.y -= Pair{2.0 * qd[i] * spin.x[0], 0.0};
            motion.swing = Swing(spin);
            loads[i] = calcSlidingLoad(joint.mass, joint.moment, joint.second, motion.swing, {a.x[0], a.y[0], a.z[0]});
        } else {
            const double wx = spin.x[0], wy = spin.y[0];
            spin.x += Pair{0.0, qd[i] * wy};
            spin.y -= Pair{0.0, qd[i] * wx};
            spin.z += Pair{qd[i], 0.0};
            motion.swing = Swing(spin);
            loads[i] = calcTurningLoad(joint.moment, joint.second, motion.swing, {a.x[0], a.y[0], a.z[0]});
        }
        motion.spin = spin;
        motion.acceleration = a;
    }

    out.M.setZero(n_, n_);
    out.b.resize(n_);
    out.gravity.resize(n_);
    for (int i = n_ - 1; i >= 0; --i) {  // from the tips inwards
        const Joint& joint = joints_[i];
        pass.addInertia(i, out.M);
        const Composite& own = pass.carried[i];
        const Triple<Pair>& a = motions[i].acceleration;
        out.gravity[i] = joint.isPrismatic ? -own.mass * a.z[1] : own.hy * a.x[1] - own.hx * a.y[1];
        out.b[i] = loads[i].z[joint.isPrismatic ? 0 : 1] + out.gravity[i];
        if (joint.parent < 0) continue;
        loads[joint.parent] += shift(pass.origin[i], turnOutwards(pass.rotation[i], loads[i]));
    }

    const Place& carrier = places[toolParent_];
    out.tool.position = carrier.origin + carrier.rotation * toolOrigin_;
    out.tool.orientation = Eigen::Quaterniond(Matrix3d(carrier.rotation * toolRotation_));
    out.J.setZero(6, n_);
    for (int i = toolParent_; i >= 0; i = joints_[i].parent) {
        const Vector3d axis = places[i].rotation.col(2);
        if (joints_[i].isPrismatic) {
            out.J.col(i).head<3>() = axis;
        } else {
            out.J.col(i).head<3>() = axis.cross(out.tool.position - places[i].origin);
            out.J.col(i).tail<3>() = axis;
        }
    }
}

}  // namespace viable
