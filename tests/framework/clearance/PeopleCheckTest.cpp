#include "clearance/PeopleCheck.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "DrawnPath.h"
#include "SlidingArm.h"
#include "limits/SeparationLimit.h"

namespace viable {
namespace {

using detail::ArmPath;
using detail::PeopleCheck;
using detail::PeopleWatch;

constexpr double kTick_s = 1e-3;

Person makePerson(double maxSpeed, double latency_s, double error_m, double contactSpeed) {
    Person person;
    person.name = "ann";
    person.maxSpeed = maxSpeed;
    person.latency_s = latency_s;
    person.error_m = error_m;
    person.contactSpeed = contactSpeed;
    return person;
}

PeopleObservation see(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius, double stamp_s) {
    static std::int64_t version = 0;
    PeopleObservation seen;
    PersonObservation& one = seen.people[0];
    one.kind = PersonObservation::Kind::Seen;
    one.stamp_s = stamp_s;
    one.count = 1;
    one.capsules[0] = {a, b, radius};
    seen.version = ++version;
    return seen;
}
PeopleObservation seeBall(double x, double stamp_s) {
    return see({x, 0, 0}, {x, 0, 0}, 0.1, stamp_s);
}
PeopleObservation tell(PersonObservation::Kind kind, double stamp_s = 0.0) {
    PeopleObservation told = seeBall(0.0, stamp_s);
    told.people[0].kind = kind;
    return told;
}

TEST(PeopleWatch, TellsWhoIsWhereNobodyWasExpected) {
    PeopleWatch watch({makePerson(1.0, 0.1, 0.02, 0.0)});
    EXPECT_TRUE(watch.take({}, 0.0));
    EXPECT_FALSE(watch.known()[0].isKnown);
    EXPECT_FALSE(watch.take(seeBall(2.0, 0.5), 0.5)) << "nobody was known of";
    EXPECT_EQ(watch.faults().appeared, 1);
    const PeopleWatch::Known& ann = watch.known()[0];
    EXPECT_DOUBLE_EQ(ann.bodies[0].radius, 0.12) << "with the error";
    EXPECT_DOUBLE_EQ(ann.calcGrowth(0.5), 0.1) << "latency at 1 m/s";
    EXPECT_DOUBLE_EQ(ann.calcGrowth(1.5), 1.1);
    // In 0.1 s: 0.1 m, as much by the latency, and the error twice.
    EXPECT_TRUE(watch.take(seeBall(1.77, 0.6), 0.6));
    EXPECT_EQ(watch.faults().faster, 0);
    EXPECT_FALSE(watch.take(seeBall(1.52, 0.7), 0.7));
    EXPECT_EQ(watch.faults().faster, 1);
    EXPECT_EQ(watch.faults().last, 0);
    EXPECT_DOUBLE_EQ(watch.known()[0].bodies[0].a.x(), 1.52) << "taken all the same";
    EXPECT_DOUBLE_EQ(watch.age_s(0.9), 0.2);

    EXPECT_FALSE(watch.take(see({1.5, 0, 0}, {1.5, 0, 0.9}, 0.1, 0.8), 0.8)) << "it has become longer";
    EXPECT_FALSE(watch.take(see({1.5, 0, 0}, {1.5, 0, 0.9}, 0.5, 0.9), 0.9)) << "and thicker";
    EXPECT_TRUE(watch.take(see({1.5, 0, 0}, {1.5, 0, 0.8}, 0.4, 1.0), 1.0)) << "smaller";
}

TEST(PeopleWatch, WhoIsLostMayBeAnywhereByAndBy) {
    PeopleWatch watch({makePerson(1.0, 0.0, 0.0, 0.0)});
    watch.take(seeBall(2.0, 0.0), 0.0);
    EXPECT_EQ(watch.faults().appeared, 0) << "there from the start on";
    PeopleObservation none = tell(PersonObservation::Kind::Unseen);
    EXPECT_TRUE(watch.take(none, 0.1));
    const std::int64_t version = none.version;
    none = tell(PersonObservation::Kind::Unseen);
    EXPECT_GT(none.version, version);
    EXPECT_TRUE(watch.take(none, 0.2));
    EXPECT_EQ(watch.faults().lost, 1) << "once";
    EXPECT_TRUE(watch.known()[0].isKnown);
    EXPECT_DOUBLE_EQ(watch.known()[0].calcGrowth(1.0), 1.0);
    EXPECT_TRUE(watch.take(seeBall(1.2, 1.0), 1.0)) << "as far as it can have come";
    EXPECT_TRUE(watch.take(tell(PersonObservation::Kind::Gone), 1.1));
    EXPECT_TRUE(watch.known()[0].isKnown) << "from before the last observation";
    EXPECT_TRUE(watch.take(tell(PersonObservation::Kind::Gone, 1.05), 1.1));
    EXPECT_FALSE(watch.known()[0].isKnown);
    EXPECT_EQ(watch.faults().lost, 1);
}

// From one observation to the next latency and error hide any speed; from one to a later one they do not.
TEST(PeopleWatch, WhoIsFasterThanStatedIsFoundAtAnyRate) {
    constexpr double kStated = 1.6, kLatency_s = 0.05, kError_m = 0.02;
    const auto countFaster = [&](double speed, double period_s, std::uint64_t seed) {
        std::mt19937 random(static_cast<std::uint32_t>(seed));
        std::uniform_real_distribution<double> uniform(0.0, 1.0);
        PeopleWatch watch({makePerson(kStated, kLatency_s, kError_m, 0.0)});
        for (double t = 0.0; t < 3.0; t += period_s) {
            const double seen_s = t - kLatency_s * uniform(random), wrong_m = kError_m * (2.0 * uniform(random) - 1.0);
            watch.take(seeBall(20.0 - speed * seen_s + wrong_m, t), t);
        }
        return watch.faults().faster;
    };
    for (const double period_s : {0.001, 0.033, 0.2}) {
        for (std::uint64_t seed = 1; seed <= 20; ++seed)
            EXPECT_EQ(countFaster(kStated, period_s, seed), 0) << period_s << " s, seed " << seed;
        EXPECT_GT(countFaster(2.5, period_s, 1), 3) << period_s;
    }
}

TEST(PeopleWatch, SomebodyUnknownWhoCannotBeToldBlindsUntilHeCan) {
    PeopleWatch watch({makePerson(1.0, 0.0, 0.0, 0.0)});
    watch.take(seeBall(2.0, 0.9), 0.1);  // from a clock that is ahead
    EXPECT_TRUE(watch.isBlind());
    watch.take(seeBall(2.0, 0.2), 0.2);
    EXPECT_FALSE(watch.isBlind());
    watch.reset();
    PeopleObservation refused = seeBall(2.0, 0.5);
    refused.people[0].kind = PersonObservation::Kind::Unseen;
    refused.refused = refused.people[0].refused = 1;  // by the feed
    refused.lastRefused = 0;
    watch.take(refused, 0.5);
    EXPECT_TRUE(watch.isBlind());
    PeopleObservation gone = tell(PersonObservation::Kind::Gone, 0.6);
    gone.refused = gone.people[0].refused = 1;
    gone.people[0].stamp_s = 0.4;
    watch.take(gone, 0.6);
    EXPECT_TRUE(watch.isBlind()) << "from before nobody knew";
    gone = tell(PersonObservation::Kind::Gone, 0.6);
    gone.refused = gone.people[0].refused = 1;
    watch.take(gone, 0.6);
    EXPECT_FALSE(watch.isBlind());
    // What was mended before a second start does not blind after it.
    watch.reset();
    PeopleObservation nobody = seeBall(0.0, 0.0);
    nobody.people[0] = {};
    nobody.people[0].refused = 1;
    nobody.refused = 1;
    watch.take(nobody, 0.1);
    EXPECT_FALSE(watch.isBlind());
    EXPECT_EQ(watch.faults().refused, 0);
}

TEST(PeopleWatch, ObservationsOfAnotherTime) {
    PeopleWatch watch({makePerson(1.0, 0.0, 0.0, 0.0)});
    watch.take(seeBall(2.0, 0.5), 0.5);
    EXPECT_TRUE(watch.take(seeBall(0.3, 0.4), 0.6)) << "older than what is known";
    EXPECT_DOUBLE_EQ(watch.known()[0].bodies[0].a.x(), 2.0);
    EXPECT_TRUE(watch.take(seeBall(1.95, 0.9), 0.7)) << "from a clock that is ahead";
    EXPECT_DOUBLE_EQ(watch.known()[0].bodies[0].a.x(), 2.0);
    EXPECT_EQ(watch.faults().refused, 1);
    PeopleObservation refused = seeBall(2.0, 0.5);
    refused.refused = 3;  // by the feed
    refused.lastRefused = 0;
    watch.take(refused, 0.8);
    EXPECT_EQ(watch.faults().refused, 4);
}

ArmPath drawPath(int n, std::mt19937& random, double size) {
    const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -60.0, 60.0};
    return DrawnPath{JointVector::Constant(n, 1.5), 3.0, 10.0, 60.0, limits}.draw(random, size, kTick_s);
}

/** The least m of PeopleCheck over times of a path, with code that shares none of it: the person has grown by then. */
double sampleMargin(const detail::SeparationLimit& checker, const ArmPath& path, const PersonObservation& seen,
                    double grown, double speed, double t) {
    JointVector q, qd;
    path.calcMotion(t, q, qd);
    PeopleObservation places;
    places.people[0] = seen;
    // The checker tells the gap to what is not at rest.
    const double gap = checker.find(q, qd, places, 0.0).protective;
    return gap - grown - speed * t;
}

// What is proven along a path against a checker of its own, at four hundred times of the path: never too much, and not far off.
TEST(PeopleCheck, NobodyIsNearerThanIsProvenAtAnyTime) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> share(0.0, 1.0);
    std::normal_distribution<double> normal;
    const auto direction = [&] { return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized(); };
    for (const RobotDescription& robot : loadArms()) {
        const ArmGeometry geometry = loadArmGeometry(robot);
        int kept = 0, broken = 0, refused = 0;
        double tooMuch = 0.0;
        for (int round = 0; round < 200; ++round) {
            const double speed = 2.0 * share(random), latency_s = 0.1 * share(random), error_m = 0.05 * share(random);
            const double contactSpeed = round % 3 == 0 ? 0.5 * share(random) : 0.0;
            const std::vector<Person> people = {makePerson(speed + 0.01, latency_s, error_m, contactSpeed)};
            const ArmPath path = drawPath(robot.size(), random, round % 2 ? 0.3 : 1.0);
            const Eigen::Vector3d a = (0.3 + 2.0 * share(random)) * direction();
            const PeopleObservation seen = see(a, a + share(random) * direction(), 0.05 + 0.2 * share(random), 0.0);
            PeopleWatch watch(people);
            watch.take(seen, 0.0);
            PeopleCheck check(robot, &geometry, 1, kTick_s);
            check.setKnown(watch, 0.0);
            PeopleCheck::Result result;
            check.examine(path, calcExtremes(path), {0.0, PeopleCheck::kGuard_m}, false, result);
            const detail::SeparationLimit checker(robot, geometry, people);
            double least = kInfinity;
            constexpr int kTimes = 400;
            for (int k = 0; k < kTimes; ++k)
                least = std::min(least,
                                 sampleMargin(checker, path, seen.people[0], error_m + people[0].maxSpeed * latency_s,
                                              people[0].maxSpeed, path.duration() * (k + 0.5) / kTimes));
            if (result.isKept) {
                ++kept;
                EXPECT_GT(least, -1e-9) << round;
                tooMuch = std::max(tooMuch, result.proven - least);
            } else if (least < 0.0) {
                ++broken;
            } else {
                refused += least > 0.02;  // a contact speed is looked for 2 % below it
            }
        }
        std::printf("  %s: %d kept, %d not, %d refused although 20 mm are free; proven more than there is: %.2g m\n",
                    robot.name.c_str(), kept, broken, refused, tooMuch);
        EXPECT_LE(tooMuch, 1e-9);
        EXPECT_GT(kept, 30);
        EXPECT_GT(broken, 20);
        EXPECT_LT(refused, 8);
    }
}

// What rests can be touched: an arm at rest keeps apart from everybody, and a link before the first joint that moves does.
TEST(PeopleCheck, WhatRestsMayBeTouched) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const ArmGeometry geometry = loadArmGeometry(robot);
    PeopleWatch watch({makePerson(1.6, 0.0, 0.0, 0.0)});
    watch.take(see({0, 0, 0.1}, {0, 0, 0.3}, 0.2, 0.0), 0.0);  // around the arm's first link
    PeopleCheck check(robot, &geometry, 1, kTick_s);
    check.setKnown(watch, 0.0);
    const auto examine = [&](int joint, double velocity) {
        MotionState s{robot.home, JointVector::Zero(6), JointVector::Zero(6)};
        s.qd[joint] = velocity;
        std::array<GridStop, kMaxJoints> stops;
        const AxisLimits limits{-9.0, 9.0, -3.0, 3.0, -12.0, 12.0, -60.0, 60.0};
        for (int i = 0; i < 6; ++i) stops[static_cast<std::size_t>(i)].plan(s.qd[i], 0.0, limits, kTick_s);
        ArmPath path;
        path.set(s, JointVector::Zero(6), stops, kTick_s);
        PeopleCheck::Result result;
        check.beginTick();
        check.examine(path, calcExtremes(path), {}, false, result);
        return result;
    };
    EXPECT_TRUE(examine(0, 0.0).isKept);
    EXPECT_EQ(examine(0, 0.0).proven, kInfinity);
    EXPECT_TRUE(examine(5, 0.05).isKept) << "the wrist turns, half a metre away";
    const PeopleCheck::Result turning = examine(0, 0.05);
    EXPECT_FALSE(turning.isKept);
    EXPECT_EQ(turning.person, 0);
    EXPECT_GE(turning.link, 0);
}

}  // namespace
}  // namespace viable
