#include "viable/plugin/CommandReceiver.h"

#include <algorithm>
#include <cmath>

#include "viable/core/RotationVector.h"

namespace viable {

namespace {

/** The period is a mean over about so many samples. */
constexpr double kMeanOf = 50.0;
/** Receipts at the same time count as so far apart [s]. */
constexpr double kShortestInterval_s = 1e-6;
/** A sample counts as one later that comes so much of a period before it is due. */
constexpr double kEarly = 0.25;
/** After so many in a row that seem to follow a lost one the sender has become slower. */
constexpr int kSlower = 5;
/** So much of its lateness a sample moves the clock of the sender: it may drift. */
constexpr double kDrift = 0.02;
/** A late sample is met no sooner than after so much of a period. */
constexpr double kShortestBlend = 0.5;
/** What was extrapolated stands so many periods after the newest sample was sent. */
constexpr double kOverdue = 2.0;

/** The slope that follows two others, continued as they changed: from none, where they point apart, to twice the smaller
one (the limits of a monotone interpolation), so that nothing is overshot that has stopped or jumped.
@param trend  so much of their change follows */
double calcNext(double newer, double older, double trend) {
    if (!(newer * older > 0.0)) return 0.0;
    const double least = std::min(std::abs(newer), std::abs(older));
    const double next = std::abs(newer) + trend * (std::abs(newer) - std::abs(older));
    return std::copysign(std::clamp(next, 0.0, 2.0 * least), newer);
}

/** The same in space. */
Eigen::Vector3d calcNext(const Eigen::Vector3d& newer, const Eigen::Vector3d& older, double trend) {
    if (!(newer.dot(older) > 0.0)) return Eigen::Vector3d::Zero();
    const Eigen::Vector3d next = newer + trend * (newer - older);
    if (!(next.dot(newer) > 0.0)) return Eigen::Vector3d::Zero();
    const double most = 2.0 * std::min(newer.norm(), older.norm());
    return next * std::min(1.0, most / next.norm());
}

/** From one pose to the other in `seconds`. */
Vector6 calcTwist(const Pose& from, const Pose& to, double seconds) {
    Vector6 twist;
    twist << to.position - from.position, calcRotationVector(to.orientation * from.orientation.conjugate());
    return twist / seconds;
}

}  // namespace

const char* getName(BetweenSamples between) {
    constexpr const char* kNames[] = {"hold", "interpolate", "extrapolate"};
    return kNames[static_cast<int>(between)];
}

void CommandReceiver::reset(const MotionCommand& first) {
    newest_ = goal_ = first;
    goal_.qd.setZero(first.q.size());
    goal_.toolTwist.setZero();
    base_ = goal_;
    slope_.setZero(first.q.size());
    twist_.setZero();
    received_s_ = sent_s_ = begin_s_ = meets_s_ = stands_s_ = period_s_ = lasted_s_ = 0.0;
    samples_ = slower_ = 0;
}

/** Returns how long the sample before the one that has just come lasted at the sender [s]. */
double CommandReceiver::followClock(double t) {
    const double interval = std::max(t - received_s_, kShortestInterval_s);
    received_s_ = t;
    ++samples_;
    if (samples_ <= 2) {
        sent_s_ = t;
        period_s_ = interval;
        return interval;
    }
    double periods = std::max(1.0, std::floor((t - sent_s_) / period_s_ + kEarly));
    slower_ = periods > 1.0 ? slower_ + 1 : 0;
    if (slower_ > kSlower) {
        samples_ = 2;
        slower_ = 0;
        period_s_ = interval;
        periods = 1.0;
    }
    period_s_ += (interval / periods - period_s_) / std::min(kMeanOf, static_cast<double>(samples_ - 1));
    const double due = sent_s_ + periods * period_s_;
    sent_s_ = std::min(t, due + kDrift * (t - due));
    return periods * period_s_;
}

void CommandReceiver::take(double t, const MotionCommand& received) {
    MotionCommand sample = received;
    sample.tool.orientation.normalize();
    MotionCommand now;
    calc(t, now);
    const double lasted_s = followClock(t);

    base_ = sample;
    base_.qd.setZero(sample.q.size());
    base_.toolTwist.setZero();
    goal_ = base_;
    begin_s_ = meets_s_ = stands_s_ = t;
    if (samples_ > 1 && between_ == BetweenSamples::Interpolate) {
        leadTo(now, t + period_s_);
        stands_s_ = meets_s_;
    } else if (samples_ > 1 && between_ == BetweenSamples::Extrapolate) {
        stands_s_ = sent_s_ + kOverdue * period_s_;
        const double meets_s = std::max(sent_s_ + period_s_, t + kShortestBlend * period_s_);
        if (findNextVelocity(sample, lasted_s)) {
            move(goal_, meets_s - sent_s_);
            leadTo(now, meets_s);
        }
    }
    newest_ = sample;
}

/** The velocity after the last two differences becomes that of goal_. False where there is none. */
bool CommandReceiver::findNextVelocity(const MotionCommand& sample, double lasted_s) {
    // A difference is the velocity in the middle of its interval.
    const double trend = (lasted_s + period_s_) / (lasted_s + lasted_s_);
    lasted_s_ = lasted_s;
    if (sample.space == MotionCommand::Space::Joint) {
        for (Eigen::Index i = 0; i < sample.q.size(); ++i) {
            const double slope = (sample.q[i] - newest_.q[i]) / lasted_s;
            goal_.qd[i] = calcNext(slope, slope_[i], trend);
            slope_[i] = slope;
        }
        return !goal_.qd.isZero(0.0);
    }
    const Vector6 twist = calcTwist(newest_.tool, sample.tool, lasted_s);
    for (const int part : {0, 3})
        goal_.toolTwist.segment<3>(part) =
            calcNext(Eigen::Vector3d(twist.segment<3>(part)), Eigen::Vector3d(twist_.segment<3>(part)), trend);
    twist_ = twist;
    return !goal_.toolTwist.isZero(0.0);
}

/** From where the command is to goal_, so that it does not jump. */
void CommandReceiver::leadTo(const MotionCommand& now, double meets_s) {
    meets_s_ = meets_s;
    base_.q = now.q;
    base_.tool = now.tool;
    const double seconds = meets_s - begin_s_;
    if (goal_.space == MotionCommand::Space::Joint)
        base_.qd = (goal_.q - now.q) / seconds;
    else
        base_.toolTwist = calcTwist(now.tool, goal_.tool, seconds);
}

void CommandReceiver::move(MotionCommand& command, double seconds) {
    command.q += seconds * command.qd;
    command.tool.position += seconds * command.toolTwist.head<3>();
    const Eigen::Vector3d turn = seconds * command.toolTwist.tail<3>();
    command.tool.orientation = calcRotation(turn) * command.tool.orientation;
}

void CommandReceiver::calc(double t, MotionCommand& command) const {
    if (t < meets_s_) {
        command = base_;
        move(command, t - begin_s_);
        return;
    }
    command = goal_;
    if (stands_s_ > meets_s_) move(command, std::min(t, stands_s_) - meets_s_);
    if (t >= stands_s_) {
        command.qd.setZero(command.q.size());
        command.toolTwist.setZero();
    }
}

}  // namespace viable
