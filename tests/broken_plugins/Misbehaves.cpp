#include <unistd.h>

#include <csignal>
#include <cstdlib>

#include "BrokenPlugin.h"

namespace {

struct MisbehavesOptions {
    broken::LateOptions late;
    std::string how = "not";

    template <class V>
    void describe(V& v) {
        late.describe(v);
        v(how, "how", "not|segfaults|exits|is_killed|hangs|refuses|eats_memory", "What it does from then on.");
    }
};

/** Fails in the way that its parameter says, so that a sweep can draw who fails and how. */
class Misbehaves : public broken::LateFilter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        LateFilter::configure(setup, parameters);
        how_ = parameters.get<MisbehavesOptions>().how;
        if (how_ == "refuses") throw viable::badInput("", "it does not want to");
    }

private:
    __attribute__((no_sanitize("undefined"))) void misbehave(viable::FilterDecision&) override {
        if (how_ == "segfaults") *nowhere_ = 1;
        if (how_ == "exits") std::exit(0);
        if (how_ == "is_killed") raise(SIGKILL);  // as by the system when memory runs out
        while (how_ == "hangs") usleep(1000);
        while (how_ == "eats_memory") eaten_ = new char[std::size_t(1) << 26];
    }
    std::string how_;
    volatile int* nowhere_ = nullptr;
    char* volatile eaten_ = nullptr;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Misbehaves, "misbehaves",
              "Does what its parameter says in the tick after the first after_ticks.", MisbehavesOptions)
