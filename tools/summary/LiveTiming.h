#pragma once

#include <string>
#include <vector>

#include "realtime/LatencyHistogram.h"

namespace viable {

/** How punctual a live run was. */
struct LiveTiming {
    bool isRealTime = false;            ///< priority and locked memory were had
    std::vector<std::string> refusals;  ///< what the system refused, each with its remedy
    bool hasClock = false;              ///< the plant made the ticks
    /** From the time of a tick to the loop's wake-up; of the computer's clock only. */
    LatencyHistogram wakeUp;
    LatencyHistogram compute;   ///< of a tick, with the plant's part, without counting and handing it to the log
    LatencyHistogram interval;  ///< between the beginnings of two ticks, less those that are missed
    std::int64_t ticks = 0, missed = 0, longestGap = 0;  ///< [ticks]
    std::int64_t lostRows = 0;                           ///< ticks that the log does not have: the disk was too slow
    struct Change {
        std::string state, asker;
        double time_s;
    };
    std::vector<Change> changes;  ///< of the state
    /** What the operator wanted to keep; the first is number 1. */
    struct Take {
        double begin_s, end_s;  ///< of its first and its last tick
    };
    std::vector<Take> takes;
};

}  // namespace viable
