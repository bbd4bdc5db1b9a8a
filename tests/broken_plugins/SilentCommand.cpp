#include "BrokenPlugin.h"

namespace {

class SilentCommand : public viable::CommandSource {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        afterTicks_ = parameters.get<broken::LateOptions>().afterTicks;
    }
    void reset(const viable::MotionState& start) override {
        ticks_ = 0;
        start_ = start.q;
    }
    viable::CommandTraits traits() const override { return {viable::MotionCommand::Space::Joint}; }
    viable::TickStatus sample(double, viable::MotionCommand& out) override {
        if (++ticks_ > afterTicks_) return viable::TickStatus::Faulted;
        out.space = viable::MotionCommand::Space::Joint;
        out.q = start_.array() + 1.0;
        out.qd.setZero(start_.size());
        return viable::TickStatus::Ok;
    }

private:
    std::int64_t afterTicks_ = 0, ticks_ = 0;
    viable::JointVector start_;
};

}  // namespace

VIABLE_PLUGIN(viable::CommandSource, SilentCommand, "silent_command", "Gives no command after the first `after_ticks`.",
              broken::LateOptions)
