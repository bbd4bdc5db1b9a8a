#include <unistd.h>

#include <stdexcept>
#include <thread>

#include "BrokenPlugin.h"

namespace {

class ThrowsInThread : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override {
        if (hasBegun_) return;
        hasBegun_ = true;
        std::thread([] { throw std::runtime_error("the thread lost its temper"); }).detach();
        usleep(200'000);
    }
    bool hasBegun_ = false;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ThrowsInThread, "throws_in_thread",
              "Starts a thread after the first after_ticks; an exception leaves it.", broken::LateOptions)
