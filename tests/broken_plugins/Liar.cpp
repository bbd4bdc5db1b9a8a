#include "BrokenPlugin.h"

namespace {

class Liar : public broken::Filter {
public:
    viable::FilterTraits traits() const override { return {viable::LimitSet::joints()}; }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Liar, "liar", "Guarantees every limit and keeps none.", viable::NoOptions)
