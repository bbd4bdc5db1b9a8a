#include "BrokenPlugin.h"

// Shows the longer table of a later interface.
VIABLE_BROKEN_TABLE("long_table", library.size += 8; library.stamp.interfaceVersion = 7)
