#include "viable/braking/Servo.h"

#include <gtest/gtest.h>

#include <random>

#include "Effort.h"
#include "viable/braking/Braking.h"
#include "viable/braking/GridStop.h"
#include "viable/testing/AllocationCounter.h"

namespace viable::test {
namespace {

/** One joint under a servo. */
class ServedJoint {
public:
    ServedJoint(const AxisLimits& l, double tick_s, const AxisState& start, double share = 1.0)
        : state(start), limits_(l), tick_s_(tick_s) {
        const auto one = [](double x) { return JointVector::Constant(1, x); };
        servo_.configure({{one(l.positionLower), one(l.positionUpper)},
                          {one(l.velocityLower), one(l.velocityUpper)},
                          {one(l.accelerationLower), one(l.accelerationUpper)},
                          {one(l.jerkLower), one(l.jerkUpper)}},
                         tick_s, share);
        servo_.reset({one(start.p), one(start.v), one(start.a)});
    }

    /** A tick towards the target; the jerk that was held. */
    double advance(const AxisState& target) {
        for (JointVector* v : {&state_.q, &state_.qd, &state_.qdd, &target_.q, &target_.qd, &target_.qdd}) v->resize(1);
        state_.q[0] = state.p, state_.qd[0] = state.v, state_.qdd[0] = state.a;
        target_.q[0] = target.p, target_.qd[0] = target.v, target_.qdd[0] = target.a;
        servo_.calc(state_, target_, jerk_);
        const double j = jerk_[0];
        state = viable::advance(state, j, tick_s_);
        // Largest excess, each relative to its limit's size.
        const auto see = [this](double x, double lower, double upper) {
            worst = std::max(worst, std::max(x - upper, lower - x) / std::max({1e-9, -lower, upper}));
        };
        see(state.p, limits_.positionLower, limits_.positionUpper);
        see(state.v, limits_.velocityLower, limits_.velocityUpper);
        see(state.a, limits_.accelerationLower, limits_.accelerationUpper);
        see(j, limits_.jerkLower, limits_.jerkUpper);
        return j;
    }

    AxisState state;
    double worst = -kInfinity;

private:
    AxisLimits limits_;
    double tick_s_;
    Servo servo_;
    MotionState state_, target_;
    JointVector jerk_;
};

/** Limits on both sides of V = A^2 / J, each side its own, and a state that can be stopped within them. */
struct Draw {
    AxisLimits l;
    double tick_s, size;  ///< of the position range [rad]
    AxisState start;

    explicit Draw(std::mt19937_64& random) {
        const auto draw = [&](double low, double high) {
            return low + (high - low) * std::uniform_real_distribution<double>(0.0, 1.0)(random);
        };
        const auto drawPower = [&](double low, double high) { return std::pow(10.0, draw(low, high)); };
        for (;;) {
            tick_s = drawPower(-4.0, -2.4);
            const double V = drawPower(-1.0, 1.0), A = V * drawPower(0.0, 1.5), J = A * A / V * drawPower(-1.0, 1.0);
            if (J * tick_s > 0.3 * A || A * tick_s > 0.3 * V) continue;
            size = drawPower(-1.0, 1.0);
            const auto side = [&](double x) { return x * draw(0.3, 1.0); };
            l = {-side(size), side(size), -side(V), side(V), -side(A), side(A), -side(J), side(J)};
            start = {draw(l.positionLower, l.positionUpper), draw(l.velocityLower, l.velocityUpper),
                     draw(l.accelerationLower, l.accelerationUpper)};
            const StationaryStop stop = calcStationaryStop(start.v, start.a, l);
            const double end = start.p + stop.displacement, peak = calcVelocityPeak(start.v, start.a, l);
            const double room = 0.001 * size;
            if (end < l.positionUpper - room && end > l.positionLower + room && peak < 0.999 * l.velocityUpper &&
                peak > 0.999 * l.velocityLower && start.v < 0.999 * l.velocityUpper &&
                start.v > 0.999 * l.velocityLower && isInside(stop))
                return;
        }
    }

    /** The positions where velocity turns on the way into the stop. */
    bool isInside(const StationaryStop& stop) const {
        AxisState s = start;
        for (int k = 0; k < 200; ++k) {
            s = viable::advance(s, stop.jerk, stop.T1 / 200.0);
            if (s.p > 0.999 * l.positionUpper || s.p < 0.999 * l.positionLower) return false;
        }
        return true;
    }
};

AxisLimits mirror(const AxisLimits& l) {
    return {-l.positionUpper,     -l.positionLower,     -l.velocityUpper, -l.velocityLower,
            -l.accelerationUpper, -l.accelerationLower, -l.jerkUpper,     -l.jerkLower};
}

/** The least time in which a triple integrator goes from `s` to rest at 0, position limits apart: full jerk towards it, up
to the acceleration limit, for as long as the stop then ends at 0; where that would pass the velocity limit, cruise
there. By bisection. */
double calcLeastTime(const AxisState& s, const AxisLimits& l) {
    const StationaryStop now = calcStationaryStop(s.v, s.a, l);
    if (s.p + now.displacement > 0.0) return calcLeastTime({-s.p, -s.v, -s.a}, mirror(l));
    const auto accelerate = [&](double t) {
        const double ramp = std::min(t, std::max(0.0, (l.accelerationUpper - s.a) / l.jerkUpper));
        return advance(advance(s, l.jerkUpper, ramp), 0.0, t - ramp);
    };
    double low = 0.0, high = 1e4;
    for (int k = 0; k < 200; ++k) {
        const double t = 0.5 * (low + high);
        const AxisState x = accelerate(t);
        const bool isFar = x.p + calcStationaryStop(x.v, x.a, l).displacement > 0.0;
        (isFar ? high : low) = t;
    }
    const AxisState x = accelerate(low);
    if (calcVelocityPeak(x.v, x.a, l) <= l.velocityUpper) return low + calcStationaryStop(x.v, x.a, l).duration();
    const double V = l.velocityUpper;
    const StationaryStop to = calcStationaryStop(s.v - V, s.a, l), from = calcStationaryStop(V, 0.0, l);
    const double toTime = to.duration(), left = -(s.p + to.displacement + V * toTime + from.displacement);
    return toTime + left / V + from.duration();
}

/** Where the stop on the grid ends. */
double calcGridEnd(AxisState s, const AxisLimits& l, double tick_s) {
    GridStop stop;
    stop.plan(s.v, s.a, l, tick_s);
    while (!stop.atRest()) s = advance(s, stop.popJerk(), tick_s);
    return s.p;
}

// 1e5 states: VIABLE_EFFORT=50
TEST(Servo, ATargetAtRestIsReachedInTheLeastTimeWithoutOvershootAndHeld) {
    const int count = countOf(2000);
    std::mt19937_64 random(static_cast<std::uint64_t>(getSeed(1)));
    std::vector<double> ratios;
    double worstTicks = -kInfinity, soonest = kInfinity, latest = -kInfinity, worstOvershoot = 0.0, worstRest = 0.0,
           worstExcess = -kInfinity;
    for (int k = 0; k < count; ++k) {
        const Draw draw(random);
        const AxisLimits& l = draw.l;
        const double target =
            std::uniform_real_distribution<double>(0.99 * l.positionLower, 0.99 * l.positionUpper)(random);
        ServedJoint joint(l, draw.tick_s, draw.start);
        const double side =
            draw.start.p + calcStationaryStop(draw.start.v, draw.start.a, l).displacement <= target ? 1.0 : -1.0;
        const double least = calcLeastTime({draw.start.p - target, draw.start.v, draw.start.a}, l);
        const int allowed = static_cast<int>(std::ceil(1.1 * least / draw.tick_s)) + 3;
        // Of 1e5 states one stops before its target in continuous time only, by 1e-6 of the range.
        const bool canStopBefore = side * (calcGridEnd(draw.start, l, draw.tick_s) - target) <= 0.0;
        int arrived = -1;
        bool isOnItsWay = false;  // before that it may have to turn beyond the target
        for (int tick = 0; tick < allowed + 100; ++tick) {
            joint.advance({target, 0.0, 0.0});
            const AxisState& s = joint.state;
            const double e = side * (s.p - target);
            isOnItsWay |= e < 0.0 && side * calcVelocityPeak(s.v, s.a, l) > 0.0;
            if (isOnItsWay && canStopBefore) worstOvershoot = std::max(worstOvershoot, e / draw.size);
            const bool isThere = std::abs(e) <= 1e-12 * draw.size && std::abs(s.v) <= 1e-9 * l.velocityUpper &&
                                 std::abs(s.a) <= 1e-6 * l.accelerationUpper;
            if (!isThere) arrived = -1;
            if (isThere && arrived < 0) arrived = tick + 1;
        }
        ASSERT_GE(arrived, 0) << "state " << k << " does not rest on its target";
        worstRest = std::max(worstRest, std::abs(joint.state.p - target));
        ratios.push_back(arrived * draw.tick_s / std::max(least, draw.tick_s));
        soonest = std::min(soonest, arrived - least / draw.tick_s);
        latest = std::max(latest, arrived - least / draw.tick_s);
        worstTicks = std::max(worstTicks, arrived - 1.1 * least / draw.tick_s);
        worstExcess = std::max(worstExcess, joint.worst);
    }
    std::sort(ratios.begin(), ratios.end());
    std::printf(
        "%d states: time over the least time: median %.5f, p99 %.4f, worst %.4f; ticks longer: at most %.2f; "
        "overshoot %.2g of the range; at rest %.2g rad from the target\n",
        count, ratios[ratios.size() / 2], ratios[ratios.size() * 99 / 100], ratios.back(), latest, worstOvershoot,
        worstRest);
    EXPECT_LE(ratios[ratios.size() / 2], 1.02);
    EXPECT_GE(soonest, -1.0) << "faster than possible: the yardstick is wrong";
    EXPECT_LE(worstTicks, 3.0);
    EXPECT_LE(worstOvershoot, 1e-11);
    EXPECT_LE(worstRest, 1e-12 * 10.0);
    EXPECT_LE(worstExcess, 1e-12);
}

/** A target that keeps the limits: a sine with the given shares of them. */
struct Sine {
    double amplitude, omega;
    AxisState at(double t) const {
        return {amplitude * std::sin(omega * t), amplitude * omega * std::cos(omega * t),
                -amplitude * omega * omega * std::sin(omega * t)};
    }
};

TEST(Servo, AMovingTargetWhoseVelocityAndAccelerationAreKnownIsFollowedWithoutError) {
    const AxisLimits l{-3.0, 3.0, -2.1, 2.1, -12.6, 12.6, -37.7, 37.7};
    for (const double share : {0.3, 0.6, 1.0})
        for (const double omega : {1.0, 2.0, 3.0}) {
            const Sine sine{0.5, omega};
            ServedJoint joint(l, 1e-3, {-0.5, 0.0, 0.0}, share);
            double worst = 0.0;
            for (int tick = 0; tick < 10000; ++tick) {
                const double t = 1e-3 * tick;
                if (tick > 4000) worst = std::max(worst, std::abs(joint.state.p - sine.at(t).p));
                joint.advance(sine.at(t));
            }
            EXPECT_LE(worst, 1e-9) << "share " << share << ", " << omega << " rad/s";
            EXPECT_LE(joint.worst, 1e-12);
        }
}

// What a target does that tells less, or asks for too much, costs accuracy and never a limit.
TEST(Servo, KeepsAllLimitsWhateverTheTargetDoes) {
    std::mt19937_64 random(static_cast<std::uint64_t>(getSeed(3)));
    double worst = -kInfinity;
    for (int k = 0; k < countOf(300); ++k) {
        const Draw draw(random);
        const double share = std::uniform_real_distribution<double>(0.1, 1.0)(random);
        ServedJoint joint(draw.l, draw.tick_s, draw.start, share);
        std::normal_distribution<double> noise;
        AxisState target{};
        for (int tick = 0; tick < 3000; ++tick) {
            if (random() % 50 == 0)
                target = {draw.size * noise(random), draw.l.velocityUpper * noise(random),
                          draw.l.accelerationUpper * noise(random)};
            if (random() % 5 == 0) target.p += 0.01 * draw.size * noise(random);
            if (random() % 3 == 0) target.a *= -1.0;
            joint.advance(target);
        }
        worst = std::max(worst, joint.worst);
    }
    EXPECT_LE(worst, 1e-12);
}

TEST(Servo, TakesNoMemoryInItsTicks) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const AxisLimits l{-3.0, 3.0, -2.1, 2.1, -12.6, 12.6, -37.7, 37.7};
    ServedJoint joint(l, 1e-3, {-0.5, 0.0, 0.0}, 0.6);
    joint.advance({});
    const testing::AllocationCounter counter;
    for (int tick = 0; tick < countOf(1000000); ++tick) joint.advance({tick % 3000 < 1500 ? 1.0 : -4.0, 0.0, 0.0});
    EXPECT_EQ(counter.count(), 0);
}

/** One joint, V = 2, whose stop from it lasts half a second. */
class Believed {
public:
    Believed() {
        const auto both = [](double x) {
            return JointBounds{JointVector::Constant(1, -x), JointVector::Constant(1, x)};
        };
        velocity_.configure({both(kInfinity), both(2.0), both(12.0), both(40.0)}, 1e-3);
    }
    double calc(double q) { return velocity_.calc(JointVector::Constant(1, q))[0]; }

private:
    TargetVelocity velocity_;
};

TEST(TargetVelocity, AnEvenMotionIsBelievedSoonAndAStandstillAtOnce) {
    for (const double speed : {0.3, -1.8}) {
        Believed velocity;
        double seen = 0.0;
        for (int k = 0; k <= 3000; ++k) seen = velocity.calc(1e-3 * speed * k);
        EXPECT_NEAR(seen, speed, 1e-3);
        EXPECT_EQ(velocity.calc(3.0 * speed), 0.0);
    }
}

TEST(TargetVelocity, GrowsNoFasterThanAShareOfTheStop) {
    Believed velocity;
    double last = 0.0, most = 0.0;
    for (int k = 0; k < 500; ++k) {
        const double now = velocity.calc(2e-3 * k);  // the limit, at once
        most = std::max(most, now - last);
        last = now;
    }
    const AxisLimits l{-kInfinity, kInfinity, -2.0, 2.0, -12.0, 12.0, -40.0, 40.0};
    EXPECT_NEAR(most, 0.5 * 2.0 / calcStationaryStop(2.0, 0.0, l).duration() * 1e-3, 1e-9);
}

TEST(TargetVelocity, JumpsHardlyCountAndDoNotHideAnEvenMotion) {
    Believed velocity;
    EXPECT_EQ(velocity.calc(0.0), 0.0);
    EXPECT_LT(std::abs(velocity.calc(5.0)), 0.02);
    for (int k = 0; k < 2000; ++k) EXPECT_LT(std::abs(velocity.calc(k % 2)), 0.05);
    // 0.9 V, and in every third of a tenth of a second 1.5 V: the catching up after late samples.
    double q = 0.0, sum = 0.0;
    for (int k = 0; k < 6000; ++k) {
        q += 1e-3 * (k % 33 < 10 ? 3.0 : k % 33 < 23 ? 1.8 : 0.876);
        const double now = velocity.calc(q);
        if (k >= 3000) sum += now / 3000.0;
    }
    EXPECT_GT(sum, 0.7 * 1.8);  // slower at once, faster slowly: a little less
}

}  // namespace
}  // namespace viable::test
