#include <chrono>
#include <thread>

#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {broken::kAfterTicks};

class Hangs : public broken::Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        afterTicks_ = parameters.integer("after_ticks");
    }
    viable::FilterStatus filter(const viable::MotionState& nominal,
                                const viable::JointVector& torque, const viable::Dynamics& dynamics,
                                viable::FilterDecision& decision) override {
        const viable::FilterStatus status = Filter::filter(nominal, torque, dynamics, decision);
        while (ticks_ > afterTicks_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return status;
    }

private:
    std::int64_t afterTicks_ = 0;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, Hangs, "hangs", "Never comes back in every tick after the first after_ticks.",
              kParameters)
