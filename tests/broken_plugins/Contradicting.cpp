#include "BrokenPlugin.h"

namespace {

class Contradicting : public broken::LateFilter {
    void misbehave(viable::FilterDecision& decision) override {
        decision.held = viable::HeldQuantity::Jerk;
        decision.jerk.setConstant(1e11);  // the acceleration says nothing of this
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Contradicting, "contradicting",
              "Gives a jerk that does not belong to its acceleration in every tick after the first after_ticks.",
              broken::kLateParameters)
