#include "Tosbp.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

BrakingStop Tosbp::calcStop(double v, double a, const AxisLimits& limits) const {
    return calcStationaryStop(v, a, limits);
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::Tosbp, "tosbp",
              "Keeps position, velocity, acceleration and jerk limits by the time-optimal stationary braking "
              "policy (the paper's C2 and S4).",
              viable::BrakingPolicyOptions)
