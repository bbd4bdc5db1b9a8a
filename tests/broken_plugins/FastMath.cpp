#include "BrokenPlugin.h"

// Nothing is wrong with the source: the build compiles and links it with -ffast-math.
VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, "fast_math", "Built with -ffast-math.", viable::NoOptions)
