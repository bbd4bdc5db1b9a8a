#pragma once

#include "experiment/RunningCase.h"

namespace viable {

struct RunOptions {
    std::filesystem::path log;  ///< log file to create; empty: none
    /** Becomes non-zero when the user wants the run to end: the arm is braked, the log finished. May be null. */
    const std::atomic<int>* stopRequest = nullptr;
    /** Called now and then with the share done (0..1), from the running thread, between ticks. May be empty. */
    std::function<void(double)> progress;
    /** No other case runs in this process meanwhile: memory by which it grows is this one's. */
    bool isAlone = true;
};

/** Runs a case to its end, or to the end of the stop that a failure or a request caused; after a lost tracking for
kSettling_s more, until the real arm has come to rest, too. Its plugins are destroyed afterwards. Throws Error only before
the first tick (log file, a map that is gone, a plugin's reset()). */
CaseResult runCase(std::unique_ptr<ConfiguredCase> configured, const RunOptions& options);

}  // namespace viable
