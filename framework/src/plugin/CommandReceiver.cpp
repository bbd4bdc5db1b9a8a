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
/** Half way to where it counts as the next one, a sample may be either: it tells nothing of a change of speed. */
constexpr double kLate = (1.0 - kEarly) / 2.0;
/** A moving command is led from where it was when a sample came to where it should be in so much of a period. */
constexpr double kBlend = 0.5;
/** What is extrapolated goes on for so many periods after the newest sample was sent, or so long [s]. In so many times
that it goes back to that sample. */
constexpr double kOverdue = 2.0, kOverdue_s = 0.2, kReturn = 7.5;
/** What a motion is like is told by so many samples. */
constexpr double kMemory = 32.0;
/** A change of the slope that is so many times the RMS one is a jump. */
constexpr double kJump = 4.0;
/** A slope that is so many times the RMS one is an outlier's. */
constexpr double kOutlier = 16.0;
/** Turns are led the short way round: no farther than this ahead [rad]. */
constexpr double kFarthestTurn = 1.5;

/** The slope that follows two others, continued as they changed: none after a rest, or where this would turn round. One that
has just turned round, or jumped, is not changed further; after a jump it is at most twice the older one.
@param trend  so much of their change follows */
Eigen::Vector3d calcNext(const Eigen::Vector3d& newer, const Eigen::Vector3d& older, double trend, bool isJump) {
    const double along = newer.dot(older);
    const Eigen::Vector3d next = along < 0.0 || isJump ? newer : newer + trend * (newer - older);
    if (along == 0.0 || (along < 0.0 && isJump) || !(next.dot(newer) > 0.0)) return Eigen::Vector3d::Zero();
    const double most = 2.0 * (isJump ? std::min(newer.norm(), older.norm()) : newer.norm());
    return next * std::min(1.0, most / next.norm());
}

Eigen::Vector3d calcTurn(const Pose& from, const Pose& to) {
    return calcRotationVector(to.orientation * from.orientation.conjugate());
}

void stop(MotionCommand& command) {
    command.qd.setZero(command.q.size());
    command.toolTwist.setZero();
}

/** The way of joint i, or of position (0) and orientation (1). */
Eigen::Vector3d calcWay(const MotionCommand& from, const MotionCommand& to, int i) {
    if (from.space == MotionCommand::Space::Joint) return {to.q[i] - from.q[i], 0.0, 0.0};
    return i == 0 ? Eigen::Vector3d(to.tool.position - from.tool.position) : calcTurn(from.tool, to.tool);
}

/** Goes that way on. @param rate  at which it changes */
void move(MotionCommand& command, int i, const Eigen::Vector3d& way, const Eigen::Vector3d& rate) {
    if (command.space == MotionCommand::Space::Joint) {
        command.q[i] += way[0];
        command.qd[i] = rate[0];
    } else if (i == 0) {
        command.tool.position += way;
        command.toolTwist.head<3>() = rate;
    } else {
        command.tool.orientation = calcRotation(way) * command.tool.orientation;
        command.toolTwist.tail<3>() = calcAngularVelocity(way, rate);
    }
}

}  // namespace

const char* getName(BetweenSamples between) {
    constexpr const char* kNames[] = {"hold", "interpolate", "extrapolate"};
    return kNames[static_cast<int>(between)];
}

void CommandReceiver::reset(const MotionCommand& first) {
    newest_ = first;
    stop(newest_);
    ways_.fill({});
    received_s_ = sent_s_ = begin_s_ = blend_s_ = stands_s_ = period_s_ = lasted_s_ = 0.0;
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
    intervals_[static_cast<std::size_t>(intervalCount_++ % kIntervals)] = interval_s;
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
        for (Way& way : ways_) way.came = way.expected = 0.0;
        return std::max(1.0, std::round(interval / period_s_)) * period_s_;
    }
    const double periods = std::max(1.0, std::floor((t - sent_s_) / period_s_ + kEarly));
    const double due = sent_s_ + periods * period_s_;
    sent_s_ = std::min(t, due + kDrift * (t - due));
    return periods * period_s_;
}

int CommandReceiver::countWays() const {
    return newest_.space == MotionCommand::Space::Joint ? static_cast<int>(newest_.q.size()) : 2;
}

void CommandReceiver::take(double t, const MotionCommand& received) {
    MotionCommand now;
    calc(t, now);
    const MotionCommand before = newest_;
    newest_ = received;
    newest_.tool.orientation.normalize();
    stop(newest_);
    const double lasted_s = followClock(t);
    begin_s_ = t;
    blend_s_ = 0.0;
    if (samples_ < 2 || between_ == BetweenSamples::Hold) return;
    const bool goesOn = between_ == BetweenSamples::Extrapolate;
    // A difference is the velocity in the middle of its interval.
    const bool isLate = t - sent_s_ > kLate * period_s_;
    const double trend = isLate ? 0.0 : (lasted_s + period_s_) / (lasted_s + lasted_s_);
    lasted_s_ = lasted_s;
    blend_s_ = goesOn ? kBlend * period_s_ : period_s_;
    stands_s_ = std::max(sent_s_ + std::max(kOverdue * period_s_, kOverdue_s), t + blend_s_);
    for (int i = 0; i < countWays(); ++i) {
        Way& way = ways_[i];
        if (goesOn) predict(way, calcWay(before, newest_, i) / lasted_s, lasted_s, trend);
        const bool isTurn = newest_.space == MotionCommand::Space::Tool && i == 1 && !way.velocity.isZero(0.0);
        way.most_s = isTurn ? kFarthestTurn / way.velocity.norm() : kInfinity;
        double rate = 0.0;
        way.offset = calcWay(newest_, now, i) - calcAhead(way, t, rate) * way.velocity;
        if (goesOn && way.velocity.isZero(0.0)) way.offset.setZero();  // at rest, or has jumped: taken at once
    }
}

/** The slope of the next period, and for how long it can be told. Motions are smooth: over a time u their velocities are
correlated by exp(-(fading u)^2). Over a period, the correlation is the share of the predicted slopes that came. */
void CommandReceiver::predict(Way& way, const Eigen::Vector3d& slope, double lasted_s, double trend) const {
    const double next2 = way.next.squaredNorm(), slope2 = slope.squaredNorm();
    // An outlier comes back: what goes on the same way is a motion that has begun.
    const bool goesOn = way.isOff && slope.dot(way.slope) > 0.0;
    const bool isOff = !goesOn && way.slope2 > 0.0 && slope2 > kOutlier * kOutlier * way.slope2;
    const double counted = isOff ? kJump * kJump * way.slope2 : slope2;  // so that the next one is told, too
    if (slope2 > 0.0) way.slope2 += (counted - way.slope2) / kMemory;
    if (lasted_s < 1.5 * period_s_ && !isOff) {
        way.came += (std::clamp(way.next.dot(slope), -2.0 * next2, 2.0 * next2) - way.came) / kMemory;
        way.expected += (next2 - way.expected) / kMemory;
    }
    const double correlation = way.expected > 0.0 ? std::clamp(way.came / way.expected, 1e-9, 1.0) : 1.0;
    way.fading = std::sqrt(-std::log(correlation)) / period_s_;
    const double change2 = (slope - way.slope).squaredNorm();
    way.next = calcNext(slope, way.slope, trend, isOff || change2 > kJump * kJump * way.change2);
    if (!std::exchange(way.isOff, isOff) && !isOff) way.change2 += (change2 - way.change2) / kMemory;
    way.slope = slope;
    way.velocity = period_s_ > kLongestPeriod_s ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : way.next;
}

/** How far the command is ahead of the newest sample, in seconds at the way's velocity. `rate`: the share of that velocity
which is left. The correlation counts from the middle of the last interval. */
double CommandReceiver::calcAhead(const Way& way, double t, double& rate) const {
    const double seconds = std::min(t, stands_s_) - sent_s_, begin = way.fading * period_s_ / 2.0;
    const double end = begin + way.fading * seconds;
    rate = std::exp(-end * end);
    double ahead = end - begin > 1e-6
                       ? seconds * std::sqrt(kPi) / 2.0 * (std::erf(end) - std::erf(begin)) / (end - begin)
                       : rate * seconds;
    if (ahead > way.most_s) {
        ahead = way.most_s;
        rate = 0.0;
    }
    if (t < stands_s_) return ahead;
    const double back_s = kReturn * (stands_s_ - sent_s_), left = std::max(0.0, 1.0 - (t - stands_s_) / back_s);
    rate = left > 0.0 ? -ahead / back_s : 0.0;
    return left * ahead;
}

void CommandReceiver::calc(double t, MotionCommand& command) const {
    command = newest_;
    if (!(blend_s_ > 0.0)) return;
    const double left = std::max(0.0, 1.0 - (t - begin_s_) / blend_s_);
    for (int i = 0; i < countWays(); ++i) {
        const Way& way = ways_[i];
        double rate = 0.0;
        const double ahead = calcAhead(way, t, rate);
        const Eigen::Vector3d leaves =
            left > 0.0 ? Eigen::Vector3d(way.offset / blend_s_) : Eigen::Vector3d(Eigen::Vector3d::Zero());
        move(command, i, ahead * way.velocity + left * way.offset, rate * way.velocity - leaves);
    }
}

}  // namespace viable
