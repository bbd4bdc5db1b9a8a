#include "BrokenPlugin.h"

// Its entries are larger than viable's.
VIABLE_BROKEN_TABLE("other_entry_size", library.entrySize += 8)
