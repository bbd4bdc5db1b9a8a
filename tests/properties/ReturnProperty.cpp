#include <cstdio>

#include "ArmProperty.h"
#include "FastestReturn.h"

namespace viable {

namespace {

/** Rounding that does not count as a violation, relative to calcSize(). */
constexpr double kAllowed = 1e-12;
/** So many times what one tick adds (see FastestReturn) position, velocity and acceleration may go beyond the fastest
stop's extreme; in 2.4e8 joint steps it is 4.4, 0.43 and 0.12 times. */
constexpr double kMostTicks[] = {8.0, 1.0, 1.0};
/** The return may take so many times as long as the fastest, and so many ticks more; of ways of 50 ticks and more the
longest measured is 1.52 times, of shorter ones 6.1 ticks more. */
constexpr double kMostTimes = 1.5;
constexpr double kMoreTicks = 20.0;
constexpr double kLongWay = 50.0;   // [ticks]
constexpr int kLongestWait = 3000;  // [ticks]

constexpr const char* kNames[] = {"position", "velocity", "acceleration"};

/** How far `x` is beyond its limits; <= 0: inside. */
Real calcBeyond(const Range& x, const Sides& limit) {
    return std::max(x.largest - limit.upper, limit.lower - x.least);
}

/** One joint's way back, from the start or from a change of limits on. */
struct ArmTrack {
    /** @param earlier  limits by which the joint may have planned its stop: while it has not come back from one change
        of limits, those before it, too */
    ArmTrack(const AxisState& s, const AxisLimits& l, const std::vector<AxisLimits>& earlier, double tick_s)
        : fastest(s, l, l, tick_s), taken(s) {
        for (const AxisLimits& before : earlier) {
            const FastestReturn old(s, before, l, tick_s);
            fastest.stop.include(old.stop);
            fastest.seconds = std::max(fastest.seconds, old.seconds);
            for (int q = 0; q < 3; ++q) fastest.tickTravel[q] = std::max(fastest.tickTravel[q], old.tickTravel[q]);
        }
        allowed_s = kMostTimes * fastest.seconds + kMoreTicks * tick_s;
    }

    FastestReturn fastest;
    PathRange taken;
    double allowed_s;
    double last_s = 0.0;  ///< when a limit was passed for the last time, by the motion or by its stop
    bool isBack = false;
    Real farther[3] = {-INFINITY, -INFINITY, -INFINITY};  ///< than the fastest stop [ticks of travel]
};

class ReturnProperty : public ArmProperty {
public:
    ReturnProperty(const char* name, const Options& options, bool changes)
        : ArmProperty(name, options), changes_(changes) {}

private:
    void followArm() override {
        Random random(run_.seed(), run_.arm());
        Arm arm(random);
        arm_ = &arm;
        if (!changes_) arm.startAnywhere(random);
        earlier_.assign(static_cast<std::size_t>(arm.n), {});
        begin();
        int left = changes_ ? random.integer(50, 300) : kLongestWait, ticks = changes_ ? 4000 : calcWait();
        for (int k = 0; k < ticks; ++k) {
            if (changes_ && --left == 0) {
                end();
                change(random);
                begin();
                left = static_cast<int>(random.logUniform(50, 2000));
            }
            runTick(k);
        }
        end();
        run_.addSteps(std::int64_t(ticks) * arm.n);
    }

    /** Until all joints must have come back, where that is not too long. */
    int calcWait() const {
        double longest_s = 0.0;
        for (const ArmTrack& way : ways_) longest_s = std::max(longest_s, way.allowed_s);
        return static_cast<int>(std::clamp(longest_s / arm_->tick_s + 50.0, 300.0, double(kLongestWait)));
    }

    void begin() {
        ways_.clear();
        for (int i = 0; i < arm_->n; ++i)
            ways_.emplace_back(arm_->at(i), arm_->limits.axis(i), earlier_[i], arm_->tick_s);
        elapsed_ = 0;
        remember();
    }

    void change(Random& random) {
        for (int i = 0; i < arm_->n; ++i) {
            if (ways_[i].isBack) earlier_[i].clear();
            earlier_[i].push_back(arm_->limits.axis(i));
        }
        arm_->changeLimits(random);
    }

    void remember() {
        before_.clear();
        for (int i = 0; i < arm_->n; ++i) before_.push_back(walkStop(arm_->at(i), arm_->braking.stop(i), arm_->tick_s));
    }

    void runTick(int k) {
        Arm& arm = *arm_;
        std::vector<GridStop> stops;
        for (int i = 0; i < arm.n; ++i) stops.push_back(arm.braking.stop(i));
        recovering_ += arm.choose(k) == FilterStatus::Recovering;
        ++elapsed_;
        for (int i = 0; i < arm.n; ++i) checkJoint(i, stops[i]);
        arm.move();
        remember();
    }

    void checkJoint(int i, const GridStop& stopBefore) {
        Arm& arm = *arm_;
        const AxisLimits l = arm.limits.axis(i);
        const PathRange tick = walkTick(arm.at(i), arm.chosen[i], arm.tick_s);
        const AxisState next = advance(arm.at(i), arm.chosen[i], arm.tick_s);
        const GridStop& stop = arm.braking.stop(i);
        PathRange path = tick;
        path.include(walkStop(next, stop, arm.tick_s));
        ArmTrack& way = ways_[i];
        way.taken.include(tick);

        // Jerk: within the limits, or the stop's own that is older than they are.
        const auto isAllowed = [&](double j) { return j >= l.jerkLower && j <= l.jerkUpper; };
        if (!isAllowed(arm.chosen[i]) && arm.chosen[i] != stopBefore.nextJerk())
            fail("a jerk beyond its limit [rad/s^3]", arm.chosen[i], i);
        bool beyond = !isAllowed(arm.chosen[i]);
        for (int k = 0; k < GridStop::kSegments; ++k)
            beyond |= stop.remaining(k).ticks > 0 && !isAllowed(stop.remaining(k).jerk);

        for (int q = 0; q < 3; ++q) {
            const Sides limit = getSides(l, q);
            const Real seen = std::max(getRange(way.taken, q).size(), getRange(before_[i], q).size());
            const Real size = calcSize(limit.lower, limit.upper, static_cast<double>(seen));
            const Real rounding = kAllowed * size;
            beyond |= calcBeyond(getRange(path, q), limit) > rounding;
            checkNotWorse(i, q, getRange(path, q), limit, rounding);
            checkExcursion(i, q, getRange(tick, q), limit, rounding);
        }
        way.isBack = !beyond;
        if (!beyond) return;
        const double now_s = elapsed_ * arm.tick_s;
        way.last_s = now_s;
        if (now_s > way.allowed_s) fail("a limit is still passed [s]", now_s - way.allowed_s, i);
    }

    /** Nothing passes a limit farther than the stop of one tick before would have. */
    void checkNotWorse(int i, int q, const Range& path, const Sides& limit, Real rounding) {
        static const char* const whats[] = {"position gets worse", "velocity gets worse", "acceleration gets worse"};
        const Range& old = getRange(before_[i], q);
        const Sides bound{std::min(limit.lower, static_cast<double>(old.least)),
                          std::max(limit.upper, static_cast<double>(old.largest))};
        const Real beyond = calcBeyond(path, bound);
        if (!(beyond <= rounding)) fail(whats[q], static_cast<double>(beyond), i);
    }

    /** Nothing passes a limit much farther than the fastest stop does. */
    void checkExcursion(int i, int q, const Range& tick, const Sides& limit, Real rounding) {
        static const char* const whats[] = {"position farther than the fastest stop needs [ticks of travel]",
                                            "velocity farther than the fastest stop needs [ticks of travel]",
                                            "acceleration farther than the fastest stop needs [ticks of travel]"};
        ArmTrack& way = ways_[i];
        const FastestReturn& fastest = way.fastest;
        const Range& reference = getRange(fastest.stop, q);
        const Real farther = std::max(tick.largest - std::max(Real(limit.upper), reference.largest),
                                      std::min(Real(limit.lower), reference.least) - tick.least);
        const Real ticks = (farther - rounding) / fastest.tickTravel[q];
        way.farther[q] = std::max(way.farther[q], ticks);
        if (!(ticks <= kMostTicks[q])) fail(whats[q], static_cast<double>(ticks), i);
    }

    /** Takes the figures of the ways that end here. */
    void end() {
        for (int i = 0; i < arm_->n; ++i) {
            const ArmTrack& way = ways_[i];
            const AxisLimits l = arm_->limits.axis(i);
            for (int q = 0; q < 3; ++q) {
                const Real beyond = calcBeyond(getRange(way.taken, q), getSides(l, q));
                worst_[q] = std::max(worst_[q], static_cast<double>(beyond));
                if (beyond > 0) farther_[q].add(static_cast<double>(way.farther[q]));
            }
            if (elapsed_ * arm_->tick_s < way.allowed_s) {
                ++cutShort_;
                continue;
            }
            ++waited_;
            if (way.last_s == 0.0) continue;
            ++cameBack_;
            const double ticks = way.fastest.seconds / arm_->tick_s;
            if (ticks >= kLongWay)
                times_.add(way.last_s / way.fastest.seconds);
            else
                ticks_.add(way.last_s / arm_->tick_s - ticks);
        }
    }

    void report() override {
        std::printf("  ticks on the way back %lld\n", static_cast<long long>(recovering_));
        std::printf("  worst excess: position %.3g rad, velocity %.3g rad/s, acceleration %.3g rad/s^2\n", worst_[0],
                    worst_[1], worst_[2]);
        for (int q = 0; q < 3; ++q) {
            char name[80];
            std::snprintf(name, sizeof name, "%s excess beyond the fastest stop's [ticks]", kNames[q]);
            farther_[q].print(name);
        }
        std::printf("  ways back waited for %lld (of them outside at first %lld), cut short %lld\n",
                    static_cast<long long>(waited_), static_cast<long long>(cameBack_),
                    static_cast<long long>(cutShort_));
        times_.print("time until all limits hold / fastest (of 50 ticks)");
        ticks_.print("shorter ways: longer than the fastest by [ticks]");
    }

    bool changes_;
    std::vector<ArmTrack> ways_;
    std::vector<std::vector<AxisLimits>> earlier_;
    std::vector<PathRange> before_;  ///< the stops of one tick before
    int elapsed_ = 0;                ///< [ticks] of these ways
    double worst_[3] = {-1.0, -1.0, -1.0};
    Figures farther_[3], times_, ticks_;
    std::int64_t recovering_ = 0, waited_ = 0, cameBack_ = 0, cutShort_ = 0;
};

}  // namespace

bool checkRecovery(const Options& options) {
    return ReturnProperty("recovery", options, false).check();
}

bool checkChangingLimits(const Options& options) {
    return ReturnProperty("changing_limits", options, true).check();
}

}  // namespace viable
