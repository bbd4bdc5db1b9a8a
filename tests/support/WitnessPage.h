#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace viable::test {

/** What the command `witness` writes into a file in each tick, by a plain store into mapped memory: it stays
when the program is killed, whatever became of the log. */
struct WitnessPage {
    static constexpr std::size_t kKept = 1 << 15;

    std::atomic<std::int64_t> ticks;  ///< begun so far
    std::int64_t begun_ns[kKept];     ///< when tick k began: entry k % kKept, CLOCK_MONOTONIC
};

}  // namespace viable::test
