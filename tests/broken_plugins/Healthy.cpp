#include "BrokenPlugin.h"

// Nothing is wrong with it: built as two libraries of one name in two folders.
VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, "twin", "One of two.", viable::NoOptions)
