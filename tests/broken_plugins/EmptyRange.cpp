#include "BrokenPlugin.h"

// No number is in the range of a parameter.
VIABLE_BROKEN_TABLE("empty_range", parameters[0].min = 2; parameters[0].max = 1)
