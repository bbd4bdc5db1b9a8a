#include "Tosbp.h"

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

Tosbp::Tosbp() : BrakingPolicyFilter("tosbp") {}

BrakingStop Tosbp::calcStop(double v, double a, const AxisLimits& limits) const {
    return calcStationaryStop(v, a, limits);
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::Tosbp, "tosbp",
              "Keeps position, velocity, acceleration and jerk limits by the time-optimal stationary braking "
              "policy (the paper's C2 and S4).",
              viable::kParameters)
