#include <cstdlib>

#include "BrokenPlugin.h"

namespace {

struct Trap {
    Trap() { std::abort(); }
} trap;

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, "crashes_on_load", "Aborts while it is loaded.", nullptr)
