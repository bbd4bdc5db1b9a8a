#pragma once

#include <algorithm>
#include <limits>

namespace viable::detail {

/** Adaptive bisection of a path with motion bounds (Schwarzer, Saha and Latombe, Adaptive dynamic collision checking for
single and multiple articulated robots in complex environments, IEEE Trans. Robotics 21, 2005), here not for contact but for a
clearance c(t) that must be kept.

c cannot change faster than the points move: between two looks at a and b, where no point moves by more than D,

    c(t) >= max(c(a) - D(a, t), c(b) - D(t, b)) >= (c(a) + c(b) - D) / 2,

so that nothing between two looks can be missed, however thin. Where that does not suffice the middle is looked at, down to
neighbouring samples; what is not proven then counts as not kept. */
namespace bisection {

/** Looks aim at so much more than must be kept; what is left between two of them may use it up [m]. */
inline constexpr double kGuard_m = 0.005;
/** A clearance that differs by less is the same: rounding of poses [m]. */
inline constexpr double kRounding_m = 1e-9;

/** The clearance at a sample of the path, or a lower bound of it. */
struct Look {
    int sample = 0;
    double clearance = std::numeric_limits<double>::infinity();
    double moved = 0.0;     ///< farthest that any point can have moved since the path's begin [m]
    double ofMiddle = 0.0;  ///< see ElementDistance::Rough
    bool isRough = true;    ///< it can be looked at more closely
};

/** What a clearance must keep [m]. */
struct Demand {
    double floor;  ///< at every time
    double least;  ///< at looks, >= floor
    double ahead;  ///< >= least: from here on clearances need not be told apart
};

struct Result {
    double seen = std::numeric_limits<double>::infinity();    ///< least clearance of the looks [m]
    double proven = std::numeric_limits<double>::infinity();  ///< lower bound for all times [m]
    bool isKept = true;                                       ///< floor and least are proven
    Look rough;                                               ///< lowest look that stayed rough
};

/** Nothing more is looked at between these two. */
inline void settle(double bound, const Look& from, const Look& to, Result& result) {
    result.proven = std::min(result.proven, bound);
    result.seen = std::min({result.seen, from.clearance, to.clearance});
    for (const Look* look : {&from, &to})
        if (look->isRough && look->clearance < result.rough.clearance) result.rough = *look;
}

/** Proves what it can between two looks, adding to `result`.
@param clearance  answers
    double calcReach(const Look& from, const Look& to)  D
    Look lookRoughly(int sample)                        quick, a lower bound
    void look(Look& look)                               closely, where it is rough
    bool hasBudget() const                              false: nothing more may be looked at closely */
template <class Clearance>
void prove(const Demand& demand, Clearance& clearance, Look& from, Look& to, Result& result) {
    const double reach = clearance.calcReach(from, to);
    const double enough = demand.ahead + reach / 2.0;
    if (clearance.hasBudget() && !(from.clearance >= enough)) clearance.look(from);
    if (clearance.hasBudget() && !(to.clearance >= enough)) clearance.look(to);
    // A look is a lower bound; so is its neighbour's, less what can have changed.
    from.clearance = std::max(from.clearance, to.clearance - reach);
    to.clearance = std::max(to.clearance, from.clearance - reach);
    const double bound = (from.clearance + to.clearance - reach) / 2.0;
    if (bound >= demand.ahead) return settle(bound, from, to, result);
    const double lowest = std::min(from.clearance, to.clearance);
    const bool keepsLeast = lowest >= demand.least - kRounding_m;
    const bool keepsFloor = bound >= demand.floor - kRounding_m;
    if (keepsLeast && keepsFloor && reach <= 2.0 * kGuard_m) return settle(bound, from, to, result);
    const int middle = (from.sample + to.sample) / 2;
    // What is not kept need not be known to the last look: a place to steer away from is enough.
    const bool isTold = !keepsLeast && bound >= lowest - kGuard_m;
    if (isTold || middle == from.sample || !clearance.hasBudget() ||
        !(lowest > -std::numeric_limits<double>::infinity())) {
        result.isKept = result.isKept && keepsLeast && keepsFloor;
        return settle(bound, from, to, result);
    }
    Look between = clearance.lookRoughly(middle);
    prove(demand, clearance, from, between, result);
    prove(demand, clearance, between, to, result);
}

}  // namespace bisection

}  // namespace viable::detail
