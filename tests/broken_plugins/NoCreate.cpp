#include "BrokenPlugin.h"

// Its entry cannot be made.
VIABLE_BROKEN_TABLE("no_create", entry.create = nullptr)
