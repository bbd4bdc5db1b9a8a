#include "BrokenPlugin.h"

// Cannot be made and does not say why.
VIABLE_BROKEN_TABLE(
    "silent_create", entry.create = [](char*, std::size_t) -> void* { return nullptr; })
