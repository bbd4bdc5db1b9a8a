#include "viable/core/FilterStatus.h"

#include "core/Text.h"

namespace viable {

const char* getName(FilterStatus status) {
    return detail::enumName<FilterStatus::Ended>(status, {"passed", "modified", "stopped_by_plan", "recovering",
                                                          "infeasible", "invalid_input", "faulted", "ended"});
}

}  // namespace viable
