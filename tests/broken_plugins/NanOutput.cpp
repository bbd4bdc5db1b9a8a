#include <limits>

#include "BrokenPlugin.h"

namespace {

class NanOutput : public broken::LateFilter {
    void misbehave(viable::FilterDecision& decision) override {
        decision.value.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, NanOutput, "nan_output", "Decides NaN in every tick after the first after_ticks.",
              broken::LateOptions)
