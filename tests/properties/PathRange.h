#pragma once

#include <algorithm>
#include <cmath>

#include "viable/braking/GridStop.h"

namespace viable {

using Real = long double;

struct Range {
    Real least, largest;

    void include(Real x) {
        least = std::min(least, x);
        largest = std::max(largest, x);
    }
    void include(const Range& other) {
        include(other.least);
        include(other.largest);
    }
    Real size() const { return std::max(std::abs(least), std::abs(largest)); }
};

/** Walks along constant jerks and keeps the least and largest position, velocity and acceleration, turning points between
the ends included. The checker's own: long double, on its own formulas. */
class PathRange {
public:
    explicit PathRange(const AxisState& s) : p(start(s.p)), v(start(s.v)), a(start(s.a)), p_(s.p), v_(s.v), a_(s.a) {}

    void hold(Real jerk, Real seconds) {
        const auto position = [&](Real x) { return p_ + x * (v_ + x * (a_ / 2 + x * jerk / 6)); };
        const auto velocity = [&](Real x) { return v_ + x * (a_ + x * jerk / 2); };
        const auto isInside = [&](Real x) { return x > 0 && x < seconds; };  // false for NaN
        const Real turn = -a_ / jerk;
        if (isInside(turn)) v.include(velocity(turn));
        const Real inside = a_ * a_ - 2 * jerk * v_;
        if (inside >= 0) {
            const Real q = -(a_ + std::copysign(std::sqrt(inside), a_));
            for (const Real x : {q / jerk, 2 * v_ / q})
                if (isInside(x)) p.include(position(x));
        }
        p_ = position(seconds);
        v_ = velocity(seconds);
        a_ += jerk * seconds;
        p.include(p_);
        v.include(v_);
        a.include(a_);
    }

    void follow(const GridStop& stop, double tick_s) {
        for (int i = 0; i < GridStop::kSegments; ++i) {
            const GridStop::Segment segment = stop.remaining(i);
            if (segment.ticks > 0) hold(segment.jerk, Real(segment.ticks) * tick_s);
        }
    }

    /** What another path from here on reaches belongs to it. */
    void include(const PathRange& other) {
        p.include(other.p);
        v.include(other.v);
        a.include(other.a);
    }

    Real endPosition() const { return p_; }
    AxisState end() const { return {static_cast<double>(p_), static_cast<double>(v_), static_cast<double>(a_)}; }

    Range p, v, a;

private:
    static Range start(double x) { return {x, x}; }

    Real p_, v_, a_;
};

/** The tick alone. */
inline PathRange walkTick(const AxisState& from, double jerk, double tick_s) {
    PathRange path(from);
    path.hold(jerk, tick_s);
    return path;
}

inline PathRange walkStop(const AxisState& from, const GridStop& stop, double tick_s) {
    PathRange path(from);
    path.follow(stop, tick_s);
    return path;
}

}  // namespace viable
