#include "BrokenPlugin.h"

// Shows the shorter table of an older interface.
VIABLE_BROKEN_TABLE("short_table", library.size -= 8; library.stamp.interfaceVersion = 0)
