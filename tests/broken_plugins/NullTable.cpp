#include "BrokenPlugin.h"

// Shows nothing.
VIABLE_BROKEN_TABLE("null_table", return nullptr)
