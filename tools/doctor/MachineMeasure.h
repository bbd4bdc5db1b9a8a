#pragma once

#include "realtime/LatencyHistogram.h"
#include "realtime/RealTimeSetup.h"

namespace viable {

struct MeasureWish {
    double duration_s = 5.0;  ///< of all of it
    double tick_s = 0.001;
    RealTimeWish realTime;
};

/** A loop's times on this machine, with or without priority. */
struct LoopTimes {
    LatencyHistogram wakeUp;             ///< lateness, where it slept before
    LatencyHistogram work;               ///< time that the same arithmetic took, in every tick
    LatencyHistogram udp;                ///< 512 byte over 127.0.0.1 to another process and back, in every other tick
    LatencyHistogram sharedMemory;       ///< a number over shared memory and back (futex), in the ticks between
    std::int64_t ticks = 0, missed = 0;  ///< missed ones are among the ticks
    std::int64_t lost = 0;               ///< answers that did not come within 0.1 s
};

struct Measurement {
    double duration_s = 0.0, tick_s = 0.0;
    LoopTimes plain;
    LoopTimes priority;  ///< nothing counted where there is no priority
    // What `priority` ran with, as RealTimeState has it.
    int grantedPriority = 0, cpu = -1;
    MemoryLock memoryLock = MemoryLock::None;
    bool holdsLatency = false;
    std::vector<RealTimeRefusal> refusals;
};

/** Runs a loop of the tick, with and without priority in turns of about a second, so that both meet the same load. Two more
processes answer, with the same priority; all have ended when it returns. The first 10 ticks of a turn are not counted.
Throws std::system_error where there can be no process, socket or memory, or no answer. */
Measurement measureMachine(const MeasureWish& wish);

}  // namespace viable
