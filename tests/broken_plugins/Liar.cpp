#include "BrokenPlugin.h"

namespace {

class Liar : public broken::Filter {
public:
    bool promisesLimits() const override { return true; }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Liar, "liar", "Promises every limit and keeps none.", nullptr)
