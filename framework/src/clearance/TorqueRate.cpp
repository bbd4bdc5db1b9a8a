#include "clearance/TorqueRate.h"

#include <Eigen/Eigenvalues>

namespace viable::detail {

TorqueRate::TorqueRate(const RobotDescription& robot) : n_(robot.size()), gravity_(robot.gravity.norm()) {
    for (int i = 0; i < n_; ++i) {
        const JointDescription& joint = robot.joints[static_cast<std::size_t>(i)];
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> principal(joint.body.inertia, Eigen::EigenvaluesOnly);
        bodies_[static_cast<std::size_t>(i)] = {joint.parent,
                                                joint.type == JointType::Prismatic,
                                                joint.placement.translation().norm(),
                                                joint.body.com.norm(),
                                                joint.body.mass,
                                                principal.eigenvalues().maxCoeff(),
                                                robot.actuation.rotorInertia[i]};
    }
}

/* With w, A, E the bounds of a frame's angular velocity, acceleration and its derivative, and a point fixed in it at
distance d from its origin, whose acceleration and its derivative are bounded by B and C:
    acceleration  B + (A + w^2) d,    its derivative  C + (E + 3 w A + w^3) d
A joint about an axis that turns with the parent (w, A, E) at speed s, with c and e bounding its derivatives:
    w + s,    A + c + w s,    E + e + 2 w c + A s + w^2 s
A moment about the centre of mass, I alpha + omega x I omega, changes by at most I (E + 4 w A + w^3). */
void TorqueRate::calcBound(const ArmPath::Extremes& path, JointVector& bound) const {
    struct Motion {
        double w = 0.0, A = 0.0, E = 0.0, B = 0.0, C = 0.0, reach = 0.0;
    };
    std::array<Motion, kMaxJoints> motions;
    std::array<double, kMaxJoints> force, forceRate, moment, momentRate;
    bound.setZero(n_);
    for (int i = 0; i < n_; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const Body& body = bodies_[at];
        const Motion base{0.0, 0.0, 0.0, gravity_, 0.0, 0.0};
        const Motion& p = body.parent >= 0 ? motions[static_cast<std::size_t>(body.parent)] : base;
        const double s = path.velocity[i], c = path.acceleration[i], e = path.jerk[i];
        Motion& m = motions[at];
        const double d = body.offset + (body.isPrismatic ? path.position[i] : 0.0);
        m = p;
        m.reach = d;
        m.B = p.B + (p.A + p.w * p.w) * d;
        m.C = p.C + (p.E + 3.0 * p.w * p.A + p.w * p.w * p.w) * d;
        if (body.isPrismatic) {
            m.B += 2.0 * p.w * s + c;
            m.C += 3.0 * (p.A + p.w * p.w) * s + 3.0 * p.w * c + e;
        } else {
            m.w = p.w + s;
            m.A = p.A + c + p.w * s;
            m.E = p.E + e + 2.0 * p.w * c + p.A * s + p.w * p.w * s;
        }
        const double w3 = m.w * m.w * m.w;
        force[at] = body.mass * (m.B + (m.A + m.w * m.w) * body.com);
        forceRate[at] = body.mass * (m.C + (m.E + 3.0 * m.w * m.A + w3) * body.com);
        moment[at] = body.inertia * (m.A + m.w * m.w);
        momentRate[at] = body.inertia * (m.E + 4.0 * m.w * m.A + w3);
        bound[i] += body.rotor * e;

        // What this body asks of every joint that carries it: arm and its rate from that joint's frame to the body.
        double arm = body.com, armRate = m.w * body.com;
        for (int k = i; k >= 0;) {
            const Body& carrier = bodies_[static_cast<std::size_t>(k)];
            const int parent = carrier.parent;
            const double turn = parent >= 0 ? motions[static_cast<std::size_t>(parent)].w : 0.0;
            if (carrier.isPrismatic)
                bound[k] += turn * force[at] + forceRate[at];
            else
                bound[k] +=
                    turn * (arm * force[at] + moment[at]) + armRate * force[at] + arm * forceRate[at] + momentRate[at];
            arm += motions[static_cast<std::size_t>(k)].reach;
            armRate +=
                turn * motions[static_cast<std::size_t>(k)].reach + (carrier.isPrismatic ? path.velocity[k] : 0.0);
            k = parent;
        }
    }
}

}  // namespace viable::detail
