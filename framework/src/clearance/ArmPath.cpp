#include "clearance/ArmPath.h"

#include <algorithm>
#include <cmath>

namespace viable::detail {

void ArmPath::set(const MotionState& start, const JointVector& jerk, const std::array<GridStop, kMaxJoints>& stops,
                  double tick_s) {
    n_ = static_cast<int>(start.q.size());
    tick_s_ = tick_s;
    ticks_ = 1;
    for (int i = 0; i < n_; ++i) {
        Joint& joint = joints_[i];
        AxisState state{start.q[i], start.qd[i], start.qdd[i]};
        std::int64_t tick = 0;
        double travel = 0.0;
        joint.count = 0;
        const auto append = [&](std::int64_t ticks, double held) {
            joint.pieces[joint.count++] = {static_cast<double>(tick) * tick_s, held, travel, tick, state};
            const double t = static_cast<double>(ticks) * tick_s;
            const AxisState end = advance(state, held, t);
            travel += calcPieceTravel(state, held, t, end);
            state = end;
            tick += ticks;
        };
        append(1, jerk[i]);
        for (int k = 0; k < GridStop::kSegments; ++k) {
            const GridStop::Segment segment = stops[i].remaining(k);
            if (segment.ticks > 0) append(segment.ticks, segment.jerk);
        }
        ticks_ = std::max(ticks_, tick);
        state.v = state.a = 0.0;  // up to rounding they are
        append(0, 0.0);           // rest
    }
    duration_ = static_cast<double>(ticks_) * tick_s;
}

const ArmPath::Piece& ArmPath::Joint::find(double t) const {
    int k = count - 1;
    while (k > 0 && pieces[k].begin_s > t) --k;
    return pieces[k];
}

int ArmPath::Joint::findTick(std::int64_t tick) const {
    int k = count - 1;
    while (k > 0 && pieces[k].beginTick > tick) --k;
    return k;
}

double ArmPath::calcRestTime(int i) const {
    const Joint& joint = joints_[i];
    const Piece& first = joint.pieces[0];
    const bool stays = joint.count == 2 && first.state.v == 0.0 && first.state.a == 0.0 && first.jerk == 0.0;
    return stays ? 0.0 : joint.pieces[joint.count - 1].begin_s;
}

AxisState ArmPath::calcState(int i, double t) const {
    const Piece& piece = joints_[i].find(t);
    return advance(piece.state, piece.jerk, t - piece.begin_s);
}

void ArmPath::calcPositions(double t, JointVector& q) const {
    q.resize(n_);
    for (int i = 0; i < n_; ++i) q[i] = calcPosition(i, t);
}

void ArmPath::calcMotion(double t, JointVector& q, JointVector& qd) const {
    q.resize(n_);
    qd.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const AxisState s = calcState(i, t);
        q[i] = s.p;
        qd[i] = s.v;
    }
}

void ArmPath::calcTick(std::int64_t tick, JointVector& q, JointVector& qd, JointVector& meanQdd) const {
    q.resize(n_);
    qd.resize(n_);
    meanQdd.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const Piece& piece = joints_[i].pieces[joints_[i].findTick(tick)];
        const AxisState s = advance(piece.state, piece.jerk, static_cast<double>(tick - piece.beginTick) * tick_s_);
        q[i] = s.p;
        qd[i] = s.v;
        meanQdd[i] = s.a + piece.jerk * tick_s_ / 2.0;
    }
}

/** The integral of |v| over `t`, when `end` comes: pieces between the zeros of v. */
double ArmPath::calcPieceTravel(const AxisState& s, double jerk, double t, const AxisState& end) {
    // Where v and its change towards the end have one sign there is no zero between.
    const double turn = s.v * s.a, atEnd = end.v * end.a;
    if (s.v * end.v > 0.0 && (turn >= 0.0 || atEnd <= 0.0)) return std::abs(end.p - s.p);
    double zeros[2];
    int count = 0;
    const double discriminant = s.a * s.a - 2.0 * jerk * s.v;
    if (discriminant > 0.0) {
        const double q = -(s.a + std::copysign(std::sqrt(discriminant), s.a));
        if (jerk != 0.0) zeros[count++] = q / jerk;
        if (q != 0.0) zeros[count++] = 2.0 * s.v / q;
        if (count == 2 && zeros[0] > zeros[1]) std::swap(zeros[0], zeros[1]);
    }
    double travel = 0.0, p = s.p;
    for (int k = 0; k < count; ++k) {
        if (!(zeros[k] > 0.0 && zeros[k] < t)) continue;
        const double next = advance(s, jerk, zeros[k]).p;
        travel += std::abs(next - p);
        p = next;
    }
    return travel + std::abs(end.p - p);
}

void ArmPath::calcPositions(double t, JointVector& q, JointVector& travel) const {
    q.resize(n_);
    travel.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const Piece& piece = joints_[i].find(t);
        const double since = t - piece.begin_s;
        const AxisState end = advance(piece.state, piece.jerk, since);
        q[i] = end.p;
        travel[i] = piece.travel + calcPieceTravel(piece.state, piece.jerk, since, end);
    }
}

void ArmPath::calcExtremes(Extremes& extremes) const {
    for (JointVector* v :
         {&extremes.position, &extremes.velocity, &extremes.acceleration, &extremes.jerk, &extremes.travel})
        v->setZero(n_);
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[i];
        for (int k = 0; k < joint.count; ++k) {
            const Piece& piece = joint.pieces[k];
            const AxisState& s = piece.state;
            const auto see = [](double& most, double x) { most = std::max(most, std::abs(x)); };
            see(extremes.velocity[i], s.v);
            see(extremes.acceleration[i], s.a);
            see(extremes.jerk[i], piece.jerk);
            const double turn = piece.jerk != 0.0 ? -s.a / piece.jerk : -1.0;
            if (k + 1 < joint.count && turn > 0.0 && turn < joint.pieces[k + 1].begin_s - piece.begin_s)
                see(extremes.velocity[i], s.v - s.a * s.a / (2.0 * piece.jerk));
        }
        // Nowhere farther from the start than all of the travel.
        extremes.travel[i] = joint.pieces[joint.count - 1].travel;
        extremes.position[i] = std::abs(joint.pieces[0].state.p) + extremes.travel[i];
    }
}

/** From one segment's begin to the next, of either path, the difference has constant jerk: between two times h apart no
component is farther from the straight line through its ends than h^2/8 times its second derivative. */
void ArmPath::calcDifference(const ArmPath& other, std::int64_t begin, Difference& difference) const {
    for (JointVector* v : {&difference.position, &difference.velocity, &difference.acceleration}) v->setZero(n_);
    for (int i = 0; i < n_; ++i) {
        const Joint &own = joints_[i], &their = other.joints_[i];
        int k = 0, l = their.findTick(begin);
        double bend = 0.0, kink = 0.0;  // what straight lines miss of position and velocity
        for (std::int64_t tick = 0;;) {
            const Piece &a = own.pieces[k], &b = their.pieces[l];
            const auto calcTime = [&](std::int64_t ticks) { return static_cast<double>(ticks) * tick_s_; };
            const AxisState is = advance(a.state, a.jerk, calcTime(tick - a.beginTick));
            const AxisState was = advance(b.state, b.jerk, calcTime(tick + begin - b.beginTick));
            const double apart = std::abs(is.a - was.a);
            difference.position[i] = std::max(difference.position[i], std::abs(is.p - was.p));
            difference.velocity[i] = std::max(difference.velocity[i], std::abs(is.v - was.v));
            difference.acceleration[i] = std::max(difference.acceleration[i], apart);
            const bool isLast = k + 1 == own.count, isTheirLast = l + 1 == their.count;
            if (isLast && isTheirLast) break;
            // Of a joint that rests there is no next segment.
            constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
            const std::int64_t ownNext = isLast ? kNever : own.pieces[k + 1].beginTick;
            const std::int64_t theirNext = isTheirLast ? kNever : their.pieces[l + 1].beginTick - begin;
            const std::int64_t next = std::min(ownNext, theirNext);
            const double h = calcTime(next - tick), jerk = a.jerk - b.jerk;
            bend = std::max(bend, h * h / 8.0 * std::max(apart, std::abs(is.a - was.a + jerk * h)));
            kink = std::max(kink, h * h / 8.0 * std::abs(jerk));
            if (ownNext == next) ++k;
            if (theirNext == next) ++l;
            tick = next;
        }
        difference.position[i] += bend;
        difference.velocity[i] += kink;
    }
}

}  // namespace viable::detail
