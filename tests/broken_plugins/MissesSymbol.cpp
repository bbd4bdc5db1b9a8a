#include "BrokenPlugin.h"

// Asks for a function of viable's that this version has not: what most plugins of an older version do.
namespace viable {
void functionOfAnOlderVersion(int);
}

namespace {

struct MissesSymbol : broken::Filter {
    MissesSymbol() { viable::functionOfAnOlderVersion(1); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, MissesSymbol, "misses_symbol", "Asks for a function that is not there.",
              viable::NoOptions)
