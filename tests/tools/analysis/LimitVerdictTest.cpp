#include "analysis/smoothing/LimitVerdict.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "Effort.h"
#include "SyntheticRecord.h"

// Verdicts over a population of records with a known truth, and what is said of them.

namespace viable::test {
namespace {

AxisLimits makeLimits(const std::array<double, 4>& l) {
    return {-l[0], l[0], -l[1], l[1], -l[2], l[2], -l[3], l[3]};
}

/** The limits that the motion touches and does not pass within the record. */
std::array<double, 4> findTouched(const SyntheticRecord& one) {
    std::array<double, 4> largest{};
    const double margin_s = 2.0 / one.sensor.rate_Hz;
    for (double t = one.record.times_s.front() - margin_s; t < one.record.times_s.back() + margin_s; t += 2e-4) {
        const auto x = one.motion.at(std::max(t, 0.0));
        for (std::size_t order = 0; order < 4; ++order) largest[order] = std::max(largest[order], std::abs(x[order]));
    }
    largest[3] = one.jerk;
    return largest;
}

/** Limits that one segment of 50 ms exceeds by 10 %, as nothing longer does. */
std::array<double, 4> findExceeded(const SyntheticRecord& one, const std::array<double, 4>& touched) {
    constexpr double kStep_s = 1e-3;
    std::vector<std::array<double, 4>> samples;
    for (double t = one.record.times_s.front() + 0.05; t < one.record.times_s.back() - 0.05; t += kStep_s)
        samples.push_back(one.motion.at(t));
    std::array<double, 4> limits{};
    for (std::size_t order = 0; order < 4; ++order) {
        double low = 0.0, high = touched[order];
        for (int step = 0; step < 40; ++step) {
            const double level = 0.5 * (low + high);
            double segment_s = 0.0, longest_s = 0.0;
            for (const auto& x : samples) {
                segment_s = std::abs(x[order]) >= level ? segment_s + kStep_s : 0.0;
                longest_s = std::max(longest_s, segment_s);
            }
            (longest_s >= 0.05 ? low : high) = level;
        }
        limits[order] = low / 1.1;
    }
    return limits;
}

TEST(LimitVerdict, IsRightOnAPopulationOfRecords) {
    const int records = countOf(40);
    int cleanButBroken = 0;
    std::array<int, 4> tells{}, could{}, found{};
    for (int seed = 1; seed <= records; ++seed) {
        SyntheticRecord one(static_cast<std::uint64_t>(seed));
        const auto touched = findTouched(one);
        const auto clean = checkRecord(one.record, {makeLimits(touched)});
        cleanButBroken += clean.overall() == Finding::Broken;
        for (std::size_t order = 0; order < 4; ++order)
            tells[order] += clean.joints[0].limits[order].finding == Finding::Held;

        const auto exceeded = findExceeded(one, touched);
        const auto beyond = checkRecord(one.record, {makeLimits(exceeded)});
        const auto count = [&](const LimitVerdict& limit, std::size_t order, double size) {
            if (!(size > 0.0) || limit.visibleExcess > 0.1 * size) return;
            ++could[order];
            found[order] += limit.finding == Finding::Broken;
        };
        for (std::size_t order = 0; order < 3; ++order) count(beyond.joints[0].limits[order], order, exceeded[order]);
        // Jerk: one piece of it is 10 % larger for 50 ms.
        const double margin_s = 0.1;
        if (one.motion.exceed(1.1, 0.05, margin_s, one.sensor.duration_s - margin_s, one.random)) {
            const MotionRecord record = one.sensor.sample(one.motion, one.random);
            const auto jerk = checkRecord(record, {makeLimits({kInfinity, kInfinity, kInfinity, one.jerk})});
            count(jerk.joints[0].limits[3], 3, one.jerk);
        }
    }
    const char* names[] = {"position", "velocity", "acceleration", "jerk"};
    std::printf("%d records (seeds 1 to %d): %d that keep their limits are called broken\n", records, records,
                cleanButBroken);
    EXPECT_LE(cleanButBroken, records / 100);
    for (std::size_t order = 0; order < 4; ++order) {
        std::printf("%s: held in %d; an excess of 10 %% for 50 ms found in %d of %d where it could be told\n",
                    names[order], tells[order], found[order], could[order]);
        EXPECT_GE(found[order], 0.95 * could[order]) << names[order];
    }
    // Good sensors are rare among these; TellsTheJerkOfAGoodEncoder sees to it that jerk is told at all.
    EXPECT_GT(could[0], records / 2);
    EXPECT_GT(could[1], records / 2);
    EXPECT_GT(could[2], records / 4);
}

/** A good encoder on a joint that moves at its jerk limit for long. */
SyntheticRecord makeGood() {
    SyntheticRecord one(1);
    one.sensor = {};
    one.sensor.count = 8e-7;
    one.sensor.noise = 4e-7;
    one.jerk = 40.0;
    one.sensor.duration_s = 8.0;
    one.motion = makeMotion(one.random, 8.2, one.jerk, 12.0, 3.0);
    one.record = one.sensor.sample(one.motion, one.random);
    return one;
}

TEST(LimitVerdict, TellsTheJerkOfAGoodEncoder) {
    SyntheticRecord one = makeGood();
    const auto touched = findTouched(one);
    const auto held = checkRecord(one.record, {makeLimits(touched)});
    EXPECT_EQ(held.overall(), Finding::Held) << writeText(held);
    EXPECT_LT(held.joints[0].limits[3].visibleExcess, 0.1 * one.jerk);
    EXPECT_GT(held.joints[0].limits[3].judged, 0.7);
    ASSERT_TRUE(one.motion.exceed(1.1, 0.05, 0.2, 7.8, one.random));
    const MotionRecord record = one.sensor.sample(one.motion, one.random);
    const auto broken = checkRecord(record, {makeLimits({kInfinity, kInfinity, kInfinity, one.jerk})});
    const LimitVerdict& jerk = broken.joints[0].limits[3];
    ASSERT_EQ(jerk.finding, Finding::Broken) << writeText(broken);
    EXPECT_GT(std::abs(one.motion.at(jerk.worst_s + 0.02)[3]), 1.05 * one.jerk);  // it says where
    EXPECT_NEAR(jerk.excess, 0.1 * one.jerk, 0.06 * one.jerk);
    EXPECT_GT(jerk.certainExcess, 0.0);
    EXPECT_LT(jerk.certainExcess, 0.1 * one.jerk);
    EXPECT_EQ(broken.joints[0].limits[0].finding, Finding::NoLimit);
}

TEST(LimitVerdict, WithALimitFarAwayNothingIsBroken) {
    const SyntheticRecord one = makeGood();
    auto wide = findTouched(one);
    for (double& l : wide) l *= 3.0;
    EXPECT_EQ(checkRecord(one.record, {makeLimits(wide)}).overall(), Finding::Held);
}

TEST(LimitVerdict, WithNoiseItCannotTell) {
    SyntheticRecord one = makeGood();
    one.sensor.count = 1.5e-3;  // 12 bit
    const auto record = one.sensor.sample(one.motion, one.random);
    const auto verdict = checkRecord(record, {makeLimits(findTouched(one))});
    EXPECT_EQ(verdict.joints[0].limits[3].finding, Finding::CannotTell);
    EXPECT_GT(verdict.joints[0].limits[3].visibleExcess, 0.1 * one.jerk);
    EXPECT_EQ(verdict.joints[0].limits[0].finding, Finding::Held);
    EXPECT_EQ(verdict.overall(), Finding::CannotTell);
    EXPECT_NE(writeText(verdict).find("cannot tell"), std::string::npos);
}

TEST(LimitVerdict, AStuckJointIsNamedAndTheOthersAreJudged) {
    SyntheticRecord one = makeGood();
    MotionRecord record = one.record;
    record.joints.push_back(record.joints[0]);
    record.joints[1].name = "stuck";
    std::fill(record.joints[1].positions.begin(), record.joints[1].positions.end(), 0.3);
    const auto touched = makeLimits(findTouched(one));
    const auto verdict = checkRecord(record, {touched, touched});
    EXPECT_TRUE(verdict.joints[0].motion.has_value());
    EXPECT_FALSE(verdict.joints[1].motion.has_value());
    EXPECT_NE(verdict.joints[1].trouble.find("all readings are the same"), std::string::npos);
    EXPECT_EQ(verdict.joints[1].limits[2].finding, Finding::CannotTell);
    EXPECT_EQ(verdict.overall(), Finding::CannotTell);
    const auto json = nlohmann::json::parse(writeJson(verdict, record)).at("joints").at(1).at("limits").at("velocity");
    EXPECT_EQ(json.at("upper").get<double>(), touched.velocityUpper);
    EXPECT_EQ(json.at("visible_excess"), nullptr);
    EXPECT_EQ(json.at("deviation"), nullptr);
    record.joints.erase(record.joints.begin());
    EXPECT_THROW(checkRecord(record, {touched}), Error);
}

TEST(LimitVerdict, AShortMoveInALongRecordIsSeen) {
    std::mt19937_64 random(5);
    JerkLimitedMotion motion(0.3);
    motion.add(110.1, 0.0);  // 120 s at rest but for one move of a second
    for (const double jerk : {40.0, -40.0, -40.0, 40.0}) motion.add(0.2, jerk);
    motion.stop();
    motion.add(10.0, 0.0);
    Sensor sensor;
    sensor.noise = 1e-5;
    sensor.duration_s = 120.0;
    const MotionRecord record = sensor.sample(motion, random);
    // True sizes: velocity 1.6, acceleration 8.
    const auto verdict = checkRecord(record, {makeLimits({kInfinity, 1.4, 7.0, kInfinity})});
    EXPECT_EQ(verdict.joints[0].limits[1].finding, Finding::Broken) << writeText(verdict);
    EXPECT_EQ(verdict.joints[0].limits[2].finding, Finding::Broken) << writeText(verdict);
    EXPECT_LT(verdict.joints[0].motion->noise, 2e-5);
}

TEST(LimitVerdict, WhatWasLeftOutIsNotHeld) {
    SyntheticRecord one = makeGood();
    auto limits = makeLimits(findTouched(one));
    ASSERT_EQ(checkRecord(one.record, {limits}).overall(), Finding::Held);
    for (std::size_t i = 4000; i < 4004; ++i) one.record.joints[0].positions[i] += 0.5;
    const auto verdict = checkRecord(one.record, {limits});
    const LimitVerdict& velocity = verdict.joints[0].limits[1];
    EXPECT_NE(velocity.finding, Finding::Held) << writeText(verdict);
    if (velocity.finding == Finding::CannotTell) {
        EXPECT_NEAR(velocity.hiding_s, one.record.times_s[4000], 0.005);
        EXPECT_NE(writeText(verdict).find("may hide an excess"), std::string::npos) << writeText(verdict);
    }
    // One wild reading alone is no motion.
    SyntheticRecord single = makeGood();
    single.record.joints[0].positions[4000] += 0.5;
    EXPECT_EQ(checkRecord(single.record, {limits}).overall(), Finding::Held);
}

TEST(LimitVerdict, TooFewReadingsInAnExcessTellNothing) {
    SyntheticRecord one = makeGood();
    one.sensor.rate_Hz = 50.0;
    const MotionRecord record = one.sensor.sample(one.motion, one.random);
    const auto verdict = checkRecord(record, {makeLimits({4.0, 10.0, 50.0, 500.0})});
    for (const LimitVerdict& limit : verdict.joints[0].limits) EXPECT_EQ(limit.finding, Finding::CannotTell);
    EXPECT_EQ(checkRecord(record, {makeLimits({4.0, 10.0, 50.0, kInfinity})}, {0.99, 0.1, 0.2}).overall(),
              Finding::Held);
}

TEST(LimitVerdict, GapsAreNotJudgedAndCostNothing) {
    const SyntheticRecord one = makeGood();
    const auto limits = makeLimits(findTouched(one));
    MotionRecord record = one.record;
    for (std::size_t i = record.times_s.size() / 2; i < record.times_s.size(); ++i) record.times_s[i] += 0.5;
    const auto small = checkRecord(record, {limits});
    EXPECT_EQ(small.overall(), Finding::Held) << writeText(small);
    for (std::size_t i = record.times_s.size() / 2; i < record.times_s.size(); ++i) record.times_s[i] += 1e6;
    const auto large = checkRecord(record, {limits});
    EXPECT_LT(large.joints[0].limits[1].judged, 1e-4);  // of the time from the first to the last reading
    EXPECT_EQ(large.joints[0].limits[1].finding, Finding::CannotTell);
    EXPECT_LT(large.joints[0].limits[1].visibleExcess, 0.1 * limits.velocityUpper);
    EXPECT_FALSE(writeJson(large, record).empty());
}

TEST(LimitVerdict, ShortRecordsAreNotCalledBroken) {
    const int records = countOf(40);
    int broken = 0;
    for (int seed = 1; seed <= records; ++seed) {
        SyntheticRecord one(static_cast<std::uint64_t>(500000 + seed));  // others than those above
        const std::size_t n = seed % 2 ? 300 : 100;
        one.record.times_s.resize(n);
        one.record.joints[0].positions.resize(n);
        const auto& readings = one.record.joints[0].positions;
        if (std::all_of(readings.begin(), readings.end(), [&](double q) { return q == readings[0]; })) continue;
        broken += checkRecord(one.record, {makeLimits(findTouched(one))}).overall() == Finding::Broken;
    }
    std::printf("%d of %d short records that keep their limits are called broken (seeds 500001 on)\n", broken, records);
    EXPECT_LE(broken, records / 100);
}

TEST(LimitVerdict, OptionsAreChecked) {
    const SyntheticRecord one = makeGood();
    const auto limits = makeLimits(findTouched(one));
    for (const JudgeOptions& options :
         {JudgeOptions{1.0, 0.1, 0.05}, JudgeOptions{0.3, 0.1, 0.05}, JudgeOptions{0.99, 0.0, 0.05},
          JudgeOptions{0.99, 0.1, -1.0}, JudgeOptions{0.99, 0.1, std::nan("")}})
        EXPECT_THROW(checkRecord(one.record, {limits}, options), Error);
}

TEST(LimitVerdict, JsonHoldsWhatTheReportDraws) {
    const SyntheticRecord one = makeGood();
    auto l = findTouched(one);
    l[1] *= 0.5;
    AxisLimits limits = makeLimits(l);
    limits.positionLower = -kInfinity;
    const auto verdict = checkRecord(one.record, {limits});
    const auto json = nlohmann::json::parse(writeJson(verdict, one.record));
    EXPECT_EQ(json.at("verdict"), "broken");
    const auto& joint = json.at("joints").at(0);
    EXPECT_EQ(joint.at("limits").at("position").at("lower"), nullptr);
    EXPECT_EQ(joint.at("limits").at("velocity").at("verdict"), "broken");
    EXPECT_EQ(joint.at("limits").at("velocity").at("broken").at("certain_excess").get<double>(),
              verdict.joints[0].limits[1].certainExcess);
    const auto& curves = joint.at("curves");
    const auto n = curves.at("n").get<std::size_t>();
    for (const char* quantity : {"position", "velocity", "acceleration", "jerk"})
        for (const char* curve : {"raw_least", "raw_largest", "mean_least", "mean_largest", "low", "high"})
            EXPECT_EQ(curves.at(quantity).at(curve).size(), n) << quantity << " " << curve;
    for (std::size_t i = 0; i < n; i += 97) {
        EXPECT_LE(curves.at("jerk").at("low")[i].get<double>(), curves.at("jerk").at("mean_least")[i].get<double>());
        EXPECT_GE(curves.at("jerk").at("high")[i].get<double>(), curves.at("jerk").at("mean_largest")[i].get<double>());
    }
}

}  // namespace
}  // namespace viable::test
