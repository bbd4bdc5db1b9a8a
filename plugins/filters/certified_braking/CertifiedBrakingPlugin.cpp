#include "viable/filter/CertifiedBrakingFilter.h"
#include "viable/plugin/PluginExport.h"

VIABLE_PLUGIN(viable::SafetyFilter, viable::CertifiedBrakingFilter, "certified_braking",
              "Keeps position, velocity, acceleration and jerk limits in sampled time, always: every tick "
              "holds a checked stop.",
              viable::CertifiedBrakingOptions)
