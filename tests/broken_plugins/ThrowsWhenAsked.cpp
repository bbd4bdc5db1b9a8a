#include <stdexcept>

#include "BrokenPlugin.h"

namespace {

class ThrowsWhenAsked : public broken::Filter {
    viable::FilterTraits traits() const override { throw std::runtime_error("who knows"); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowsWhenAsked, "throws_when_asked", "Throws when it is asked what it guarantees.",
              viable::NoOptions)
