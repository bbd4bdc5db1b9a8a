#include "BrokenPlugin.h"

// Was built with the headers of another interface version.
VIABLE_BROKEN_TABLE("other_version", library.stamp.interfaceVersion += 1)
