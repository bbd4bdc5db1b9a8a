#include "viable/plugin/HostServices.h"

#include <cstdio>

#include "plugin/FaultExplanation.h"
#include "plugin/StopSignal.h"

namespace viable {

namespace {

thread_local char explanation[512] = "";
thread_local bool isTaken = true;

}  // namespace

void explainFault(const char* message) noexcept {
    std::snprintf(explanation, sizeof explanation, "%s", message);
    isTaken = false;
}

const char* detail::readFaultExplanation() noexcept {
    const bool wasTaken = isTaken;
    isTaken = true;
    return wasTaken ? "" : explanation;
}

std::atomic<int> detail::stopSignal{0};

bool isStopRequested() noexcept {
    return detail::stopSignal.load(std::memory_order_relaxed) != 0;
}

}  // namespace viable
