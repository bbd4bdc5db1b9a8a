#pragma once

#include <algorithm>
#include <chrono>
#include <limits>
#include <vector>

namespace viable {

/** How long single ticks take [us]: all of them, with what the machine does in between, and of each tick its fastest
replay, which is the filter's own. */
struct TickTimes {
    std::vector<double> all, fastest;

    /** @param loop  has rewind(), and step() for a tick */
    template <class Loop>
    static TickTimes measure(Loop& loop, int ticks, int replays) {
        using Clock = std::chrono::steady_clock;
        TickTimes times;
        times.fastest.assign(static_cast<std::size_t>(ticks), std::numeric_limits<double>::infinity());
        for (int replay = 0; replay < replays; ++replay) {
            loop.rewind();
            for (double& tick : times.fastest) {
                const Clock::time_point begin = Clock::now();
                loop.step();
                times.all.push_back(std::chrono::duration<double, std::micro>(Clock::now() - begin).count());
                tick = std::min(tick, times.all.back());
            }
        }
        return times;
    }
};

}  // namespace viable
