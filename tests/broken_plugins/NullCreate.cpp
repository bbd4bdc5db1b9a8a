#include "BrokenPlugin.h"

// Cannot be made and says why.
VIABLE_BROKEN_TABLE(
    "null_create", entry.create = [](char* message, std::size_t size) -> void* {
        std::snprintf(message, size, "the device is not plugged in");
        return nullptr;
    })
