#include "loop/PathExtent.h"

#include <algorithm>

namespace viable::detail {

namespace {

/** Halvings per extreme. Near an extreme the gap shrinks by a factor of 4 each time and one or two pieces
survive: 1e-12 of the first gap takes about 40. */
constexpr int kMaxSplits = 96;

struct Cubic {
    double c0, c1, c2, c3;  // control points
    double hull() const { return std::max(c1, c2); }
    Cubic operator-() const { return {-c0, -c1, -c2, -c3}; }
};

/** The largest value of `curve`, whose ends are not above `best`; at least `best`. */
double calcLargest(const Cubic& curve, double best, double resolution) {
    Cubic pieces[kMaxSplits + 1];
    int count = 0;
    pieces[count++] = curve;
    for (int splits = 0; count > 0;) {
        const Cubic c = pieces[--count];
        if (!(c.hull() > best + resolution)) continue;
        if (splits == kMaxSplits) {
            best = c.hull();
            continue;
        }
        ++splits;
        const double c01 = (c.c0 + c.c1) / 2.0, c12 = (c.c1 + c.c2) / 2.0;
        const double c23 = (c.c2 + c.c3) / 2.0;
        const double left = (c01 + c12) / 2.0, right = (c12 + c23) / 2.0;
        const double middle = (left + right) / 2.0;
        best = std::max(best, middle);
        pieces[count++] = {c.c0, c01, left, middle};
        pieces[count++] = {middle, right, c23, c.c3};
    }
    return best;
}

void include(PathExtent::Range& range, const Cubic& curve, const PathExtent::Accuracy& accuracy) {
    range.include(curve.c3);
    const double upper = std::max(curve.c1, curve.c2), lower = std::min(curve.c1, curve.c2);
    if (upper > range.upper)
        range.upper = calcLargest(curve, range.upper, upper > accuracy.upper ? accuracy.outside : accuracy.inside);
    if (lower < range.lower)
        range.lower = -calcLargest(-curve, -range.lower, lower < accuracy.lower ? accuracy.outside : accuracy.inside);
}

}  // namespace

void PathExtent::follow(double jerk, double seconds) {
    const double a = a_ + jerk * seconds;
    const double vMiddle = v_ + a_ * seconds / 2.0;  // second control point of the velocity
    const double v = v_ + (a_ + a) * seconds / 2.0;
    const double p = p_ + (v_ + vMiddle + v) * seconds / 3.0;
    acceleration.include(a);
    include(velocity, {v_, (v_ + 2.0 * vMiddle) / 3.0, (2.0 * vMiddle + v) / 3.0, v}, velocityAccuracy_);
    include(position, {p_, p_ + v_ * seconds / 3.0, p - v * seconds / 3.0, p}, positionAccuracy_);
    p_ = p;
    v_ = v;
    a_ = a;
}

}  // namespace viable::detail
