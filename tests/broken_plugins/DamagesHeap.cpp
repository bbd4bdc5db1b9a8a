#include <malloc.h>

#include <cstdlib>
#include <cstring>

#include "BrokenPlugin.h"

namespace {

/** Writes over the end of its memory, which is found when somebody else asks for some. */
class DamagesHeap : public broken::LateFilter {
    void misbehave(viable::FilterDecision&) override {
        if (memory_) return;
        // Behind a piece this large lies, after a few, the rest of the heap and its size.
        for (int i = 0; i < 64; ++i) memory_ = static_cast<char*>(std::malloc(100'000));
        std::memset(memory_ + malloc_usable_size(memory_), 0xff, 8);
    }
    char* memory_ = nullptr;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, DamagesHeap, "damages_heap",
              "Writes over the end of its memory after the first after_ticks.", broken::LateOptions)
