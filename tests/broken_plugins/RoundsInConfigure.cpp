#include <cfenv>

#include "BrokenPlugin.h"

namespace {

class RoundsInConfigure : public broken::Filter {
    void configure(const viable::RunSetup&, const viable::Parameters&) override { std::fesetround(FE_UPWARD); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, RoundsInConfigure, "rounds_in_configure", "Rounds upward from configure() on.",
              viable::NoOptions)
