#include "viable/plugin/StopRequest.h"

#include "plugin/StopSignal.h"

namespace viable {

std::atomic<int> detail::stopSignal{0};

bool isStopRequested() noexcept {
    return detail::stopSignal.load(std::memory_order_relaxed) != 0;
}

}  // namespace viable
