#pragma once

#include <atomic>

namespace viable {

/** What is done before a second signal ends the program at once, such as giving a terminal back; async-signal-safe. Null:
nothing. */
void setLastAct(void (*act)());
/** Does that; for who ends the program otherwise. Async-signal-safe. */
void doLastAct();

/** The signal that asked for the end; 0: none so far. */
const std::atomic<int>& getStopSignal();

/** From now on the first SIGINT, SIGTERM or SIGHUP is only noted, the second ends the program with code 128 + n. A SIGHUP
that is ignored already, as under nohup, stays ignored. Where SIGPIPE is ignored, one that another process sends counts as
well; that of a write to a closed pipe stays ignored. Returns getStopSignal(). */
const std::atomic<int>& catchStopSignals();

}  // namespace viable
