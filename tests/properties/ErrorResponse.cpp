#include "ErrorResponse.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace viable {

using Eigen::MatrixXd;
using Eigen::VectorXd;

double ErrorResponse::calcSize(int joint, int age, double tick_s) const {
    const double a = begin(joint, age), b = end(joint, age);
    if (a * b >= 0.0) return 0.5 * tick_s * (std::abs(a) + std::abs(b));
    return 0.5 * tick_s * (a * a + b * b) / (std::abs(a) + std::abs(b));
}

ErrorResponse calcResponse(const LinearLoop& loop, int joint, bool isVelocity, int ticks) {
    const auto n = static_cast<int>(loop.kr.size());
    const int d = loop.delayTicks;
    const double h = loop.tick_s;
    const MatrixXd inverse = MatrixXd(loop.M).llt().solve(MatrixXd::Identity(n, n));
    // e, de and a torque that is held, over a tick.
    MatrixXd flow = MatrixXd::Zero(3 * n, 3 * n);
    flow.block(0, n, n, n).setIdentity();
    flow.block(n, n, n, n) = -inverse * MatrixXd(loop.damping.asDiagonal());
    flow.block(n, 2 * n, n, n) = inverse;
    const MatrixXd tick = MatrixXd(h * flow).exp();
    // The torque of a tick from x = (e, de, e read before, sum of e dt, torques under way) and the reading's error.
    const int size = n * (4 + d);
    MatrixXd torque = MatrixXd::Zero(n, size);
    const VectorXd kr = loop.kr, kp = loop.kp, ki = loop.ki;
    const VectorXd ofReading = kr.cwiseProduct(VectorXd::Constant(n, 1.0 / h) + kp + h * ki);
    torque.block(0, 0, n, n).diagonal() = -ofReading;
    torque.block(0, 2 * n, n, n).diagonal() = kr / h;
    torque.block(0, 3 * n, n, n).diagonal() = -kr.cwiseProduct(ki);
    MatrixXd A = MatrixXd::Zero(size, size), B = MatrixXd::Zero(size, n);
    A.topLeftCorner(2 * n, 2 * n) = tick.topLeftCorner(2 * n, 2 * n);
    const MatrixXd push = tick.block(0, 2 * n, 2 * n, n);
    if (d == 0) {
        A.topRows(2 * n) += push * torque;
        B.topRows(2 * n) = -push * ofReading.asDiagonal();
    } else {
        A.block(0, 4 * n, 2 * n, n) += push;
        for (int k = 0; k + 1 < d; ++k) A.block((4 + k) * n, (5 + k) * n, n, n).setIdentity();
        A.bottomRows(n) = torque;
        B.bottomRows(n) = MatrixXd((-ofReading).asDiagonal());
    }
    A.block(2 * n, 0, n, n).setIdentity();
    B.middleRows(2 * n, n).setIdentity();
    A.block(3 * n, 3 * n, n, n).setIdentity();
    A.block(3 * n, 0, n, n).diagonal().setConstant(h);
    B.middleRows(3 * n, n).diagonal().setConstant(h);

    const MatrixXd back = A.transpose(), read = B.transpose();
    const MatrixXd atEnd = inverse, atBegin = inverse * tick.block(0, n, 2 * n, n).transpose();
    ErrorResponse response{MatrixXd(n, ticks), MatrixXd(n, ticks), MatrixXd(n, ticks)};
    VectorXd costate = VectorXd::Unit(size, (isVelocity ? n : 0) + joint);
    for (int k = 0; k < ticks; ++k) {
        response.end.col(k).noalias() = atEnd * costate.segment(n, n);
        response.begin.col(k).noalias() = atBegin * costate.head(2 * n);
        response.reading.col(k).noalias() = read * costate;
        costate = back * costate;
    }
    return response;
}

}  // namespace viable
