#include "simulation/CommandStream.h"

#include <gtest/gtest.h>

#include <cmath>

namespace viable {
namespace {

/** The sent command is the time; what is received at each tick of 1 ms. */
std::vector<double> run(CommandStream& stream, double seconds) {
    MotionCommand sent, received;
    sent.q = JointVector::Zero(1);
    sent.qd = JointVector::Ones(1);
    stream.reset(sent);
    std::vector<double> times;
    for (int k = 0; k < seconds * 1000; ++k) {
        sent.q[0] = 0.001 * k;
        stream.pass(0.001 * k, sent, received);
        times.push_back(received.q[0]);
    }
    return times;
}

std::vector<double> run(const StreamOptions& options, double seconds) {
    CommandStream stream(options);
    return run(stream, seconds);
}

StreamOptions held(double rate_hz) {
    StreamOptions options;
    options.rate_hz = rate_hz;
    options.between = BetweenSamples::Hold;
    return options;
}

TEST(CommandStream, ASampleATickIsTheCommandItself) {
    const std::vector<double> times = run(held(1000.0), 2.0);
    for (std::size_t k = 0; k < times.size(); ++k) ASSERT_EQ(times[k], 0.001 * static_cast<double>(k));
}

TEST(CommandStream, SamplesComeAtTheirRate) {
    const std::vector<double> times = run(held(30.0), 2.0);
    for (std::size_t k = 0; k < times.size(); ++k) {
        const double t = 0.001 * static_cast<double>(k);
        ASSERT_NEAR(times[k], std::floor((t + 1e-9) * 30.0) / 30.0, 0.001 + 1e-9) << t;
    }
}

TEST(CommandStream, JitterDelaysByUpToItsShareOfAPeriod) {
    StreamOptions options = held(10.0);
    options.jitter = 0.3;
    const std::vector<double> times = run(options, 20.0);
    double late = 0.0;
    int changes = 0;
    for (std::size_t k = 1; k < times.size(); ++k) {
        if (times[k] == times[k - 1]) continue;
        ++changes;
        late = std::max(late, 0.001 * static_cast<double>(k) - times[k]);
    }
    EXPECT_EQ(changes, 199);  // in order, none lost
    EXPECT_LE(late, 0.031);
    EXPECT_GT(late, 0.028);
}

TEST(CommandStream, WithoutLossAllComes) {
    for (const double rate : {60.0, 300.0, 600.0, 700.0}) {
        StreamOptions options = held(rate);
        options.jitter = 0.99;
        const std::vector<double> times = run(options, 10.0);
        int changes = 0;
        for (std::size_t k = 1; k < times.size(); ++k) changes += times[k] != times[k - 1];
        // Of two that arrive in one tick the first is not seen.
        EXPECT_GE(changes, rate <= 300.0 ? 9.5 * rate : 6.0 * rate) << rate;
    }
}

TEST(CommandStream, LosesItsShareOfTheSamples) {
    StreamOptions options = held(100.0);
    options.loss = 0.2;
    const std::vector<double> times = run(options, 100.0);
    int changes = 0;
    for (std::size_t k = 1; k < times.size(); ++k) changes += times[k] != times[k - 1];
    EXPECT_NEAR(changes, 8000, 4 * std::sqrt(10000 * 0.2 * 0.8));
}

TEST(CommandStream, AGapComesOnceInEveryWhile) {
    StreamOptions options = held(100.0);
    options.gap_s = 0.3;
    options.gapEvery_s = 2.0;
    const std::vector<double> times = run(options, 20.0);
    int gaps = 0, longest = 0, still = 0;
    for (std::size_t k = 1; k < times.size(); ++k) {
        still = times[k] == times[k - 1] ? still + 1 : 0;
        gaps += still == 100;
        longest = std::max(longest, still);
    }
    EXPECT_EQ(gaps, 10);
    EXPECT_NEAR(longest, 300, 20);
}

TEST(CommandStream, IsTheSameAgainAfterResetAndAnotherWithAnotherSeed) {
    StreamOptions options = held(50.0);
    options.jitter = 0.5;
    options.loss = 0.1;
    const std::vector<double> times = run(options, 5.0);
    CommandStream stream(options);
    for (int again = 0; again < 2; ++again) EXPECT_EQ(run(stream, 5.0), times);
    options.seed = 2;
    EXPECT_NE(run(options, 5.0), times);
}

TEST(CommandStream, TheFirstSampleIsNeverLost) {
    StreamOptions options = held(10.0);
    options.loss = 0.99;
    options.jitter = 0.9;
    CommandStream stream(options);
    MotionCommand sent, received;
    sent.q = JointVector::Zero(1);
    sent.qd = JointVector::Zero(1);
    stream.reset(sent);
    sent.q[0] = 5.0;
    stream.pass(0.0, sent, received);
    EXPECT_EQ(received.q[0], 5.0);
}

}  // namespace
}  // namespace viable
