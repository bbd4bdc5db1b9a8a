#pragma once

#include <random>

#include "clearance/ArmPath.h"

namespace viable {

/** The shortest stop of joint i after a tick with this jerk. */
inline GridStop planStop(const MotionState& s, int i, double jerk, const AxisLimits& limits, double tick_s) {
    const AxisState after = advance({s.q[i], s.qd[i], s.qdd[i]}, jerk, tick_s);
    GridStop stop;
    stop.plan(after.v, after.a, limits, tick_s);
    return stop;
}

inline detail::ArmPath::Extremes calcExtremes(const detail::ArmPath& path) {
    detail::ArmPath::Extremes extremes;
    path.calcExtremes(extremes);
    return extremes;
}

/** How large the parts of a drawn path are; each is drawn evenly to both sides of zero, and `size` shares of velocity
and acceleration are taken. */
struct DrawnPath {
    JointVector position;  ///< per joint [rad, m]
    double velocity, acceleration, jerk;
    AxisLimits limits;  ///< that its stop keeps

    detail::ArmPath draw(std::mt19937& random, double size, double tick_s) const {
        std::uniform_real_distribution<double> share(-1.0, 1.0);
        const auto n = static_cast<int>(position.size());
        MotionState s{JointVector(n), JointVector(n), JointVector(n)};
        JointVector firstJerk(n);
        std::array<GridStop, kMaxJoints> stops;
        for (int i = 0; i < n; ++i) {
            s.q[i] = position[i] * share(random);
            s.qd[i] = velocity * size * share(random);
            s.qdd[i] = acceleration * size * share(random);
            drawTick(i, s, random, tick_s, firstJerk, stops);
        }
        detail::ArmPath path;
        path.set(s, firstJerk, stops, tick_s);
        return path;
    }

    /** Another path from where `path` is at its tick `tick`, with other jerks in one tick and the stops after it. */
    detail::ArmPath branchOff(const detail::ArmPath& path, std::int64_t tick, std::mt19937& random,
                              double tick_s) const {
        const auto n = static_cast<int>(position.size());
        MotionState s{JointVector(n), JointVector(n), JointVector(n)};
        path.calcTick(tick, s.q, s.qd, s.qdd);
        JointVector firstJerk(n);
        std::array<GridStop, kMaxJoints> stops;
        for (int i = 0; i < n; ++i) {
            s.qdd[i] = path.calcAcceleration(i, static_cast<double>(tick) * tick_s);
            drawTick(i, s, random, tick_s, firstJerk, stops);
        }
        detail::ArmPath other;
        other.set(s, firstJerk, stops, tick_s);
        return other;
    }

private:
    /** A jerk in the tick from `s`, and the stop after it. */
    void drawTick(int i, const MotionState& s, std::mt19937& random, double tick_s, JointVector& firstJerk,
                  std::array<GridStop, kMaxJoints>& stops) const {
        firstJerk[i] = jerk * std::uniform_real_distribution<double>(-1.0, 1.0)(random);
        stops[static_cast<std::size_t>(i)] = planStop(s, i, firstJerk[i], limits, tick_s);
    }
};

}  // namespace viable
