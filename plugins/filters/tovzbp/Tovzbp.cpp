#include "Tovzbp.h"

#include "viable/plugin/PluginExport.h"

namespace viable {

BrakingStop Tovzbp::calcStop(double v, double a, const AxisLimits& limits) const {
    const bool isUpward = v > 0.0 || (v == 0.0 && a >= 0.0);
    return calcVelocityZeroingStop(v, a, limits, isUpward ? LimitSide::Upper : LimitSide::Lower);
}

}  // namespace viable

VIABLE_PLUGIN(viable::SafetyFilter, viable::Tovzbp, "tovzbp",
              "Tries to keep all limits by the time-optimal velocity-zeroing braking policy, which oscillates at a "
              "position limit (the paper's S5).",
              viable::BrakingPolicyOptions)
