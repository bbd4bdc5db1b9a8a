#include "BrokenPlugin.h"

void functionThatNobodyDefines();

namespace {

// With lazy binding the process would end here, in the middle of the motion.
struct UnresolvedFilter : broken::Filter {
    void reset(const viable::MotionState&) override { functionThatNobodyDefines(); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, UnresolvedFilter, "unresolved_symbol", "Misses a function.", viable::NoOptions)
