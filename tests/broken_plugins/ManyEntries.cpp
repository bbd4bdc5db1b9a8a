#include "BrokenPlugin.h"

// Its count of entries is damaged.
VIABLE_BROKEN_TABLE("many_entries", library.entryCount = 4000000000u)
