#include <stdexcept>

#include "BrokenPlugin.h"

namespace {

class ThrowsInReset : public broken::Filter {
    void reset(const viable::MotionState&) override { throw std::runtime_error("no way back"); }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowsInReset, "throws_in_reset", "Throws in reset().", viable::NoOptions)
