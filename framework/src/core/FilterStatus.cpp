#include "viable/core/FilterStatus.h"

namespace viable {

const char* getName(FilterStatus status) {
    switch (status) {
        case FilterStatus::Passed:
            return "passed";
        case FilterStatus::Modified:
            return "modified";
        case FilterStatus::StoppedByPlan:
            return "stopped_by_plan";
        case FilterStatus::Recovering:
            return "recovering";
        case FilterStatus::Infeasible:
            return "infeasible";
        case FilterStatus::InvalidInput:
            return "invalid_input";
        case FilterStatus::Ended:
            return "ended";
        case FilterStatus::Faulted:
            return "faulted";
    }
    return "unknown";
}

}  // namespace viable
