
#include <cmath>
#include <thread>

#include "Complaint.h"
#include "viable/environment/Environment.h"

namespace viable::test {
namespace {

std::vector<Person> readThem(const std::string& text) {
    const ConfigNode root = parseConfig("environment:\n  people:\n" + text, "experiment.yaml");
    return readEnvironment(*root.find("environment")).people;
}

std::string complainOfFile(const std::string& text) {
    return findComplaint([&] { readThem(text); });
}

constexpr char kWalk[] = "walk: [{time_s: 1, xyz: [2, 0, 0]}, {time_s: 3, xyz: [1, 0, 0]}]";

TEST(ReadPeople, AllThatIsSaidOfAPerson) {
    const std::vector<Person> people = readThem(
        std::string("    ann: {capsules: [{from_m: [0, 0, 0], to_m: [0, 0, 1.5], radius_m: 0.25}, "
                    "{from_m: [0.3, 0, 1], radius_m: 0.1}], ") +
        kWalk +
        ", max_speed_mps: 2, latency_s: 0.05, error_m: 0.02, contact_speed_mps: 0.1, unseen: [{from_s: 2, to_s: "
        "2.5}]}\n    bob: {capsules: [{from_m: [0, 0, 0], radius_m: 0.3}], " +
        kWalk + "}\n");
    ASSERT_EQ(people.size(), 2u);
    const Person& ann = people[0];
    EXPECT_EQ(ann.name, "ann");
    ASSERT_EQ(ann.capsules.size(), 2u);
    EXPECT_EQ(ann.capsules[0].b, Eigen::Vector3d(0, 0, 1.5));
    EXPECT_EQ(ann.capsules[1].a, ann.capsules[1].b);
    EXPECT_EQ(ann.maxSpeed, 2.0);
    EXPECT_EQ(ann.latency_s, 0.05);
    EXPECT_EQ(ann.error_m, 0.02);
    EXPECT_EQ(ann.contactSpeed, 0.1);
    EXPECT_EQ(ann.calcPlace(0.0).x(), 2.0);
    EXPECT_DOUBLE_EQ(ann.calcPlace(2.0).x(), 1.5);
    EXPECT_EQ(ann.calcPlace(9.0).x(), 1.0);
    EXPECT_TRUE(ann.isSeen(1.99));
    EXPECT_FALSE(ann.isSeen(2.0));
    EXPECT_TRUE(ann.isSeen(2.5));
    EXPECT_EQ(people[1].maxSpeed, 1.6);
    EXPECT_EQ(people[1].contactSpeed, 0.0);
}

TEST(ReadPeople, WrongOnesAreRefusedWithPlaceAndRemedy) {
    const std::string capsules = "capsules: [{from_m: [0, 0, 0], radius_m: 0.3}], ";
    expectContains(complainOfFile("    ann: {" + capsules + "}\n"), {"experiment.yaml:3", "walk"});
    expectContains(complainOfFile(std::string("    ann: {") + kWalk + "}\n"), {"capsules"});
    expectContains(complainOfFile("    ann: {" + capsules + kWalk + ", max_speed_mps: 0}\n"), {"max_speed_mps"});
    expectContains(complainOfFile("    ann: {" + capsules + kWalk + ", speed: 1}\n"), {"`speed`"});
    expectContains(
        complainOfFile("    ann: {" + capsules + "walk: [{time_s: 1, xyz: [0, 0, 0]}, {time_s: 1, xyz: [1, 0, 0]}]}\n"),
        {"is not after the one before", "rise"});
    expectContains(complainOfFile("    ann: {" + capsules + kWalk + ", repeats: true}\n"), {"would jump"});
    expectContains(complainOfFile("    ann: {" + capsules + kWalk + ", unseen: [{from_s: 2, to_s: 1}]}\n"), {"to_s"});
    std::string many = "capsules: [";
    for (int k = 0; k <= kMaxPersonCapsules; ++k) many += "{from_m: [0, 0, 0], radius_m: 0.3}, ";
    expectContains(complainOfFile("    ann: {" + many + "], " + kWalk + "}\n"), {"9 capsules", "up to 8"});
    std::string crowd;
    for (int k = 0; k <= kMaxPeople; ++k) crowd += "    p" + std::to_string(k) + ": {" + capsules + kWalk + "}\n";
    expectContains(complainOfFile(crowd), {"17 people", "Up to 16"});
}

// The speed that a blunt touch of a part may have: by hand from the standard's formula.
TEST(BodyPart, ContactSpeedFollowsFromForceStiffnessAndMasses) {
    // mu = 0.6 * 20 / 20.6 kg, F = 280 N, k = 75000 N/m
    EXPECT_NEAR(calcContactSpeed(BodyPart::Hand, 20.0), 280.0 / std::sqrt(0.6 * 20.0 / 20.6 * 75000.0), 1e-12);
    EXPECT_NEAR(calcContactSpeed(BodyPart::Chest, 20.0), 280.0 / std::sqrt(40.0 * 20.0 / 60.0 * 25000.0), 1e-12);
    const std::vector<std::string>& names = bodyPartNames();
    ASSERT_EQ(names.size(), 9u);
    EXPECT_EQ(names[static_cast<std::size_t>(BodyPart::LowerLeg)], "lower_leg");
    for (std::size_t i = 0; i < names.size(); ++i) {
        const BodyPart part = static_cast<BodyPart>(i);
        EXPECT_GT(calcContactSpeed(part, 5.0), calcContactSpeed(part, 50.0)) << names[i] << ": more mass, less speed";
        EXPECT_GT(calcContactSpeed(part, 50.0), 0.1) << names[i];
    }
}

TEST(ReadPeople, ABodyPartStandsForItsContactSpeed) {
    const std::string capsules = "    ann: {capsules: [{from_m: [0, 0, 0], radius_m: 0.3}], " + std::string(kWalk);
    std::vector<Person> people = readThem(capsules + ", body_part: hand}\n");
    ASSERT_TRUE(people[0].bodyPart);
    EXPECT_EQ(*people[0].bodyPart, BodyPart::Hand);
    EXPECT_EQ(people[0].contactSpeed, 0.0) << "as long as nobody says how heavy the arm is";
    setContactSpeeds(people, 20.0);
    EXPECT_EQ(people[0].contactSpeed, calcContactSpeed(BodyPart::Hand, 20.0));
    setContactSpeeds(people, 0.0);
    EXPECT_EQ(people[0].contactSpeed, 0.0) << "without a mass nothing follows";
    expectContains(complainOfFile(capsules + ", body_part: neck}\n"),
                   {"body_part", "may not be touched", "rests before"});
    expectContains(complainOfFile(capsules + ", body_part: hnd}\n"), {"body_part", "hand", "chest"});
    expectContains(complainOfFile(capsules + ", body_part: hand, contact_speed_mps: 0.1}\n"),
                   {"exclude each other", "Remove one"});
}

Person makePerson(const char* name) {
    Person person;
    person.name = name;
    return person;
}

PersonObservation seeBall(double x, double stamp_s) {
    PersonObservation one;
    one.kind = PersonObservation::Kind::Seen;
    one.stamp_s = stamp_s;
    one.count = 1;
    one.capsules[0] = {Eigen::Vector3d(x, 0, 0), Eigen::Vector3d(x, 0, 0), 0.1};
    return one;
}

TEST(PeopleFeed, WhatCannotBeUsedIsRefusedAndCounted) {
    PeopleFeed feed({makePerson("ann"), makePerson("bob")});
    EXPECT_EQ(feed.take().version, 0);
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInf = std::numeric_limits<double>::infinity();
    PeopleObservation seen;
    seen.people[0] = seeBall(1.0, 0.5);
    EXPECT_EQ(feed.put(seen), 0);
    EXPECT_EQ(feed.take().people[0].kind, PersonObservation::Kind::Seen);
    EXPECT_EQ(feed.take().people[0].capsules[0].a.x(), 1.0);
    int refused = 0;
    const auto expectRefused = [&](const PersonObservation& one) {
        seen.people[1] = one;
        EXPECT_EQ(feed.put(seen), 1);
        const PeopleObservation& got = feed.take();
        EXPECT_EQ(got.people[1].kind, PersonObservation::Kind::Unseen);
        EXPECT_EQ(got.people[0].kind, PersonObservation::Kind::Seen) << "the others count";
        EXPECT_EQ(got.refused, ++refused);
        EXPECT_EQ(got.lastRefused, 1);
    };
    for (const double x : {kNan, kInf, -kInf, 1e9}) expectRefused(seeBall(x, 0.5));
    expectRefused(seeBall(1.0, kNan));
    PersonObservation one = seeBall(1.0, 0.5);
    for (const int count : {0, -1, kMaxPersonCapsules + 1, 1000000}) {
        one.count = count;
        expectRefused(one);
    }
    one = seeBall(1.0, 0.5);
    for (const double radius : {0.0, -1.0, kNan, kInf}) {
        one.capsules[0].radius = radius;
        expectRefused(one);
    }
    seen.people[1] = {};
    seen.people[2] = seeBall(1.0, 0.5);
    EXPECT_EQ(feed.put(seen), 1) << "nobody of that index";
    EXPECT_EQ(feed.take().lastRefused, -1);
    EXPECT_TRUE(feed.claim());
    EXPECT_FALSE(feed.claim());
}

TEST(PeopleFeed, NumbersThatCannotBeAreRefused) {
    const auto complainOf = [](Person person) { return findComplaint([&] { PeopleFeed feed({std::move(person)}); }); };
    Person person = makePerson("ann");
    EXPECT_EQ(complainOf(person), "");
    person.maxSpeed = 0.0;
    person.latency_s = -1.0;
    person.error_m = std::numeric_limits<double>::quiet_NaN();
    expectContains(complainOf(person), {"'ann'", "largest speed", "latency", "measurement error"});
    EXPECT_THROW(PeopleFeed(std::vector<Person>(kMaxPeople + 1)), Error);
}

TEST(PeopleFeed, WhatIsTakenIsWhole) {
    PeopleFeed feed({makePerson("ann"), makePerson("bob")});
    constexpr int kPuts = 20000;
    std::atomic<bool> isOver{false};
    std::thread sensor([&] {
        PeopleObservation seen;
        for (int k = 1; k <= kPuts; ++k) {
            seen.people[0] = seen.people[1] = seeBall(1e-3 * k, 1e-3 * k);
            feed.put(seen);
        }
        isOver = true;
    });
    std::int64_t last = 0;
    while (last < kPuts) {
        const bool wasOver = isOver;
        const PeopleObservation& got = feed.take();
        ASSERT_GE(got.version, last);
        last = got.version;
        if (last == 0) continue;
        ASSERT_EQ(got.people[0].stamp_s, 1e-3 * static_cast<double>(last));
        ASSERT_EQ(got.people[1].capsules[0].b.x(), got.people[0].stamp_s);
        if (wasOver) break;
    }
    sensor.join();
    EXPECT_EQ(feed.take().version, kPuts);
}

}  // namespace
}  // namespace viable::test
