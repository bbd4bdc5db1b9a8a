#include "BrokenPlugin.h"

// Is of a kind that does not exist.
VIABLE_BROKEN_TABLE("unknown_kind", entry.kind = static_cast<viable::PluginKind>(5))
