#include "Tovzbp.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

namespace {

const ParameterSpec kParameters[] = {
    parameter::number("k_alpha", "1/s", "5.0",
                      "Slope of alpha: how fast a limit may be approached; k_alpha * tick_s must not exceed 1.")
        .above(0),
    parameter::number("gamma", "1/s", "20.0",
                      "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
        .above(0),
};

}  // namespace

Tovzbp::Tovzbp() : BrakingPolicyFilter("tovzbp") {}

BrakingStop Tovzbp::calcStop(double v, double a, const AxisLimits& limits) const {
    const bool isUpward = v > 0.0 || (v == 0.0 && a >= 0.0);
    return calcVelocityZeroingStop(v, a, limits, isUpward ? LimitSide::Upper : LimitSide::Lower);
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::Tovzbp, "tovzbp",
              "Tries to keep all limits by the time-optimal velocity-zeroing braking policy, which oscillates at a "
              "position limit (the paper's S5).",
              viable::kParameters)
