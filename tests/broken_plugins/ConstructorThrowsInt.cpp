#include "BrokenPlugin.h"

namespace {

class ThrowingFilter : public broken::Filter {
public:
    ThrowingFilter() { throw 7; }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowingFilter, "constructor_throws_int", "Throws.", nullptr)
