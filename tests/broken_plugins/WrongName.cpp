#include "BrokenPlugin.h"

// Is called other than its file.
VIABLE_BROKEN_TABLE("wrong_name", entry.name = "right_name")
