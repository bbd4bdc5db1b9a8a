#include "clearance/TorqueRate.h"

#include <Eigen/Eigenvalues>

namespace viable::detail {

TorqueRate::TorqueRate(const RobotDescription& robot) : n_(robot.size()), gravity_(robot.gravity.norm()) {
    for (int i = 0; i < n_; ++i) {
        const JointDescription& joint = robot.joints[i];
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> principal(joint.body.inertia, Eigen::EigenvaluesOnly);
        bodies_[i] = {joint.parent,
                      joint.type == JointType::Prismatic,
                      joint.placement.translation().norm(),
                      joint.body.com.norm(),
                      joint.body.mass,
                      principal.eigenvalues().maxCoeff(),
                      robot.actuation.rotorInertia[i]};
    }
}

/* Two motions of one frame: w, A, B bound the angular velocity and acceleration and the acceleration of the origin of both,
turned, dw, dA, dB how far apart they are, `turned` the angle between the two rotations. For x y with |x| <= X, |y| <= Y
the difference is at most dX Y + X dY. What is fixed in the frame, of length d, differs by at most turned d, so the
acceleration B + (A + w^2) d of such a point by
    dB + (dA + turned A + 2 w dw + turned w^2) d.
A joint about an axis that is fixed in its parent (w, A, turned), with speed s and acceleration c:
    w + s,    A + c + w s,    dw + ds + turned s,    dA + dc + turned c + dw s + w (ds + turned s).
An inertia I (largest principal one; all of them above 0) differs by at most turned I, so the moment I alpha + omega x I omega by
    I (dA + turned A + 2 w dw + turned w^2).
How fast one motion changes are the same formulas, with differences per time. */
void TorqueRate::calcChange(const ArmPath::Extremes& motion, const JointVector& dq, const JointVector& dqd,
                            const JointVector& dqdd, JointVector& bound) const {
    struct Frame {
        double w = 0.0, A = 0.0, B = 0.0, turned = 0.0, dw = 0.0, dA = 0.0, dB = 0.0;
        double reach = 0.0;  // from the parent's origin
        double slid = 0.0;   // what of its change is not the parent's turning
        double calcChange() const { return dA + turned * A + 2.0 * w * dw + turned * w * w; }
    };
    const Frame base{0.0, 0.0, gravity_, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    std::array<Frame, kMaxJoints> frames;
    bound.setZero(n_);
    for (int i = 0; i < n_; ++i) {
        const Body& body = bodies_[i];
        const Frame& p = body.parent >= 0 ? frames[body.parent] : base;
        const double s = motion.velocity[i], c = motion.acceleration[i];
        const double ds = dqd[i] + p.turned * s, dc = dqdd[i] + p.turned * c;
        Frame& f = frames[i];
        f = p;
        f.reach = body.offset + (body.isPrismatic ? motion.position[i] : 0.0);
        f.slid = body.isPrismatic ? dq[i] : 0.0;
        f.B += (p.A + p.w * p.w) * f.reach;
        f.dB += p.calcChange() * f.reach + (p.A + p.w * p.w) * f.slid;
        if (body.isPrismatic) {
            f.B += 2.0 * p.w * s + c;
            f.dB += 2.0 * (p.dw * s + p.w * ds) + dc;
        } else {
            f.w += s;
            f.A += c + p.w * s;
            f.turned += dq[i];
            f.dw += ds;
            f.dA += dc + p.dw * s + p.w * ds;
        }
        const double change = f.calcChange();
        const double force = body.mass * (f.B + (f.A + f.w * f.w) * body.com);
        const double dForce = body.mass * (f.dB + change * body.com);
        const double moment = body.inertia * (f.A + f.w * f.w), dMoment = body.inertia * change;
        bound[i] += body.rotor * dqdd[i];

        // What this body asks of every joint that carries it: lever from that joint's frame to the body.
        double lever = body.com, dLever = f.turned * body.com;
        for (int k = i; k >= 0;) {
            const Body& carrier = bodies_[k];
            const Frame& here = frames[k];
            const double turned = carrier.parent >= 0 ? frames[carrier.parent].turned : 0.0;
            if (carrier.isPrismatic)
                bound[k] += turned * force + dForce;
            else
                bound[k] += turned * (lever * force + moment) + dLever * force + lever * dForce + dMoment;
            lever += here.reach;
            dLever += turned * here.reach + here.slid;
            k = carrier.parent;
        }
    }
}

}  // namespace viable::detail
