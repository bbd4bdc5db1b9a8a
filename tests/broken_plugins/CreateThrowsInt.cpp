#include "BrokenPlugin.h"

// Its create function lets an int out.
VIABLE_BROKEN_TABLE(
    "create_throws_int", entry.create = [](char*, std::size_t) -> void* { throw 7; })
