#include "BrokenPlugin.h"

// Says that it has an entry and shows none.
VIABLE_BROKEN_TABLE("null_entries", library.entries = nullptr)
