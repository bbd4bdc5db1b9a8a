#include <cfenv>

#include "BrokenPlugin.h"

namespace {

constexpr viable::ParameterSpec kParameters[] = {broken::kAfterTicks};

class RoundsInTick : public broken::Filter {
public:
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        Filter::configure(setup, parameters);
        afterTicks_ = parameters.integer("after_ticks");
    }
    viable::FilterStatus filter(const viable::MotionState& nominal,
                                const viable::JointVector& torque, const viable::Dynamics& dynamics,
                                viable::FilterDecision& decision) override {
        const viable::FilterStatus status = Filter::filter(nominal, torque, dynamics, decision);
        if (ticks_ > afterTicks_) std::fesetround(FE_UPWARD);
        return status;
    }

private:
    std::int64_t afterTicks_ = 0;
};

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, RoundsInTick, "rounds_in_tick", "Rounds upward in every tick after the first after_ticks.",
              kParameters)
