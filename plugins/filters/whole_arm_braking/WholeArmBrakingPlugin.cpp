#include "filter/WholeArmBrakingFilter.h"
#include "viable/plugin/PluginExport.h"

namespace {

using namespace viable;

// Defaults: those of WholeArmBrakingOptions (the suite compares them).
const ParameterSpec kParameters[] = {
    parameter::number("k_alpha", "1/s", ".inf",
                      "How fast a limit may be approached, and from where on the arm steers away from an "
                      "obstacle; k_alpha * tick_s must not exceed 1. Infinite: as fast as the limits allow.")
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
                    "Accept a start outside the limits or too near to something, and return within the limits."),
    parameter::number(
        "torque_share", "", ".inf",
        "Share of the motors' torque limits that the nominal torque, as it is held over each tick, may use, "
        "now and along the stop. Infinite: torque is not limited.")
        .above(0)
        .upTo(1)
        .orInfinite(),
    parameter::jointNumbers("torque_rate_Nmps", "Nm/s", ".inf",
                            "Largest change of the nominal torque, now and along the stop. Jerks stay as "
                            "low as it demands.")
        .above(0)
        .orInfinite(),
    parameter::flag("steers", "true",
                    "Look for jerks that lead around an obstacle or along a torque limit; false: only "
                    "brake before it."),
    parameter::number("max_age_s", "s", ".inf",
                      "Older surroundings are not used: the arm stops until "
                      "newer ones come. Those of an experiment file were seen at its start.")
        .above(0)
        .orInfinite(),
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, viable::WholeArmBrakingFilter, "whole_arm_braking",
              "Certified braking of the whole arm: joint limits, obstacles, self-collision and "
              "torque limits, now and along a checked stop.",
              kParameters)
