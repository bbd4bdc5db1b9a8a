#include "BrokenPlugin.h"

// Shows a table that ends before its version.
VIABLE_BROKEN_TABLE("tiny_table", library.size = 12)
