#include <cstdlib>

#include "BrokenPlugin.h"

namespace {

class Aborts : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override { std::abort(); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Aborts, "aborts", "Calls abort() after the first after_ticks.", broken::LateOptions)
