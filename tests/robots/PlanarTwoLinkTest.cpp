#include <gtest/gtest.h>

#include <cmath>

#include "Paths.h"
#include "RandomStates.h"
#include "viable/robot/RobotModel.h"

namespace viable {
namespace {

/** The textbook's planar arm with two revolute joints (Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, example
7.4), q1 and q2 counted from the horizontal, with the figures of the folder's README. */
struct Textbook {
    double m1 = 2.0, m2 = 1.0;          // [kg]
    double l1 = 0.5, l2 = 0.5;          // [m]
    double lc1 = l1 / 2, lc2 = l2 / 2;  // uniform rods
    double I1 = m1 * l1 * l1 / 12.0, I2 = m2 * l2 * l2 / 12.0, height = 1.0, g = 9.81;

    void calc(const JointState& s, Dynamics& out) const {
        const double c1 = std::cos(s.q[0]), c2 = std::cos(s.q[1]), s2 = std::sin(s.q[1]);
        const double c12 = std::cos(s.q[0] + s.q[1]), s12 = std::sin(s.q[0] + s.q[1]);
        const double coupling = m2 * (lc2 * lc2 + l1 * lc2 * c2) + I2;
        out.M.resize(2, 2);
        out.M << m1 * lc1 * lc1 + m2 * (l1 * l1 + lc2 * lc2 + 2 * l1 * lc2 * c2) + I1 + I2,
            coupling,  //
            coupling, m2 * lc2 * lc2 + I2;
        out.gravity.resize(2);
        out.gravity << (m1 * lc1 + m2 * l1) * g * c1 + m2 * lc2 * g * c12, m2 * lc2 * g * c12;
        const double h = -m2 * l1 * lc2 * s2;
        out.b.resize(2);
        out.b << h * s.qd[1] * s.qd[0] + h * (s.qd[0] + s.qd[1]) * s.qd[1], -h * s.qd[0] * s.qd[0];
        out.b += out.gravity;
        out.tool.position = {l1 * c1 + l2 * c12, 0.0, height + l1 * std::sin(s.q[0]) + l2 * s12};
        out.J.resize(6, 2);
        out.J.setZero();
        const double dx1 = -l1 * std::sin(s.q[0]) - l2 * s12, dz1 = l1 * c1 + l2 * c12;
        out.J.row(0) << dx1, -l2 * s12;
        out.J.row(2) << dz1, l2 * c12;
        out.J.row(4) << -1.0, -1.0;  // up is positive: about -y
    }
};

TEST(PlanarTwoLink, IsTheTextbooksArm) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/planar_two_link");
    RobotModel model(robot);
    RandomStates states(robot, 11);
    const Textbook textbook;
    Dynamics ours, theirs;
    for (int k = 0; k < 1000; ++k) {
        const JointState state = states.draw();
        model.calcDynamics(state.q, state.qd, ours);
        textbook.calc(state, theirs);
        ASSERT_LT((ours.M - theirs.M).cwiseAbs().maxCoeff(), 1e-14);              // of 1.2 kg m^2
        ASSERT_LT((ours.gravity - theirs.gravity).cwiseAbs().maxCoeff(), 1e-13);  // of 12 Nm
        ASSERT_LT((ours.b - theirs.b).cwiseAbs().maxCoeff(), 1e-13);              // of 24 Nm
        ASSERT_LT((ours.tool.position - theirs.tool.position).norm(), 1e-14);
        ASSERT_LT((ours.J - theirs.J).cwiseAbs().maxCoeff(), 1e-14);
        const Eigen::Quaterniond turned(Eigen::AngleAxisd(-state.q.sum(), Eigen::Vector3d::UnitY()));
        ASSERT_LT((ours.tool.orientation.toRotationMatrix() - turned.toRotationMatrix()).norm(), 1e-14);
    }
}

}  // namespace
}  // namespace viable
