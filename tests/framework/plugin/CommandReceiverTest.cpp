#include "viable/plugin/CommandReceiver.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "viable/core/RotationVector.h"
#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

MotionCommand at(double q) {
    MotionCommand command;
    command.q = JointVector::Constant(1, q);
    command.qd = JointVector::Zero(1);
    return command;
}

MotionCommand calc(const CommandReceiver& receiver, double t) {
    MotionCommand command;
    receiver.calc(t, command);
    return command;
}

TEST(CommandReceiver, HoldsTheNewestSampleAtRest) {
    CommandReceiver receiver(BetweenSamples::Hold);
    receiver.reset(at(1.0));
    EXPECT_EQ(calc(receiver, 0.0).q[0], 1.0);
    receiver.take(0.1, at(2.0));
    receiver.take(0.2, at(3.0));
    for (const double t : {0.2, 0.25, 9.0}) {
        EXPECT_EQ(calc(receiver, t).q[0], 3.0);
        EXPECT_EQ(calc(receiver, t).qd[0], 0.0);
    }
}

TEST(CommandReceiver, InterpolationArrivesWhenTheNextIsDueAndStandsThere) {
    CommandReceiver receiver(BetweenSamples::Interpolate);
    receiver.reset(at(0.0));
    for (int k = 0; k <= 5; ++k) receiver.take(0.1 * k, at(k));  // 10 a second
    EXPECT_NEAR(calc(receiver, 0.5).q[0], 4.0, 1e-12);
    EXPECT_NEAR(calc(receiver, 0.55).q[0], 4.5, 1e-12);
    EXPECT_NEAR(calc(receiver, 0.55).qd[0], 10.0, 1e-9);
    EXPECT_NEAR(calc(receiver, 0.6).q[0], 5.0, 1e-12);
    EXPECT_NEAR(calc(receiver, 3.0).q[0], 5.0, 1e-12);
    EXPECT_EQ(calc(receiver, 3.0).qd[0], 0.0);
}

TEST(CommandReceiver, InterpolationIsContinuousWhateverComesWhen) {
    std::mt19937_64 random(7);
    const auto draw = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
    CommandReceiver receiver(BetweenSamples::Interpolate);
    receiver.reset(at(0.0));
    double t = 0.0;
    for (int k = 0; k < 1000; ++k) {
        const double before = calc(receiver, t).q[0];
        receiver.take(t, at(draw(-1.0, 1.0)));
        if (k > 0) {
            EXPECT_NEAR(calc(receiver, t).q[0], before, 1e-12);
        }
        t += draw(0.001, 0.2);
    }
}

/** RMS distance to what is sent, in periods of an even motion, 30 times a second with jitter and loss. */
double calcLag(BetweenSamples between) {
    std::mt19937_64 random(3);
    const auto draw = [&] { return std::uniform_real_distribution<double>(0.0, 1.0)(random); };
    CommandReceiver receiver(between);
    receiver.reset(at(0.0));
    const double period = 0.033, speed = 0.7;
    double sum = 0.0, last = 0.0;
    int count = 0;
    for (int k = 0; k < 3000; ++k) {
        const double sent = k * period;
        if (k > 0 && draw() < 0.05) continue;
        const double received = sent + (k > 0 ? 0.3 * period * draw() : 0.0);
        for (double t = last; k > 100 && t < received; t += 0.001, ++count)
            sum += std::pow((calc(receiver, t).q[0] - speed * t) / (speed * period), 2);
        receiver.take(last = received, at(speed * sent));
    }
    return std::sqrt(sum / count);
}

TEST(CommandReceiver, AnEvenMotionIsFollowedThroughJitterAndLoss) {
    EXPECT_NEAR(calcLag(BetweenSamples::Hold), 0.75, 0.1);         // half a period, and the jitter
    EXPECT_NEAR(calcLag(BetweenSamples::Interpolate), 1.25, 0.1);  // half a period more
    EXPECT_LT(calcLag(BetweenSamples::Extrapolate), 0.15);
}

TEST(CommandReceiver, ExtrapolationDoesNotOvershootACommandThatJumpsOrStops) {
    CommandReceiver receiver(BetweenSamples::Extrapolate);
    receiver.reset(at(0.0));
    double t = 0.0;
    const auto send = [&](double q) { receiver.take(t += 0.05, at(q)); };
    for (int k = 0; k < 10; ++k) send(0.0);
    for (const double q : {1.0, 1.0, -2.0, -2.0, 5.0}) {
        send(q);
        EXPECT_EQ(calc(receiver, t + 0.04).q[0], q);
    }
    for (int k = 1; k < 10; ++k) send(5.0 + k);
    send(14.0);  // stops
    EXPECT_EQ(calc(receiver, t + 0.04).q[0], 14.0);
}

TEST(CommandReceiver, ExtrapolationStandsWhereNothingComes) {
    CommandReceiver receiver(BetweenSamples::Extrapolate);
    receiver.reset(at(0.0));
    for (int k = 0; k <= 20; ++k) receiver.take(0.1 * k, at(0.1 * k));
    EXPECT_NEAR(calc(receiver, 2.1).q[0], 2.1, 1e-12);
    EXPECT_NEAR(calc(receiver, 2.2).q[0], 2.2, 1e-9);
    EXPECT_NEAR(calc(receiver, 9.0).q[0], 2.2, 1e-9);  // two periods after the last
    EXPECT_EQ(calc(receiver, 9.0).qd[0], 0.0);
}

TEST(CommandReceiver, PosesTurnAtAConstantRate) {
    for (const BetweenSamples between : {BetweenSamples::Interpolate, BetweenSamples::Extrapolate}) {
        const Eigen::Vector3d rate(0.3, -0.5, 0.8), velocity(0.1, 0.2, -0.3);
        const auto pose = [&](double t) {
            MotionCommand command;
            command.space = MotionCommand::Space::Tool;
            command.tool = {velocity * t, calcRotation(rate * t)};
            return command;
        };
        CommandReceiver receiver(between);
        receiver.reset(pose(0.0));
        for (int k = 0; k <= 40; ++k) receiver.take(0.05 * k, pose(0.05 * k));
        const double behind = between == BetweenSamples::Interpolate ? 0.05 : 0.0;
        for (const double t : {2.0, 2.02, 2.049}) {
            const MotionCommand command = calc(receiver, t), truth = pose(t - behind);
            EXPECT_LT((command.tool.position - truth.tool.position).norm(), 1e-12);
            EXPECT_LT(command.tool.orientation.angularDistance(truth.tool.orientation), 1e-7);
            EXPECT_LT((command.toolTwist.head<3>() - velocity).norm(), 1e-9);
            EXPECT_LT((command.toolTwist.tail<3>() - rate).norm(), 1e-7);
        }
    }
}

TEST(CommandReceiver, SamplesAtTheSameTimeAndLongOrientationsAreTaken) {
    for (const BetweenSamples between :
         {BetweenSamples::Hold, BetweenSamples::Interpolate, BetweenSamples::Extrapolate}) {
        CommandReceiver receiver(between);
        MotionCommand command = at(0.0);
        command.space = MotionCommand::Space::Tool;
        command.tool.orientation.coeffs() *= 1.5;
        receiver.reset(command);
        for (int k = 0; k < 5; ++k) receiver.take(0.0, command);
        const MotionCommand out = calc(receiver, 0.01);
        EXPECT_TRUE(out.tool.position.allFinite() && out.toolTwist.allFinite());
        EXPECT_NEAR(out.tool.orientation.norm(), 1.0, 1e-12);
    }
}

TEST(CommandReceiver, DoesNotAllocate) {
    CommandReceiver receiver(BetweenSamples::Extrapolate);
    receiver.reset(at(0.0));
    MotionCommand out = at(0.0);
    const MotionCommand sample = at(1.0);
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    const testing::AllocationCounter allocations;
    for (int k = 0; k < 1000; ++k) {
        receiver.take(0.01 * k, sample);
        receiver.calc(0.01 * k + 0.005, out);
    }
    EXPECT_EQ(allocations.count(), 0);
}

}  // namespace
}  // namespace viable
