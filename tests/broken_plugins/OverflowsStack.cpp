#include "BrokenPlugin.h"

namespace {

class OverflowsStack : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override { ticks_ += dig(ticks_); }
    static std::int64_t dig(std::int64_t depth) {
        volatile char room[4096];
        room[0] = static_cast<char>(depth);
        return depth < 0 ? 0 : dig(depth + 1) + room[0];
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, OverflowsStack, "overflows_stack",
              "Calls itself without end after the first after_ticks.", broken::LateOptions)
