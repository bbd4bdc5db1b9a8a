#include <unistd.h>

#include <cstdlib>

#include "BrokenPlugin.h"

// Built three times: aborts (0), hangs (1) or ends the process (2) in a static object.

namespace {

struct Trap {
    Trap() {
        if (VIABLE_ON_LOAD == 0) std::abort();
        while (VIABLE_ON_LOAD == 1) usleep(1000);
        std::exit(0);
    }
} trap;

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, VIABLE_ON_LOAD_NAME, "Fails while it is loaded.", viable::NoOptions)
