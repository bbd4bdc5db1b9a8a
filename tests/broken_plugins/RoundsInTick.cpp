#include <cfenv>

#include "BrokenPlugin.h"

namespace {

class RoundsInTick : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override { std::fesetround(FE_UPWARD); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, RoundsInTick, "rounds_in_tick",
              "Rounds upward in every tick after the first after_ticks.", broken::LateOptions)
