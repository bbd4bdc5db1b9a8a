#pragma once

#include <array>
#include <cstdint>

#include "viable/core/JointLimits.h"

namespace viable {

/** A stop of one joint on the time grid. It has up to six segments of whole ticks with constant jerk, and ends at v
= 0 and a = 0 up to rounding. Holding its jerks tick by tick stops the joint. Plain data, so that a filter can hand
its stop to the host. */
class GridStop {
public:
    static constexpr int kSegments = 6;
    struct Segment {
        std::int64_t ticks = 0;
        double jerk = 0.0;  ///< [rad/s^3]
    };

    /** Plans the stop from (v, a) that takes the fewest ticks, or nearly so. Every phase of the stationary stop is
    rounded to whole ticks and the jerks are solved for again, so that acceleration and jerk limits hold. If (v, a)
    lies too far outside the acceleration limit for such a plan, the stop first brings `a` to zero at full jerk. It
    returns false in that case. Jerk limits finite. No allocation; bounded work. */
    bool plan(double v, double a, const AxisLimits& limits, double tick_s);

    /** The stop that consists of these segments; a negative number of ticks counts as 0, more than
    1e12 as 1e12. */
    void set(const std::array<Segment, kSegments>& segments);

    bool atRest() const { return tick_ >= totalTicks(); }
    std::int64_t remainingTicks() const { return totalTicks() - tick_; }

    /** True when the remaining segments have the same jerks and ticks. */
    friend bool operator==(const GridStop& a, const GridStop& b) {
        for (int i = 0; i < kSegments; ++i) {
            const Segment x = a.remaining(i), y = b.remaining(i);
            if (x.ticks != y.ticks || (x.ticks > 0 && x.jerk != y.jerk)) return false;
        }
        return true;
    }

    /** The rest of segment `i`; its ticks are 0 when it has passed. */
    Segment remaining(int i) const;

    /** The jerk to hold in the next tick; 0 when the stop has ended. */
    double nextJerk() const;
    /** Returns nextJerk() and advances by one tick. */
    double popJerk();
    /** Advances by `ticks` >= 0 ticks, at most to the end. */
    void skip(std::int64_t ticks);

private:
    std::int64_t totalTicks() const;

    std::array<Segment, kSegments> segments_{};
    std::int64_t tick_ = 0;
};

}  // namespace viable
