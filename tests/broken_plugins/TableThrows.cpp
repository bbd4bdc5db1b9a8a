#include <stdexcept>

#include "BrokenPlugin.h"

// Throws instead of showing its table.
VIABLE_BROKEN_TABLE("table_throws", throw std::runtime_error("no table today"))
