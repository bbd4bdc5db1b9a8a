#include <cstdlib>

#include "BrokenPlugin.h"

namespace {

class CallsExit : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override { std::exit(0); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, CallsExit, "calls_exit", "Calls exit(0) after the first after_ticks.",
              broken::LateOptions)
