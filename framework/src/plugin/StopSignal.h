#pragma once

#include <atomic>

namespace viable::detail {

/** The signal that asked for the end; 0: none so far. Set by the program's signal handlers. */
extern std::atomic<int> stopSignal;

}  // namespace viable::detail
