#include "BrokenPlugin.h"

namespace {

class Liar : public broken::Filter {
public:
    bool guaranteesLimits() const override { return true; }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Liar, "liar", "Guarantees every limit and keeps none.", nullptr)
