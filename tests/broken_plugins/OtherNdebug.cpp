// Built with NDEBUG, as CMake's Release does unless -UNDEBUG follows.
#ifndef NDEBUG
#define NDEBUG
#endif
#include "BrokenPlugin.h"

VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, "other_ndebug", "Built otherwise.", viable::NoOptions)
