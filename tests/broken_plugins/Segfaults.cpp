#include "BrokenPlugin.h"

namespace {

class Segfaults : public broken::LateFilter {
    __attribute__((no_sanitize("undefined"))) void misbehave(viable::FilterDecision&) override { *nowhere_ = 1; }
    volatile int* nowhere_ = nullptr;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Segfaults, "segfaults",
              "Writes through a null pointer in every tick after the first after_ticks.", broken::LateOptions)
