#include "BrokenPlugin.h"

// Shows a table that is too long for this interface.
VIABLE_BROKEN_TABLE("long_table", library.size += 8)
