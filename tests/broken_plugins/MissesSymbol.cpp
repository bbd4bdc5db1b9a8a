#include "BrokenPlugin.h"

// Asks for a function of viable's that this version has not: what most plugins of an older version do.
namespace viable {
void functionOfAnOlderVersion(int);
}

VIABLE_BROKEN_TABLE("misses_symbol", viable::functionOfAnOlderVersion(1))
