#include "BrokenPlugin.h"

// Shows a table that is too short for this interface.
VIABLE_BROKEN_TABLE("short_table", library.size -= 8)
