#include "BrokenPlugin.h"

// A controller whose file is called viable_filter_wrong_kind.so.
VIABLE_PLUGIN(viable::NominalController, broken::Controller, "wrong_kind", "A controller.", nullptr)
