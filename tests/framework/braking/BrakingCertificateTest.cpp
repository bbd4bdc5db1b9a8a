#include "braking/BrakingCertificate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "viable/braking/Braking.h"

namespace viable {
namespace {

/** What counts as rounding beyond a limit, relative to max(1, limit). */
constexpr double kAllowed = 1e-12;
/** Outside by no more than this, relative, counts as rounding that has added up: the stop then aims at the limit itself,
so that the two bounds may cross by as much. */
constexpr double kDrift = 1e-11;

AxisLimits makeSymmetric(double P, double V, double A, double J) {
    return {-P, P, -V, V, -A, A, -J, J};
}

/** The paper's single joint (26). */
const AxisLimits kPaper = makeSymmetric(kPi, 2 * kPi, 3 * kPi, 4 * kPi);
const AxisLimits kAsymmetric = {-2.0, kPi, -5.0, 4.0, -7.0, 11.0, -9.0, 14.0};
/** V > A^2 / J on both sides: stops cruise. */
const AxisLimits kCruising = {-3.0, 4.0, -3.0, 2.5, -3.0, 2.0, -40.0, 30.0};

/** Least and largest values on a way, looked at four times a tick and where it turns. */
struct Extent {
    AxisState least, largest;

    explicit Extent(const AxisState& s) : least(s), largest(s) {}

    void see(const AxisState& s) {
        least = {std::min(least.p, s.p), std::min(least.v, s.v), std::min(least.a, s.a)};
        largest = {std::max(largest.p, s.p), std::max(largest.v, s.v), std::max(largest.a, s.a)};
    }
    void seeTick(const AxisState& s, double jerk, double tick_s) {
        for (int i = 1; i <= 4; ++i) see(advance(s, jerk, tick_s * i / 4.0));
        const double root = std::sqrt(std::max(0.0, s.a * s.a - 2.0 * jerk * s.v));
        for (const double turn : {(-s.a - root) / jerk, (-s.a + root) / jerk})
            if (turn > 0.0 && turn < tick_s) see(advance(s, jerk, turn));
    }
};

Extent followStop(AxisState s, GridStop stop, double tick_s) {
    Extent extent(s);
    while (!stop.atRest()) {
        const double jerk = stop.popJerk();
        extent.seeTick(s, jerk, tick_s);
        s = advance(s, jerk, tick_s);
    }
    return extent;
}

double calcBeyond(double least, double largest, double lower, double upper) {
    const double size = std::max({1.0, std::isfinite(lower) ? -lower : 0.0, std::isfinite(upper) ? upper : 0.0});
    return std::max(largest - upper, lower - least) / size;
}

/** How far the way lies outside the limits, relative to max(1, limit); negative: inside. */
double calcExcess(const Extent& e, const AxisLimits& l) {
    return std::max({calcBeyond(e.least.p, e.largest.p, l.positionLower, l.positionUpper),
                     calcBeyond(e.least.v, e.largest.v, l.velocityLower, l.velocityUpper),
                     calcBeyond(e.least.a, e.largest.a, l.accelerationLower, l.accelerationUpper)});
}

AxisLimits widen(AxisLimits l, const Extent& e) {
    l.positionLower = std::min(l.positionLower, e.least.p);
    l.positionUpper = std::max(l.positionUpper, e.largest.p);
    l.velocityLower = std::min(l.velocityLower, e.least.v);
    l.velocityUpper = std::max(l.velocityUpper, e.largest.v);
    l.accelerationLower = std::min(l.accelerationLower, e.least.a);
    l.accelerationUpper = std::max(l.accelerationUpper, e.largest.a);
    return l;
}

/** A joint under its certificate, asked for a jerk in each tick. */
struct Joint {
    AxisLimits limits;
    double tick_s;
    BrakingCertificate certificate;
    AxisState s;
    double worst = -kInfinity;

    Joint(const AxisLimits& l, double tick, const AxisState& start, double approach = 1.0)
        : limits(l), tick_s(tick), s(start) {
        certificate.configure(l, tick, approach);
        certificate.reset(start);
    }

    /** The jerk that was taken. */
    double tick(double wanted) {
        certificate.beginTick(s);
        const double jerk =
            certificate.commit(certificate.isAdmissible(wanted) ? wanted : certificate.findBound(wanted).jerk);
        Extent path(s);
        path.seeTick(s, jerk, tick_s);
        worst = std::max(worst, calcExcess(path, limits));
        EXPECT_GE(jerk, limits.jerkLower);
        EXPECT_LE(jerk, limits.jerkUpper);
        s = advance(s, jerk, tick_s);
        return jerk;
    }
};

/** The paper's law (24) with (14): jerk towards k_p (target - p) - k_d v. */
class PaperLaw {
public:
    PaperLaw(double target, double gamma) : target_(target), gamma_(gamma) {}
    double want(const AxisState& s, double tick_s) {
        const double aim = 5.0 * (target_ - s.p) - s.v;
        const double jerk = (hasLast_ ? aim - last_ : 0.0) / tick_s - gamma_ * (s.a - aim);
        last_ = aim;
        hasLast_ = true;
        return jerk;
    }

private:
    double target_, gamma_, last_ = 0.0;
    bool hasLast_ = false;
};

constexpr double kTicks[] = {1e-4, 1e-3, 4e-3};

struct Rest {
    double jerk = 0.0;  ///< largest share of the jerk limit in the last 5 of 10 s
    double overshoot = -kInfinity;
};

template <class Want>
Rest runTenSeconds(Joint& joint, Want want) {
    Rest rest;
    const int ticks = static_cast<int>(std::lround(10.0 / joint.tick_s));
    const double J = std::min(joint.limits.jerkUpper, -joint.limits.jerkLower);
    for (int k = 0; k < ticks; ++k) {
        const double jerk = joint.tick(want());
        if (2 * k >= ticks) rest.jerk = std::max(rest.jerk, std::abs(jerk) / J);
    }
    rest.overshoot = joint.worst;
    return rest;
}

// MATH 5, Fig. 6: pushed for ever into a position limit.
TEST(BrakingCertificate, RestsOnAPositionLimitWithoutChatter) {
    for (const AxisLimits& limits : {kPaper, kAsymmetric, kCruising})
        for (const double tick_s : kTicks)
            for (const double side : {1.0, -1.0}) {
                Joint joint(limits, tick_s, {});
                PaperLaw law(side * 2.0 * kPi, 100.0);
                const Rest rest = runTenSeconds(joint, [&] { return law.want(joint.s, tick_s); });
                std::printf("  P %.3g, tick %.1g ms: jerk at rest %.2g of J, beyond %.2g\n",
                            side > 0 ? limits.positionUpper : limits.positionLower, tick_s * 1e3, rest.jerk,
                            rest.overshoot);
                EXPECT_LT(rest.jerk, 1e-3);
                EXPECT_LT(rest.overshoot, 1e-12);
                EXPECT_NEAR(joint.s.p, side > 0 ? limits.positionUpper : limits.positionLower, 1e-6);
            }
}

TEST(BrakingCertificate, RidesAVelocityLimitWithoutChatter) {
    for (AxisLimits limits : {kPaper, kAsymmetric, kCruising}) {
        limits.positionLower = -kInfinity;
        limits.positionUpper = kInfinity;
        for (const double tick_s : kTicks)
            for (const double side : {1.0, -1.0}) {
                Joint joint(limits, tick_s, {});
                const Rest rest = runTenSeconds(joint, [&] { return side * 1e3; });
                const double V = side > 0 ? limits.velocityUpper : limits.velocityLower;
                std::printf("  V %.3g, tick %.1g ms: jerk at the limit %.2g of J, beyond %.2g\n", V, tick_s * 1e3,
                            rest.jerk, rest.overshoot);
                EXPECT_LT(rest.jerk, 1e-3);
                EXPECT_LT(rest.overshoot, 1e-12);
                EXPECT_NEAR(joint.s.v, V, 1e-9 * std::abs(V));
            }
    }
}

TEST(BrakingCertificate, WhatItAdmitsIsTakenBitForBitAndWhatItRefusesIsNot) {
    const unsigned seed = 11;
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937_64 random(seed);
    int admitted = 0, refused = 0;
    Joint joint(kAsymmetric, 1e-3, {});
    std::uniform_real_distribution<double> number(-20.0, 20.0);
    double wanted = 0.0;
    for (int k = 0; k < 100000; ++k) {
        if (k % 37 == 0) wanted = number(random);
        joint.certificate.beginTick(joint.s);
        const double stored = joint.certificate.storedJerk();
        const bool admits = joint.certificate.isAdmissible(wanted);
        const double jerk = joint.certificate.commit(wanted);
        ASSERT_EQ(jerk, admits ? wanted : stored);
        joint.s = advance(joint.s, jerk, joint.tick_s);
        (admits ? admitted : refused) += 1;
    }
    EXPECT_GT(admitted, 10000);
    EXPECT_GT(refused, 1000);
}

TEST(BrakingCertificate, AfterATickItsStopEndsAtRestWithinTheLimits) {
    const unsigned seed = 12;
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> share(-1.5, 1.5);
    for (const AxisLimits& limits : {kPaper, kAsymmetric, kCruising}) {
        Joint joint(limits, 4e-3, {});
        double wanted = 0.0;
        for (int k = 0; k < 20000; ++k) {
            if (k % 101 == 0) wanted = share(random) * limits.jerkUpper;
            joint.tick(wanted);
            if (k % 20 != 0) continue;
            const GridStop& stop = joint.certificate.stop();
            ASSERT_LE(calcExcess(followStop(joint.s, stop, joint.tick_s), limits), kAllowed) << "tick " << k;
            AxisState end = joint.s;
            for (GridStop s = stop; !s.atRest();) end = advance(end, s.popJerk(), joint.tick_s);
            ASSERT_NEAR(end.v, 0.0, 1e-11);
            ASSERT_NEAR(end.a, 0.0, 1e-11);
        }
    }
}

/** Largest jerk of a joint that is pushed from rest on its limit, in the first `ticks` ticks. */
double calcLargestJerk(Joint& joint, double wanted, int ticks) {
    double largest = 0.0;
    for (int k = 0; k < ticks; ++k) largest = std::max(largest, std::abs(joint.tick(wanted)));
    return largest;
}

TEST(Fault14, AtRestOnALimitPushedOutwardsItNeverMoves) {
    for (const double tick_s : kTicks)
        for (AxisLimits l : {kPaper, kAsymmetric}) {
            const double range = 8.0 * std::max(l.jerkUpper, -l.jerkLower) * std::pow(tick_s, 3);
            l.positionUpper = l.positionLower + range;
            for (const double side : {1.0, -1.0}) {
                Joint joint(l, tick_s, {side > 0 ? l.positionUpper : l.positionLower, 0.0, 0.0});
                ASSERT_EQ(joint.certificate.findExcess().limit, LimitKind::None);
                // Far below the catalogue's bound on chatter, J dt: nothing but rounding of p.
                EXPECT_LE(calcLargestJerk(joint, side * 1e6, 100000), l.jerkUpper * tick_s);
                EXPECT_LE(joint.worst, kAllowed);
            }
        }
}

TEST(Fault14, BetweenNearlyEqualLimitsItGoesToTheOtherOneAndRestsThere) {
    for (const double tick_s : kTicks)
        for (AxisLimits l : {kPaper, kAsymmetric}) {
            const double range = 8.0 * std::max(l.jerkUpper, -l.jerkLower) * std::pow(tick_s, 3);
            l.positionUpper = l.positionLower + range;
            Joint joint(l, tick_s, {l.positionLower, 0.0, 0.0});
            EXPECT_GT(calcLargestJerk(joint, 1e6, 1000), 0.0);  // there is room for a move
            EXPECT_LE(calcLargestJerk(joint, 1e6, 100000), 1e-3 * l.jerkUpper);
            // The smallest range is 1e-10 rad: there rounding of p counts.
            EXPECT_NEAR(joint.s.p, l.positionUpper, std::max(1e-3 * range, kAllowed));
            for (int k = 0; k < 100000; ++k) joint.tick(k / 7 % 2 ? 1e6 : -1e6);
            EXPECT_LE(joint.worst, kAllowed);
        }
}

/** Decisions from three neighbouring states, pushed both ways. */
void expectSameDecisions(const AxisLimits& limits, double tick_s, const AxisState& s) {
    const auto decide = [&](double v, double wanted) {
        Joint joint(limits, tick_s, {s.p, v, s.a});
        joint.certificate.beginTick(joint.s);
        const double jerk = joint.certificate.findBound(wanted).jerk;
        EXPECT_TRUE(joint.certificate.isAdmissible(jerk));
        return jerk;
    };
    for (const double wanted : {1e6, -1e6}) {
        const double jerk = decide(s.v, wanted);
        ASSERT_TRUE(std::isfinite(jerk));
        for (const double v : {std::nextafter(s.v, kInfinity), std::nextafter(s.v, -kInfinity)})
            EXPECT_NEAR(decide(v, wanted), jerk, 1e-9 * limits.jerkUpper)
                << "p " << s.p << " v " << s.v << " a " << s.a << " tick " << tick_s << " wanted " << wanted;
    }
}

// sigma = v + a |a| / (2 J) = 0: where the stop changes its side.
TEST(Fault15, OnTheCurveBetweenTypesIIAndIIIOneUlpChangesNothing) {
    for (const double tick_s : kTicks)
        for (const double a : {-6.0, -1.7, -0.01, 0.3, 2.5, 6.0}) {
            const double v = -a * std::abs(a) / (2.0 * kPaper.jerkUpper);
            expectSameDecisions(kPaper, tick_s, {0.0, v, a});
            const double way = calcStationaryStop(v, a, kPaper).displacement;
            const double tight = std::copysign(kPaper.positionUpper - std::abs(way) - 1e-4, way);
            expectSameDecisions(kPaper, tick_s, {tight, v, a});
        }
}

// (a^2 + 2 J v) / 2 = A^2: where the stop begins to cruise.
TEST(Fault15, OnTheCurveBetweenTypesIIIAndIVOneUlpChangesNothing) {
    const AxisLimits limits = makeSymmetric(4.0, 3.0, 2.0, 20.0);
    for (const double tick_s : kTicks)
        for (const double a : {-1.5, -0.2, 0.0, 0.7, 1.9}) {
            const double v = (2.0 * 4.0 - a * a) / (2.0 * 20.0);
            expectSameDecisions(limits, tick_s, {0.0, v, a});
            const double stop = calcStationaryStop(v, a, limits).displacement;
            expectSameDecisions(limits, tick_s, {4.0 - stop - 1e-3, v, a});
        }
}

TEST(Fault33, StatesOnTheLimitsByAHairLeaveAChoice) {
    const double hairs[] = {-1e-12, -1e-15, 0.0, 1e-15, 1e-12};
    for (const AxisLimits& l : {kPaper, kAsymmetric, kCruising})
        for (const double tick_s : kTicks)
            for (const double hair : hairs)
                for (const AxisState& s :
                     {AxisState{l.positionUpper + hair, 0.0, 0.0}, AxisState{l.positionLower + hair, 0.0, 0.0},
                      AxisState{0.0, l.velocityUpper + hair, 0.0}, AxisState{0.0, l.velocityLower + hair, 0.0},
                      AxisState{0.0, 0.0, l.accelerationUpper + hair}, AxisState{0.0, 0.0, l.accelerationLower + hair},
                      AxisState{l.positionUpper + hair, -1.0, l.accelerationLower + hair},
                      AxisState{l.positionUpper, hair, hair}}) {
                    Joint joint(l, tick_s, s);
                    const AxisLimits allowed = widen(l, followStop(s, joint.certificate.stop(), tick_s));
                    for (int k = 0; k < 200; ++k) {
                        joint.certificate.beginTick(joint.s);
                        const double most = joint.certificate.findBound(1e6).jerk;
                        const double least = joint.certificate.findBound(-1e6).jerk;
                        ASSERT_LE(least, most + kDrift * l.jerkUpper);
                        ASSERT_GE(most, l.jerkLower);
                        ASSERT_LE(least, l.jerkUpper);
                        Extent path(joint.s);
                        const double jerk = joint.certificate.commit(least);
                        path.seeTick(joint.s, jerk, tick_s);
                        ASSERT_LE(calcExcess(path, allowed), kAllowed);
                        joint.s = advance(joint.s, jerk, tick_s);
                    }
                }
}

// The discrete barrier: a tick uses up at most this share of what is left.
TEST(BrakingCertificate, TheStopApproachesItsLimitAtMostByTheShareOfATick) {
    for (const AxisLimits& limits : {kPaper, kAsymmetric, kCruising})
        for (const double tick_s : {1e-3, 4e-3})
            for (const double share : {5.0 * tick_s, 20.0 * tick_s, 0.5}) {
                Joint joint(limits, tick_s, {}, share);
                double room = limits.positionUpper;
                for (int k = 0; k < 3000; ++k) {
                    joint.tick(1e3);
                    const double left =
                        limits.positionUpper - followStop(joint.s, joint.certificate.stop(), tick_s).largest.p;
                    ASSERT_GE(left, (1.0 - share) * room - kAllowed) << "tick " << k;
                    room = left;
                }
                EXPECT_LT(room, 0.1 * limits.positionUpper);  // it did come near
                EXPECT_LE(joint.worst, kAllowed);
            }
}

TEST(BrakingCertificate, ASmallShareHoldsBackEarlierThanAFullOne) {
    const auto calcWay = [](double share) {
        Joint joint(kPaper, 1e-3, {}, share);
        for (int k = 0; k < 1500; ++k) joint.tick(1e3);
        return joint.s.p;
    };
    EXPECT_LT(calcWay(0.001), calcWay(0.005));
    EXPECT_LT(calcWay(0.005), calcWay(1.0) - 1e-3);
}

TEST(Fault38, ConflictsAreNamedInTheOrderAccelerationJerkPositionVelocity) {
    const auto find = [](const AxisState& s) {
        BrakingCertificate certificate;
        certificate.configure(kPaper, 1e-3, 1.0);
        certificate.reset(s);
        return certificate.findExcess();
    };
    const double P = kPaper.positionUpper, V = kPaper.velocityUpper, A = kPaper.accelerationUpper;
    PassedLimit excess = find({P + 0.5, V + 0.5, A + 0.5});
    EXPECT_EQ(excess.limit, LimitKind::Acceleration);
    EXPECT_EQ(excess.side, LimitSide::Upper);
    EXPECT_NEAR(excess.excess, 0.5, 1e-9);
    excess = find({-P - 0.5, -V - 0.5, 0.0});
    EXPECT_EQ(excess.limit, LimitKind::Position);
    EXPECT_EQ(excess.side, LimitSide::Lower);
    EXPECT_GT(excess.excess, 0.5);
    excess = find({0.0, V + 0.5, 0.0});
    EXPECT_EQ(excess.limit,
              LimitKind::Position);  // not the velocity, although only it is passed yet
    EXPECT_EQ(excess.side, LimitSide::Upper);
    AxisLimits wide = kPaper;
    wide.positionUpper = kInfinity;
    BrakingCertificate certificate;
    certificate.configure(wide, 1e-3, 1.0);
    certificate.reset({0.0, V + 0.5, 0.0});
    EXPECT_EQ(certificate.findExcess().limit, LimitKind::Velocity);
    EXPECT_NEAR(certificate.findExcess().excess, 0.5, 1e-9);

    // Jerk limits that shrink under a stop: the stop's jerk comes before the position it leads to.
    certificate.configure(kPaper, 1e-3, 1.0);
    certificate.reset({0.0, 0.5 * V, 0.0});
    AxisLimits gentle = kPaper;
    gentle.jerkLower *= 0.25, gentle.positionUpper = 1e-3;
    certificate.changeLimits(gentle);
    certificate.beginTick({0.0, 0.5 * V, 0.0});
    EXPECT_EQ(certificate.findExcess().limit, LimitKind::Jerk);
    EXPECT_EQ(certificate.findExcess().side, LimitSide::Lower);
}

/** The jerks of a joint that is greedy from rest towards a velocity limit, from when it reaches it within 1e-3. */
std::vector<double> calcJerksAtVelocityLimit(double tick_s, double approach) {
    AxisLimits limits = kPaper;
    limits.positionUpper = kInfinity;
    BrakingCertificate certificate;
    certificate.configure(limits, tick_s, approach);
    AxisState s;
    certificate.reset(s);
    std::vector<double> jerks;
    for (int k = 0; k < 4'000'000 && jerks.size() < 2000; ++k) {
        certificate.beginTick(s);
        const double jerk = certificate.commit(certificate.findBound(1e6).jerk);
        s = advance(s, jerk, tick_s);
        if (s.v > (1.0 - 1e-3) * limits.velocityUpper) jerks.push_back(jerk);
    }
    return jerks;
}

TEST(BrakingCertificate, GreedyAtTheVelocityLimitItDoesNotRing) {
    for (const double tick_s : {1e-4, 1e-3, 4e-3})
        for (const double approach : {1.0, 5.0 * tick_s}) {
            SCOPED_TRACE(std::to_string(tick_s) + " s, share " + std::to_string(approach));
            const std::vector<double> jerks = calcJerksAtVelocityLimit(tick_s, approach);
            ASSERT_EQ(jerks.size(), 2000u);
            // Braking to the limit its jerk has one sign; at the limit there is none left.
            for (std::size_t k = 0; k < jerks.size(); ++k) ASSERT_LE(jerks[k], 1e-6 * kPaper.jerkUpper) << k;
            if (approach < 1.0) continue;
            for (std::size_t k = 1000; k < jerks.size(); ++k)
                ASSERT_LE(std::abs(jerks[k]), 1e-9 * kPaper.jerkUpper) << k;
        }
}

TEST(BrakingCertificate, RidingThePositionBarrierTheJerkIsSmooth) {
    // Greedy towards a position limit under the discrete barrier: the jerk that the grid allows follows the one of
    // continuous time, instead of leaping by what rounding to whole ticks costs.
    constexpr double kTick_s = 1e-3;
    BrakingCertificate certificate;
    certificate.configure(kPaper, kTick_s, 5.0 * kTick_s);
    AxisState s{0.0, 0.2, 0.0};
    certificate.reset(s);
    double before = 0.0, sumOfSquares = 0.0;
    int ticks = 0;
    for (int k = 0; k < 1500; ++k) {
        certificate.beginTick(s);
        const BrakingCertificate::Bound bound = certificate.findBound(1e6);
        const double jerk = certificate.commit(bound.jerk);
        if (bound.limit == LimitKind::Position) {
            sumOfSquares += ticks > 0 ? (jerk - before) * (jerk - before) : 0.0;
            ++ticks;
            before = jerk;
        }
        s = advance(s, jerk, kTick_s);
    }
    ASSERT_GT(ticks, 500);
    const double rms = std::sqrt(sumOfSquares / ticks);
    RecordProperty("rms_jerk_step_of_limit", std::to_string(rms / kPaper.jerkUpper));
    EXPECT_LT(rms, 0.02 * kPaper.jerkUpper);
}

}  // namespace
}  // namespace viable
