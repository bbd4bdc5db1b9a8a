#include "viable/plugin/FaultMessage.h"

#include <cstdio>

#include "plugin/FaultExplanation.h"

namespace viable {

namespace {

thread_local char explanation[512] = "";
thread_local bool isTaken = true;

}  // namespace

void explainFault(const char* message) noexcept {
    std::snprintf(explanation, sizeof explanation, "%s", message);
    isTaken = false;
}

const char* detail::takeFaultExplanation() noexcept {
    const bool wasTaken = isTaken;
    isTaken = true;
    return wasTaken ? "" : explanation;
}

}  // namespace viable
