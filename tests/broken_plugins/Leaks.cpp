#include <cstdlib>
#include <cstring>

#include "BrokenPlugin.h"

namespace {

class Leaks : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override {
        constexpr std::size_t kMegabyte = 1 << 20;
        lost_ = static_cast<char*>(std::malloc(kMegabyte));
        std::memset(lost_, 1, kMegabyte);
    }
    char* volatile lost_ = nullptr;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Leaks, "leaks", "Loses 1 MB in every tick after the first after_ticks.",
              broken::LateOptions)
