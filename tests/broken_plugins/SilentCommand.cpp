#include "BrokenPlugin.h"

namespace {

class SilentCommand : public broken::Command {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        afterTicks_ = parameters.get<broken::LateOptions>().afterTicks;
    }
    void reset(const viable::MotionState& start) override {
        Command::reset(start);
        ticks_ = 0;
    }
    viable::TickStatus sample(double, viable::MotionCommand& out) override {
        if (++ticks_ > afterTicks_) return viable::TickStatus::Faulted;
        return setPoint(1.0, out);
    }

private:
    std::int64_t afterTicks_ = 0, ticks_ = 0;
};

}  // namespace

VIABLE_PLUGIN(viable::CommandSource, SilentCommand, "silent_command", "Gives no command after the first `after_ticks`.",
              broken::LateOptions)
