#include "plugin/CommandReceiver.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/RotationVector.h"

namespace viable {

namespace {

/** Receipts at the same time count as so far apart [s]. */
constexpr double kShortestInterval_s = 1e-6;
/** Samples that come more seldom are set-points, not a stream: nothing is extrapolated [s]. */
constexpr double kLongestPeriod_s = 0.25;
/** A sample counts as one later that comes so much of a period before it is due. */
constexpr double kEarly = 0.25;
/** Samples come in bursts where the mean interval is more than so many medians: more than losses make of it. */
constexpr double kBurst = 4.0;
/** Intervals differ from the period, and from each other, where it is by more than this share; so many in a row tell a
slower sender, or a faster one (fewer of them may be a burst). */
constexpr double kOtherPeriod = 0.3;
constexpr int kSlower = 3, kFaster = 6;
/** A period that changes by more than this share is that of another clock. */
constexpr double kOtherClock = 0.2;
/** So much of its lateness a sample moves the clock of the sender: it may drift. */
constexpr double kDrift = 0.1;
/** A late sample is met no sooner than after so much of a period. */
constexpr double kShortestBlend = 0.5;
/** What is extrapolated goes on for so many periods after the newest sample was sent; in so many more it goes back to
that sample. */
constexpr double kOverdue = 2.0, kReturn = 15.0;
/** Turns are led the short way round: no farther than this ahead [rad]. */
constexpr double kFarthestTurn = 1.5;

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

Eigen::Vector3d calcTurn(const Pose& from, const Pose& to) {
    return calcRotationVector(to.orientation * from.orientation.conjugate());
}

/** `seconds` on with its own velocity. */
void move(MotionCommand& command, double seconds) {
    command.q += seconds * command.qd;
    command.tool.position += seconds * command.toolTwist.head<3>();
    const Eigen::Vector3d turn = seconds * command.toolTwist.tail<3>();
    command.tool.orientation = calcRotation(turn) * command.tool.orientation;
}

void stop(MotionCommand& command) {
    command.qd.setZero(command.q.size());
    command.toolTwist.setZero();
}

/** At `from`, with the velocity that leads to `to` in `seconds`. */
MotionCommand leadTo(const MotionCommand& from, const MotionCommand& to, double seconds) {
    MotionCommand way = from;
    if (way.space == MotionCommand::Space::Joint)
        way.qd = (to.q - from.q) / seconds;
    else
        way.toolTwist << (to.tool.position - from.tool.position) / seconds, calcTurn(from.tool, to.tool) / seconds;
    return way;
}

}  // namespace

const char* getName(BetweenSamples between) {
    constexpr const char* kNames[] = {"hold", "interpolate", "extrapolate"};
    return kNames[static_cast<int>(between)];
}

void CommandReceiver::reset(const MotionCommand& first) {
    newest_ = first;
    stop(newest_);
    base_ = goal_ = newest_;
    slope_.setZero(first.q.size());
    twist_.setZero();
    received_s_ = sent_s_ = begin_s_ = meets_s_ = stands_s_ = period_s_ = lasted_s_ = 0.0;
    samples_ = intervalCount_ = 0;
    streak_ = 0;
    streak_s_ = 0.0;
}

/** Several intervals in a row that are alike, and other than the period, are those of another sender. */
bool CommandReceiver::isOtherSender(double interval_s) {
    const bool isLong = interval_s > (1.0 + kOtherPeriod) * period_s_;
    const bool isShort = interval_s < (1.0 - kOtherPeriod) * period_s_;
    const bool isAlike = streak_ != 0 && std::abs(interval_s - streak_s_) <= kOtherPeriod * streak_s_;
    const int step = isLong ? 1 : isShort ? -1 : 0;
    streak_ = step == 0 ? 0 : isAlike && streak_ * step > 0 ? streak_ + step : step;
    streak_s_ = interval_s;
    return streak_ >= kSlower || streak_ <= -kFaster;
}

/** From the last intervals between receipts. Of most senders a few are long, since samples were lost: each counts as so
many periods as it has medians. Where the mean is far from the median, samples come in bursts, and the mean is it; but
one that is longer than all the others together is a gap. */
void CommandReceiver::learnPeriod(double interval_s) {
    if (intervalCount_ > 0 && isOtherSender(interval_s)) intervalCount_ = 0;
    if (intervalCount_ == 0) streak_ = 0;
    intervals_[intervalCount_++ % kIntervals] = interval_s;
    const auto count = static_cast<std::size_t>(std::min<std::int64_t>(intervalCount_, kIntervals));
    std::array<double, kIntervals> sorted = intervals_;
    std::sort(sorted.data(), sorted.data() + count);
    double sum = std::accumulate<const double*>(sorted.data(), sorted.data() + count, 0.0);
    std::size_t used = count;
    if (count > 2 && sorted[count - 1] > sum - sorted[count - 1]) sum -= sorted[--used];
    const double median = sorted[(used - 1) / 2];
    if (sum / static_cast<double>(used) > kBurst * median) {
        period_s_ = sum / static_cast<double>(used);
        return;
    }
    double periods = 0.0;
    for (std::size_t i = 0; i < used; ++i) periods += std::max(1.0, std::round(sorted[i] / median));
    period_s_ = sum / periods;
}

/** Returns how long the sample before the one that has just come lasted at the sender [s]. */
double CommandReceiver::followClock(double t) {
    const double interval = std::max(t - received_s_, kShortestInterval_s);
    received_s_ = t;
    if (++samples_ == 1) {
        sent_s_ = t;
        return interval;
    }
    const double before_s = period_s_;
    learnPeriod(interval);
    if (std::abs(period_s_ - before_s) > kOtherClock * period_s_) {  // the phase of the one before says nothing
        sent_s_ = t;
        return std::max(1.0, std::round(interval / period_s_)) * period_s_;
    }
    const double periods = std::max(1.0, std::floor((t - sent_s_) / period_s_ + kEarly));
    const double due = sent_s_ + periods * period_s_;
    sent_s_ = std::min(t, due + kDrift * (t - due));
    return periods * period_s_;
}

void CommandReceiver::take(double t, const MotionCommand& received) {
    MotionCommand now;
    calc(t, now);
    const MotionCommand before = newest_;
    newest_ = received;
    newest_.tool.orientation.normalize();
    stop(newest_);
    const double lasted_s = followClock(t);
    base_ = goal_ = newest_;
    begin_s_ = meets_s_ = stands_s_ = t;
    if (samples_ < 2 || between_ == BetweenSamples::Hold) return;
    if (between_ == BetweenSamples::Interpolate) {
        meets_s_ = stands_s_ = t + period_s_;
        base_ = leadTo(now, goal_, period_s_);
        return;
    }
    findNextVelocity(before, lasted_s);
    if (period_s_ > kLongestPeriod_s) return stop(goal_);
    meets_s_ = std::max(sent_s_ + period_s_, t + kShortestBlend * period_s_);
    stands_s_ = std::max(meets_s_, sent_s_ + kOverdue * period_s_);
    updateWay(now);
}

/** The velocity after the last two differences becomes that of goal_. */
void CommandReceiver::findNextVelocity(const MotionCommand& before, double lasted_s) {
    // A difference is the velocity in the middle of its interval.
    const double trend = (lasted_s + period_s_) / (lasted_s + lasted_s_);
    lasted_s_ = lasted_s;
    if (newest_.space == MotionCommand::Space::Joint) {
        for (Eigen::Index i = 0; i < newest_.q.size(); ++i) {
            const double slope = (newest_.q[i] - before.q[i]) / lasted_s;
            goal_.qd[i] = calcNext(slope, slope_[i], trend);
            slope_[i] = slope;
        }
        return;
    }
    const Eigen::Vector3d velocity = (newest_.tool.position - before.tool.position) / lasted_s;
    const Eigen::Vector3d rate = calcTurn(before.tool, newest_.tool) / lasted_s;
    goal_.toolTwist << calcNext(velocity, Eigen::Vector3d(twist_.head<3>()), trend),
        calcNext(rate, Eigen::Vector3d(twist_.tail<3>()), trend);
    twist_ << velocity, rate;
}

/** From `now` to where goal_ is when it is met. What does not move, or has jumped, is taken at once: each joint, the
position and the orientation by itself. */
void CommandReceiver::updateWay(const MotionCommand& now) {
    const double ahead_s = meets_s_ - sent_s_, seconds = meets_s_ - begin_s_;
    const double turn = goal_.toolTwist.tail<3>().norm() * ahead_s;
    if (turn > kFarthestTurn) goal_.toolTwist.tail<3>() *= kFarthestTurn / turn;
    const MotionCommand newest = goal_;
    move(goal_, ahead_s);
    base_ = leadTo(now, goal_, seconds);
    for (Eigen::Index i = 0; i < base_.q.size(); ++i) {
        if (newest.qd[i] != 0.0) continue;
        base_.q[i] = newest.q[i];
        base_.qd[i] = 0.0;
    }
    if (newest.toolTwist.head<3>().isZero(0.0)) {
        base_.tool.position = newest.tool.position;
        base_.toolTwist.head<3>().setZero();
    }
    if (newest.toolTwist.tail<3>().isZero(0.0) || base_.toolTwist.tail<3>().norm() * seconds > 2.0 * kFarthestTurn) {
        base_.tool.orientation = goal_.tool.orientation;
        base_.toolTwist.tail<3>().setZero();
    }
}

void CommandReceiver::calc(double t, MotionCommand& command) const {
    if (t < meets_s_) {
        command = base_;
        move(command, t - begin_s_);
        return;
    }
    command = goal_;
    move(command, std::min(t, stands_s_) - meets_s_);
    if (t < stands_s_) return;
    const double back_s = kReturn * period_s_;
    stop(command);
    if (t < stands_s_ + back_s && stands_s_ > begin_s_) {
        command = leadTo(command, newest_, back_s);
        move(command, t - stands_s_);
    } else {
        command = newest_;
    }
}

}  // namespace viable
