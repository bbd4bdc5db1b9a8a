#include <stdexcept>

#include "BrokenPlugin.h"

namespace {

class ThrowsWhenAsked : public broken::Filter {
    bool promisesLimits() const override { throw std::runtime_error("who knows"); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowsWhenAsked, "throws_when_asked",
              "Throws when it is asked what it promises.", nullptr)
