#include "BrokenPlugin.h"

// Has an empty table.
VIABLE_BROKEN_TABLE("no_entries", library.entryCount = 0)
