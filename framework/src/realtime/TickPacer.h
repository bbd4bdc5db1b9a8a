#pragma once

#include <cmath>
#include <cstdint>

namespace viable {

/** What waiting for a tick has come to. */
struct WakeUp {
    /** A signal came before the tick: see whether to stop, and wait() again for the same tick. */
    bool isInterrupted = false;
    /** The time was not yet there when wait() was called. Only then is the lateness that of the wake-up; else the work
    of the tick before took longer than a tick. */
    bool hasSlept = false;
    /** Number of the tick that begins now; the first after start() is 1. */
    std::int64_t tick = 0;
    /** From the time of the tick that was waited for until now [ns]. */
    std::int64_t lateness_ns = 0;
    /** Whole ticks that have passed unseen between that one and `tick`; in time: 0. */
    std::int64_t missed = 0;
};

/** Wakes a loop at start + k * tick by CLOCK_MONOTONIC, which no setting of the clock moves and which stands still while
the machine sleeps.
Guarantees: the times are absolute, rounded to 1 ns each, so nothing adds up (drift: none); after missed ticks the next
ones are where they would have been without.
Real time: no allocation, lock or throw. Thread: one caller at a time. */
class TickPacer {
public:
    /** @param tick_s  longer than 0 [s] */
    explicit TickPacer(double tick_s) : tick_ns_(1e9 * tick_s) {}

    /** Time 0 is now, or at `start_ns` by CLOCK_MONOTONIC [ns]. */
    void start() { start(readClock_ns()); }
    void start(std::int64_t start_ns) {
        start_ns_ = start_ns;
        tick_ = 0;
    }
    /** Sleeps until the next tick, not at all where that has passed. */
    WakeUp wait();

    /** When the tick comes that wait() waits for, by CLOCK_MONOTONIC [ns]. */
    std::int64_t getNext_ns() const { return getTime_ns(tick_ + 1); }
    /** The bookkeeping of wait(), for who sleeps in another way (a simulated clock): it is `now_ns`, and the next tick
    has come. */
    WakeUp arrive(std::int64_t now_ns, bool hasSlept);

    /** CLOCK_MONOTONIC [ns]. */
    static std::int64_t readClock_ns();

private:
    std::int64_t getTime_ns(std::int64_t tick) const {
        return start_ns_ + std::llround(static_cast<double>(tick) * tick_ns_);
    }

    double tick_ns_;
    std::int64_t start_ns_ = 0, tick_ = 0;
};

}  // namespace viable
