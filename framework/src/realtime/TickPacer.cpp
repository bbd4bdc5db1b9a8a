#include "realtime/TickPacer.h"

#include <time.h>

#include <cerrno>

namespace viable {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

std::int64_t TickPacer::readClock_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<std::int64_t>(now.tv_sec) * kSecond_ns + now.tv_nsec;
}

WakeUp TickPacer::wait() {
    const std::int64_t next_ns = getNext_ns();
    const bool hasSlept = readClock_ns() < next_ns;
    if (hasSlept) {
        const timespec until{static_cast<time_t>(next_ns / kSecond_ns), static_cast<long>(next_ns % kSecond_ns)};
        if (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) return {true, false, tick_};
    }
    return arrive(readClock_ns(), hasSlept);
}

WakeUp TickPacer::arrive(std::int64_t now_ns, bool hasSlept) {
    WakeUp wakeUp;
    wakeUp.hasSlept = hasSlept;
    wakeUp.lateness_ns = now_ns - getNext_ns();
    ++tick_;
    if (wakeUp.lateness_ns > 0) {
        wakeUp.missed = static_cast<std::int64_t>(static_cast<double>(wakeUp.lateness_ns) / tick_ns_);
        // Rounded to 1 ns, the tick that this names may still be to come, or the one after it be there.
        if (getTime_ns(tick_ + wakeUp.missed) > now_ns) --wakeUp.missed;
        if (getTime_ns(tick_ + wakeUp.missed + 1) <= now_ns) ++wakeUp.missed;
        tick_ += wakeUp.missed;
    }
    wakeUp.tick = tick_;
    return wakeUp;
}

}  // namespace viable
