#include <stdexcept>

#include "BrokenPlugin.h"

// Its create function lets an exception out.
VIABLE_BROKEN_TABLE(
    "create_throws",
    entry.create = [](char*, std::size_t) -> void* { throw std::runtime_error("thrown across the border"); })
