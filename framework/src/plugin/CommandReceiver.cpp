#include "viable/plugin/CommandReceiver.h"

#include <algorithm>
#include <cmath>

#include "viable/core/RotationVector.h"

namespace viable {

namespace {

/** Share of a new interval between receipts in the mean: about ten of them count. */
constexpr double kNewShare = 0.1;
/** An interval counts as no more than so many of the mean: a gap is not a rate. */
constexpr double kLongestInterval = 2.0;
/** Receipts at the same time count as so far apart [s]. */
constexpr double kShortestInterval_s = 1e-6;
/** A sample is overdue after so many mean intervals. */
constexpr double kOverdue = 1.5;

/** Of two slopes of one thing what both agree in: none where they point apart. */
double calcCommon(double newer, double older) {
    if (!(newer * older > 0.0)) return 0.0;
    return std::abs(newer) < std::abs(older) ? newer : older;
}

/** The newer one, no longer than the older one reaches along it. */
Eigen::Vector3d calcCommon(const Eigen::Vector3d& newer, const Eigen::Vector3d& older) {
    const double length2 = newer.squaredNorm(), along = newer.dot(older);
    if (!(along > 0.0)) return Eigen::Vector3d::Zero();
    return newer * std::min(1.0, along / length2);
}

Eigen::Vector3d calcTurn(const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
    return calcRotationVector(to * from.conjugate());
}

}  // namespace

const char* getName(BetweenSamples between) {
    constexpr const char* kNames[] = {"hold", "interpolate", "extrapolate"};
    return kNames[static_cast<int>(between)];
}

void CommandReceiver::reset(const MotionCommand& first) {
    newest_ = base_ = first;
    base_.qd.setZero(first.q.size());
    base_.toolTwist.setZero();
    slope_.setZero(first.q.size());
    twist_.setZero();
    received_s_ = moves_s_ = period_s_ = 0.0;
    samples_ = 0;
}

void CommandReceiver::take(double t, const MotionCommand& received) {
    MotionCommand sample = received;
    sample.tool.orientation.normalize();
    const double interval = std::max(t - received_s_, kShortestInterval_s);
    if (samples_ == 1)
        period_s_ = interval;
    else if (samples_ > 1)
        period_s_ += kNewShare * (std::min(interval, kLongestInterval * period_s_) - period_s_);

    const bool isJoint = sample.space == MotionCommand::Space::Joint;
    MotionCommand base = sample;
    base.qd.setZero(sample.q.size());
    base.toolTwist.setZero();
    moves_s_ = 0.0;
    if (samples_ > 0 && between_ == BetweenSamples::Interpolate) {
        MotionCommand now;
        calc(t, now);
        base = now;
        moves_s_ = period_s_;
        if (isJoint) {
            base.qd = (sample.q - now.q) / period_s_;
        } else {
            base.toolTwist << (sample.tool.position - now.tool.position) / period_s_,
                calcTurn(now.tool.orientation, sample.tool.orientation) / period_s_;
        }
    } else if (samples_ > 0 && between_ == BetweenSamples::Extrapolate) {
        // So many samples were sent since, whenever they came.
        const double sent_s = std::max(1.0, std::round(interval / period_s_)) * period_s_;
        moves_s_ = kOverdue * period_s_;
        if (isJoint) {
            for (Eigen::Index i = 0; i < sample.q.size(); ++i) {
                const double slope = (sample.q[i] - newest_.q[i]) / sent_s;
                base.qd[i] = calcCommon(slope, slope_[i]);
                slope_[i] = slope;
            }
        } else {
            Vector6 twist;
            twist << (sample.tool.position - newest_.tool.position) / sent_s,
                calcTurn(newest_.tool.orientation, sample.tool.orientation) / sent_s;
            base.toolTwist << calcCommon(Eigen::Vector3d(twist.head<3>()), Eigen::Vector3d(twist_.head<3>())),
                calcCommon(Eigen::Vector3d(twist.tail<3>()), Eigen::Vector3d(twist_.tail<3>()));
            twist_ = twist;
        }
    }
    base_ = base;
    newest_ = sample;
    received_s_ = t;
    samples_ = std::min(samples_ + 1, 2);
}

void CommandReceiver::calc(double t, MotionCommand& command) const {
    command = base_;
    const double since = t - received_s_;
    const double moved_s = std::min(since, moves_s_);
    if (moved_s > 0.0) {
        command.q += moved_s * base_.qd;
        command.tool.position += moved_s * base_.toolTwist.head<3>();
        const Eigen::Vector3d turn = moved_s * base_.toolTwist.tail<3>();
        command.tool.orientation = calcRotation(turn) * base_.tool.orientation;
    }
    if (since >= moves_s_) {
        command.qd.setZero(command.q.size());
        command.toolTwist.setZero();
    }
}

}  // namespace viable
