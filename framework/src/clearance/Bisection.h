#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace viable::detail {

/** Adaptive bisection of a path with motion bounds (Schwarzer, Saha and Latombe, Adaptive dynamic collision checking for
single and multiple articulated robots in complex environments, IEEE Trans. Robotics 21, 2005), here not for contact but for a
clearance c(t) that must be kept.

c cannot change faster than the points move: between two looks at a and b, where no point moves by more than D,

    c(t) >= max(c(a) - D(a, t), c(b) - D(t, b)) >= (c(a) + c(b) - D) / 2,

so that nothing between two looks can be missed, however thin. Where points move beside a thing more than towards it, another
bound is closer. The element is made of balls of radius r around points (a pair: of the differences of two points, around the
origin). Where a point goes straight by L from a to b, its squared distance from anything, less its squared way, is concave, as
the least of linear functions; with m = c + r and s the share of the way

    (c(t) + r)^2 >= (1 - s) m(a)^2 + s m(b)^2 - s (1 - s) L^2,

which costs L^2 / 8 m where the other bound costs L / 2; off the straight line by no more than the sag, c is less by no more.
Where neither suffices the middle is looked at, down to neighbouring samples; what is not proven then counts as not kept. */
namespace bisection {

inline constexpr int kDivisions = 128;  ///< of a path's time; samples 0 ... kDivisions

/** Looks aim at so much more than must be kept; what is left between two of them may use it up [m]. */
inline constexpr double kGuard_m = 0.005;
/** So much lower than at its ends a clearance may be between two looks at places far apart: how near a path comes must not
depend on where it happens to be looked at [m]. */
inline constexpr double kBlur_m = 0.0003;
/** A clearance that differs by less is the same: rounding of poses [m]. */
inline constexpr double kRounding_m = 1e-9;

/** The clearance at a sample of the path, or a lower bound of it. */
struct Look {
    int sample = 0;
    double clearance = std::numeric_limits<double>::infinity();
    double ofMiddle = 0.0;  ///< see ElementDistance::Rough
    bool isRough = true;    ///< it can be looked at more closely
};

/** How the points of an element move between two looks [m]. */
struct Travel {
    double reach;  ///< D
    double chord;  ///< L; infinite: not known
    double sag;
};

/** What a clearance must keep [m]. */
struct Demand {
    double floor;  ///< at every time
    double least;  ///< at looks, >= floor
    double ahead;  ///< >= least: from here on clearances need not be told apart
    double far;    ///< >= ahead: from here on what was known before will do
};

/** Least clearances of the looks and lower bounds for all times, of a whole path or a part of it [m]. */
struct Bounds {
    double seen = std::numeric_limits<double>::infinity();
    double proven = std::numeric_limits<double>::infinity();

    void include(const Bounds& other) {
        seen = std::min(seen, other.seen);
        proven = std::min(proven, other.proven);
    }
    bool areFar(const Demand& demand) const { return seen >= demand.far && proven >= demand.floor; }
};

struct Result {
    static constexpr int kParts = 16;

    Bounds all;
    std::array<Bounds, kParts> parts;  ///< of equal shares of the path's time
    bool isKept = true;                ///< floor and least are proven
    Look rough;                        ///< lowest look that stayed rough

    /** Nothing more is looked at between two samples. */
    void settle(int from, int to, const Bounds& bounds) {
        all.include(bounds);
        for (int k = from * kParts / kDivisions; k * kDivisions < to * kParts; ++k) parts[k].include(bounds);
    }
};

/** Nothing more is looked at between these two. */
inline void settle(double bound, const Look& from, const Look& to, Result& result) {
    result.settle(from.sample, to.sample, {std::min(from.clearance, to.clearance), bound});
    for (const Look* look : {&from, &to})
        if (look->isRough && look->clearance < result.rough.clearance) result.rough = *look;
}

/** A lower bound between two looks. */
inline double calcBound(const Look& from, const Look& to, const Travel& travel, double radius) {
    const double bound = (from.clearance + to.clearance - travel.reach) / 2.0;
    const double a = from.clearance + radius, b = to.clearance + radius;
    if (!(a > 0.0 && b > 0.0 && a < std::numeric_limits<double>::infinity()) ||
        !(b < std::numeric_limits<double>::infinity()) || travel.sag >= std::min(a, b) - radius - bound)
        return bound;
    const double difference = b * b - a * a, square = travel.chord * travel.chord;
    double least = std::min(a, b);
    if (std::abs(difference) < square)  // it is lowest on the way
        least =
            std::sqrt(std::max(0.0, (a * a + b * b) / 2.0 - square / 4.0 - difference * difference / (4.0 * square)));
    return std::max(bound, least - radius - travel.sag);
}

/** Proves what it can between two looks, adding to `result`.
@param clearance  answers
    double radius()                                     r
    Travel calcTravel(const Look& from, const Look& to)
    Look calcRough(int sample)                          quick, a lower bound
    void refine(Look& look)                               closely, where it is rough
    bool hasBudget() const                              false: nothing more may be looked at closely */
template <class Clearance>
void prove(const Demand& demand, Clearance& clearance, Look& from, Look& to, Result& result) {
    const Travel travel = clearance.calcTravel(from, to);
    double bound = 0.0, lowest = 0.0;
    const auto compare = [&] {
        // A look is a lower bound; so is its neighbour's, less what can have changed.
        from.clearance = std::max(from.clearance, to.clearance - travel.reach);
        to.clearance = std::max(to.clearance, from.clearance - travel.reach);
        lowest = std::min(from.clearance, to.clearance);
        bound = calcBound(from, to, travel, clearance.radius());
    };
    compare();
    if (bound < demand.ahead && (from.isRough || to.isRough)) {
        const double enough = demand.ahead + (lowest - bound);
        for (Look* look : {&from, &to})
            if (clearance.hasBudget() && !(look->clearance >= enough)) clearance.refine(*look);
        compare();
    }
    // With half of what is beyond `ahead` in reserve the bound is still good for paths that are near this one.
    const bool isAhead = bound >= demand.ahead;
    if (isAhead && bound >= std::min((demand.ahead + lowest) / 2.0, lowest - kGuard_m))
        return settle(bound, from, to, result);
    const bool keepsLeast = lowest >= demand.least - kRounding_m;
    const bool keepsFloor = bound >= demand.floor - kRounding_m;
    const bool isNear = travel.reach <= 2.0 * kGuard_m || bound >= lowest - kBlur_m;
    // Nor need more be known of a place that cannot be the nearest.
    const bool isFarther = bound >= result.all.seen;
    if (keepsLeast && keepsFloor && (isNear || isFarther)) return settle(bound, from, to, result);
    const int middle = (from.sample + to.sample) / 2;
    // What is not kept need not be known to the last look: a place to steer away from is enough.
    const bool isTold = !keepsLeast && isNear;
    if (isTold || middle == from.sample || !clearance.hasBudget() ||
        !(lowest > -std::numeric_limits<double>::infinity())) {
        result.isKept = result.isKept && keepsLeast && keepsFloor;
        return settle(bound, from, to, result);
    }
    Look between = clearance.calcRough(middle);
    between.clearance = std::max(between.clearance, bound);
    // The nearer side first: it may make looks at the other one needless.
    const bool isToNearer = to.clearance < from.clearance;
    if (isToNearer) prove(demand, clearance, between, to, result);
    prove(demand, clearance, from, between, result);
    if (!isToNearer) prove(demand, clearance, between, to, result);
}

}  // namespace bisection

}  // namespace viable::detail
