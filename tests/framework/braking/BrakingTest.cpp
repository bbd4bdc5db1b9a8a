#include "viable/braking/Braking.h"

#include <gtest/gtest.h>

#include <type_traits>

#include "MotionTestSupport.h"

namespace viable {
namespace {

StationaryStop calcStop(const StationaryStop*, double v, double a, const AxisLimits& l) {
    return calcStationaryStop(v, a, l);
}
VelocityZeroingStop calcStop(const VelocityZeroingStop*, double v, double a, const AxisLimits& l) {
    return calcVelocityZeroingStop(v, a, l);
}

/** The state at the end of the stop, its phases followed one by one. */
AxisState followStop(const AxisState& s, const StationaryStop& stop, const AxisLimits& l) {
    const AxisState s1 = advance(s, stop.jerk, stop.T1);
    const AxisState s2 = advance(s1, 0.0, stop.T2);
    return advance(s2, stop.side == LimitSide::Upper ? l.jerkUpper : l.jerkLower, stop.T3);
}
AxisState followStop(const AxisState& s, const VelocityZeroingStop& stop, const AxisLimits&) {
    return advance(advance(s, stop.jerk, stop.T1), 0.0, stop.T2);
}

double getEndAcceleration(const StationaryStop&) {
    return 0.0;
}
double getEndAcceleration(const VelocityZeroingStop& stop) {
    return stop.endAcceleration;
}

AxisLimits mirror(const AxisLimits& l) {
    return makeLimits(l.accelerationUpper, -l.accelerationLower, l.jerkUpper, -l.jerkLower);
}

/** An acceleration within the limits and a velocity, on either side of V = A^2 / J. */
AxisState drawState(std::mt19937_64& random, const AxisLimits& l) {
    AxisState s;
    s.a = drawUniform(random, l.accelerationLower, l.accelerationUpper);
    s.v = drawUniform(random, -5, 5);
    return s;
}

/** What holds for both policies. */
template <class Stop>
struct BrakingPolicy : ::testing::Test {
    static Stop calc(double v, double a, const AxisLimits& l) {
        return calcStop(static_cast<const Stop*>(nullptr), v, a, l);
    }
    std::mt19937_64 random_{1};
};
using Policies = ::testing::Types<StationaryStop, VelocityZeroingStop>;
struct PolicyNames {
    template <class Stop>
    static std::string GetName(int) {
        return std::is_same_v<Stop, StationaryStop> ? "stationary" : "velocity_zeroing";
    }
};
TYPED_TEST_SUITE(BrakingPolicy, Policies, PolicyNames);

TYPED_TEST(BrakingPolicy, EndsWhereItSaysWithinTheLimits) {
    int types[4] = {};
    for (int k = 0; k < 200000; ++k) {
        const AxisLimits l = drawLimits(this->random_);
        const AxisState s = drawState(this->random_, l);
        const TypeParam stop = this->calc(s.v, s.a, l);
        ++types[static_cast<int>(stop.type())];
        ASSERT_GE(stop.T1, 0.0);
        ASSERT_GE(stop.T2, 0.0);
        ASSERT_EQ(stop.jerk, stop.side == LimitSide::Upper ? l.jerkLower : l.jerkUpper);
        const AxisState end = followStop(s, stop, l);
        const double scale = 1.0 + std::abs(stop.displacement) + std::abs(s.v) + std::abs(s.a);
        ASSERT_NEAR(end.v, 0.0, 1e-11 * scale) << "v " << s.v << " a " << s.a;
        ASSERT_NEAR(end.a, getEndAcceleration(stop), 1e-11 * scale);
        ASSERT_NEAR(end.p, stop.displacement, 1e-11 * scale * (1.0 + stop.gradientV));
        const double a1 = s.a + stop.jerk * stop.T1;
        ASSERT_GE(a1, l.accelerationLower - 1e-9);
        ASSERT_LE(a1, l.accelerationUpper + 1e-9);
        if (stop.cruises) {
            const bool upper = stop.side == LimitSide::Upper;
            ASSERT_NEAR(a1, upper ? l.accelerationLower : l.accelerationUpper, 1e-11 * scale);
        }
    }
    for (int count : types) EXPECT_GT(count, 10000);  // both sides of V = A^2 / J were met
}

/** The displacement once more by some 1e6 small steps, which know the policy only as a rule for the
jerk; limits such that the shortest phase is many of them. */
TYPED_TEST(BrakingPolicy, DisplacementAgreesWithFineIntegrationOfItsRule) {
    for (int k = 0; k < 50; ++k) {
        const AxisLimits l = makeLimits(drawLog(this->random_, 1, 10), drawLog(this->random_, 1, 10),
                                        drawLog(this->random_, 5, 100), drawLog(this->random_, 5, 100));
        const AxisState start = drawState(this->random_, l);
        const TypeParam stop = this->calc(start.v, start.a, l);
        const bool upper = stop.side == LimitSide::Upper;
        const double limit = upper ? l.accelerationLower : l.accelerationUpper;
        const double back = upper ? l.jerkUpper : l.jerkLower, sign = upper ? 1.0 : -1.0;
        const double h = stop.gradientV * 1e-6;
        AxisState s = start;
        double travelled = 0.0;
        for (int i = 0; i < 4000000 && (sign * s.v > 0.0 || sign * s.a > 0.0); ++i) {
            // Recovering to a = 0 begins when it just uses up the velocity that is left.
            const bool returns = std::is_same_v<TypeParam, StationaryStop> && sign * s.a < 0.0 &&
                                 sign * s.v <= s.a * s.a / (2.0 * std::abs(back));
            const double toLimit = (limit - s.a) / h;
            const double braking = upper ? std::max(stop.jerk, toLimit) : std::min(stop.jerk, toLimit);
            travelled += std::abs(s.v) * h;
            s = advance(s, returns ? back : braking, h);
        }
        ASSERT_NEAR(s.p, stop.displacement, 1e-4 * travelled) << "v " << start.v << " a " << start.a;
    }
}

TYPED_TEST(BrakingPolicy, GradientsMatchFiniteDifferencesAndTheIdentityOfThePolicy) {
    int compared = 0;
    for (int k = 0; k < 50000; ++k) {
        const AxisLimits l = drawLimits(this->random_);
        AxisState s = drawState(this->random_, l);
        s.a *= 0.9;
        const TypeParam stop = this->calc(s.v, s.a, l);
        // Braking at full jerk leaves the stop position where it is.
        const double scale = std::abs(s.v) + std::abs(stop.gradientV * s.a) + std::abs(stop.gradientA * stop.jerk);
        ASSERT_NEAR(s.v + stop.gradientV * s.a + stop.gradientA * stop.jerk, 0.0, 1e-10 * scale);
        const double h = 1e-6;
        const TypeParam stops[] = {this->calc(s.v + h, s.a, l), this->calc(s.v - h, s.a, l),
                                   this->calc(s.v, s.a + h, l), this->calc(s.v, s.a - h, l)};
        bool sameType = true;
        for (const TypeParam& other : stops) sameType &= other.type() == stop.type();
        const double w = std::abs(s.a + stop.jerk * stop.T1);  // curvature grows as 1 / w
        if (!sameType || stop.T1 < 1e-3 || w < 1e-2 * std::abs(stop.jerk)) continue;
        ++compared;
        const double dv = (stops[0].displacement - stops[1].displacement) / (2 * h);
        const double da = (stops[2].displacement - stops[3].displacement) / (2 * h);
        ASSERT_NEAR(dv, stop.gradientV, 1e-5 * (1.0 + stop.gradientV));
        ASSERT_NEAR(da, stop.gradientA, 1e-5 * (1.0 + stop.gradientA));
    }
    EXPECT_GT(compared, 25000);
}

/** Optimality: whatever jerk and acceleration the limits allow, the stop position never comes nearer;
so no other way of braking stops shorter. */
TYPED_TEST(BrakingPolicy, NothingAdmissibleStopsShorter) {
    for (int k = 0; k < 20000; ++k) {
        const AxisLimits l = drawLimits(this->random_);
        AxisState s = drawState(this->random_, l);
        const TypeParam first = this->calc(s.v, s.a, l);
        const double sign = first.side == LimitSide::Upper ? 1.0 : -1.0, h = (first.T1 + first.T2) / 50.0;
        double stop = sign * first.displacement;
        for (int i = 0; i < 50; ++i) {
            // Bang-bang half of the time, so that sequences near the optimum are among them.
            const double lower = std::max(l.jerkLower, (l.accelerationLower - s.a) / h);
            const double upper = std::min(l.jerkUpper, (l.accelerationUpper - s.a) / h);
            const double u = drawUniform(this->random_, 0.0, 1.0);
            const double share = this->random_() % 2 ? u : std::round(u);
            s = advance(s, lower + share * (upper - lower), h);
            const TypeParam next = this->calc(s.v, s.a, l);
            if (next.side != first.side || sign * s.v < 0.0) break;
            const double nextStop = sign * (s.p + next.displacement);
            ASSERT_GE(nextStop, stop - 1e-11 * (1.0 + std::abs(stop) + std::abs(first.displacement)))
                << "problem " << k << " step " << i;
            stop = nextStop;
        }
    }
}

TYPED_TEST(BrakingPolicy, MirroredStatesAndLimitsGiveTheMirrorImage) {
    for (int k = 0; k < 50000; ++k) {
        const AxisLimits l = drawLimits(this->random_);
        const AxisState s = drawState(this->random_, l);
        const TypeParam stop = this->calc(s.v, s.a, l), image = this->calc(-s.v, -s.a, mirror(l));
        ASSERT_NE(image.side, stop.side);
        ASSERT_EQ(image.cruises, stop.cruises);
        ASSERT_EQ(image.T1, stop.T1);
        ASSERT_EQ(image.T2, stop.T2);
        ASSERT_EQ(image.jerk, -stop.jerk);
        ASSERT_EQ(image.displacement, -stop.displacement);
        ASSERT_EQ(image.gradientV, stop.gradientV);
        ASSERT_EQ(image.gradientA, stop.gradientA);
        ASSERT_EQ(getEndAcceleration(image), -getEndAcceleration(stop));
    }
}

TYPED_TEST(BrakingPolicy, WorksWithoutAnAccelerationLimit) {
    const AxisLimits l = makeLimits(kInfinity, kInfinity, 10, 10);
    const TypeParam stop = this->calc(100.0, 0.0, l);
    EXPECT_EQ(stop.type(), BrakingType::III);
    EXPECT_NEAR(followStop({0, 100.0, 0}, stop, l).v, 0.0, 1e-10);
}

TYPED_TEST(BrakingPolicy, AtRestItIsEmpty) {
    const TypeParam stop = this->calc(0.0, 0.0, makeLimits(3, 2, 20, 10));
    EXPECT_EQ(stop.displacement, 0.0);
    EXPECT_EQ(stop.T1, 0.0);
    EXPECT_EQ(stop.T2, 0.0);
    EXPECT_EQ(stop.gradientV, 0.0);
    EXPECT_EQ(stop.gradientA, 0.0);
}

TYPED_TEST(BrakingPolicy, BeyondTheAccelerationLimitTheFirstPhaseIsLeftOut) {
    const TypeParam stop = this->calc(1.0, -4.0, makeLimits(3, 2, 20, 10));
    EXPECT_EQ(stop.type(), BrakingType::IV);
    EXPECT_EQ(stop.T1, 0.0);
    EXPECT_GT(stop.T2, 0.0);
}

/** Both sides of a switching curve, one unit in the last place apart. */
template <class Stop>
void expectSameStop(const Stop& one, const Stop& other) {
    EXPECT_NEAR(one.displacement, other.displacement, 1e-9 * std::abs(one.displacement));
    for (const Stop& stop : {one, other})
        EXPECT_TRUE(std::isfinite(stop.displacement) && std::isfinite(stop.gradientV) &&
                    std::isfinite(stop.gradientA) && std::isfinite(stop.T1) && std::isfinite(stop.T2));
}

/** The velocity at which type III becomes IV for this acceleration: a1 = -Ad. */
double calcCruiseVelocity(const StationaryStop*, double a, double Ad, double Jd, double Ju) {
    return Ad * Ad * (Jd + Ju) / (2.0 * Jd * Ju) - a * a / (2.0 * Jd);
}
double calcCruiseVelocity(const VelocityZeroingStop*, double a, double Ad, double Jd, double) {
    return (Ad * Ad - a * a) / (2.0 * Jd);
}

template <class Stop>
class Fault15 : public BrakingPolicy<Stop> {};
TYPED_TEST_SUITE(Fault15, Policies, PolicyNames);

TYPED_TEST(Fault15, NothingJumpsWhereTheCruiseBegins) {
    int changes = 0;
    for (int k = 0; k < 20000; ++k) {
        const AxisLimits l = drawLimits(this->random_);
        const double a = drawUniform(this->random_, 0.99 * l.accelerationLower, l.accelerationUpper);
        const double v = calcCruiseVelocity(static_cast<const TypeParam*>(nullptr), a, -l.accelerationLower,
                                            -l.jerkLower, l.jerkUpper);
        const TypeParam below = this->calc(std::nextafter(v, -kInfinity), a, l);
        const TypeParam above = this->calc(std::nextafter(v, kInfinity), a, l);
        if (below.side != LimitSide::Upper || above.side != LimitSide::Upper) continue;
        changes += below.type() != above.type();
        expectSameStop(below, above);
        EXPECT_NEAR(below.gradientV, above.gradientV, 1e-6 * above.gradientV);
        expectSameStop(this->calc(-std::nextafter(v, -kInfinity), -a, mirror(l)),
                       this->calc(-std::nextafter(v, kInfinity), -a, mirror(l)));
        if (this->HasFailure()) FAIL() << "limits " << k;
    }
    EXPECT_GT(changes, 5000);
}

/** The velocity at which sigma = 0. */
double calcCurveVelocity(double a, const AxisLimits& l) {
    return -a * std::abs(a) / (2.0 * (a > 0.0 ? -l.jerkLower : l.jerkUpper));
}

TEST(Fault15StationaryStop, DisplacementDoesNotJumpWhereTheSideChanges) {
    std::mt19937_64 random(15);
    int changes = 0;
    for (int k = 0; k < 20000; ++k) {
        const AxisLimits l = drawLimits(random);
        const double a = drawUniform(random, l.accelerationLower, l.accelerationUpper);
        const double v = calcCurveVelocity(a, l);
        const StationaryStop above = calcStationaryStop(std::nextafter(v, kInfinity), a, l);
        const StationaryStop below = calcStationaryStop(std::nextafter(v, -kInfinity), a, l);
        changes += above.side != below.side;
        expectSameStop(below, above);
        if (::testing::Test::HasFailure()) FAIL() << "limits " << k << " a " << a;
    }
    EXPECT_GT(changes, 15000);
}

/** Here the policy itself jumps: on one side of sigma = 0 the joint brakes through v = 0, on the other
it comes to v = 0 with a = 0. Each side must be the limit of its own formula. */
TEST(Fault15VelocityZeroingStop, WhereTheSideChangesEachSideKeepsItsOwnLimit) {
    std::mt19937_64 random(16);
    for (int k = 0; k < 20000; ++k) {
        const AxisLimits l = drawLimits(random);
        const double a = drawUniform(random, l.accelerationLower, 0.0), v = calcCurveVelocity(a, l);
        const double Jd = -l.jerkLower, Ju = l.jerkUpper;
        // sigma < 0: +Ju to v = a = 0.
        const VelocityZeroingStop below = calcVelocityZeroingStop(v * (1.0 - 1e-15), a, l);
        ASSERT_EQ(below.side, LimitSide::Lower);
        ASSERT_NEAR(below.displacement, -a * a * a / (6.0 * Ju * Ju), 1e-9 * below.displacement);
        ASSERT_NEAR(below.endAcceleration, 0.0, 1e-6 * std::abs(a));
        // sigma > 0: -Jd to v = 0, unless the limit is met before.
        const VelocityZeroingStop above = calcVelocityZeroingStop(v * (1.0 + 1e-15), a, l);
        ASSERT_EQ(above.side, LimitSide::Upper);
        if (above.cruises) continue;
        const double w = -a * std::sqrt(1.0 + Jd / Ju), T = (w + a) / Jd;
        const AxisState end = advance({0.0, v, a}, -Jd, T);
        ASSERT_NEAR(above.displacement, end.p, 1e-9 * end.p + 1e-13 * std::abs(v * a / Jd));
        ASSERT_NEAR(above.endAcceleration, -w, 1e-9 * w);
    }
}

TEST(StationaryStop, SymmetricLimitsGiveTheTypesOfTableOne) {
    const double A = 2.0, J = 10.0;
    const AxisLimits l = makeLimits(A, A, J, J);
    // Type III: T1 = (a + sqrt((a^2 + 2 J v) / 2)) / J, T3 = sqrt(...) / J.
    const StationaryStop three = calcStationaryStop(0.1, 0.5, l);
    const double w = std::sqrt((0.25 + 2 * J * 0.1) / 2);
    EXPECT_EQ(three.type(), BrakingType::III);
    EXPECT_NEAR(three.T1, (0.5 + w) / J, 1e-14);
    EXPECT_EQ(three.T2, 0.0);
    EXPECT_NEAR(three.T3, w / J, 1e-14);
    // Type IV exactly when sqrt((a^2 + 2 J v) / 2) > A.
    const double border = (2 * A * A - 0.25) / (2 * J);
    EXPECT_EQ(calcStationaryStop(border * 0.999, 0.5, l).type(), BrakingType::III);
    const StationaryStop four = calcStationaryStop(border * 1.5, 0.5, l);
    EXPECT_EQ(four.type(), BrakingType::IV);
    EXPECT_NEAR(four.T1, (0.5 + A) / J, 1e-14);
    EXPECT_NEAR(four.T2, (border * 1.5 + 0.25 / (2 * J) - A * A / J) / A, 1e-14);
    EXPECT_NEAR(four.T3, A / J, 1e-14);
    // Types II and I are the mirror image.
    const StationaryStop two = calcStationaryStop(-0.1, -0.5, l);
    EXPECT_EQ(two.type(), BrakingType::II);
    EXPECT_DOUBLE_EQ(two.displacement, -three.displacement);
    EXPECT_DOUBLE_EQ(two.gradientA, three.gradientA);
    EXPECT_EQ(calcStationaryStop(-border * 1.5, -0.5, l).type(), BrakingType::I);
}

TEST(VelocityZeroingStop, SymmetricLimitsGiveTheTypesOfTableTwo) {
    const double A = 2.0, J = 10.0;
    const AxisLimits l = makeLimits(A, A, J, J);
    // Type III: T1 = (a + sqrt(a^2 + 2 J v)) / J.
    for (double a : {0.5, -0.5, 0.0}) {
        const VelocityZeroingStop three = calcVelocityZeroingStop(0.1, a, l);
        const double w = std::sqrt(a * a + 2 * J * 0.1);
        EXPECT_EQ(three.type(), BrakingType::III);
        EXPECT_NEAR(three.T1, (a + w) / J, 1e-14);
        EXPECT_EQ(three.T2, 0.0);
        EXPECT_NEAR(three.endAcceleration, -w, 1e-14);
        const VelocityZeroingStop two = calcVelocityZeroingStop(-0.1, -a, l);
        EXPECT_EQ(two.type(), BrakingType::II);
        EXPECT_EQ(two.displacement, -three.displacement);
    }
    // Type IV exactly when sqrt(a^2 + 2 J v) > A; T2 = +v1 / A.
    const double border = (A * A - 0.25) / (2 * J);
    EXPECT_EQ(calcVelocityZeroingStop(border * 0.999, 0.5, l).type(), BrakingType::III);
    const VelocityZeroingStop four = calcVelocityZeroingStop(border * 1.5, 0.5, l);
    const double v1 = border * 1.5 + (0.25 - A * A) / (2 * J);
    EXPECT_EQ(four.type(), BrakingType::IV);
    EXPECT_NEAR(four.T1, (0.5 + A) / J, 1e-14);
    EXPECT_NEAR(four.T2, v1 / A, 1e-14);
    EXPECT_EQ(four.endAcceleration, -A);
    EXPECT_EQ(calcVelocityZeroingStop(-border * 1.5, -0.5, l).type(), BrakingType::I);
}

/** With the paper's numbers types I and IV of the stationary policy never occur: V < A^2 / J. */
TEST(StationaryStop, CruisesOnlyBeyondVEqualsASquaredOverJ) {
    const double V = 2 * kPi / 3, A = 4 * kPi;
    for (double J : {12 * kPi, 0.99 * A * A / V, 1.01 * A * A / V}) {
        const AxisLimits l = makeLimits(A, A, J, J);
        EXPECT_EQ(calcStationaryStop(V, 0.0, l).cruises, V > A * A / J);
        EXPECT_EQ(calcStationaryStop(-V, 0.0, l).cruises, V > A * A / J);
    }
}

TEST(VelocityZeroingStop, NeverStopsLaterThanTheStationaryStop) {
    std::mt19937_64 random(2);
    for (int k = 0; k < 50000; ++k) {
        const AxisLimits l = drawLimits(random);
        const AxisState s = drawState(random, l);
        const StationaryStop rest = calcStationaryStop(s.v, s.a, l);
        const VelocityZeroingStop zero = calcVelocityZeroingStop(s.v, s.a, l);
        ASSERT_EQ(rest.side, zero.side);
        ASSERT_LE(zero.T1 + zero.T2, rest.duration() * (1 + 1e-12));
        const double sign = rest.side == LimitSide::Upper ? 1.0 : -1.0;
        ASSERT_LE(sign * zero.displacement, sign * rest.displacement + 1e-12 * (1 + std::abs(rest.displacement)));
    }
}

TEST(Braking, TheLongestStopWithoutAJerkLimitIsAtTheDecelerationLimit) {
    JointLimits limits = JointLimits::unlimited(2);
    EXPECT_EQ(calcLongestStop(limits), 0.0);
    limits.velocity = {JointVector::Constant(2, -2.0), JointVector::Constant(2, 3.0)};
    EXPECT_EQ(calcLongestStop(limits), 0.0);
    limits.acceleration.lower.setConstant(2, -0.5);
    limits.acceleration.upper.setConstant(2, 0.1);
    EXPECT_DOUBLE_EQ(calcLongestStop(limits), 2.0 / 0.1);
    limits.acceleration.upper.setConstant(2, 10.0);
    EXPECT_DOUBLE_EQ(calcLongestStop(limits), 3.0 / 0.5);
    EXPECT_EQ(calcLongestStopTicks(limits, 1e-3), 6001);
    EXPECT_EQ(calcLongestStopTicks(JointLimits::unlimited(2), 1e-3), 1001);
    limits.jerk = {JointVector::Constant(2, -1e9), JointVector::Constant(2, 1e9)};
    EXPECT_NEAR(calcLongestStop(limits), 3.0 / 0.5, 1e-6);
}

}  // namespace
}  // namespace viable
