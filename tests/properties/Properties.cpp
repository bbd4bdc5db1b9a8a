// Property tests of certified braking: random limits, random arms, adversarial input, millions of joint steps.
//
//     viable_properties limits|recovery|changing_limits|stops [--steps N] [--seed S]
//
// --steps counts joint steps (joints times ticks), 20,000,000 by default; the long mode is --steps 1000000000. For
// `stops` it counts random viable states, at most 1,000,000.
// A run is a function of its seed. Exit code 0: no violation; 1: at least one, the first is printed in full.

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "viable/motion/Braking.h"
#include "viable/motion/CertifiedBraking.h"

namespace viable {

namespace {

using Real = long double;

/** Rounding that does not count as a violation, relative to the larger of a limit's two sides. */
constexpr double kAllowed = 1e-12;

class Random {
public:
    explicit Random(std::uint64_t seed) : engine_(seed) {}
    double uniform(double a, double b) {
        return std::uniform_real_distribution<double>(a, b)(engine_);
    }
    double logUniform(double a, double b) { return std::exp(uniform(std::log(a), std::log(b))); }
    int integer(int a, int b) { return std::uniform_int_distribution<int>(a, b)(engine_); }
    bool chance(double p) { return uniform(0.0, 1.0) < p; }

private:
    std::mt19937_64 engine_;
};

/** Limits of one joint, on both sides of V = A^2 / J, every second set different by side. */
AxisLimits drawLimits(Random& random, double tick_s) {
    const double J = random.logUniform(1.0, 300.0);
    const double A = J * std::max(random.logUniform(0.02, 1.0), 2.0 * tick_s);
    const double V = A * A / J * random.logUniform(0.1, 10.0);
    const double most = random.chance(0.5) ? 1.0 : 2.5;
    const auto side = [&](double size) { return size * random.logUniform(1.0 / most, 1.0); };
    AxisLimits l{};
    l.jerkUpper = side(J);
    l.jerkLower = -side(J);
    const double least = std::max(l.jerkUpper, -l.jerkLower) * tick_s;
    l.accelerationUpper = std::max(side(A), least);
    l.accelerationLower = -std::max(side(A), least);
    l.velocityUpper = side(V);
    l.velocityLower = -side(V);
    const double stop = V * V / A + V * A / J;
    const double least8 = 8.0 * least * tick_s * tick_s;
    const double range = std::max(stop * random.logUniform(0.05, 5.0), least8);
    const double center = random.uniform(-3.0, 3.0);
    l.positionLower = center - range;
    l.positionUpper = center + std::max(side(range), least8);
    return l;
}

void setAxis(JointLimits& limits, int i, const AxisLimits& l) {
    limits.position.lower[i] = l.positionLower;
    limits.position.upper[i] = l.positionUpper;
    limits.velocity.lower[i] = l.velocityLower;
    limits.velocity.upper[i] = l.velocityUpper;
    limits.acceleration.lower[i] = l.accelerationLower;
    limits.acceleration.upper[i] = l.accelerationUpper;
    limits.jerk.lower[i] = l.jerkLower;
    limits.jerk.upper[i] = l.jerkUpper;
}

/** M with M'M of a condition number up to 1e8. */
JointMatrix drawInertia(Random& random, int n) {
    JointMatrix M = JointMatrix::Identity(n, n);
    for (int i = 0; i < n; ++i)
        for (int k = 0; k < i; ++k) M(i, k) = random.uniform(-0.7, 0.7);
    JointMatrix scale = JointMatrix::Zero(n, n);
    for (int i = 0; i < n; ++i) scale(i, i) = random.logUniform(0.03, 3.0);
    return scale * (M * M.transpose()) * scale;
}

/** Wants of a joint that try to make it leave its limits. */
class Adversary {
public:
    enum Kind {
        HeldRandom,
        BangBang,
        TwoTickBang,
        Greedy,
        SineAtLimit,
        AtTheCorner,
        Noise,
        kKinds
    };

    Adversary(Random& random, const AxisLimits& l)
        : random_(random), limits_(l), kind_(static_cast<Kind>(random.integer(0, kKinds - 1))) {
        period_ = random.integer(2, 600);
        phase_ = random.uniform(0.0, 6.3);
    }

    double want(std::int64_t tick, double last, double stored) {
        const auto scaled = [&](double x) {
            return x > 0.0 ? x * limits_.jerkUpper : -x * limits_.jerkLower;
        };
        switch (kind_) {
            case HeldRandom:
                if (--left_ <= 0)
                    left_ = random_.integer(1, 500), value_ = random_.uniform(-1.5, 1.5);
                return scaled(value_);
            case BangBang:
                if (--left_ <= 0) left_ = random_.integer(1, 800), value_ = -value_;
                return scaled(value_);
            case TwoTickBang:
                return tick / 2 % 2 ? 1e9 : -1e9;
            case Greedy:
                return tick / 2000 % 2 ? -1e300 : 1e300;
            case SineAtLimit:
                return scaled(2.0 *
                              std::sin(6.283185307 * static_cast<double>(tick) / period_ + phase_));
            case AtTheCorner:  // what was granted, a hair more; or the stop, a hair less
                return random_.chance(0.5) ? std::nextafter(last, value_ * INFINITY)
                                           : std::nextafter(stored, -value_ * INFINITY);
            case Noise:
                return scaled(random_.uniform(-3.0, 3.0) + value_);
            case kKinds:
                break;
        }
        return 0.0;
    }

private:
    Random& random_;
    AxisLimits limits_;
    Kind kind_;
    int period_, left_ = 0;
    double phase_, value_ = 1.0;
};

/** Least and largest values of a tick, with the turning points between its ends; long double, on its own formulas. */
struct TickRange {
    Real p[2], v[2], a[2];

    TickRange(const AxisState& s, double jerk, double tick_s) {
        const Real t = tick_s, j = jerk;
        const auto position = [&](Real x) {
            return s.p + x * (s.v + x * (Real(s.a) / 2 + x * j / 6));
        };
        const auto velocity = [&](Real x) { return s.v + x * (s.a + x * j / 2); };
        const auto see = [](Real* range, Real x) {
            range[0] = std::min(range[0], x);
            range[1] = std::max(range[1], x);
        };
        p[0] = p[1] = position(t);
        v[0] = v[1] = velocity(t);
        a[0] = a[1] = s.a + t * j;
        if (j != 0) {
            const Real turn = -Real(s.a) / j;
            if (turn > 0 && turn < t) see(v, velocity(turn));
            const Real inside = Real(s.a) * s.a - 2 * j * s.v;
            if (inside >= 0)
                for (const Real root : {-std::sqrt(inside), std::sqrt(inside)}) {
                    const Real when = (-s.a + root) / j;
                    if (when > 0 && when < t) see(p, position(when));
                }
        } else if (s.a != 0) {
            const Real when = -Real(s.v) / s.a;
            if (when > 0 && when < t) see(p, position(when));
        }
    }
};

/** How far beyond its limits anything ever was; relative, negative: never reached. */
struct Worst {
    const char* name;
    Real use = -1;

    Real see(const Real* range, double lower, double upper) {
        const Real scale = std::max(std::abs(lower), std::abs(upper));
        const Real beyond = std::max(range[1] - upper, lower - range[0]) / scale;
        use = std::max(use, beyond);
        return beyond;
    }
};

struct Run {
    std::int64_t steps;
    std::uint64_t seed;
    std::int64_t done = 0, arms = 0, violations = 0, passed = 0, skipped = 0, returning = 0;
    Worst position{"position"}, velocity{"velocity"}, acceleration{"acceleration"}, jerk{"jerk"};

    void fail(const char* what, double excess, int joint, const AxisState& s, const AxisLimits& l,
              double tick_s) {
        if (++violations > 1) return;
        std::printf(
            "VIOLATION: %s by %.6g (relative or absolute, see the property), arm %lld, joint %d, "
            "tick %g s\n",
            what, excess, static_cast<long long>(arms), joint, tick_s);
        std::printf("  state p %.17g v %.17g a %.17g\n", s.p, s.v, s.a);
        std::printf(
            "  limits p [%.17g, %.17g] v [%.17g, %.17g] a [%.17g, %.17g] j [%.17g, %.17g]\n",
            l.positionLower, l.positionUpper, l.velocityLower, l.velocityUpper, l.accelerationLower,
            l.accelerationUpper, l.jerkLower, l.jerkUpper);
    }
};

AxisState get(const MotionState& state, int i) {
    return {state.q[i], state.qd[i], state.qdd[i]};
}

void move(MotionState& state, const JointVector& jerk, double tick_s) {
    for (int i = 0; i < jerk.size(); ++i) {
        const AxisState next = advance(get(state, i), jerk[i], tick_s);
        state.q[i] = next.p, state.qd[i] = next.v, state.qdd[i] = next.a;
    }
}

/** A random arm under certified braking. */
struct Arm {
    int n;
    double tick_s, approach;
    JointLimits limits;
    JointMatrix M;
    MotionState state;
    CertifiedBraking braking;
    std::vector<Adversary> adversaries;
    JointVector wanted, chosen;
    std::array<CertifiedBraking::ActingLimit, kMaxJoints> acting;

    explicit Arm(Random& random) : n(random.integer(1, 7)) {
        const double ticks[] = {1e-4, 1e-3, 4e-3, 1e-2};
        tick_s = ticks[random.integer(0, 3)];
        approach = random.chance(0.7) ? 1.0 : random.logUniform(0.01, 1.0);
        limits = JointLimits::unlimited(n);
        M = drawInertia(random, n);
        for (JointVector* v : {&state.q, &state.qd, &state.qdd, &wanted, &chosen}) v->setZero(n);
        for (int i = 0; i < n; ++i) {
            const AxisLimits l = drawLimits(random, tick_s);
            setAxis(limits, i, l);
            adversaries.emplace_back(random, l);
            // At rest: inside, or exactly on a limit.
            state.q[i] = random.chance(0.2)   ? l.positionUpper
                         : random.chance(0.2) ? l.positionLower
                                              : random.uniform(l.positionLower, l.positionUpper);
        }
        braking.configure(limits, tick_s, approach);
        braking.reset(state);
    }

    CertifiedBraking::Status choose(std::int64_t tick) {
        for (int i = 0; i < n; ++i)
            wanted[i] = std::clamp(adversaries[i].want(tick, chosen[i], braking.stop(i).nextJerk()),
                                   -1e300, 1e300);
        return braking.choose(state, M, wanted, chosen, acting);
    }
};

/** All limits hold, at the ticks and between, and an admissible want is granted bit for bit. */
void checkLimits(Random& random, Run& run) {
    Arm arm(random);
    const int ticks = random.integer(1000, 6000);
    std::vector<GridStop> stops(static_cast<std::size_t>(arm.n));
    for (int k = 0; k < ticks; ++k, run.done += arm.n) {
        if (k > 0 &&
            random.chance(0.001)) {  // no usable input (NaN burst) or missed ticks: the stops go on
            const int missed = random.integer(1, 1000);
            for (int i = 0; i < arm.n; ++i) stops[i] = arm.braking.stop(i);
            for (int m = 0; m < missed; ++m) {
                for (int i = 0; i < arm.n; ++i) arm.chosen[i] = stops[i].takeJerk();
                for (int i = 0; i < arm.n; ++i) {
                    const AxisLimits l = arm.limits.axis(i);
                    const TickRange range(get(arm.state, i), arm.chosen[i], arm.tick_s);
                    const Real beyond = std::max(
                        {run.position.see(range.p, l.positionLower, l.positionUpper),
                         run.velocity.see(range.v, l.velocityLower, l.velocityUpper),
                         run.acceleration.see(range.a, l.accelerationLower, l.accelerationUpper)});
                    if (!(beyond <= kAllowed))
                        run.fail("a limit is passed in a missed tick", beyond, i, get(arm.state, i),
                                 l, arm.tick_s);
                }
                move(arm.state, arm.chosen, arm.tick_s);
            }
            arm.braking.skipTicks(missed);
            run.skipped += missed;
        }
        bool admissible = false;
        CertifiedBraking::Status status;
        if (k > 0 && random.chance(0.02)) {  // the stop itself is always admissible
            for (int i = 0; i < arm.n; ++i) arm.wanted[i] = arm.braking.stop(i).nextJerk();
            admissible = true;
            status = arm.braking.choose(arm.state, arm.M, arm.wanted, arm.chosen, arm.acting);
        } else {
            status = arm.choose(k);
        }
        if (status == CertifiedBraking::Status::Passed) ++run.passed;
        if (status == CertifiedBraking::Status::Returning)
            run.fail("a stop was lost", 0.0, 0, get(arm.state, 0), arm.limits.axis(0), arm.tick_s);
        if ((admissible || status == CertifiedBraking::Status::Passed) && arm.chosen != arm.wanted)
            run.fail("an admissible jerk was changed",
                     (arm.chosen - arm.wanted).lpNorm<Eigen::Infinity>(), 0, get(arm.state, 0),
                     arm.limits.axis(0), arm.tick_s);
        for (int i = 0; i < arm.n; ++i) {
            const AxisLimits l = arm.limits.axis(i);
            const Real jerk[] = {arm.chosen[i], arm.chosen[i]};
            const TickRange range(get(arm.state, i), arm.chosen[i], arm.tick_s);
            const Real beyond =
                std::max({run.position.see(range.p, l.positionLower, l.positionUpper),
                          run.velocity.see(range.v, l.velocityLower, l.velocityUpper),
                          run.acceleration.see(range.a, l.accelerationLower, l.accelerationUpper),
                          run.jerk.see(jerk, l.jerkLower, l.jerkUpper)});
            if (!(beyond <= kAllowed))
                run.fail("a limit is passed", static_cast<double>(beyond), i, get(arm.state, i), l,
                         arm.tick_s);
        }
        move(arm.state, arm.chosen, arm.tick_s);
    }
}

/** Least and largest of everything on the way of a stop. */
struct StopRange {
    Real p[2], v[2], a[2];

    StopRange(AxisState s, const GridStop& stop, double tick_s) {
        p[0] = p[1] = s.p, v[0] = v[1] = s.v, a[0] = a[1] = s.a;
        for (int i = 0; i < GridStop::kStretches; ++i) {
            const GridStop::Stretch stretch = stop.remaining(i);
            if (stretch.ticks == 0) continue;
            const double duration = static_cast<double>(stretch.ticks) * tick_s;
            const TickRange part(s, stretch.jerk, duration);
            see(p, part.p), see(v, part.v), see(a, part.a);
            s = advance(s, stretch.jerk, duration);
        }
    }

private:
    static void see(Real* range, const Real* part) {
        range[0] = std::min(range[0], part[0]);
        range[1] = std::max(range[1], part[1]);
    }
};

/** From a start anywhere, or after limits changed: nothing passes a limit farther than the stop of one tick before would
have, and after a while every limit holds again. */
void checkReturn(Random& random, Run& run, bool changeLimits) {
    Arm arm(random);
    if (!changeLimits) {
        for (int i = 0; i < arm.n; ++i) {
            const AxisLimits l = arm.limits.axis(i);
            const double range = l.positionUpper - l.positionLower;
            arm.state.q[i] = random.uniform(l.positionLower - range, l.positionUpper + range);
            arm.state.qd[i] = random.uniform(2.0 * l.velocityLower, 2.0 * l.velocityUpper);
            arm.state.qdd[i] = random.uniform(2.0 * l.accelerationLower, 2.0 * l.accelerationUpper);
        }
        arm.braking.reset(arm.state);
    }
    std::vector<StopRange> before;
    double longest = 0.0;  // [s] within which every limit must have been met
    const auto expectMet = [&] {
        for (int i = 0; i < arm.n; ++i) {
            const AxisLimits l = arm.limits.axis(i);
            const double J = std::min(-l.jerkLower, l.jerkUpper),
                         A = std::min(-l.accelerationLower, l.accelerationUpper);
            const double V = std::min(-l.velocityLower, l.velocityUpper);
            const AxisState s = get(arm.state, i);
            const double v = std::abs(s.v) + s.a * s.a / J,
                         far = std::max({0.0, s.p - l.positionUpper, l.positionLower - s.p});
            const double stop = v / A + 2.0 * std::abs(s.a) / J + A / J;
            longest = std::max(
                longest, 3.0 * (stop + (far + v * stop) / V + V / A + A / J) + 20.0 * arm.tick_s);
        }
    };
    expectMet();
    const auto remember = [&] {
        before.clear();
        for (int i = 0; i < arm.n; ++i)
            before.emplace_back(get(arm.state, i), arm.braking.stop(i), arm.tick_s);
    };
    remember();
    const int ticks = random.integer(300, 1500);
    double met = 0.0;
    for (int k = 0; k < ticks; ++k, run.done += arm.n, met += arm.tick_s) {
        if (changeLimits && k % 150 == 149) {
            remember();
            for (int i = 0; i < arm.n; ++i) {
                AxisLimits l = arm.limits.axis(i);
                const double s = random.logUniform(0.3, 3.0), x = random.logUniform(0.3, 3.0),
                             y = random.logUniform(0.5, 2.0);
                l.velocityLower *= s, l.velocityUpper *= s;
                l.accelerationLower *= x, l.accelerationUpper *= x;
                l.jerkLower *= y, l.jerkUpper *= y;
                const double least = std::max(-l.jerkLower, l.jerkUpper) * arm.tick_s;
                l.accelerationLower = std::min(l.accelerationLower, -least);
                l.accelerationUpper = std::max(l.accelerationUpper, least);
                const double range = l.positionUpper - l.positionLower;
                const double least8 = 8.0 * least * arm.tick_s * arm.tick_s;
                const double a = l.positionLower + random.uniform(-0.3, 0.3) * range,
                             b = l.positionUpper + random.uniform(-0.3, 0.3) * range;
                l.positionLower = std::min(a, b);
                l.positionUpper = std::max({a, b, l.positionLower + least8});
                setAxis(arm.limits, i, l);
            }
            arm.braking.changeLimits(arm.limits);
            met = longest = 0.0;
            expectMet();
        }
        std::vector<GridStop> stops;
        for (int i = 0; i < arm.n; ++i) stops.push_back(arm.braking.stop(i));
        const CertifiedBraking::Status status = arm.choose(k);
        const bool returning = status == CertifiedBraking::Status::Returning;
        run.returning += returning;
        if (returning && met > longest)
            run.fail("a limit is still not met", met - longest, 0, get(arm.state, 0),
                     arm.limits.axis(0), arm.tick_s);
        for (int i = 0; i < arm.n; ++i) {
            const AxisLimits l = arm.limits.axis(i);
            // Jerk: within the limits, or the stop's own that is older than they are.
            if (!(arm.chosen[i] >= l.jerkLower && arm.chosen[i] <= l.jerkUpper) &&
                arm.chosen[i] != stops[i].nextJerk())
                run.fail("a jerk beyond its limit", arm.chosen[i], i, get(arm.state, i), l,
                         arm.tick_s);
            const TickRange tick(get(arm.state, i), arm.chosen[i], arm.tick_s);
            const AxisState next = advance(get(arm.state, i), arm.chosen[i], arm.tick_s);
            const StopRange after(next, arm.braking.stop(i), arm.tick_s);
            const auto check = [&](const char* what, const Real* old, const Real* inTick,
                                   const Real* later, double lower, double upper) {
                const Real scale = std::max({std::abs(lower), std::abs(upper),
                                             static_cast<double>(std::abs(old[0])),
                                             static_cast<double>(std::abs(old[1]))});
                const Real most = std::max(Real(upper), old[1]),
                           least = std::min(Real(lower), old[0]);
                const Real beyond = std::max({inTick[1] - most, later[1] - most, least - inTick[0],
                                              least - later[0]}) /
                                    scale;
                if (!(beyond <= kAllowed))
                    run.fail(what, static_cast<double>(beyond), i, get(arm.state, i), l,
                             arm.tick_s);
            };
            check("position gets worse", before[i].p, tick.p, after.p, l.positionLower,
                  l.positionUpper);
            check("velocity gets worse", before[i].v, tick.v, after.v, l.velocityLower,
                  l.velocityUpper);
            check("acceleration gets worse", before[i].a, tick.a, after.a, l.accelerationLower,
                  l.accelerationUpper);
        }
        move(arm.state, arm.chosen, arm.tick_s);
        remember();
    }
}

/** Sorted figures with a name. */
void print(const char* name, std::vector<double> x) {
    if (x.empty()) return;
    std::sort(x.begin(), x.end());
    const auto at = [&](double p) {
        return x[static_cast<std::size_t>(p * static_cast<double>(x.size() - 1))];
    };
    std::printf("  %-52s median %.4g, 99 %% %.4g, worst %.4g\n", name, at(0.5), at(0.99), at(1.0));
}

/** For states from which the fastest stop in continuous time keeps the limits: is there one on the grid, and what does
it cost? */
void checkStops(Random& random, Run& run) {
    std::vector<double> timeRatio, delay, distanceRatio, edge;
    std::int64_t none = 0;
    const double ticks[] = {1e-4, 1e-3, 4e-3, 1e-2};
    while (run.done < run.steps) {
        ++run.arms;
        const double dt = ticks[random.integer(0, 3)];
        const AxisLimits l = drawLimits(random, dt);
        BrakingCertificate certificate;
        certificate.configure(l, dt, 1.0);
        for (int k = 0; k < 20; ++k) {
            const AxisState s{random.uniform(l.positionLower, l.positionUpper),
                              random.uniform(l.velocityLower, l.velocityUpper),
                              random.uniform(l.accelerationLower, l.accelerationUpper)};
            const double peak = calcVelocityPeak(s.v, s.a, l);
            const StationaryStop fastest = calcStationaryStop(s.v, s.a, l);
            const double end = s.p + fastest.displacement;
            const TickRange first(s, fastest.jerk, fastest.T1);
            if (peak > l.velocityUpper || peak < l.velocityLower || end > l.positionUpper ||
                end < l.positionLower || first.p[1] > l.positionUpper ||
                first.p[0] < l.positionLower)
                continue;
            ++run.done;
            certificate.reset(s);
            const double T = fastest.T1 + fastest.T2 + fastest.T3;
            if (certificate.findExcess().limit != LimitKind::None) {
                ++none;
                const double travel = std::abs(s.v) * dt + std::abs(s.a) * dt * dt / 2.0 +
                                      l.jerkUpper * dt * dt * dt / 6.0;
                const double room =
                    certificate.findExcess().limit == LimitKind::Position
                        ? std::min(l.positionUpper - end, end - l.positionLower) / travel
                        : std::min(l.velocityUpper - peak, peak - l.velocityLower) /
                              (std::abs(s.a) * dt + l.jerkUpper * dt * dt / 2.0);
                edge.push_back(room);
                continue;
            }
            const double duration = static_cast<double>(certificate.stop().remainingTicks()) * dt;
            delay.push_back((duration - T) / dt);
            if (T > 50.0 * dt) timeRatio.push_back(duration / T);
            AxisState at = s;
            for (int i = 0; i < GridStop::kStretches; ++i) {
                const GridStop::Stretch stretch = certificate.stop().remaining(i);
                at = advance(at, stretch.jerk, static_cast<double>(stretch.ticks) * dt);
            }
            if (T > 50.0 * dt && std::abs(fastest.displacement) > 0.1 * std::abs(s.v) * T)
                distanceRatio.push_back((at.p - s.p) / fastest.displacement);
        }
    }
    std::printf(
        "stops on the grid against the fastest in continuous time, %lld viable states, seed %llu\n",
        static_cast<long long>(run.done), static_cast<unsigned long long>(run.seed));
    print("longer by [ticks]", delay);
    print("time ratio (stops of 50 ticks and more)", timeRatio);
    print("distance ratio (the same)", distanceRatio);
    std::printf("  no stop found for %lld states, a share of %.2g (goal 0)\n",
                static_cast<long long>(none),
                static_cast<double>(none) / static_cast<double>(run.done));
    print("their distance from the edge [travel of one tick]", edge);
    // What a regression would look like: many such states, or some well inside.
    const bool rare = static_cast<double>(none) <= 2e-4 * static_cast<double>(run.done);
    const bool atEdge = edge.empty() || *std::max_element(edge.begin(), edge.end()) < 0.1;
    if (!rare || !atEdge) ++run.violations;
}

}  // namespace

}  // namespace viable

int main(int argc, char** argv) {
    using namespace viable;
    CLI::App app{"Property tests of certified braking"};
    std::string property;
    Run run{20'000'000, 1};
    app.add_option("property", property)
        ->required()
        ->check(CLI::IsMember({"limits", "recovery", "changing_limits", "stops"}));
    app.add_option("--steps", run.steps, "Joint steps (joints times ticks)")
        ->check(CLI::PositiveNumber);
    app.add_option("--seed", run.seed, "Seed of everything random");
    CLI11_PARSE(app, argc, argv);

    Random random(run.seed);
    if (property == "stops") {
        run.steps = std::min<std::int64_t>(run.steps, 1'000'000);
        checkStops(random, run);
        return run.violations == 0 ? 0 : 1;
    }
    while (run.done < run.steps) {
        ++run.arms;
        if (property == "limits")
            checkLimits(random, run);
        else
            checkReturn(random, run, property == "changing_limits");
    }
    std::printf(
        "%s: seed %llu, %lld joint steps on %lld arms, %lld violations, %lld ticks passed "
        "unchanged\n",
        property.c_str(), static_cast<unsigned long long>(run.seed),
        static_cast<long long>(run.done), static_cast<long long>(run.arms),
        static_cast<long long>(run.violations), static_cast<long long>(run.passed));
    if (property == "limits")
        std::printf(
            "missed ticks %lld; worst beyond a limit (relative): position %.2Lg, velocity %.2Lg, "
            "acceleration %.2Lg, jerk %.2Lg\n",
            static_cast<long long>(run.skipped), run.position.use, run.velocity.use,
            run.acceleration.use, run.jerk.use);
    else
        std::printf("ticks on the way back %lld\n", static_cast<long long>(run.returning));
    return run.violations == 0 ? 0 : 1;
}
