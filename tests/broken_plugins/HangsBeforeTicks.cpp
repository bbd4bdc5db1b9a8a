#include <unistd.h>

#include <cstdlib>
#include <string>

#include "BrokenPlugin.h"

namespace {

/** Hangs in the call that VIABLE_HANGS_WHEN names: made, configured, asked or reset. */
class HangsBeforeTicks : public broken::Filter {
public:
    HangsBeforeTicks() { hangIf("made"); }
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        hangIf("configured");
    }
    viable::FilterTraits traits() const override {
        hangIf("asked");
        return {};
    }
    void reset(const viable::MotionState& start) override {
        Filter::reset(start);
        hangIf("reset");
    }

private:
    static void hangIf(const char* when) {
        const char* const wanted = std::getenv("VIABLE_HANGS_WHEN");
        while (wanted && std::string(wanted) == when) usleep(1000);
    }
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, HangsBeforeTicks, "hangs_before_ticks",
              "Hangs in the call that VIABLE_HANGS_WHEN names.", viable::NoOptions)
