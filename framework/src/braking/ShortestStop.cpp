#include "braking/ShortestStop.h"

#include "braking/GridPhases.h"

namespace viable::detail {

namespace {

/** State in units of one tick: all quantities are jerks. */
struct TickState {
    double p, v, a;

    TickState(double p0, const AxisState& s, double dt) : p(p0 / (dt * dt * dt)), v(s.v / (dt * dt)), a(s.a / dt) {}

    void hold(std::int64_t ticks, double jerk) {
        const double n = static_cast<double>(ticks);
        p += n * (v + n * (a / 2.0 + n * jerk / 6.0));
        v += n * (a + n * jerk / 2.0);
        a += n * jerk;
    }
};

/** What a jerk of 1 in one tick adds to velocity and position `after` ticks later. */
double calcVelocityGain(double after) {
    return after + 0.5;
}
double calcPositionGain(double after) {
    return after * (after + 1.0) / 2.0 + 1.0 / 6.0;
}

/** Ticks more to try on either side where the other jerk is `ratio` times as large. */
std::int64_t countMore(double ratio) {
    constexpr double kMost = 12.0;
    return static_cast<std::int64_t>(std::ceil(std::min(std::abs(ratio), kMost) - 1e-9)) - 1;
}

}  // namespace

ShortestStop::ShortestStop(const StationaryStop& fastest, const AxisLimits& limits, double tick_s)
    : tick_s_(tick_s),
      lower_(limits.jerkLower),
      upper_(limits.jerkUpper),
      first_(fastest.jerk),
      back_(fastest.jerk < 0.0 ? limits.jerkUpper : limits.jerkLower),
      cruise_((fastest.jerk < 0.0 ? limits.accelerationLower : limits.accelerationUpper) / tick_s),
      cruises_(fastest.cruises),
      skipsDirect_(fastest.cruises && fastest.T2 >= 2.0 * tick_s),
      k_(roundDownToTicks(fastest.T1, tick_s)),
      c_(roundDownToTicks(fastest.T2, tick_s)),
      m_(roundDownToTicks(fastest.T3, tick_s)),
      moreK_(countMore(back_ / first_)),
      moreM_(countMore(first_ / back_)) {}

bool ShortestStop::fits(double& jerk) const {
    constexpr double slack = 1.0 + kPlanRounding;
    if (!(jerk >= lower_ * slack && jerk <= upper_ * slack)) return false;
    jerk = std::clamp(jerk, lower_, upper_);
    return true;
}

bool ShortestStop::solve(const AxisState& from, Plan& plan) const {
    TickState s(0.0, from, tick_s_);
    s.hold(plan.k, first_);
    if (plan.cruises) {
        plan.into = cruise_ - s.a;
        if (!fits(plan.into)) return false;
        s.hold(1, plan.into);
        s.hold(plan.c, 0.0);
    }
    s.hold(1, 0.0);
    s.hold(plan.m, back_);
    s.hold(1, 0.0);
    // What is left at the end is for x, m + 1 ticks before it, and for y, in the last tick.
    plan.x = (s.a / 2.0 - s.v) / static_cast<double>(plan.m + 1);
    plan.y = -s.a - plan.x;
    return fits(plan.x) && fits(plan.y);
}

bool ShortestStop::solveTo(double position, const AxisState& from, Plan& plan) const {
    TickState s(from.p - position, from, tick_s_);
    s.hold(1, 0.0);
    s.hold(plan.k, first_);
    const double afterX = static_cast<double>(plan.m + 1);
    double after = static_cast<double>(plan.k) + 1.0 + afterX;
    double gainA = 1.0, gainV = 0.0, gainP = 0.0;
    double into = 0.0;
    if (plan.cruises) {
        into = cruise_ - s.a;  // less the jerk
        s.hold(1, into);
        s.hold(plan.c, 0.0);
        const double afterInto = static_cast<double>(plan.c) + 1.0 + afterX;
        after = static_cast<double>(plan.k) + 1.0 + afterInto;
        gainA = 0.0;
        gainV = -calcVelocityGain(afterInto);
        gainP = -calcPositionGain(afterInto);
    }
    gainV += calcVelocityGain(after);
    gainP += calcPositionGain(after);
    s.hold(1, 0.0);
    s.hold(plan.m, back_);
    s.hold(1, 0.0);

    // Three equations for jerk, x and y: acceleration, velocity and distance are zero at the end. First y goes, then x.
    const double leftV = s.v - s.a / 2.0, leftP = s.p - s.a / 6.0;
    const double halfX = (afterX + 1.0) / 2.0;
    gainV -= gainA / 2.0;
    gainP -= gainA / 6.0;
    plan.jerk = -(leftP - halfX * leftV) / (gainP - halfX * gainV);
    plan.x = -(leftV + gainV * plan.jerk) / afterX;
    plan.y = -s.a - gainA * plan.jerk - plan.x;
    plan.into = plan.cruises ? into - plan.jerk : 0.0;
    // A last jerk of the other sign would mean that the joint passes the position and comes back.
    return plan.y * back_ >= 0.0 && fits(plan.jerk) && fits(plan.into) && fits(plan.x) && fits(plan.y);
}

GridStop ShortestStop::makeStop(const Plan& plan) const {
    GridStop stop;
    if (plan.cruises)
        stop.set({{{plan.k, first_}, {1, plan.into}, {plan.c, 0.0}, {1, plan.x}, {plan.m, back_}, {1, plan.y}}});
    else
        stop.set({{{plan.k, first_}, {1, plan.x}, {plan.m, back_}, {1, plan.y}}});
    return stop;
}

}  // namespace viable::detail
