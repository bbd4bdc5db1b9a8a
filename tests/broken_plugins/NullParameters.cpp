#include "BrokenPlugin.h"

// Says that it has parameters and shows none.
VIABLE_BROKEN_TABLE("null_parameters", entry.parameters = nullptr)
