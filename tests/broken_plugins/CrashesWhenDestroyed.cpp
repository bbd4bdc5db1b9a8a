#include <cstdlib>

#include "BrokenPlugin.h"

namespace {

class CrashesWhenDestroyed : public broken::Filter {
public:
    void reset(const viable::MotionState&) override { wasReset_ = true; }
    ~CrashesWhenDestroyed() override {
        if (wasReset_) std::abort();
    }

private:
    bool wasReset_ = false;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, CrashesWhenDestroyed, "crashes_when_destroyed",
              "Aborts in its destructor after a run.", viable::NoOptions)
