#include <cfenv>

#include "BrokenPlugin.h"

namespace {

// Changes the arithmetic not when it is loaded but when it is made.
class RoundingFilter : public broken::Filter {
public:
    RoundingFilter() { std::fesetround(FE_UPWARD); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, RoundingFilter, "changes_rounding", "Rounds upward.", viable::NoOptions)
