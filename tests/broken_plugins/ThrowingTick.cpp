#include <stdexcept>

#include "BrokenPlugin.h"

namespace {

class ThrowingTick : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override { throw std::runtime_error("the filter lost its temper"); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowingTick, "throwing_tick", "Throws in every tick after the first after_ticks.",
              broken::LateOptions)
