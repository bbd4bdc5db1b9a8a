#include "plugin/CommandReceiver.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/MinimumJerk.h"
#include "core/RotationVector.h"
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

/** One that waits at 0. */
struct Receiver : CommandReceiver {
    explicit Receiver(BetweenSamples between = BetweenSamples::Extrapolate) : CommandReceiver(between) {
        reset(at(0.0));
    }
};

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
    Receiver receiver(BetweenSamples::Interpolate);
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
    Receiver receiver(BetweenSamples::Interpolate);
    double t = 0.0;
    for (int k = 0; k < 1000; ++k) {
        const double before = calc(receiver, t).q[0];
        receiver.take(t, at(draw(-1.0, 1.0)));
        if (k > 0) EXPECT_NEAR(calc(receiver, t).q[0], before, 1e-12);
        t += draw(0.001, 0.2);
    }
}

/** RMS distance to what is sent, in periods of an even motion, 30 times a second with jitter and loss. */
double calcLag(BetweenSamples between) {
    std::mt19937_64 random(3);
    const auto draw = [&] { return std::uniform_real_distribution<double>(0.0, 1.0)(random); };
    Receiver receiver(between);
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
    Receiver receiver;
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

// One sample that is far off is neither gone beyond, nor does it hide the next one or end the extrapolation.
TEST(CommandReceiver, OutliersAreNotGoneBeyondAndSoonForgotten) {
    Receiver receiver;
    for (int k = 0; k < 400; ++k) {
        const double t = 0.01 * k, q = std::sin(t);
        const bool isOff = k == 100 || k == 110 || k == 131;
        receiver.take(t, at(isOff ? q + 1.0 : q));
        const double next = calc(receiver, t + 0.009).q[0];
        if (k > 20) EXPECT_NEAR(next, isOff ? q + 1.0 : q, 0.02) << k;
        if ((k > 50 && k < 100) || k > 180) EXPECT_NEAR(next, std::sin(t + 0.009), 0.003) << k;
    }
}

TEST(CommandReceiver, AfterSilenceTheCommandIsTheLastSample) {
    Receiver receiver;
    for (int k = 0; k <= 20; ++k) receiver.take(0.1 * k, at(0.1 * k));
    EXPECT_NEAR(calc(receiver, 2.1).q[0], 2.1, 1e-12);
    EXPECT_NEAR(calc(receiver, 2.2).q[0], 2.2, 1e-9);  // two periods after the last
    const MotionCommand back = calc(receiver, 2.9);
    EXPECT_LT(back.q[0], 2.15);
    EXPECT_LT(back.qd[0], 0.0);
    EXPECT_EQ(calc(receiver, 9.0).q[0], 2.0);
    EXPECT_EQ(calc(receiver, 9.0).qd[0], 0.0);
}

TEST(CommandReceiver, AGapIsBridgedForAFifthOfASecond) {
    Receiver receiver;
    for (int k = 0; k <= 200; ++k) receiver.take(0.01 * k, at(0.01 * k));
    EXPECT_NEAR(calc(receiver, 2.19).q[0], 2.19, 1e-9);
    EXPECT_LT(calc(receiver, 2.4).q[0], 2.2);
    EXPECT_NEAR(calc(receiver, 2.4).qd[0], -1.0 / 7.5, 1e-9);
    EXPECT_EQ(calc(receiver, 3.8).q[0], 2.0);
}

/** RMS distance to a hand that reaches to and fro in `reach_s` with pauses, 10 samples a second. */
double calcDistance(BetweenSamples between, double reach_s) {
    Receiver receiver(between);
    const auto hand = [&](double t) {
        const double s = std::fmod(t, 2.2 * reach_s) / reach_s;
        const double way = calcMinimumJerk(s < 1.1 ? s : s - 1.1).value;
        return s < 1.1 ? way : 1.0 - way;
    };
    double sum = 0.0;
    for (int k = 0; k < 30000; ++k) {
        if (k % 100 == 0) receiver.take(0.001 * k, at(hand(0.001 * k)));
        sum += std::pow(calc(receiver, 0.001 * k).q[0] - hand(0.001 * k), 2);
    }
    return std::sqrt(sum / 30000);
}

TEST(CommandReceiver, AHandThatStartsAndStopsIsNearerThanHeld) {
    for (const auto& [reach_s, share] : {std::pair(0.47, 0.6), std::pair(0.63, 0.4), std::pair(1.03, 0.25)})
        EXPECT_LT(calcDistance(BetweenSamples::Extrapolate, reach_s),
                  share * calcDistance(BetweenSamples::Hold, reach_s))
            << reach_s;
}

// A motion that begins after noise is no outlier.
TEST(CommandReceiver, AMotionThatBeginsAfterANoisyRestIsFollowed) {
    std::mt19937_64 random(3);
    Receiver receiver;
    double sum = 0.0;
    for (int k = 0; k < 630; ++k) {
        const double t = k / 30.0, noise = std::uniform_real_distribution<double>(-1e-5, 1e-5)(random);
        receiver.take(t, at(0.3 * calcMinimumJerk(t - 20.0).value + noise));
        sum += std::pow(calc(receiver, t + 0.033).q[0] - 0.3 * calcMinimumJerk(t + 0.033 - 20.0).value, 2);
    }
    EXPECT_LT(std::sqrt(sum / 30), 0.002);  // held: 0.012
}

TEST(CommandReceiver, WhatCannotBeToldIsHeld) {
    std::mt19937_64 random(3);
    Receiver receiver;
    double sum = 0.0;
    for (int k = 0; k < 1000; ++k) {
        const double q = std::uniform_real_distribution<double>(-1.0, 1.0)(random);
        receiver.take(0.1 * k, at(q));
        if (k >= 100) sum += std::pow(calc(receiver, 0.1 * k + 0.099).q[0] - q, 2);
    }
    EXPECT_LT(std::sqrt(sum / 900), 0.05);
}

TEST(CommandReceiver, SetPointsAreNotExtrapolated) {
    Receiver receiver;
    for (int k = 1; k < 5; ++k) {
        receiver.take(k, at(0.2 * k));
        for (const double later : {0.0, 0.5, 0.9}) EXPECT_EQ(calc(receiver, k + later).q[0], 0.2 * k);
    }
}

TEST(CommandReceiver, ASenderThatChangesItsRateIsFollowedSoon) {
    for (const auto& [before, after] : {std::pair(0.1, 0.005), std::pair(0.005, 0.1), std::pair(10.0, 0.033)}) {
        Receiver receiver;
        double t = 0.0;
        const auto send = [&](double period, int count) {
            for (int k = 0; k < count; ++k) {
                t += period;
                receiver.take(t, at(0.5 * t));
            }
        };
        send(before, before > 1.0 ? 2 : 40);
        send(after, before > after ? 10 : 6);  // from here on as if it had never been otherwise
        for (int k = 0; k < 60; ++k) {
            send(after, 1);
            EXPECT_NEAR(calc(receiver, t + 0.9 * after).q[0], 0.5 * (t + 0.9 * after), 0.05 * after)
                << before << " s, then " << after << ", " << k;
        }
    }
}

TEST(CommandReceiver, ManyLostSamplesTellNoOtherSpeed) {
    for (const double loss : {0.1, 0.2, 0.4}) {
        std::mt19937_64 random(5);
        Receiver receiver;
        double sum = 0.0, ahead = 0.0;
        int count = 0;
        for (int k = 0; k < 2000; ++k) {
            if (k > 20 && std::uniform_real_distribution<double>(0.0, 1.0)(random) < loss) continue;
            receiver.take(0.02 * k, at(0.02 * k));
            if (k < 100) continue;
            const MotionCommand next = calc(receiver, 0.02 * k + 0.015);
            sum += std::pow((next.q[0] - 0.02 * k - 0.015) / 0.02, 2);
            ahead = std::max(ahead, (next.q[0] - 0.02 * k - 0.015) / 0.02);
            ++count;
        }
        EXPECT_LT(std::sqrt(sum / count), loss < 0.3 ? 0.1 : 0.5) << loss;
        EXPECT_LT(ahead, loss < 0.3 ? 0.06 : 2.0) << loss;
    }
}

TEST(CommandReceiver, BurstsAndMuchJitterTellNoOtherSpeed) {
    for (const int burst : {2, 3, 4}) {
        Receiver receiver;
        const double period = 0.02;
        double worst = 0.0;
        for (int k = 0; k < 400; ++k) {  // all of a burst come when its last is sent, 1 ms apart
            const int last = k / burst * burst + burst - 1;
            const double t = last * period + 0.001 * (k % burst);
            receiver.take(t, at(k * period));
            if (k > 100) worst = std::max(worst, std::abs(calc(receiver, t + period).q[0] - (t + period)));
        }
        EXPECT_LT(worst, 1.6 * burst * period) << burst;
    }
    std::mt19937_64 random(3);
    Receiver receiver;
    double sum = 0.0;
    for (int k = 0; k < 3000; ++k) {
        const double t = k + 0.95 * std::uniform_real_distribution<double>(0.0, 1.0)(random);
        receiver.take(0.02 * t, at(k));
        sum += std::pow(calc(receiver, 0.02 * (t + 0.3)).q[0] - (t + 0.3), 2);
    }
    EXPECT_LT(std::sqrt(sum / 3000), 0.85);  // held, 0.94: little can be known
}

TEST(CommandReceiver, AJointThatJumpsIsTakenAtOnceBesideOneThatMoves) {
    CommandReceiver receiver(BetweenSamples::Extrapolate);
    MotionCommand command;
    command.q = command.qd = JointVector::Zero(2);
    receiver.reset(command);
    for (int k = 0; k < 20; ++k) {
        command.q << (k < 15 ? 0.0 : 1.0), 0.1 * k;
        receiver.take(0.1 * k, command);
        EXPECT_EQ(calc(receiver, 0.1 * k).q[0], command.q[0]);
    }
    EXPECT_NEAR(calc(receiver, 1.95).q[1], 1.95, 1e-9);
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

TEST(CommandReceiver, LargeTurnsGoTheirWayWithSamplesLost) {
    CommandReceiver receiver(BetweenSamples::Extrapolate);
    const auto pose = [](double t) {
        MotionCommand command;
        command.space = MotionCommand::Space::Tool;
        command.tool.orientation = calcRotation(Eigen::Vector3d(0.0, 0.0, 20.0 * t));  // 2 rad a sample
        return command;
    };
    receiver.reset(pose(0.0));
    for (int k = 0; k < 200; ++k) {
        if (k % 7 == 3) continue;
        receiver.take(0.1 * k, pose(0.1 * k));
        const MotionCommand now = calc(receiver, 0.1 * k + 0.02);
        EXPECT_TRUE(now.tool.orientation.coeffs().allFinite());
        // A lost sample makes more than half a turn of it, which nobody can tell; three later it is found again.
        if (k % 7 < 3 && k > 10)
            EXPECT_LT(now.tool.orientation.angularDistance(pose(0.1 * k + 0.02).tool.orientation), 2.2) << k;
    }
}

TEST(CommandReceiver, ResetForgetsEverything) {
    CommandReceiver used(BetweenSamples::Extrapolate), fresh(BetweenSamples::Extrapolate);
    used.reset(at(0.0));
    for (int k = 0; k < 50; ++k) used.take(0.01 * k, at(0.3 * k));
    used.reset(at(1.0));
    fresh.reset(at(1.0));
    for (int k = 0; k < 50; ++k) {
        used.take(0.02 * k, at(1.0 + 0.1 * k));
        fresh.take(0.02 * k, at(1.0 + 0.1 * k));
        EXPECT_EQ(calc(used, 0.02 * k + 0.013).q, calc(fresh, 0.02 * k + 0.013).q);
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
    Receiver receiver;
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
