#include "DisturbedArm.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace viable {

namespace {

const double kGamma = 1.0 - std::sqrt(0.5);
/** Relative to the velocities. */
constexpr double kSolved = 1e-13;

}  // namespace

DisturbedArm::DisturbedArm(const RobotDescription& robot, const JointVector& viscousVelocity)
    : arm_(robot), n_(robot.size()), viscousVelocity_(viscousVelocity) {
    reset(JointVector::Zero(n_));
}

void DisturbedArm::reset(const JointVector& q) {
    q_ = q;
    v_ = a_ = JointVector::Zero(n_);
}

void DisturbedArm::advance(const Acting& acting, double time_s) {
    const double s = time_s;
    const JointVector middle = q_ + 0.5 * s * (v_ + 0.25 * s * a_);
    JointVector b;
    arm_.calcInertia(middle, M_);
    arm_.calcTorque(middle, v_ + 0.5 * s * a_, JointVector::Zero(n_), b);
    const JointVector net = acting.torque - b, momentum = M_.lazyProduct(v_);
    JointVector first = v_, second;
    const JointVector pushed = momentum + kGamma * s * net;
    solve(acting, kGamma * s, pushed, first);
    // In place of the friction at the first stage what it has taken there: it may be anything in its range at rest.
    const JointVector friction = (pushed - M_.lazyProduct(first)) / (kGamma * s);
    second = first;
    solve(acting, kGamma * s, momentum + s * net - (1.0 - kGamma) * s * friction, second);
    q_ += s * ((1.0 - kGamma) * first + kGamma * second);
    a_ = (second - v_) / s;
    v_ = second;
}

void DisturbedArm::solve(const Acting& acting, double c, const JointVector& r, JointVector& x) const {
    if (solveByModes(acting, c, r, x)) return;
    solveJointByJoint(acting, c, r, x);
}

/** Newton's method with guesses which joints rest and which way the others move; false where it does not agree soon. */
bool DisturbedArm::solveByModes(const Acting& acting, double c, const JointVector& r, JointVector& x) const {
    std::array<int, kMaxJoints> mode;  // sign of the velocity; 0: rests
    for (int i = 0; i < n_; ++i) mode[i] = x[i] > 0.0 ? 1 : x[i] < 0.0 ? -1 : 0;
    for (int round = 0; round < 20; ++round) {
        JointMatrix A = M_;
        JointVector y = r;
        for (int i = 0; i < n_; ++i) {
            if (mode[i] == 0 && acting.dry[i] > 0.0) continue;
            const double size = std::abs(x[i]), left = std::exp(-size / viscousVelocity_[i]);
            const double slope = acting.viscous[i] / viscousVelocity_[i] * left;
            const double torque = acting.dry[i] + acting.viscous[i] * (1.0 - left);
            A(i, i) += c * slope;
            y[i] -= c * mode[i] * (torque - slope * size);
        }
        for (int i = 0; i < n_; ++i) {
            if (mode[i] != 0 || acting.dry[i] == 0.0) continue;
            A.row(i).setZero();
            A.col(i).setZero();
            A(i, i) = 1.0;
            y[i] = 0.0;
        }
        const JointVector next = Eigen::LLT<JointMatrix>(A).solve(y), force = r - M_.lazyProduct(next);
        const double change = (next - x).cwiseAbs().maxCoeff(), size = next.cwiseAbs().maxCoeff();
        x = next;
        bool agrees = true;
        for (int i = 0; i < n_; ++i) {
            const int moves = x[i] > 0.0 ? 1 : x[i] < 0.0 ? -1 : 0;
            if (acting.dry[i] == 0.0) {
                mode[i] = moves;
            } else if (mode[i] != 0) {
                if (moves == mode[i]) continue;
                mode[i] = 0;
                x[i] = 0.0;
                agrees = false;
            } else if (std::abs(force[i]) > c * acting.dry[i] * (1.0 + 1e-12)) {
                mode[i] = force[i] > 0.0 ? 1 : -1;
                agrees = false;
            }
        }
        if (agrees && change <= kSolved * size + 1e-18) return true;
    }
    return false;
}

/** Coordinate descent on the convex function whose minimum is x: slow, but it arrives. */
void DisturbedArm::solveJointByJoint(const Acting& acting, double c, const JointVector& r, JointVector& x) const {
    for (int round = 0; round < 2000; ++round) {
        double change = 0.0;
        for (int i = 0; i < n_; ++i) {
            const double rest = r[i] - M_.row(i).dot(x) + M_(i, i) * x[i];
            const double free = std::abs(rest) - c * acting.dry[i];
            double size = 0.0;
            // Concave and growing: Newton's method from 0 comes from below.
            for (int k = 0; free > 0.0 && k < 60; ++k) {
                const double left = std::exp(-size / viscousVelocity_[i]);
                const double missing = free - M_(i, i) * size - c * acting.viscous[i] * (1.0 - left);
                const double step = missing / (M_(i, i) + c * acting.viscous[i] / viscousVelocity_[i] * left);
                size += step;
                if (step <= kSolved * size) break;
            }
            const double next = std::copysign(size, rest);
            change = std::max(change, std::abs(next - x[i]));
            x[i] = next;
        }
        if (change <= kSolved * x.cwiseAbs().maxCoeff()) return;
    }
}

}  // namespace viable
