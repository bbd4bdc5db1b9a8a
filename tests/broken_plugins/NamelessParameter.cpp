#include "BrokenPlugin.h"

// One parameter has no name.
VIABLE_BROKEN_TABLE("nameless_parameter", parameters[1].name = nullptr)
