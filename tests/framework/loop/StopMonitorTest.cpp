#include "loop/StopMonitor.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <iostream>
#include <random>

#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;
constexpr unsigned kSeed = 20260721;

JointLimits makeLimits(int n, double P = 1.0, double V = 2.0, double A = 10.0, double J = 40.0) {
    const auto bounds = [&](double x) {
        return JointBounds{JointVector::Constant(n, -x), JointVector::Constant(n, x)};
    };
    return {bounds(P), bounds(V), bounds(A), bounds(J)};
}

MotionState makeState(double q, double qd, double qdd, int n = 1) {
    return {JointVector::Constant(n, q), JointVector::Constant(n, qd), JointVector::Constant(n, qdd)};
}

FilterDecision makeJerk(const MotionState& s, double jerk) {
    FilterDecision d;
    d.holdJerk(JointVector::Constant(s.q.size(), jerk));
    return d;
}

FilterDecision makeAcceleration(const MotionState& s, double x) {
    FilterDecision d;
    d.holdAcceleration(JointVector::Constant(s.q.size(), x));
    return d;
}

/** The decision with the stop that GridStop plans within `axis`. */
FilterDecision makeWithStops(const MotionState& s, double jerk, const AxisLimits& axis) {
    FilterDecision d = makeJerk(s, jerk);
    const AxisState next = advance({s.q[0], s.qd[0], s.qdd[0]}, jerk, kTick_s);
    for (int i = 0; i < s.q.size(); ++i) d.stops[i].plan(next.v, next.a, axis, kTick_s);
    d.hasStops = true;
    return d;
}

/** Extremes of tick and stop at many points. */
struct Sampled {
    double p[2]{kInfinity, -kInfinity}, v[2]{kInfinity, -kInfinity}, a[2]{kInfinity, -kInfinity},
        j[2]{kInfinity, -kInfinity};
    AxisState at;

    static void include(double (&range)[2], double x) {
        range[0] = std::min(range[0], x);
        range[1] = std::max(range[1], x);
    }
    void follow(double jerk, double seconds) {
        constexpr int kPoints = 2000;
        include(j, jerk);
        const AxisState begin = at;
        for (int k = 0; k <= kPoints; ++k) {
            at = advance(begin, jerk, seconds * k / kPoints);
            include(p, at.p), include(v, at.v), include(a, at.a);
        }
    }
};

Sampled samplePath(const MotionState& s, const FilterDecision& d) {
    Sampled sampled;
    sampled.at = {s.q[0], s.qd[0], s.qdd[0]};
    sampled.follow(d.value[0], kTick_s);
    for (int k = 0; k < GridStop::kSegments; ++k)
        if (d.stops[0].remaining(k).ticks > 0)
            sampled.follow(d.stops[0].remaining(k).jerk, static_cast<double>(d.stops[0].remaining(k).ticks) * kTick_s);
    return sampled;
}

/** A monitor at rest in the middle: its own bounds are the limits. */
StopMonitor makeMonitor(const JointLimits& limits, bool guaranteed = true) {
    StopMonitor monitor;
    const int n = limits.size();
    monitor.reset(makeState(0, 0, 0, n), limits, kTick_s, guaranteed, true);
    const MotionState rest = makeState(0, 0, 0, n);
    monitor.examine(rest, makeJerk(rest, 0.0));
    monitor.accept();
    return monitor;
}

TEST(StopMonitor, AgreesWithThePathAtManyPoints) {
    std::mt19937 random(kSeed);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    const JointLimits limits = makeLimits(1);
    const AxisLimits axis = limits.axis(0);
    int safe = 0, unsafe = 0;
    double worstMargin = 0.0;
    for (int k = 0; k < 3000; ++k) {
        SCOPED_TRACE("seed " + std::to_string(kSeed) + ", state " + std::to_string(k));
        const MotionState s = makeState(unit(random), 2.0 * unit(random), 10.0 * unit(random));
        AxisLimits planned = axis;  // sometimes wider than what the monitor allows
        const double more = std::exp(0.7 * unit(random));
        for (double* x :
             {&planned.accelerationLower, &planned.accelerationUpper, &planned.jerkLower, &planned.jerkUpper})
            *x *= more;
        const FilterDecision d = makeWithStops(s, 40.0 * unit(random), planned);
        StopMonitor monitor = makeMonitor(limits);
        const StopMonitor::Violation& violation = monitor.examine(s, d);
        const Sampled x = samplePath(s, d);
        const double share = std::max({x.p[1], -x.p[0], std::max(x.v[1], -x.v[0]) / 2.0,
                                       std::max(x.a[1], -x.a[0]) / 10.0, std::max(x.j[1], -x.j[0]) / 40.0});
        if (share > 1.0 + 2.0 * kMonitorShare) {
            ++unsafe;
            ASSERT_EQ(violation.verdict, StopVerdict::NoStop) << share;
            ASSERT_EQ(violation.fault, StopMonitor::Fault::Limit);
        } else if (share < 1.0 - 1e-5) {  // 2000 points miss an extreme by less
            ++safe;
            ASSERT_EQ(violation.verdict, StopVerdict::Safe) << share;
        }
        const double margin = std::min(1.0 - x.p[1], x.p[0] + 1.0);
        worstMargin = std::max(worstMargin, std::abs(monitor.stop(0).margin - margin));
        // Both fall short of the extreme: the samples by less than 5e-7, the monitor by 1e-6 of the range.
        ASSERT_NEAR(monitor.stop(0).margin, margin, 1e-6);
        ASSERT_NEAR(monitor.stop(0).duration_s, static_cast<double>(d.stops[0].remainingTicks()) * kTick_s, 1e-12);
        ASSERT_NEAR(monitor.stop(0).rest, x.at.p, 1e-12);
    }
    EXPECT_GT(safe, 300);
    EXPECT_GT(unsafe, 300);
    std::cout << "safe " << safe << ", unsafe " << unsafe << ", margin differs by " << worstMargin << " rad at most\n";
}

RobotDescription makeElbow(JointType type = JointType::Revolute) {
    RobotDescription robot;
    robot.joints.resize(1);
    robot.joints[0].name = "elbow";
    robot.joints[0].type = type;
    return robot;
}

TEST(StopMonitor, NamesJointLimitSideAndExcess) {
    const JointLimits limits = makeLimits(1);
    const MotionState rest = makeState(0, 0, 0);
    StopMonitor monitor = makeMonitor(limits);
    StopMonitor::Violation f = monitor.examine(rest, makeJerk(rest, -50.0));
    EXPECT_EQ(f.verdict, StopVerdict::NoStop);
    EXPECT_EQ(f.limit, LimitKind::Jerk);
    EXPECT_EQ(f.side, LimitSide::Lower);
    EXPECT_NEAR(f.excess, 10.0, 1e-9);
    char text[200];
    monitor.describe(f, makeElbow(), text, sizeof text);
    EXPECT_STREQ(text, "elbow would pass its lower jerk limit by 10 rad/s^3 in this tick or the stop after it");
    monitor.describe(f, makeElbow(JointType::Prismatic), text, sizeof text);
    EXPECT_NE(std::string(text).find("by 10 m/s^3"), std::string::npos) << text;

    const MotionState fast = makeState(0.9, 1.5, 0.0);
    f = monitor.examine(fast, makeJerk(fast, -40.0));
    EXPECT_EQ(f.limit, LimitKind::Position);
    EXPECT_EQ(f.side, LimitSide::Upper);
    EXPECT_EQ(f.joint, 0);

    FilterDecision d = makeJerk(fast, 0.0);
    d.hasStops = true;  // no tick at all
    f = makeMonitor(limits).examine(fast, d);
    EXPECT_EQ(f.fault, StopMonitor::Fault::Moving);
    EXPECT_EQ(f.verdict, StopVerdict::NoStop);
    EXPECT_NEAR(f.excess, 1.5, 1e-12);
    monitor.describe(f, makeElbow(), text, sizeof text);
    EXPECT_STREQ(text, "elbow would not be at rest at the end of its stop (velocity 1.5 rad/s)");
}

TEST(StopMonitor, ReplacesOnlyTheFalseWitnessOfAFilterWithoutGuarantee) {
    const MotionState moving = makeState(0, 0.2, 0.0);
    FilterDecision d = makeJerk(moving, 0.0);
    d.hasStops = true;
    EXPECT_EQ(makeMonitor(makeLimits(1), true).examine(moving, d).verdict, StopVerdict::NoStop);
    EXPECT_EQ(makeMonitor(makeLimits(1), false).examine(moving, d).verdict, StopVerdict::Safe);
}

TEST(StopMonitor, WhatIsBeyondALimitMayNotGetWorseAndComesBackForGood) {
    const JointLimits limits = makeLimits(1);
    StopMonitor monitor;
    MotionState s = makeState(1.1, 0.0, 0.0);
    monitor.reset(s, limits, kTick_s, true, true);
    EXPECT_EQ(monitor.examine(s, makeJerk(s, 0.0)).verdict, StopVerdict::Recovering);
    EXPECT_NEAR(monitor.stop(0).margin, -0.1, 1e-12);
    EXPECT_EQ(monitor.examine(s, makeJerk(s, 40.0)).verdict, StopVerdict::NoStop);
    monitor.examine(s, makeJerk(s, 40.0));
    char text[200];
    monitor.describe(monitor.examine(s, makeJerk(s, 40.0)), makeElbow(), text, sizeof text);
    EXPECT_NE(std::string(text).find("compared with the stop before"), std::string::npos) << text;

    // Back inside under a law with poles at -5, every decision accepted.
    int recovering = 0;
    for (int k = 0; k < 4000; ++k) {
        const double jerk = std::max(-40.0, std::min(40.0, 125.0 * (0.9 - s.q[0]) - 75.0 * s.qd[0] - 15.0 * s.qdd[0]));
        const FilterDecision d = makeJerk(s, jerk);
        const StopVerdict verdict = monitor.examine(s, d).verdict;
        ASSERT_NE(verdict, StopVerdict::NoStop) << "tick " << k;
        recovering += verdict == StopVerdict::Recovering;
        monitor.accept();
        const AxisState next = advance({s.q[0], s.qd[0], s.qdd[0]}, jerk, kTick_s);
        s = makeState(next.p, next.v, next.a);
    }
    EXPECT_GT(recovering, 100);
    EXPECT_LT(recovering, 1500);
    const MotionState before = makeState(1.1, 0.0, 0.0);
    EXPECT_EQ(monitor.examine(before, makeJerk(before, 0.0)).verdict, StopVerdict::NoStop);
}

TEST(StopMonitor, LimitsThatShrinkAreReplacedByTheStopHeldReady) {
    StopMonitor monitor = makeMonitor(makeLimits(1));
    const MotionState s = makeState(0.5, 1.0, 0.0);
    ASSERT_EQ(monitor.examine(s, makeJerk(s, 0.0)).verdict, StopVerdict::Safe);
    monitor.accept();
    const AxisState next = advance({0.5, 1.0, 0.0}, 0.0, kTick_s);
    MotionState now = makeState(next.p, next.v, next.a);
    monitor.changeLimits(makeLimits(1, 0.3, 0.5, 10.0, 40.0), now);
    EXPECT_EQ(monitor.examine(now, makeJerk(now, 40.0)).verdict, StopVerdict::NoStop);
    FilterDecision d;
    Dynamics dynamics;
    dynamics.M.setIdentity(1, 1);
    dynamics.b.setZero(1);
    double last = kInfinity;
    for (int k = 0; k < 2000 && !monitor.atRest(now); ++k) {
        ASSERT_EQ(monitor.followStop(now, d).verdict, StopVerdict::Recovering);
        ASSERT_LE(-monitor.stop(0).margin, last + 1e-12);
        last = -monitor.stop(0).margin;
        const AxisState to = advance({now.q[0], now.qd[0], now.qdd[0]}, d.value[0], kTick_s);
        now = makeState(to.p, to.v, to.a);
    }
    EXPECT_TRUE(monitor.atRest(now));
    EXPECT_NEAR(now.qd[0], 0.0, 1e-12);
}

TEST(StopMonitor, HeldAccelerationsAreStoppedByTheAccelerationLimit) {
    const JointLimits limits = makeLimits(1, 1.0, 2.0, 10.0, 40.0);
    StopMonitor monitor = makeMonitor(limits, false);
    // v^2 / (2 A) = 0.05: inside from 0.94, beyond from 0.96. A jump of acceleration is not judged.
    for (const auto& [q, verdict] : {std::pair{0.94, StopVerdict::Safe}, std::pair{0.96, StopVerdict::NoStop}}) {
        const MotionState s = makeState(q, 1.0, 0.0);
        EXPECT_EQ(monitor.examine(s, makeAcceleration(s, -10.0)).verdict, verdict) << q;
        EXPECT_NEAR(monitor.stop(0).margin, 1.0 - q - 0.05, 1e-5);
        EXPECT_NEAR(monitor.stop(0).duration_s, 0.1, 1.5e-3);
    }
    // A guarantee covers acceleration and jerk as well.
    const MotionState s = makeState(0.0, 0.0, 0.0);
    EXPECT_EQ(makeMonitor(limits, true).examine(s, makeAcceleration(s, 10.0)).limit, LimitKind::Jerk);
}

TEST(StopMonitor, JudgesWhatLimitsThereAre) {
    StopMonitor monitor = makeMonitor(JointLimits::unlimited(1));
    const MotionState s = makeState(1e3, 1e3, 1e3);
    EXPECT_EQ(monitor.examine(s, makeJerk(s, 1e5)).verdict, StopVerdict::Safe);
    EXPECT_EQ(monitor.stop(0).margin, kInfinity);
    JointLimits noJerk = makeLimits(1);
    noJerk.jerk = JointLimits::unlimited(1).jerk;
    StopMonitor other = makeMonitor(noJerk);
    const MotionState near = makeState(0.96, 1.0, 0.0);
    EXPECT_EQ(other.examine(near, makeJerk(near, 0.0)).limit, LimitKind::Position);
}

TEST(StopMonitor, CostsLittleAndAllocatesNothing) {
    const JointLimits limits = makeLimits(6);
    std::mt19937 random(kSeed);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    std::vector<MotionState> states;
    std::vector<FilterDecision> decisions[2];
    for (int k = 0; k < 500; ++k) {
        states.push_back(makeState(0.3 * unit(random), 0.5 * unit(random), 2.0 * unit(random), 6));
        const double jerk = 30.0 * unit(random);
        decisions[0].push_back(makeWithStops(states.back(), jerk, limits.axis(0)));
        decisions[1].push_back(makeJerk(states.back(), jerk));
    }
    for (int kind = 0; kind < 2; ++kind) {
        StopMonitor monitor = makeMonitor(limits);
        double best = kInfinity;
        const testing::AllocationCounter counter;
        for (int round = 0; round < 50; ++round) {
            const auto begin = std::chrono::steady_clock::now();
            for (std::size_t k = 0; k < states.size(); ++k) {
                monitor.examine(states[k], decisions[kind][k]);
                monitor.accept();
            }
            const std::chrono::duration<double, std::micro> time = std::chrono::steady_clock::now() - begin;
            best = std::min(best, time.count() / static_cast<double>(states.size()));
        }
        std::cout << (kind == 0 ? "with" : "without") << " a witness, six joints: " << best << " us per decision\n";
        if (!testing::AllocationCounter::isAvailable()) continue;  // a sanitizer's times say nothing either
        EXPECT_EQ(counter.count(), 0);
        EXPECT_LT(best, 100.0);
    }
}

}  // namespace
}  // namespace viable
