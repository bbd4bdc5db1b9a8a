
#include "BrokenPlugin.h"

namespace {

class ThrowingRobust : public viable::RobustLoop {
public:
    void configure(const viable::RunSetup&, const viable::Parameters& parameters) override {
        afterTicks_ = parameters.get<broken::LateOptions>().afterTicks;
    }
    void reset(const viable::MotionState&) override { ticks_ = 0; }
    viable::TickStatus compute(const viable::JointState&, const viable::MotionState& nominal,
                               const viable::JointVector&, viable::JointVector& torque) override {
        if (++ticks_ > afterTicks_) throw std::runtime_error("bus off");
        torque.setZero(nominal.q.size());
        return viable::TickStatus::Ok;
    }

private:
    std::int64_t afterTicks_ = 0, ticks_ = 0;
};

}  // namespace

VIABLE_PLUGIN(viable::RobustLoop, ThrowingRobust, "throwing_robust",
              "Throws in every tick after the first `after_ticks`.", broken::LateOptions)
