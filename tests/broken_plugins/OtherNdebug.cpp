// Built with NDEBUG, as CMake's Release does unless -UNDEBUG follows.
#ifndef NDEBUG
#define NDEBUG
#endif
#include "BrokenPlugin.h"

VIABLE_BROKEN_TABLE("other_ndebug", )
