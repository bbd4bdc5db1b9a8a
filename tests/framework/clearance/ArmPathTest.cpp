#include "clearance/ArmPath.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace viable {
namespace {

constexpr double kTick_s = 1e-3;
constexpr int kJoints = 5;

struct Drawn {
    MotionState start;
    JointVector jerk{kJoints};
    std::array<GridStop, kMaxJoints> stops;
    detail::ArmPath path;
};

/** A moving arm, a jerk for a tick and the stops after it. */
Drawn draw(std::mt19937& random) {
    const AxisLimits limits{-3.0, 3.0, -2.0, 2.0, -9.0, 9.0, -40.0, 40.0};
    std::uniform_real_distribution<double> share(-1.0, 1.0);
    Drawn d;
    for (JointVector* v : {&d.start.q, &d.start.qd, &d.start.qdd}) v->resize(kJoints);
    for (int i = 0; i < kJoints; ++i) {
        AxisState s{share(random), 2.0 * share(random), 9.0 * share(random)};
        if (i == 0) s.v = s.a = 0.0;
        d.start.q[i] = s.p;
        d.start.qd[i] = s.v;
        d.start.qdd[i] = s.a;
        d.jerk[i] = i == 0 ? 0.0 : 40.0 * share(random);
        s = advance(s, d.jerk[i], kTick_s);
        d.stops[static_cast<std::size_t>(i)].plan(s.v, s.a, limits, kTick_s);
    }
    d.path.set(d.start, d.jerk, d.stops, kTick_s);
    return d;
}

// Against the stops taken tick by tick, each tick in fifty parts.
TEST(ArmPath, AgreesWithTheStopsTakenTickByTick) {
    std::mt19937 random(1);
    for (int round = 0; round < 200; ++round) {
        Drawn d = draw(random);
        detail::ArmPath::Extremes extremes;
        d.path.calcExtremes(extremes);
        for (int i = 0; i < kJoints; ++i) {
            AxisState s{d.start.q[i], d.start.qd[i], d.start.qdd[i]};
            GridStop& stop = d.stops[static_cast<std::size_t>(i)];
            double travel = 0.0;
            const double half = d.path.duration() / 2.0;
            double travelToHalf = 0.0;
            for (std::int64_t tick = 0; tick < d.path.ticks(); ++tick) {
                const double jerk = tick == 0 ? d.jerk[i] : stop.popJerk();
                JointVector q, qd, mean;
                d.path.calcTick(tick, q, qd, mean);
                ASSERT_NEAR(q[i], s.p, 1e-12);
                ASSERT_NEAR(qd[i], s.v, 1e-11);
                ASSERT_NEAR(mean[i], s.a + jerk * kTick_s / 2.0, 1e-10);
                for (int k = 0; k < 50; ++k) {
                    const AxisState next = advance(s, jerk, kTick_s / 50.0);
                    travel += std::abs(next.p - s.p);
                    const double t = (static_cast<double>(tick) + (k + 1) / 50.0) * kTick_s;
                    if (t <= half) travelToHalf = travel;
                    s = next;
                    ASSERT_LE(std::abs(s.p), extremes.position[i] + 1e-12);
                    ASSERT_LE(std::abs(s.v), extremes.velocity[i] + 1e-11);
                    ASSERT_LE(std::abs(s.a), extremes.acceleration[i] + 1e-10);
                }
                ASSERT_LE(std::abs(jerk), extremes.jerk[i]);
            }
            EXPECT_NEAR(s.v, 0.0, 1e-10);
            // What turns within a part is travel that the parts do not see: never more, hardly less.
            JointVector end, travelled;
            d.path.calcPositions(half, end, travelled);
            EXPECT_NEAR(travelled[i], travelToHalf, 5e-5);
            d.path.calcPositions(d.path.duration(), end, travelled);
            const double whole = travelled[i];
            EXPECT_EQ(extremes.travel[i], whole);
            EXPECT_GE(whole, travel - 1e-12);
            EXPECT_LE(whole, travel + 1e-6);
            EXPECT_NEAR(end[i], s.p, 1e-11);
        }
    }
}

}  // namespace
}  // namespace viable
