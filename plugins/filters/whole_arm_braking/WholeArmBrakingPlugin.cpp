#include "filter/WholeArmBrakingFilter.h"
#include "viable/plugin/PluginExport.h"

VIABLE_PLUGIN(viable::SafetyFilter, viable::WholeArmBrakingFilter, "whole_arm_braking",
              "Certified braking of the whole arm: joint limits, obstacles, self-collision and "
              "torque limits, now and along a checked stop.",
              viable::WholeArmBrakingOptions)
