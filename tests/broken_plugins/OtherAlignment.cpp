// Built with another Eigen alignment, as -march=native does on a machine with AVX-512.
#define EIGEN_MAX_ALIGN_BYTES 64
#include "BrokenPlugin.h"

VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, "other_alignment", "Built otherwise.", viable::NoOptions)
