#pragma once

#include <algorithm>

#include "viable/braking/Braking.h"
#include "viable/braking/GridStop.h"

namespace viable::detail {

/** The shortest stops that jerks held over whole ticks allow, and of those the ones that go least far: full jerk, one
tick in between, full jerk back, one tick in between; where the acceleration limit is reached, one more tick in between
and a cruise. (A linear programme with the two equations v = 0 and a = 0 at the end has at most two jerks that stand at
no limit.) Their stop position differs from that of the fastest stop in continuous time in second order of the tick only,
where phases that are rounded to whole ticks differ in first. No allocation; bounded work. */
class ShortestStop {
public:
    /** @param fastest  the stop in continuous time from the state in question, or one close to it
        @param limits   of acceleration and jerk; jerk finite */
    ShortestStop(const StationaryStop& fastest, const AxisLimits& limits, double tick_s);

    /** Calls `accept(stop)` with one stop from `from` after the other, until it returns true; false when it never does. */
    template <class Accept>
    bool find(const AxisState& from, Accept&& accept) {
        return forEachPlan([&](Plan& plan) { return solve(from, plan) && accept(makeStop(plan)); });
    }

    /** The largest jerk of one tick from `from` on, after which such a stop ends at `position` exactly. Returns false when
    none is found; `stop` is the one after that tick. */
    bool findJerkTo(double position, const AxisState& from, double& jerk, GridStop& stop) {
        return findJerkTo(position, from, jerk, stop, [](double, const GridStop&) { return true; });
    }
    /** The largest that `accept(jerk, stop)` takes. */
    template <class Accept>
    bool findJerkTo(double position, const AxisState& from, double& jerk, GridStop& stop, Accept&& accept) {
        Plan best;
        bool found = false;
        forEachPlan([&](Plan& plan) {
            if (solveTo(position, from, plan) && (!found || plan.jerk > best.jerk) &&
                accept(plan.jerk, makeStop(plan))) {
                best = plan;
                found = true;
            }
            return false;
        });
        if (!found) return false;
        jerk = best.jerk;
        stop = makeStop(best);
        return true;
    }

private:
    struct Plan {
        bool cruises = false;
        std::int64_t k = 0, c = 0, m = 0;  ///< ticks at full jerk, of the cruise, at full jerk back
        double jerk = 0.0;                 ///< of the tick before the stop
        double into = 0.0, x = 0.0,
               y = 0.0;  ///< of the ticks in between: into the cruise, out of it, at the end
    };

    template <class Visit>
    bool forEachPlan(Visit&& visit) {
        Plan plan;
        const auto from = [](std::int64_t ticks, std::int64_t less) { return std::max<std::int64_t>(0, ticks - less); };
        for (plan.m = from(m_, 2 + moreM_); plan.m <= m_ + 1 + moreM_; ++plan.m) {
            plan.cruises = false;
            for (plan.k = from(k_, 2 + moreK_); !skipsDirect_ && plan.k <= k_ + 1 + moreK_; ++plan.k)
                if (visit(plan)) return true;
            plan.cruises = true;
            for (plan.k = from(k_, 1); cruises_ && plan.k <= k_; ++plan.k)
                for (plan.c = from(c_, 2); plan.c <= c_ + 1; ++plan.c)
                    if (visit(plan)) return true;
        }
        return false;
    }
    bool solve(const AxisState& from, Plan& plan) const;
    bool solveTo(double position, const AxisState& from, Plan& plan) const;
    /** Whether a jerk keeps its limits up to rounding, which is cut off. */
    bool fits(double& jerk) const;
    GridStop makeStop(const Plan& plan) const;

    double tick_s_, lower_, upper_, first_, back_, cruise_;
    bool cruises_, skipsDirect_;  ///< a long cruise leaves no stop without one
    std::int64_t k_, c_, m_;
    std::int64_t moreK_,
        moreM_;  ///< where one jerk is several times the other, its tick is worth several of that
};

}  // namespace viable::detail
