#include <cstdio>

#include "ArmProperty.h"

namespace viable {

namespace {

/** Rounding that does not count as a violation, relative to calcSize(). */
constexpr double kAllowed = 1e-12;
/** Through missed ticks the rounding of velocity and acceleration goes on: 1e-14 of them, as a share of kAllowed. */
constexpr double kCarried = 0.01;
/** A limit is used up when no more than this share of it is left. */
constexpr double kUnused = 0.01;
/** Faster than this share of its (drawn) velocity limit a joint is in motion. */
constexpr double kMotion = 0.01;

/** So many ticks in a row a joint may stay at rest that is to move where there is room: more than kUnused of the range. */
constexpr int kMostStuck = 20;
/** ... unless what a tick of jerk moves it is no more than so many units in the last place of its position. */
constexpr double kResolution = 8.0 * std::numeric_limits<double>::epsilon();
/** The shares that must be reached at least: a third of what is measured. */
constexpr double kLeastMotion = 0.2, kLeastPassed = 0.02, kLeastHeld = 0.017;
constexpr double kLeastUsed[] = {0.27, 0.16, 0.16, 0.33};

enum Quantity { Position, Velocity, Acceleration, Jerk, kQuantities };
constexpr const char* kNames[] = {"position", "velocity", "acceleration", "jerk"};

/** A limit that exists was used up to kUnused by a joint. */
struct Uses {
    bool used[kQuantities] = {};

    void see(const PathRange& tick, double jerk, const DrawnLimits& l) {
        for (int q = 0; q < kQuantities; ++q) {
            const Range x = q == Jerk ? Range{jerk, jerk} : getRange(tick, q);
            const Sides limit = getSides(l.limits, q), finite = getSides(l.finite, q);
            const double range = finite.upper - finite.lower;
            const double above = kUnused * (q == Position ? range : finite.upper);
            const double below = kUnused * (q == Position ? range : -finite.lower);
            used[q] |= x.largest >= limit.upper - above || x.least <= limit.lower + below;
        }
    }
};

bool exists(const AxisLimits& l, int quantity) {
    const Sides sides = getSides(l, quantity);
    return std::isfinite(sides.lower) || std::isfinite(sides.upper);
}

/** What the barrier is about: where the backup stop brings a joint, and the velocity that full jerk, bringing
acceleration to zero, leads to, half a tick of acceleration more for the grid. */
struct Reach {
    Reach(const AxisState& s, const GridStop& stop, const AxisLimits& l, double tick_s)
        : path(walkStop(s, stop, tick_s)), peaks(calcPeaks(s, l, tick_s)), jerk(stop.nextJerk()) {}

    static Range calcPeaks(const AxisState& s, const AxisLimits& l, double tick_s) {
        const Real J = s.a > 0.0 ? -l.jerkLower : l.jerkUpper;
        Range peaks{s.v, s.v};
        peaks.include(s.v + Real(s.a) / 2 * (std::abs(Real(s.a)) / J + tick_s));
        return peaks;
    }

    PathRange path;
    Range peaks;
    double jerk;  ///< the next one of the stop
};

class LimitsProperty : public ArmProperty {
public:
    explicit LimitsProperty(const Options& options) : ArmProperty("limits", options) {}

private:
    /** How far anything was beyond a limit, relative to calcSize(); negative: never reached. */
    struct Worst {
        Real beyond[kQuantities] = {-1, -1, -1, -1};
    };

    void followArm() override {
        Random random(run_.seed(), run_.arm());
        Arm arm(random);
        arm.objective = run_.options().objective;
        arm_ = &arm;
        sizes_.assign(static_cast<std::size_t>(arm.n), {});
        uses_.assign(static_cast<std::size_t>(arm.n), {});
        stuck_.assign(static_cast<std::size_t>(arm.n), 0);
        for (int i = 0; i < arm.n; ++i) sizes_[i] = {arm.state.q[i], 0.0, 0.0};
        const int ticks = random.integer(1000, 6000);
        for (int k = 0; k < ticks; ++k) {
            // No usable input (NaN burst) or missed ticks: the stops go on.
            if (k > 0 && random.chance(0.001)) missTicks(random.integer(1, 1000));
            runTick(k, k > 0 && random.chance(0.02));
        }
        run_.addSteps(std::int64_t(ticks) * arm.n);
        for (int i = 0; i < arm.n; ++i) {
            if (arm.adversaries[i].kind() != Adversary::Greedy) continue;
            for (int q = 0; q < kQuantities; ++q) {
                if (!exists(arm.limits.axis(i), q)) continue;
                ++pushed_[q];
                usedUp_[q] += uses_[i].used[q];
            }
        }
    }

    void missTicks(int missed) {
        Arm& arm = *arm_;
        const double t = missed * arm.tick_s;
        for (auto& sizes : sizes_) sizes[0] = std::max(sizes[0], kCarried * t * (sizes[1] + t * sizes[2] / 2.0));
        std::vector<GridStop> stops;
        for (int i = 0; i < arm.n; ++i) stops.push_back(arm.braking.stop(i));
        for (int m = 0; m < missed; ++m) {
            for (int i = 0; i < arm.n; ++i) arm.chosen[i] = stops[i].popJerk();
            for (int i = 0; i < arm.n; ++i) checkTick(i, "a limit is passed in a missed tick (relative)");
            arm.move();
        }
        arm.braking.skipTicks(missed);
        skipped_ += missed;
    }

    void runTick(int k, bool followsStop) {
        Arm& arm = *arm_;
        const bool hasBarrier = arm.approach < 1.0;
        before_.clear();
        for (int i = 0; i < arm.n && hasBarrier; ++i)
            before_.emplace_back(arm.at(i), arm.braking.stop(i), arm.limits.axis(i), arm.tick_s);

        bool isAdmissible = followsStop;
        FilterStatus status;
        if (followsStop) {  // it is always admissible, but for what rounding left at its end
            for (int i = 0; i < arm.n; ++i) {
                arm.wanted[i] = arm.braking.stop(i).nextJerk();
                isAdmissible &= !arm.braking.stop(i).atRest() || (arm.state.qd[i] == 0.0 && arm.state.qdd[i] == 0.0);
            }
            status = arm.choose();
        } else {
            status = arm.choose(k);
        }
        const bool passed = status == FilterStatus::Passed;
        ++ticks_;
        passed_ += passed && !followsStop;
        if (status == FilterStatus::Recovering) checkNoneIsLost();
        if ((isAdmissible || passed) && arm.chosen != arm.wanted)
            fail("an admissible jerk was changed [rad/s^3]", (arm.chosen - arm.wanted).lpNorm<Eigen::Infinity>(), 0);
        for (int i = 0; i < arm.n; ++i) {
            const PathRange tick = checkTick(i, "a limit is passed (relative)");
            if (hasBarrier) checkBarrier(i, tick);
            checkNotStuck(i);
            uses_[i].see(tick, arm.chosen[i], arm.now[i]);
            const AxisLimits& typical = arm.now[i].finite;
            moving_ += tick.v.size() > kMotion * std::min(-typical.velocityLower, typical.velocityUpper);
        }
        arm.move();
    }

    void checkNoneIsLost() {
        for (int i = 0; i < arm_->n; ++i) {
            const PassedLimit& excess = arm_->braking.findExcess(i);
            if (excess.limit == LimitKind::None) continue;
            if (excess.limit != LimitKind::Jerk && excess.excess <= calcRounding(i, excess.limit)) {
                ++recoveringForRounding_;
                continue;
            }
            char what[80];
            std::snprintf(what, sizeof what, "a stop was lost: it passes %s", getName(excess.limit, excess.side));
            fail(what, excess.excess, i);
        }
    }

    double calcRounding(int i, LimitKind limit) const {
        const int q = static_cast<int>(limit) - static_cast<int>(LimitKind::Position);
        const Sides sides = getSides(arm_->limits.axis(i), q);
        return kAllowed * calcSize(sides.lower, sides.upper, sizes_[i][q]);
    }

    PathRange checkTick(int i, const char* what) {
        Arm& arm = *arm_;
        const AxisLimits l = arm.limits.axis(i);
        const PathRange tick = walkTick(arm.at(i), arm.chosen[i], arm.tick_s);
        auto& sizes = sizes_[i];
        const auto see = [&](int quantity, const Range& x, double seen) {
            const Sides limit = getSides(l, quantity);
            Real beyond = std::max(x.largest - limit.upper, limit.lower - x.least);
            if (beyond != 0) beyond /= calcSize(limit.lower, limit.upper, seen);
            worst_.beyond[quantity] = std::max(worst_.beyond[quantity], beyond);
            if (!(beyond <= kAllowed)) fail(what, static_cast<double>(beyond), i);
        };
        for (int q = 0; q < Jerk; ++q) {
            sizes[q] = std::max(sizes[q], static_cast<double>(getRange(tick, q).size()));
            see(q, getRange(tick, q), sizes[q]);
        }
        see(Jerk, {arm.chosen[i], arm.chosen[i]}, 0.0);
        return tick;
    }

    /** Where joints are coupled, one may rest for the sake of another's torque. */
    void checkNotStuck(int i) {
        if (arm_->isCoupled || arm_->objective == Objective::Path) return;
        const AxisLimits &l = arm_->now[i].limits, &finite = arm_->now[i].finite;
        const double p = arm_->state.q[i], want = arm_->wanted[i];
        const double step = std::min(-l.jerkLower, l.jerkUpper) * std::pow(arm_->tick_s, 3);
        if (step < kResolution * std::abs(p)) return;
        const double room = kUnused * (finite.positionUpper - finite.positionLower);
        const bool up = want > kUnused * l.jerkUpper && p < l.positionUpper - room;
        const bool down = want < kUnused * l.jerkLower && p > l.positionLower + room;
        if (!up && !down) return;
        const bool rests = arm_->chosen[i] == 0.0 && arm_->braking.stop(i).atRest();
        stuck_[i] = rests ? stuck_[i] + 1 : 0;
        longestStuck_ = std::max(longestStuck_, stuck_[i]);
        if (stuck_[i] > kMostStuck) fail("a joint does not move though it could [ticks]", stuck_[i], i);
    }

    /** P - reach+ >= (1 - share) (P - reach), on every side, of position and velocity. Where the stop goes on it must not
    reach farther than it did: its own velocity peak counts then. */
    void checkBarrier(int i, PathRange path) {
        Arm& arm = *arm_;
        const AxisLimits l = arm.limits.axis(i);
        const AxisState end = advance(arm.at(i), arm.chosen[i], arm.tick_s);
        const Reach& before = before_[i];
        path.include(walkStop(end, arm.braking.stop(i), arm.tick_s));
        const bool goesOn = arm.chosen[i] == before.jerk;
        const Range after = goesOn ? path.v : Reach::calcPeaks(end, l, arm.tick_s);
        seeBarrier(i, "the barrier of a position limit is passed (relative)", before.path.p, path.p, l.positionLower,
                   l.positionUpper, path.p.size(), goesOn);
        seeBarrier(i, "the barrier of a velocity limit is passed (relative)", goesOn ? before.path.v : before.peaks,
                   after, l.velocityLower, l.velocityUpper, path.v.size(), goesOn);
    }

    void seeBarrier(int i, const char* what, const Range& before, const Range& after, double lower, double upper,
                    Real seen, bool goesOn) {
        const Real rest = goesOn ? 1 : 1 - Real(arm_->approach);
        const double size = calcSize(lower, upper, static_cast<double>(seen));
        const auto seeSide = [&](double limit, Real roomBefore, Real roomAfter) {
            if (!std::isfinite(limit)) return;
            const Real least = rest * std::max(Real(0), roomBefore);
            Real beyond = least - roomAfter;
            if (beyond != 0) beyond /= size;
            barrier_ = std::max(barrier_, beyond);
            ++barriers_;
            held_ += !goesOn && least > 1e-6 * size && beyond > -1e-9;
            if (!(beyond <= kAllowed)) fail(what, static_cast<double>(beyond), i);
        };
        seeSide(upper, upper - before.largest, upper - after.largest);
        seeSide(lower, before.least - lower, after.least - lower);
    }

    void report() override {
        std::printf("  missed ticks %lld; worst beyond a limit (relative):", static_cast<long long>(skipped_));
        for (int q = 0; q < kQuantities; ++q)
            std::printf(" %s %.2Lg%s", kNames[q], worst_.beyond[q], q < Jerk ? "," : "");
        std::printf("; beyond the barrier %.2Lg\n", barrier_);
        std::printf("  longest rest of a joint that was to move where there is room: %d ticks\n", longestStuck_);
        if (recoveringForRounding_ > 0)
            std::printf("  joints reported as recovering for no more than rounding %lld times\n",
                        static_cast<long long>(recoveringForRounding_));
        run_.expectShare("joint steps in motion", moving_, run_.steps(), kLeastMotion);
        run_.expectShare("ticks passed unchanged", passed_, ticks_, kLeastPassed);
        run_.expectShare("barriers at which a joint was held back", held_, barriers_,
                         // on the path one joint is enough to hold all others back before their own barriers
                         run_.options().objective == Objective::Path ? kLeastHeld / 2.0 : kLeastHeld);
        for (int q = 0; q < kQuantities; ++q) {
            char name[80];
            std::snprintf(name, sizeof name, "joints pushed hard that used 99 %% of %s", kNames[q]);
            run_.expectShare(name, usedUp_[q], pushed_[q], kLeastUsed[q]);
        }
    }

    std::vector<std::array<double, 3>> sizes_;  // largest |p|, |v|, |a| so far
    std::vector<Uses> uses_;
    std::vector<int> stuck_;  // ticks in a row
    std::vector<Reach> before_;
    Worst worst_;
    Real barrier_ = -1;
    int longestStuck_ = 0;
    std::int64_t ticks_ = 0, passed_ = 0, skipped_ = 0, moving_ = 0, barriers_ = 0, held_ = 0,
                 recoveringForRounding_ = 0;
    std::int64_t pushed_[kQuantities] = {}, usedUp_[kQuantities] = {};
};

}  // namespace

bool checkLimits(const Options& options) {
    return LimitsProperty(options).check();
}

}  // namespace viable
