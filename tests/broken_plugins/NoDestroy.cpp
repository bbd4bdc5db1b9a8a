#include "BrokenPlugin.h"

// Its entry cannot be destroyed.
VIABLE_BROKEN_TABLE("no_destroy", entry.destroy = nullptr)
