#include "BrokenPlugin.h"

namespace {

class WrongSize : public broken::LateFilter {
    void misbehave(viable::FilterDecision& decision) override { decision.value.setZero(decision.value.size() - 1); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, WrongSize, "wrong_size",
              "Decides for one joint too few in every tick after the first after_ticks.", broken::LateOptions)
