#include "limits/SeparationLimit.h"

#include <gtest/gtest.h>

#include "Paths.h"
#include "summary/LimitCounter.h"

namespace viable {
namespace {

/** The tool of a resting Indy7 as a ball that somebody walks into, at 1 m/s from x = from. */
Person makeVisitor(double from, double maxSpeed, double contactSpeed) {
    Person person;
    person.name = "ann";
    person.maxSpeed = maxSpeed;
    person.contactSpeed = contactSpeed;
    person.capsules = {{Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0, 0, 1), 0.25}};
    person.walk = {{0.0, {from, 0, 0}}, {2.0, {from - 2.0, 0, 0}}};
    return person;
}

LimitAccount countLimit(const Person& person, double velocity, int ticks = 2000) {
    const RobotDescription robot = loadRobot(VIABLE_SOURCE_DIR "/robots/indy7");
    const ArmGeometry geometry = loadArmGeometry(robot);
    detail::LimitCounter counter(
        LimitKind::Separation, std::make_unique<detail::SeparationLimit>(robot, geometry, std::vector<Person>{person}),
        false);
    TickRecord row;
    row.nominal.q = robot.home;
    row.nominal.qd = JointVector::Zero(robot.size());
    row.reports[LimitKind::Separation].isKnown = true;
    row.peopleFaults.last = 0;
    row.joints[0].limit = LimitKind::Separation;
    for (int k = 0; k < ticks; ++k) {
        row.time_s = 1e-3 * k;
        row.nominal.qd[5] = velocity;
        row.nominal.q[5] = velocity * row.time_s;
        counter.add(row);
    }
    counter.addEnd({row.nominal.q, row.nominal.qd, row.nominal.qd}, 1e-3 * ticks);
    return counter.account();
}

TEST(Separation, WhatRestsMayBeTouched) {
    const LimitAccount found = countLimit(makeVisitor(2.0, 1.6, 0.0), 0.0);
    EXPECT_GT(found.nominal.nearTicks, 300);
    EXPECT_EQ(found.nominal.brokenTicks, 0);
    EXPECT_EQ(found.nominal.largest, 0.0);
    EXPECT_NEAR(found.resting_s, 2.0, 0.01);
    EXPECT_EQ(found.lastFault, "ann");
}

TEST(Separation, WhatMovesMayNot) {
    const LimitAccount found = countLimit(makeVisitor(2.0, 1.6, 0.0), 0.5);
    EXPECT_GT(found.nominal.brokenTicks, 100);
    EXPECT_EQ(found.nominal.violatedTicks, found.nominal.brokenTicks);
    EXPECT_LE(found.nominal.worst, 0.0);
    EXPECT_EQ(found.nominal.other, "ann");
    EXPECT_EQ(found.nominal.part, "link6");
    ASSERT_TRUE(found.nominal.firstBroken_s);
    EXPECT_EQ(found.resting_s, 0.0);
    // Slow enough to be touched at.
    const LimitAccount slow = countLimit(makeVisitor(2.0, 1.6, 0.5), 0.5);
    EXPECT_GT(slow.nominal.nearTicks, 100);
    EXPECT_EQ(slow.nominal.brokenTicks, 0);
    EXPECT_GT(slow.nominal.largest, 0.01);
}

TEST(Separation, WhoIsFasterThanStatedIsNotTheArmsFault) {
    const LimitAccount fast = countLimit(makeVisitor(2.0, 0.9, 0.0), 0.5);
    EXPECT_GT(fast.nominal.brokenTicks, 100);
    EXPECT_EQ(fast.nominal.violatedTicks, 0);
    Person late = makeVisitor(2.0, 1.6, 0.0);
    late.unseen = {{0.0, 0.1}};
    EXPECT_EQ(countLimit(late, 0.5).nominal.violatedTicks, 0) << "nobody knew of her";
    Person once = makeVisitor(2.0, 1.6, 0.0);  // a word that was broken long before frees nobody
    const Eigen::Vector3d from = once.walk.front().position;
    once.walk.insert(once.walk.begin(), {{-5.0, from + Eigen::Vector3d(5.0, 0.0, 0.0)}, {-4.0, from}});
    const LimitAccount later = countLimit(once, 0.5);
    EXPECT_GT(later.nominal.brokenTicks, 100);
    EXPECT_EQ(later.nominal.violatedTicks, later.nominal.brokenTicks);
}

TEST(Separation, AWordBrokenInEveryLapIsNotTheArmsFault) {
    Person once = makeVisitor(2.0, 1.6, 0.0);
    once.walk = {{0.0, {0.3, 0, 0}}, {0.8, {1.5, 0, 0}}};
    const std::int64_t guilty = countLimit(once, 0.5).nominal.violatedTicks;
    EXPECT_GT(guilty, 10);
    Person again = once;
    again.walk.push_back({1.0, {0.3, 0, 0}});  // at 6 m/s
    again.repeats = true;
    const LimitAccount laps = countLimit(again, 0.5);
    EXPECT_EQ(laps.nominal.violatedTicks, guilty) << "of the first lap, before the word was broken";
    EXPECT_GT(laps.nominal.brokenTicks, guilty);
}

TEST(Separation, WhoBreaksTheWordUnseenIsNotTheArmsFault) {
    Person hidden = makeVisitor(2.0, 1.6, 0.0);
    hidden.walk = {{0.0, {6.0, 0, 0}}, {1.0, {6.0, 0, 0}}, {1.2, {2.0, 0, 0}}, {4.0, {2.0, 0, 0}}, {6.0, {0.0, 0, 0}}};
    hidden.unseen = {{0.5, 9.0}};
    const LimitAccount found = countLimit(hidden, 0.5, 6000);
    EXPECT_GT(found.nominal.brokenTicks, 100);
    EXPECT_EQ(found.nominal.violatedTicks, 0);
}

TEST(Separation, TheLeastGap) {
    const LimitAccount found = countLimit(makeVisitor(4.0, 1.6, 0.0), 0.5);
    EXPECT_EQ(found.nominal.nearTicks, 0);
    EXPECT_GT(found.nominal.worst, 0.5);
    EXPECT_LT(found.nominal.worst, 3.0);
    EXPECT_NEAR(found.nominal.worst_s, 2.0, 1e-3) << "when she is nearest";
}

}  // namespace
}  // namespace viable
