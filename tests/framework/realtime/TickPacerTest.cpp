// Pacing, on the real clock and on made-up ones; faults 24 and 25.
#include "realtime/TickPacer.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <signal.h>
#include <time.h>

#include <atomic>
#include <random>
#include <thread>

#include "viable/testing/AllocationCounter.h"

namespace viable {
namespace {

constexpr std::int64_t kStart = 1'234'567'890'123;

void pauseFor(long ns) {
    const timespec pause{ns / 1'000'000'000, ns % 1'000'000'000};
    nanosleep(&pause, nullptr);
}

TEST(TickPacer, TicksAreWhereTheyBelongAfterAMillionOfThem) {
    for (const double tick_s : {0.001, 0.00025, 1.0 / 3000.0, 0.01}) {
        TickPacer pacer(tick_s);
        pacer.start(kStart);
        for (std::int64_t k = 1; k <= 1'000'000; ++k) {
            ASSERT_EQ(pacer.getNext_ns(), kStart + std::llround(1e9 * tick_s * static_cast<double>(k)));
            const WakeUp wakeUp = pacer.arrive(pacer.getNext_ns(), true);
            ASSERT_EQ(wakeUp.tick, k);
            ASSERT_EQ(wakeUp.lateness_ns, 0);
            ASSERT_EQ(wakeUp.missed, 0);
        }
    }
}

TEST(Fault24, JitterOfAnySizeNeitherMovesTheTicksNorLosesOne) {
    std::mt19937_64 random(1);
    for (const double tick_s : {0.001, 1.0 / 3000.0}) {
        const auto tick_ns = static_cast<std::int64_t>(1e9 * tick_s);
        for (const std::int64_t largest : {tick_ns / 20, tick_ns / 2, 3 * tick_ns, 3000 * tick_ns}) {
            TickPacer pacer(tick_s);
            pacer.start(kStart);
            std::int64_t seen = 0, missed = 0;
            for (int k = 0; k < 20000; ++k) {
                // Also a clock that is a little early.
                const std::int64_t late =
                    static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(largest)) - 100;
                const std::int64_t now = pacer.getNext_ns() + late;
                const WakeUp wakeUp = pacer.arrive(now, true);
                ++seen;
                missed += wakeUp.missed;
                ASSERT_EQ(wakeUp.lateness_ns, late);
                ASSERT_EQ(wakeUp.tick, seen + missed) << "each tick is seen or missed, once";
                // The tick that begins is the newest that has come, the next one is to come.
                const auto at = [&](std::int64_t tick) {
                    return kStart + std::llround(1e9 * tick_s * static_cast<double>(tick));
                };
                ASSERT_LE(at(wakeUp.tick), late < 0 ? now - late : now);
                ASSERT_GT(at(wakeUp.tick + 1), now);
            }
            EXPECT_EQ(missed > 0, largest > tick_ns);
        }
    }
}

TEST(Fault25, MissedTicksAreCounted) {
    TickPacer pacer(0.001);
    pacer.start(kStart);
    for (const std::int64_t burst : {1, 5, 20, 1000}) {
        const std::int64_t before = pacer.arrive(pacer.getNext_ns(), true).tick;
        const WakeUp wakeUp = pacer.arrive(pacer.getNext_ns() + burst * 1'000'000 + 999'999, false);
        EXPECT_EQ(wakeUp.missed, burst);
        EXPECT_EQ(wakeUp.tick, before + 1 + burst);
        EXPECT_FALSE(wakeUp.hasSlept);
    }
}

TEST(TickPacer, OnTheClockItNeverWakesEarlyAndKeepsToItsTimes) {
    TickPacer pacer(0.002);
    pacer.start();
    const std::int64_t start = pacer.getNext_ns() - 2'000'000;
    std::int64_t ticks = 0;
    for (int k = 0; k < 50; ++k) {
        const WakeUp wakeUp = pacer.wait();
        ASSERT_FALSE(wakeUp.isInterrupted);
        EXPECT_GE(wakeUp.lateness_ns, 0);
        ticks += 1 + wakeUp.missed;
        EXPECT_EQ(wakeUp.tick, ticks);
        EXPECT_GE(TickPacer::readClock_ns(), start + 2'000'000 * wakeUp.tick);
        EXPECT_GT(pacer.getNext_ns(), start + 2'000'000 * wakeUp.tick);
    }
    pauseFor(9'000'000);  // a tick whose work takes four more
    const WakeUp late = pacer.wait();
    EXPECT_FALSE(late.hasSlept);
    EXPECT_GE(late.missed, 3);
    EXPECT_EQ(late.tick, ticks + 1 + late.missed);
}

TEST(TickPacer, ASignalEndsTheWaitAndTheTickIsStillToCome) {
    static std::atomic<int> signals{0};
    struct sigaction action {};
    action.sa_handler = [](int) { ++signals; };
    action.sa_flags = SA_RESTART;  // sleeping is ended all the same
    struct sigaction before {};
    ASSERT_EQ(sigaction(SIGUSR1, &action, &before), 0);
    TickPacer pacer(0.5);
    pacer.start();
    const std::int64_t next = pacer.getNext_ns();
    std::atomic<bool> isOver{false};
    std::thread other([&, target = pthread_self()] {
        while (!isOver) {
            pauseFor(20'000'000);
            pthread_kill(target, SIGUSR1);
        }
    });
    const WakeUp first = pacer.wait();
    isOver = true;
    other.join();
    EXPECT_GT(signals, 0);
    EXPECT_TRUE(first.isInterrupted);
    EXPECT_EQ(first.tick, 0);
    EXPECT_LT(TickPacer::readClock_ns(), next) << "the wait was not ended";
    EXPECT_EQ(pacer.getNext_ns(), next);
    const WakeUp second = pacer.wait();
    EXPECT_FALSE(second.isInterrupted);
    EXPECT_TRUE(second.hasSlept);
    EXPECT_EQ(second.tick, 1 + second.missed);
    sigaction(SIGUSR1, &before, nullptr);
}

TEST(TickPacer, WaitingTakesNoMemory) {
    if (!testing::AllocationCounter::isAvailable()) GTEST_SKIP() << testing::AllocationCounter::whyNot();
    TickPacer pacer(0.0005);
    pacer.start();
    testing::AllocationCounter counter;
    for (int k = 0; k < 20; ++k) pacer.wait();
    EXPECT_EQ(counter.count(), 0);
}

}  // namespace
}  // namespace viable
