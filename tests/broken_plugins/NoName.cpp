#include "BrokenPlugin.h"

// Its entry has no name.
VIABLE_BROKEN_TABLE("no_name", entry.name = nullptr)
