#include "BrokenPlugin.h"

// Two parameters share one name.
VIABLE_BROKEN_TABLE("twin_parameters", parameters[1].name = "gain")
