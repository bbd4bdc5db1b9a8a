#include "viable/filter/CertifiedBrakingFilter.h"
#include "viable/plugin/PluginExport.h"

namespace {

using namespace viable;

// Defaults: those of CertifiedBrakingOptions (the suite compares them).
const ParameterSpec kParameters[] = {
    parameter::number("k_alpha", "1/s", ".inf",
                      "How fast a limit may be approached; k_alpha * tick_s must not exceed 1. "
                      "Infinite: as fast as the limits allow.")
        .above(0)
        .orInfinite(),
    parameter::number("gamma", "1/s", "20.0",
                      "How fast the acceleration follows the desired one; gamma * tick_s must stay below 2.")
        .above(0),
    parameter::choice(
        "objective", "torque|tool|joint|path", "torque",
        "In what the change is kept small: torque (13), the tool's jerk, the joints' jerks, or all joints "
        "held back alike on the way to the desired jerks (one joint pressed against its limit then holds all)."),
    parameter::flag("recovery", "false",
                    "Accept a start outside the limits, or one that must leave them, and return within the limits."),
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, viable::CertifiedBrakingFilter, "certified_braking",
              "Keeps position, velocity, acceleration and jerk limits in sampled time, always: every tick "
              "holds a checked stop.",
              kParameters)
