#include <chrono>
#include <thread>

#include "BrokenPlugin.h"

namespace {

class Hangs : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override {
        for (;;) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Hangs, "hangs", "Never comes back after the first after_ticks.",
              broken::LateOptions)
