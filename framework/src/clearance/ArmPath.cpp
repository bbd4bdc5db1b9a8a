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
        joint.pieces = 0;
        const auto append = [&](std::int64_t ticks, double held) {
            const auto k = static_cast<std::size_t>(joint.pieces++);
            const double t = static_cast<double>(ticks) * tick_s;
            joint.begin_s[k] = static_cast<double>(tick) * tick_s;
            joint.beginTick[k] = tick;
            joint.jerk[k] = held;
            joint.state[k] = state;
            joint.travel[k] = travel;
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
        const auto last = static_cast<std::size_t>(joint.pieces++);
        joint.begin_s[last] = static_cast<double>(tick) * tick_s;
        joint.beginTick[last] = tick;
        joint.jerk[last] = 0.0;
        joint.state[last] = state;
        joint.travel[last] = travel;
    }
    duration_ = static_cast<double>(ticks_) * tick_s;
}

int ArmPath::Joint::find(double t) const {
    int k = pieces - 1;
    while (k > 0 && begin_s[k] > t) --k;
    return k;
}

int ArmPath::Joint::findTick(std::int64_t tick) const {
    int k = pieces - 1;
    while (k > 0 && beginTick[k] > tick) --k;
    return k;
}

double ArmPath::calcRestTime(int i) const {
    const Joint& joint = joints_[i];
    const bool stays = joint.pieces == 2 && joint.state[0].v == 0.0 && joint.state[0].a == 0.0 && joint.jerk[0] == 0.0;
    return stays ? 0.0 : joint.begin_s[joint.pieces - 1];
}

double ArmPath::calcPosition(int i, double t) const {
    const Joint& joint = joints_[i];
    const auto k = static_cast<std::size_t>(joint.find(t));
    return advance(joint.state[k], joint.jerk[k], t - joint.begin_s[k]).p;
}

void ArmPath::calcPositions(double t, JointVector& q) const {
    q.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[i];
        const auto k = static_cast<std::size_t>(joint.find(t));
        q[i] = advance(joint.state[k], joint.jerk[k], t - joint.begin_s[k]).p;
    }
}

void ArmPath::calcMotion(double t, JointVector& q, JointVector& qd) const {
    q.resize(n_);
    qd.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[i];
        const auto k = static_cast<std::size_t>(joint.find(t));
        const AxisState s = advance(joint.state[k], joint.jerk[k], t - joint.begin_s[k]);
        q[i] = s.p;
        qd[i] = s.v;
    }
}

double ArmPath::calcAcceleration(int i, double t) const {
    const Joint& joint = joints_[i];
    const auto k = static_cast<std::size_t>(joint.find(t));
    return joint.state[k].a + joint.jerk[k] * (t - joint.begin_s[k]);
}

void ArmPath::calcTick(std::int64_t tick, JointVector& q, JointVector& qd, JointVector& meanQdd) const {
    q.resize(n_);
    qd.resize(n_);
    meanQdd.resize(n_);
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[i];
        const auto k = static_cast<std::size_t>(joint.findTick(tick));
        const AxisState s =
            advance(joint.state[k], joint.jerk[k], static_cast<double>(tick - joint.beginTick[k]) * tick_s_);
        q[i] = s.p;
        qd[i] = s.v;
        meanQdd[i] = s.a + joint.jerk[k] * tick_s_ / 2.0;
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
        const Joint& joint = joints_[i];
        const auto k = static_cast<std::size_t>(joint.find(t));
        const double since = t - joint.begin_s[k];
        const AxisState end = advance(joint.state[k], joint.jerk[k], since);
        q[i] = end.p;
        travel[i] = joint.travel[k] + calcPieceTravel(joint.state[k], joint.jerk[k], since, end);
    }
}

void ArmPath::calcExtremes(Extremes& extremes) const {
    for (JointVector* v :
         {&extremes.position, &extremes.velocity, &extremes.acceleration, &extremes.jerk, &extremes.travel})
        v->setZero(n_);
    for (int i = 0; i < n_; ++i) {
        const Joint& joint = joints_[i];
        for (int piece = 0; piece < joint.pieces; ++piece) {
            const auto k = static_cast<std::size_t>(piece);
            const AxisState& s = joint.state[k];
            const auto see = [](double& most, double x) { most = std::max(most, std::abs(x)); };
            see(extremes.velocity[i], s.v);
            see(extremes.acceleration[i], s.a);
            see(extremes.jerk[i], joint.jerk[k]);
            const double turn = joint.jerk[k] != 0.0 ? -s.a / joint.jerk[k] : -1.0;
            if (piece + 1 < joint.pieces && turn > 0.0 && turn < joint.begin_s[k + 1] - joint.begin_s[k])
                see(extremes.velocity[i], s.v - s.a * s.a / (2.0 * joint.jerk[k]));
        }
        const auto last = static_cast<std::size_t>(joint.pieces - 1);
        // Nowhere farther from the start than all of the travel.
        extremes.travel[i] = joint.travel[last];
        extremes.position[i] = std::abs(joint.state[0].p) + joint.travel[last];
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
            const auto a = static_cast<std::size_t>(k), b = static_cast<std::size_t>(l);
            const auto calcTime = [&](std::int64_t ticks) { return static_cast<double>(ticks) * tick_s_; };
            const AxisState is = advance(own.state[a], own.jerk[a], calcTime(tick - own.beginTick[a]));
            const AxisState was = advance(their.state[b], their.jerk[b], calcTime(tick + begin - their.beginTick[b]));
            const double apart = std::abs(is.a - was.a);
            difference.position[i] = std::max(difference.position[i], std::abs(is.p - was.p));
            difference.velocity[i] = std::max(difference.velocity[i], std::abs(is.v - was.v));
            difference.acceleration[i] = std::max(difference.acceleration[i], apart);
            const bool isLast = k + 1 == own.pieces, isTheirLast = l + 1 == their.pieces;
            if (isLast && isTheirLast) break;
            std::int64_t next = 0;
            if (!isLast) next = own.beginTick[a + 1];
            if (!isTheirLast)
                next = isLast ? their.beginTick[b + 1] - begin : std::min(next, their.beginTick[b + 1] - begin);
            const double h = calcTime(next - tick), jerk = own.jerk[a] - their.jerk[b];
            bend = std::max(bend, h * h / 8.0 * std::max(apart, std::abs(is.a - was.a + jerk * h)));
            kink = std::max(kink, h * h / 8.0 * std::abs(jerk));
            if (!isLast && own.beginTick[a + 1] <= next) ++k;
            if (!isTheirLast && their.beginTick[b + 1] - begin <= next) ++l;
            tick = next;
        }
        difference.position[i] += bend;
        difference.velocity[i] += kink;
    }
}

}  // namespace viable::detail
