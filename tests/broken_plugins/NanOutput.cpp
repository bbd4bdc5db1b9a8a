#include <limits>

#include "BrokenPlugin.h"

namespace {

class NanOutput : public broken::LateFilter {
    void misbehave(viable::FilterDecision& decision) override {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        decision.torque.setConstant(nan);
        decision.acceleration.setConstant(nan);
        decision.jerk.setConstant(nan);
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, NanOutput, "nan_output", "Decides NaN in every tick after the first after_ticks.",
              broken::kLateParameters)
