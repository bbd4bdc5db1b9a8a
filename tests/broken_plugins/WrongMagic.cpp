#include "BrokenPlugin.h"

// Shows a table of something else.
VIABLE_BROKEN_TABLE("wrong_magic", library.magic ^= 1)
